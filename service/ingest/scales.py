"""Whole scales: a channel that fits another unit at rest and with the pump running, and cannot fit the one of its name.

A broken sensor is none: what does not move, what scatters, and what stands at its full scale is stored and judged. A
record is refused for its unit only where no sensor in the unit of its name could have read it.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.errors import Fault
from twin.parameters import PumpType
from twin.units import STANDARD_ATMOSPHERE_BAR

Samples = NDArray[np.float64]

CASE, RESERVOIR, DISCHARGE = "case_pressure_bar", "reservoir_pressure_bar", "discharge_pressure_bar"
TEMPERATURE, SPEED = "fluid_temperature_degc", "shaft_speed_rpm"
PRESSURE_UNITS = {"psi": 0.0689475729, "kPa": 0.01, "mbar or hPa": 0.001, "Pa": 1e-5}
"""Units that make a pressure in bar look larger, with their size in bar."""
_RUNNING_SHARE, _OFF_SHARE = 0.5, 0.05
_FEWEST = 5
"""Samples of a stretch that say anything of a level."""
_BEYOND = 1.25
"""Times full scale that no electronics of a sensor can give (our choice: they clip at 1.0 to 1.1)."""
_SCATTER = 0.4
"""Spread over level of a sensor that only makes noise; a flight's case pressure spreads by less."""
_REST_BAR = (-0.5, 2.5)
"""Gauge pressure of case and reservoir at rest, above the pump type's nominal reservoir pressure."""
_RISE_BAR = (0.05, 5.0)
"""What a running pump adds to the case pressure, healthy or worn (our choice)."""
_USUAL_RISE_BAR = 0.6
_HOTTEST_OFF_DEGC, _HOTTEST_DEGC = 110.0, 125.0
"""Hydraulic fluid at rest after a flight and in flight: above both, degF is likelier (135 degC ends MIL-PRF-83282)."""
_USUAL_DEGC = (-50.0, 110.0)
_SLOWEST_SHARE = 0.15
"""A pump whose rotor turns is faster than this share of nominal; below it and above standstill sits a wrong unit."""
_STEADY = 0.2
_LOOKS_MPA = (0.08, 0.13)
"""Share of the pressure setting that a discharge pressure in MPa shows; a tenth is what it is."""


@dataclass(frozen=True, slots=True)
class _Level:
    """Median and spread (10 to 90 %) of a stretch."""

    middle: float
    spread: float


@dataclass(frozen=True, slots=True)
class _Stretches:
    """Samples with the pump at rest and with the pump running, shape (n,) each."""

    off: NDArray[np.bool_]
    running: NDArray[np.bool_]

    def of(self, samples: Samples) -> tuple[_Level | None, _Level | None]:
        """Levels of a channel at rest and running; None where the record has no such stretch."""
        return _level(samples[self.off]), _level(samples[self.running])


def scale_faults(channels: Mapping[str, Samples], pump: PumpType, full_scales: Mapping[str, float]) -> list[Fault]:
    """Channels whose whole scale is another unit's, with that unit.

    Parameters
    ----------
    channels
        Gauge pressures [bar] and the other channels in the units of their names, shape (n,) each.
    full_scales
        Full scale [bar] of the aircraft's own pressure sensors by channel, where the registry states them.
    """
    lengths = {len(samples) for samples in channels.values()}
    if len(lengths) != 1 or lengths == {0}:
        return []
    faults, factor = [], 1.0
    found = _speed_unit(channels, pump)
    if found is not None:
        fault, factor = found
        faults.append(fault)
    stretches = _stretches(channels, pump, factor)
    for name in (CASE, RESERVOIR, DISCHARGE):
        if name in channels and not _stuck(channels[name]):
            sensor = pump.sensors.get(name)
            scale = full_scales.get(name) or (sensor.full_scale_bar if sensor else None)
            faults += _pressure_faults(name, stretches.of(channels[name]), pump, scale)
    if TEMPERATURE in channels and not _stuck(channels[TEMPERATURE]):
        faults += _temperature_faults(stretches.of(channels[TEMPERATURE]))
    return faults


