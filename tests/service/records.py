"""Small flight records made by hand, to be broken on purpose."""

import json
from typing import Any

import numpy as np

METADATA = {
    "pump_serial": "P-1",
    "aircraft": "F-1",
    "position": "LH",
    "flight_id": "F1",
    "started_at": "2026-05-02T07:11:00Z",
}


def document(**changes: Any) -> dict[str, Any]:
    """A good record as a JSON document: 40 s pump off, 120 s at zero flow, noisy; ``changes`` replace channels."""
    rng = np.random.default_rng(7)
    n = 160
    running = np.arange(n) >= 40
    channels: dict[str, Any] = {
        "time_s": [float(i) for i in range(n)],
        "discharge_pressure_bar": list(np.where(running, 174.0, 5.0) + rng.normal(0, 0.1, n)),
        "case_pressure_bar": list(np.where(running, 0.9, 0.5) + rng.normal(0, 0.003, n)),
        "shaft_speed_rpm": list(np.where(running, 4600.0, 0.0)),
        "fluid_temperature_degc": list(50.0 + rng.normal(0, 0.05, n)),
        "reservoir_pressure_bar": list(0.5 + rng.normal(0, 0.003, n)),
    }
    channels |= {k: v for k, v in changes.items() if v is not None}
    for name, value in changes.items():
        if value is None:
            del channels[name]
    return {**METADATA, "channels": channels}


def body(changed_document: dict[str, Any] | None = None) -> bytes:
    """A document as bytes."""
    return json.dumps(document() if changed_document is None else changed_document).encode()
