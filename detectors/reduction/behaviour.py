"""How the pressure channels behaved over a whole record, in a few counts."""

import numpy as np

from detectors.reduction.windows import LOWEST_SPEED_FRACTION
from detectors.reduction.zero import PUMP_OFF_SPEED_FRACTION
from detectors.words.observation import MOST_VALUES, Behaviour
from twin.parameters import PumpType
from twin.recording import Recording

_CHANNELS = ("discharge_pressure_bar", "case_pressure_bar")
_FULL_SCALE_SHARE = 0.999
"""Share of the full scale from which a sample stands at it (estimate: converters clip within a bit or two)."""


def behaviours(recording: Recording, pump: PumpType) -> dict[str, Behaviour]:
    """Behaviour of both pressures; channels without a sample at speed are left out."""
    speed = recording["shaft_speed_rpm"]
    with np.errstate(invalid="ignore"):
        rest = np.abs(speed) < PUMP_OFF_SPEED_FRACTION * pump.nominal_speed_rpm
        turning = speed > LOWEST_SPEED_FRACTION * pump.nominal_speed_rpm
    found = {}
    for name in _CHANNELS:
        values = recording[name]
        known = np.isfinite(values)
        running = values[turning & known]
        if len(running):
            full_scale = pump.sensors[name].full_scale_bar
            found[name] = Behaviour(
                at_rest=min(len(np.unique(values[rest & known])), MOST_VALUES),
                running=min(len(np.unique(running)), MOST_VALUES),
                samples=len(running),
                at_full_scale=float(np.mean(running >= _FULL_SCALE_SHARE * full_scale)),
            )
    return found