def scale_remarks(channels: Mapping[str, Samples], pump: PumpType) -> tuple[str, ...]:
    """What looks like another unit or reference and may yet be right: remarks that verdicts carry."""
    known = {n: channels[n] for n in (CASE, RESERVOIR, SPEED, DISCHARGE) if n in channels}
    if CASE not in known or RESERVOIR not in known or len({len(samples) for samples in known.values()}) != 1:
        return ()
    stretches = _stretches(known, pump, 1.0)
    case, case_running = stretches.of(known[CASE])
    reservoir, _ = stretches.of(known[RESERVOIR])
    if case is None or reservoir is None or _stuck(known[CASE]) or _stuck(known[RESERVOIR]):
        return ()
    remarks = []
    apart = reservoir.middle - case.middle
    for first, second, by in ((RESERVOIR, CASE, apart), (CASE, RESERVOIR, -apart)):
        if abs(by - STANDARD_ATMOSPHERE_BAR) < 0.15:
            remarks.append(f"{first} reads one atmosphere more than {second} at rest: it looks absolute")
    rest = case.middle - pump.nominal_reservoir_pressure_bar
    # a tenth of a bar at rest and a tenth above it running: bar where MPa would be usual
    if case_running is not None and abs(apart) < 0.02 and 0.01 < rest < 0.2:
        rise = case_running.middle - case.middle
        if 0.02 < rise < 0.12 and case_running.spread < rise:
            remarks.append(f"{CASE} and {RESERVOIR} are a tenth of what is usual: they look like MPa")
    return tuple(remarks)


def _pressure_faults(
    name: str, levels: tuple[_Level | None, _Level | None], pump: PumpType, full_scale: float | None
) -> list[Fault]:
    off, running = levels
    most = running or off
    if most is None or full_scale is None or _scatters(most):
        return []
    if most.middle <= _BEYOND * full_scale:
        return _too_small(name, levels, pump)
    fitting = {unit: size for unit, size in PRESSURE_UNITS.items() if _fits(name, levels, size, pump)}
    if not fitting:
        return []
    likely = list(fitting)  # the largest first
    if name == CASE and off is not None and running is not None:
        rise = running.middle - off.middle
        likely.sort(key=lambda unit: abs(np.log(fitting[unit] * rise / _USUAL_RISE_BAR)))
    words = f"is {_words(levels)}, beyond the range of a sensor of {full_scale:g} bar full scale: it looks like "
    words += f"{' or '.join(likely[:2])}; if the sensor has a larger range, enter it with the aircraft's sensors"
    return [Fault(f"channels.{name}", words)]


def _too_small(name: str, levels: tuple[_Level | None, _Level | None], pump: PumpType) -> list[Fault]:
    running, setting = levels[1], _setting(pump)
    if name != DISCHARGE or setting is None or running is None:
        return []
    low, high = (share * setting for share in _LOOKS_MPA)
    if not low < running.middle < high or not _fits(name, levels, 10.0, pump):
        return []
    return [Fault(f"channels.{name}", f"is {_words(levels)}, which cannot be bar: it looks like MPa")]


def _fits(name: str, levels: tuple[_Level | None, _Level | None], size: float, pump: PumpType) -> bool:
    """Whether a pressure is a usual one at rest and running if it is counted in a unit of ``size`` bar."""
    off, running = levels
    if name == DISCHARGE:
        setting = _setting(pump)
        return (
            setting is not None
            and running is not None
            and 0.5 * setting < size * running.middle < 1.25 * setting
            and (off is None or -0.1 * setting < size * off.middle < 1.1 * setting)
        )
    low, high = (pump.nominal_reservoir_pressure_bar + rest for rest in _REST_BAR)
    at_rest = [level for level in (off, running if name == RESERVOIR else None) if level is not None]
    if not all(low < size * level.middle < high and size * level.spread < 0.5 for level in at_rest):
        return False
    if name == CASE and running is not None:
        rest = pump.nominal_reservoir_pressure_bar if off is None else size * off.middle
        return _RISE_BAR[0] < size * running.middle - rest < _RISE_BAR[1]
    return True


def _temperature_faults(levels: tuple[_Level | None, _Level | None]) -> list[Fault]:
    present = [level for level in levels if level is not None]
    if not present:
        return []
    hottest = [limit for limit, level in zip((_HOTTEST_OFF_DEGC, _HOTTEST_DEGC), levels, strict=True) if level]
    if not all(level.middle > limit for limit, level in zip(hottest, present, strict=True)):
        return []
    units = {"degF": (5.0 / 9.0, 32.0), "K": (1.0, 273.15)}
    fitting = [
        unit
        for unit, (size, zero) in units.items()
        if all(_USUAL_DEGC[0] < size * (level.middle - zero) < _USUAL_DEGC[1] for level in present)
        and all(size * level.spread < 40.0 for level in present)
    ]
    if not fitting:
        return []
    # between 223 and 230 both are possible: a fluid at -45 degC or at 108
    text = f"is {_words(levels)}, which no hydraulic fluid is in degC: it looks like {' or '.join(fitting)}"
    return [Fault(f"channels.{TEMPERATURE}", text)]


