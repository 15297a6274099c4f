"""A pump type that nobody has modelled: its measured healthy curve as the anchor of its windows.

What a pump of any kind does stands in for a twin: leaks raise the case in proportion to what the healthy pump shows
there, and cost regulated pressure by a base's droop. Levels are the curve's own, so a change is seen as well as the curve
is known; how large it is in L/min, and against which limit, nobody can say.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from detectors.expectation.anchor import COLUMN, COLUMNS, anchors, reference_condition
from detectors.expectation.reduced_twin import nominal_pressures
from detectors.expectation.reference_curve import OutsideRange, Reference, ReferenceCurve, Regressor, fit_reference
from detectors.expectation.type_correction import WARMING, HealthyCurve
from twin.condition import Condition
from twin.parameters import Circuit, PumpType
from twin.pumps import PUMP_TYPES

Array = NDArray[np.float64]

_TEMPERATURE, _SPEED = "fluid_temperature_degc", "speed_rpm"
_REGRESSORS = {
    # no twin says what lies between or beyond: a rig's curve carried to a temperature never seen was off by 0.1 bar
    _TEMPERATURE: Regressor(_TEMPERATURE, "degC", scale=5.0, margin=2.0, degree=2, gap=3.0),
    _SPEED: Regressor(_SPEED, "rpm", scale=50.0, margin=25.0, gap=50.0),
}
_DEPARTURE = {"discharge_pressure_bar": 0.003, "case_pressure_bar": 0.2}
"""How far a healthy pump's pressure may change over 5 K or 50 rpm, as a share of its level (estimates: 0.5 bar of 190 on a
rig; the case's follows viscosity)."""
_MEASURED = (
    ("discharge_pressure_bar", "discharge_pressure_bar"),
    ("case_pressure_bar", "case_minus_reservoir_bar"),
)
"""Channels that a curve may hold, and what its points call them."""
_LEAST_RATIO = 1.0e-3
"""Rise of the case over a base's below which the drain counts as open."""


class StandIns(NamedTuple):
    """Anchors of windows: rows (n, len(COLUMNS)), where there is one (n,), and the errors of the curve at discharge and
    case pressure [bar], (n, 2). ``outside`` names, by window, what takes it outside the curve's range.
    """

    rows: Array
    solved: NDArray[np.bool_]
    spreads: Array
    outside: tuple[tuple[str, ...], ...]


def stand_ins(
    curve: HealthyCurve | None,
    conditions: Sequence[Condition],
    warming: Sequence[float | None],
    pump: PumpType,
    circuit: Circuit,
) -> StandIns:
    """Anchors at zero flow from a measured curve; a window under load, or outside the curve's range, has none.

    Parameters
    ----------
    curve
        None: nobody has measured one yet, and no window has an anchor.
    conditions, warming
        Where the windows were taken and how fast the fluid warmed [K/min], None where that is not known; length n.
    """
    n = len(conditions)
    rows, spreads = np.full((n, len(COLUMNS)), np.nan), np.zeros((n, 2))
    outside: list[tuple[str, ...]] = [()] * n
    solved = np.zeros(n, dtype=np.bool_)
    base = base_anchor(circuit)
    repeats = tuple((c, pump.sensors[c].repeatability_bar) for c, _ in _MEASURED if c not in pump.lacks)
    fitted = {} if curve is None else _fitted(curve.filled(pump), pump.lacks, repeats)
    for i, (condition, rate) in enumerate(zip(conditions, warming, strict=True)):
        if condition.discharge_flow_lpm > 0.0:
            continue
        if curve is None:
            outside[i] = ("no healthy curve has been measured",)
            continue
        asked = {_TEMPERATURE: condition.fluid_temperature_degc, _SPEED: condition.speed_rpm}
        found = {name: one.at(asked) for name, one in fitted.items()}
        beyond = [r.partition(" ")[0] for f in found.values() if isinstance(f, OutsideRange) for r in f.reasons]
        beyond += [WARMING] * curve.too_fast(rate)
        if beyond:
            outside[i] = tuple(dict.fromkeys(beyond))
            continue
        known = {name: f for name, f in found.items() if isinstance(f, Reference)}
        rows[i], spreads[i] = _row(base, condition, known, pump)
        solved[i] = True
    return StandIns(rows, solved, spreads, tuple(outside))


@lru_cache(maxsize=64)
def base_anchor(circuit: Circuit) -> Array:
    """The base's healthy pump at its reference condition in a circuit, shape (len(COLUMNS),)."""
    base = PUMP_TYPES["h225"]
    row: Array = anchors([reference_condition(base)], base, circuit)[0][0]
    row.flags.writeable = False
    return row


def _row(base: Array, condition: Condition, known: dict[str, Reference], pump: PumpType) -> tuple[Array, Array]:
    """The base's anchor with the levels and slopes of the curve, and the curve's own errors [bar]."""
    row, spread = base.copy(), np.zeros(2)
    row[COLUMN["reservoir"]] = condition.reservoir_pressure_bar
    row[COLUMN["warmth"]] = (condition.fluid_temperature_degc - 50.0) / 30.0
    for name in ("discharge", "case"):
        row[COLUMN[f"{name}_by_temperature"]] = 0.0
    case, discharge = known.get("case_pressure_bar"), known.get("discharge_pressure_bar")
    rise = 0.0 if case is None else case.mean
    nominal = nominal_pressures(row)[1] - condition.reservoir_pressure_bar
    # where nobody measures the case it is taken to stand at its reservoir
    ratio = max(rise / nominal, _LEAST_RATIO)
    row[COLUMN["drain"]] *= ratio
    row[COLUMN["return_coefficient"]] *= ratio
    for place, (name, one) in enumerate((("discharge", discharge), ("case", case))):
        if one is not None:
            row[COLUMN[f"{name}_by_temperature"]] = one.slope.get(_TEMPERATURE, 0.0)
            spread[place] = one.predictive_sd
    if discharge is not None:
        # pressures of the curve stand over the type's nominal reservoir pressure
        row[COLUMN["regulated_difference"]] = discharge.mean - pump.nominal_reservoir_pressure_bar - rise
    return row, spread


@lru_cache(maxsize=64)
def _fitted(
    curve: HealthyCurve, lacks: tuple[str, ...], repeats: tuple[tuple[str, float], ...]
) -> dict[str, ReferenceCurve]:
    """A curve for each pressure that the type's records hold, over the conditions that they hold.

    ``repeats`` names those pressures with what their sensors repeat to [bar].
    """
    points, fields = curve.sorted, dict(_MEASURED)
    # one condition for all where none is recorded: the level alone
    regressors = [r for name, r in _REGRESSORS.items() if _channel_of(name) not in lacks] or [_REGRESSORS[_SPEED]]
    values = np.array([[getattr(p, r.name) for r in regressors] for p in points])
    found = {}
    for channel, repeatability in repeats:
        response = np.array([getattr(p, fields[channel]) for p in points])
        found[channel] = fit_reference(
            regressors,
            values,
            response,
            repeatability=repeatability,
            departure=max(_DEPARTURE[channel] * float(np.median(np.abs(response))), 1.0e-6),
        )
    return found


def _channel_of(regressor: str) -> str:
    return "shaft_speed_rpm" if regressor == _SPEED else regressor
