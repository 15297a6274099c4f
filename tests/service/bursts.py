"""A fast record with orders of known size, to look at its spectrum."""

import math
from typing import Any

import numpy as np

from tests.service.records import METADATA

RPM0, RPM1, RATE, N = 4600.0, 4640.0, 4000.0, 8000


def burst_document(rate: float = RATE, n: int = N, **changes: Any) -> dict[str, Any]:
    """2 s in which the speed drifts and discharge pressure holds orders 1 and 9 of known size."""
    time = np.arange(n) / rate
    speed = np.linspace(RPM0, RPM1, n)
    angle = 2.0 * math.pi / 60.0 * (RPM0 * time + 0.5 * (RPM1 - RPM0) / time[-1] * time**2)
    rng = np.random.default_rng(5)
    channels = {
        "time_s": time,
        "discharge_pressure_bar": 175.0
        + 0.3 * np.cos(angle + math.radians(40.0))
        + 1.2 * np.cos(9 * angle)
        + rng.normal(0, 0.1, n),
        "case_pressure_bar": 0.9 + rng.normal(0, 0.003, n),
        "shaft_speed_rpm": speed,
        "fluid_temperature_degc": np.full(n, 50.0),
        **changes,
    }
    return {**METADATA, "segment": "burst-1", "channels": {k: list(map(float, v)) for k, v in channels.items()}}