def _speed_unit(channels: Mapping[str, Samples], pump: PumpType) -> tuple[Fault, float] | None:
    """A speed that is steady, far below any speed of this pump, and in another unit at its nominal one.

    Evidence that the pump runs is its discharge pressure, or a speed that hits nominal closely.
    """
    speed, discharge = channels.get(SPEED), channels.get(DISCHARGE)
    if speed is None or _stuck(speed):
        return None
    size = np.abs(speed)
    known = np.isfinite(size)
    if known.sum() < _FEWEST:
        return None
    nominal = pump.nominal_speed_rpm
    top = float(np.quantile(size[known], 0.95))
    level = _level(size[known & (size > _RUNNING_SHARE * top)])
    if level is None or level.middle <= 0.0 or level.spread > _STEADY * level.middle:
        return None
    if _SLOWEST_SHARE * nominal <= level.middle <= 2.0 * nominal:
        return None
    units = {"Hz": 60.0, "rad/s": 9.549297, "percent of nominal speed": nominal / 100.0, "1000/min": 1000.0}
    units |= {"deg/s": 1.0 / 6.0, "percent as a fraction": nominal}
    near = {unit: level.middle * factor / nominal for unit, factor in units.items()}
    unit = min(near, key=lambda u: abs(np.log(near[u])))
    runs = discharge is not None and _pressurised(discharge[known & (size > _RUNNING_SHARE * top)], pump)
    if not (0.7 < near[unit] < 1.3 if runs else 0.95 < near[unit] < 1.05):
        return None
    how = "while the pump delivers pressure" if runs else "and steady"
    text = f"is {level.middle:.4g} {how}, which cannot be rpm: it looks like {unit}"
    return Fault(f"channels.{SPEED}", text), units[unit]


def _pressurised(discharge: Samples, pump: PumpType) -> bool:
    """Whether a discharge pressure is that of a running pump, in bar or in another unit."""
    level, setting = _level(discharge), _setting(pump)
    if level is None or setting is None:
        return False
    return any(0.5 < size * level.middle / setting < 1.3 for size in (1.0, 10.0, *PRESSURE_UNITS.values()))


def _stretches(channels: Mapping[str, Samples], pump: PumpType, factor: float) -> _Stretches:
    """Where the pump rests and where it runs, by its speed; without one the whole record counts as running."""
    speed = channels.get(SPEED)
    if speed is None:
        length = len(next(iter(channels.values())))
        return _Stretches(np.zeros(length, bool), np.ones(length, bool))
    size = np.abs(speed) * factor
    with np.errstate(invalid="ignore"):
        return _Stretches(size < _OFF_SHARE * pump.nominal_speed_rpm, size > _RUNNING_SHARE * pump.nominal_speed_rpm)


def _setting(pump: PumpType) -> float | None:
    limit = pump.limits.get("zero_flow_pressure_low_bar")
    return None if limit is None else limit.value


def _level(samples: Samples) -> _Level | None:
    known = samples[np.isfinite(samples)]
    if len(known) < _FEWEST:
        return None
    low, middle, high = np.quantile(known, (0.1, 0.5, 0.9))
    return _Level(float(middle), float(high - low))


def _stuck(samples: Samples) -> bool:
    """Whether a channel does not move at all: a dead sensor or a rail, and no unit."""
    known = samples[np.isfinite(samples)]
    return len(known) == 0 or float(np.ptp(known)) == 0.0


def _scatters(level: _Level) -> bool:
    return level.spread > _SCATTER * abs(level.middle)


def _words(levels: tuple[_Level | None, _Level | None]) -> str:
    return " and ".join(_parts(levels))


def _parts(levels: tuple[_Level | None, _Level | None]) -> Iterator[str]:
    for level, when in zip(levels, ("at rest", "with the pump running"), strict=True):
        if level is not None:
            yield f"{level.middle:.4g} {when}"
