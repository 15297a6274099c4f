"""How channels behave in a flight, as evidence of what an unnamed column is: levels at rest and while the pump runs."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.ingest.conversion import conversion
from service.ingest.raw import Samples
from twin.parameters import PumpType

Mask = NDArray[np.bool_]
GUESSES = {
    "time_s": ("s", "ms", "us", "min", "h"),
    "shaft_speed_rpm": ("rpm", "Hz", "rad/s"),
    "discharge_pressure_bar": ("bar", "psi", "kPa", "MPa"),
    "case_pressure_bar": ("bar", "psi", "kPa", "mbar", "MPa"),
    "reservoir_pressure_bar": ("bar", "psi", "kPa", "mbar", "MPa"),
    "fluid_temperature_degc": ("degC", "degF", "K"),
}
"""Units to try where a file names none, the usual one first."""
_REST = 0.05
_FEWEST = 5


@dataclass(frozen=True, slots=True)
class Seen:
    """How well a behaviour fits, -1 to 1, and what was seen."""

    fits: float
    what: str


def running(speed: Samples | None, pressure: Samples | None, n: int) -> Mask:
    """Where the pump seems to run, shape (n,): by its speed, else by its pressure, else everywhere."""
    by = speed if speed is not None else pressure
    if by is None or len(by) != n or not np.isfinite(by).any():
        return np.ones(n, dtype=bool)
    return np.nan_to_num(np.abs(by)) > 0.5 * float(np.nanquantile(np.abs(by), 0.95))


def _levels(samples: Samples, runs: Mask) -> tuple[float, float]:
    """Median while running and at rest; NaN where there is none."""
    mask = runs if len(runs) == len(samples) else np.ones(len(samples), dtype=bool)
    known = np.isfinite(samples)
    on, off = samples[mask & known], samples[~mask & known]
    return (
        float(np.median(on)) if len(on) >= _FEWEST else np.nan,
        float(np.median(off)) if len(off) >= _FEWEST else np.nan,
    )


def seen(channel: str, samples: Samples, runs: Mask, kind: PumpType) -> Seen:
    """How well samples [the channel's unit] behave as the channel does, with the levels that say so."""
    known = samples[np.isfinite(samples)]
    if len(known) < _FEWEST:
        return Seen(-1.0, "holds hardly any number")
    on, off = _levels(samples, runs)
    setting = kind.limits["zero_flow_pressure_low_bar"].value
    match channel:
        case "time_s":
            return _time(samples)
        case "shaft_speed_rpm":
            return _speed(known, kind.nominal_speed_rpm)
        case "discharge_pressure_bar":
            if not 0.6 * setting < on < 2.0 * setting:
                return Seen(-1.0, f"is {on:.4g} bar while running")
            rises = not np.isfinite(off) or off < 0.4 * on
            return Seen(
                1.0 if rises else 0.3, f"is {on:.4g} bar while running" + (f", {off:.4g} at rest" if rises else "")
            )
        case "case_pressure_bar" | "reservoir_pressure_bar":
            return _low(channel, on, off)
        case "fluid_temperature_degc":
            steady = float(np.median(np.abs(np.diff(known)))) < 2.0 and np.ptp(known) > 0.0
            inside = -50.0 < on < 150.0 and np.ptp(known) < 150.0
            warm = 10.0 < on < 110.0
            return Seen((0.7 if warm else 0.2) if inside and steady else -1.0, f"is {on:.4g} degC and moves slowly")
        case "flight_control_activity":
            inside = known.min() >= 0.0 and known.max() <= 1.0 and np.ptp(known) > 0.0
            return Seen(0.4 if inside else -1.0, "lies between 0 and 1")
        case _:
            return Seen(0.3 if known.min() > -5.0 and known.max() < 200.0 else -1.0, f"is {on:.4g} L/min while running")


def _time(samples: Samples) -> Seen:
    steps = np.diff(samples[np.isfinite(samples)])
    if not len(steps) or np.median(steps) <= 0.0 or (steps <= 0.0).mean() > 0.02:
        return Seen(-1.0, "does not increase")
    step = float(np.median(steps))
    even = float(np.mean(np.abs(steps - step) < 0.5 * step))
    span = float(steps.sum())
    fits = (1.0 if even > 0.9 else 0.4) if 5e-5 <= step <= 5.0 and span < 48.0 * 3600.0 else -0.5
    return Seen(fits, f"increases by {step:.4g} s")


def _speed(known: Samples, nominal: float) -> Seen:
    top = float(np.quantile(np.abs(known), 0.9))
    if not 0.5 * nominal < top < 1.6 * nominal:
        return Seen(-1.0, f"reaches {top:.4g} rpm")
    on = known[np.abs(known) > 0.5 * top]
    flat = float(np.std(on)) < 0.1 * top
    rests = float(np.mean(np.abs(known) < _REST * nominal)) > 0.02
    return Seen(
        (0.6 if flat else -0.2) + (0.4 if rests else 0.0),
        f"runs at {np.median(on):.4g} rpm{' and rests' if rests else ''}",
    )


def _low(channel: str, on: float, off: float) -> Seen:
    """Case and reservoir pressure: some bar at most; the case's rises when the pump runs, the reservoir's hardly."""
    if not -0.5 < on < 8.0 or off > 8.0:
        return Seen(-1.0, f"is {on:.4g} bar while running")
    if not max(abs(on), abs(off) if np.isfinite(off) else 0.0) > 0.02:
        return Seen(-0.3, f"is {on:.4g} bar while running")
    if not np.isfinite(off):
        return Seen(0.2, f"is {on:.4g} bar")
    rises = on - off
    what = f"is {off:.4g} bar at rest and {on:.4g} while running"
    if channel == "case_pressure_bar":
        return Seen(0.8 if rises > 0.1 else -0.3, what)
    return Seen(0.8 if abs(rises) < 0.1 else -0.2, what)


def guessed_unit(
    channel: str, samples: Samples, runs: Mask, kind: PumpType, first: Sequence[str] = ()
) -> tuple[str, Seen]:
    """The unit in which samples behave best as a channel; of equals the earlier one, ``first`` before all."""
    tried = list(dict.fromkeys((*first, *GUESSES[channel])))
    found = [(unit, seen(channel, conversion(unit, channel).applied(samples), runs, kind)) for unit in tried]
    return max(found, key=lambda pair: pair[1].fits)
