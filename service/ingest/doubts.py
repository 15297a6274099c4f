"""What no sensor and no clock is likely to have meant: a case pressure that falls at the start, a time that is no seconds.

Remarks, no refusals: each could be right, and a verdict that rests on such a record says so.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from twin.parameters import PumpType
from twin.recording import TIME

Samples = NDArray[np.float64]

CASE, RESERVOIR, SPEED = "case_pressure_bar", "reservoir_pressure_bar", "shaft_speed_rpm"
_OFF_SHARE, _RUNNING_SHARE = 0.05, 0.9
_FEWEST = 5
"""Samples of a stretch that say anything of a level."""
_FALL_BAR = 0.1
"""What a running pump cannot take off the pressure of its case (our choice: above any drift of a zero)."""
_QUICKEST_START_S = 1.5
"""No rotor, and no motor of a bench, takes a pump from standstill to its speed in less (estimate)."""
_PERIODS_S = tuple(digit * 10.0**power for power in range(-5, 2) for digit in (1.0, 2.0, 2.5, 4.0, 5.0))
"""Periods that recorders have."""
_OTHER_UNITS = (("minutes", 60.0), ("hours", 3600.0))
_SLOWEST_PERIOD_S = 10.0
"""Half the slowest rate that a record may have."""


def doubts(channels: Mapping[str, Samples], pump: PumpType) -> tuple[str, ...]:
    """Sentences on a record's channels, gauge pressures [bar], shape (n,) each."""
    speed, time = channels.get(SPEED), channels.get(TIME)
    if speed is None or time is None or len(speed) != len(time) or len(time) < 2 * _FEWEST:
        return ()
    with np.errstate(invalid="ignore"):
        off = np.abs(speed) < _OFF_SHARE * pump.nominal_speed_rpm
        running = np.abs(speed) > _RUNNING_SHARE * pump.nominal_speed_rpm
    found = [_inverted(channels, off, running), _time_unit(time, off, running)]
    return tuple(words for words in found if words is not None)


def _inverted(channels: Mapping[str, Samples], off: NDArray[np.bool_], running: NDArray[np.bool_]) -> str | None:
    case, reservoir = channels.get(CASE), channels.get(RESERVOIR)
    if case is None or len(case) != len(off):
        return None
    rise = _rise(case, off, running)
    if rise is None:
        return None
    if reservoir is not None and len(reservoir) == len(off):
        rise -= _rise(reservoir, off, running) or 0.0
    if rise > -_FALL_BAR:
        return None
    return f"{CASE} falls by {-rise:.3g} bar when the pump starts, where it must rise: the sensor looks inverted or crossed"


def _rise(samples: Samples, off: NDArray[np.bool_], running: NDArray[np.bool_]) -> float | None:
    rest, run = (samples[where & np.isfinite(samples)] for where in (off, running))
    if min(len(rest), len(run)) < _FEWEST:
        return None
    rise = float(np.median(run) - np.median(rest))
    scatter = float(np.subtract(*np.quantile(rest, (0.9, 0.1))))
    return rise if abs(rise) > scatter else None


def _time_unit(time: Samples, off: NDArray[np.bool_], running: NDArray[np.bool_]) -> str | None:
    steps = np.diff(time)
    step = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    if step <= 0.0 or not np.isfinite(step):
        return None
    if step >= _SLOWEST_PERIOD_S and _is_a_period(step / 1000.0):
        return f"{TIME} looks like milliseconds: its samples lie {step:g} s apart"
    start = _start_s(time, off, running)
    if start is None or start > _QUICKEST_START_S or _is_a_period(step):
        return None
    for unit, factor in _OTHER_UNITS:
        if _is_a_period(step * factor):
            return f"{TIME} looks like {unit}: the pump reaches its speed within {start:.2g} s of standing still"
    return None


def _start_s(time: Samples, off: NDArray[np.bool_], running: NDArray[np.bool_]) -> float | None:
    """Seconds from the last sample at rest to the first at speed; None without a start."""
    behind = np.flatnonzero(running)
    rests = np.flatnonzero(off[: behind[0]]) if len(behind) else np.array([], int)
    if len(rests) < _FEWEST or len(behind) < _FEWEST:
        return None
    return float(time[behind[0]] - time[rests[-1]])


def _is_a_period(step: float) -> bool:
    # texts round a sixtieth to six digits or so
    return any(abs(step - period) < 2e-3 * period for period in _PERIODS_S)
