"""Measured static points of chapter 3, inferred: the thesis prints errors, so that what was measured must be solved for.

Printed are relative errors without their sign (tables 3-10 and 3-11, one parameter set), objectives of five single fits
(table 3-8), and what the model of table 3-10 gives at point 2 (table 4-3: case flow, case pressure, return pressure).
A measurement I* that a model I misses by a share e is I / (1 - e) or I / (1 + e): two readings, and both are kept.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from scipy.optimize import brentq

from twin.laws.lines import return_pressure_drop

VARIABLES: tuple[str, ...] = ("discharge_pressure_bar", "discharge_flow_lpm", "case_pressure_bar", "case_flow_lpm")
UNITS: Mapping[str, str] = dict(zip(VARIABLES, ("bar", "L/min", "bar", "L/min"), strict=True))
NORMALISATION: Mapping[str, float] = dict(zip(VARIABLES, (160.0, 28.0, 2.5, 0.8), strict=True))
"""Factors X_v of table 3-7."""
TANK_PRESSURES_BAR = (0.0, 2.5)
PRINTED_ERROR_PERCENT: Mapping[float, Mapping[str, tuple[float, ...]]] = {
    0.0: {
        "discharge_pressure_bar": (4.53, 14.67, 14.59, 11.45, 9.16),
        "discharge_flow_lpm": (99.77, 7.69, 7.64, 5.92, 4.62),
        "case_pressure_bar": (130.07, 3.22, 5.45, 4.03, 18.22),
        "case_flow_lpm": (163.73, 188.74, 37.44, 35.34, 68.91),
    },
    2.5: {
        "discharge_pressure_bar": (0.68, 13.10, 12.24, 9.48, 6.14),
        "discharge_flow_lpm": (99.79, 6.95, 6.53, 5.09, 3.39),
        "case_pressure_bar": (15.77, 0.58, 3.21, 4.16, 5.05),
        "case_flow_lpm": (158.96, 324.29, 56.40, 40.63, 71.78),
    },
}
"""Tables 3-10 (tank 0 bar) and 3-11 (2.5 bar), static points 1 to 5."""
SINGLE_FIT_OBJECTIVES: Mapping[str, tuple[float, ...]] = {
    "discharge_pressure_bar": (6.01e-4, 7.15e-3, 7.58e-3, 3.15e-3, 1.22e-5),
    "discharge_flow_lpm": (2.58e-9, 1.86e-3, 5.62e-3, 9.67e-3, 2.21e-4),
    "case_pressure_bar": (2.60e-4, 1.00e-2, 8.99e-3, 2.14e-3, 1.38e-3),
    "case_flow_lpm": (2.23e-2, 4.96e-3, 7.05e-2, 9.09e-2, 7.33e-3),
}
"""Table 3-8: squared errors over X_v; they carry a digit more than the errors printed beside them."""
K_C, K_INF, K = 0.290, 0.00206, 22.8
"""Bench of table 3-4 at 50 degC [bar/(L/min), bar/(L/min)^2, L/min], gamma 1."""
ZERO_FLOW_PRESSURE_BAR = 174.4
"""Annex A-4: the same pump at zero flow; table 3-10 leaves the pressure of point 1 open."""
SET_PRESSURES_BAR = (100.0, 50.0)
"""Points 3 and 4, section 3.2.1."""
_MODEL_CASE_FLOW, _MODEL_CASE_PRESSURE, _MODEL_OVER_RETURN = 1.766, 2.498, 0.511
"""Table 4-3, nominal: the thesis' model at point 2."""
_SWEPT_CASE_PRESSURE = 2.2
_SIGMA_BENCH, _SIGMA_FIT = 0.1, 0.03
"""Bar: the bench misses 0.3 L/min of case flow (section 3.3.1), which is 0.1 bar; rounding of what table 3-8 prints."""


@dataclass(frozen=True, slots=True)
class Reading:
    """One inferred value [unit of its name] with the other reading of the same printed error, and why this one."""

    taken: float
    other: float
    why: str


@dataclass(frozen=True, slots=True)
class InferredPoint:
    """Static point 1 to 5 at 4600 rpm and 50 degC.

    Attributes
    ----------
    tank_bar, reservoir_pressure_bar
        Nominal tank pressure, and with what the tank really stood over the atmosphere [bar gauge].
    readings
        By the names of ``VARIABLES``.
    printed_error_percent
        By the same names: what the thesis' model misses them by.
    load
        k_d of equation 3-14 [bar/(L/min)^2]; 0 at zero flow.
    """

    number: int
    tank_bar: float
    reservoir_pressure_bar: float
    readings: Mapping[str, Reading]
    printed_error_percent: Mapping[str, float]
    load: float

    def value(self, name: str) -> float:
        """The reading that was taken."""
        return self.readings[name].taken


def return_drop(Q: float) -> float:
    """Pressure drop of the bench's return line [bar] at Q [L/min], equation 3-4 with table 3-4."""
    return float(return_pressure_drop(Q, K_INF, K, 1.0))


def single_fit_error(name: str, i: int) -> float:
    """Absolute error of the single fit of point i (from 0), from its objective [unit of the name]."""
    return NORMALISATION[name] * math.sqrt(SINGLE_FIT_OBJECTIVES[name][i])


def delivered(P_d: float, i: int, sign: int, p_r: float) -> float:
    """Measured delivery of point i (from 0) at measured pressure P_d [bar] that table 3-8's two errors imply [L/min].

    Both errors of a single fit stand on one load line (3-2): its pressure and its flow are off in the same direction, ``sign``.
    """
    off_P, off_Q = (single_fit_error(name, i) for name in VARIABLES[:2])

    def excess(Q: float) -> float:
        before, after = p_r + return_drop(Q + 0.7), p_r + return_drop(Q + 0.7 + sign * off_Q)
        return (P_d + sign * off_P - after) / (P_d - before) - (1.0 + sign * off_Q / Q) ** 2

    return float(brentq(excess, off_Q + 1.0, 80.0))


def tank_offset() -> float:
    """Pressure of the "unpressurised" tank [bar] at which the thesis' model sweeps the same flow at points 2, 3 and 4.

    At full tilt delivery and case flow of one parameter set add up to its displacement. With the tank at 0 the return
    pressure of table 4-3 makes point 2 sweep 0.9 L/min more than 3 and 4.
    """

    def excess(p_r: float) -> float:
        P_2, _, Q_2 = _point_2(p_r)
        others = []
        for i, P in enumerate(SET_PRESSURES_BAR, 2):
            model = delivered(P, i, -1, p_r) * (1.0 - _printed(0.0, "discharge_flow_lpm", i))
            others.append(model + _model_case_flow(P * (1.0 - _printed(0.0, "discharge_pressure_bar", i)), P_2))
        return Q_2 + _MODEL_CASE_FLOW - sum(others) / len(others)

    return float(brentq(excess, 0.0, 0.2))


def inferred_points() -> dict[float, tuple[InferredPoint, ...]]:
    """Ten points: by nominal tank pressure [bar], 1 to 5."""
    p_r = tank_offset()
    P_2, Q_2, _ = _point_2(p_r)
    flows = [0.0, Q_2, *(delivered(P, i, -1, p_r) for i, P in enumerate(SET_PRESSURES_BAR, 2))]
    open_flow = 0.5 * (flows[2] + flows[3])
    P_5 = float(brentq(lambda P: delivered(P, 4, -1, p_r) - open_flow, 15.0, 30.0))
    pressures = (ZERO_FLOW_PRESSURE_BAR, P_2, *SET_PRESSURES_BAR, P_5)
    flows.append(open_flow)
    return {tank: tuple(_inferred(i, tank, p_r, (pressures, flows)) for i in range(5)) for tank in TANK_PRESSURES_BAR}


def _printed(tank: float, name: str, i: int) -> float:
    return PRINTED_ERROR_PERCENT[tank][name][i] / 100.0


def _point_2(p_r: float) -> tuple[float, float, float]:
    """Measured pressure and delivery of point 2, and what the thesis' model delivers there."""
    P_i = _MODEL_CASE_PRESSURE - _MODEL_OVER_RETURN
    swept = float(brentq(lambda Q: p_r + return_drop(Q) - P_i, 10.0, 40.0))
    model = swept - _MODEL_CASE_FLOW
    measured = model / (1.0 - _printed(0.0, "discharge_flow_lpm", 1))
    P = float(brentq(lambda P: delivered(P, 1, -1, p_r) - measured, 120.0, 200.0))
    return P, measured, model


def _model_case_flow(P_d: float, P_2: float, P_c: float = 0.8) -> float:
    """Case flow of the thesis' model [L/min]: constant laminar gaps, scaled from point 2 (table 4-3)."""
    at_2 = P_2 * (1.0 - _printed(0.0, "discharge_pressure_bar", 1)) - _MODEL_CASE_PRESSURE
    return _MODEL_CASE_FLOW * (P_d - P_c) / at_2


def _two(model: float, error: float, reading: int, why: str) -> Reading:
    """Both measurements that a model misses by ``error``: ``reading`` -1 where the model is below, +1 where above."""
    taken, other = model / (1.0 + reading * error), model / (1.0 - reading * error)
    return Reading(taken, other if other > 0.0 else math.nan, why)


def _inferred(i: int, tank: float, p_r: float, measured: tuple[Sequence[float], Sequence[float]]) -> InferredPoint:
    """One point; ``measured`` are pressures and deliveries of all points with the unpressurised tank."""
    (pressures, flows), reservoir = measured, p_r + tank
    errors = {name: _printed(tank, name, i) for name in VARIABLES}
    below = "the thesis' model has too little displacement: it is below at every point of full tilt"
    model_P = pressures[i] * (1.0 - _printed(0.0, "discharge_pressure_bar", i))
    if tank and i in (0, 4):
        model_P += tank
    if not tank or i in (1, 2, 3):
        words = (
            "of the acceptance sheet (annex A-4)",
            "at which tables 3-8, 3-10 and 4-3 agree",
            "as set",
            "as set",
            "",
        )
        why = f"{words[i] or 'at which point 5 delivers what 3 and 4 do'}; the thesis' model is below"
        P = Reading(pressures[i], pressures[i] * (1.0 - errors["discharge_pressure_bar"]) /
                    (1.0 + errors["discharge_pressure_bar"]), why)  # fmt: skip
    else:
        P = _two(model_P, errors["discharge_pressure_bar"], -1, f"{below}; point 1 as with the tank at 0")
    model_Q = flows[i] * (1.0 - _printed(0.0, "discharge_flow_lpm", i))
    Q = Reading(0.0014, math.nan, "0.0014 L/min by table 3-8: the flow meter's zero") if i == 0 else _two(
        model_Q, errors["discharge_flow_lpm"], -1, below)  # fmt: skip
    P_2 = pressures[1]
    model_flow = _model_case_flow(model_P - (tank if i in (0, 4) else 0.0), P_2, _SWEPT_CASE_PRESSURE if i else 0.8)
    swept = (model_Q if i else 0.0) + model_flow
    model_case = reservoir + return_drop(swept) + K_C * model_flow
    single = flows[i] - single_fit_error("discharge_flow_lpm", i) if i else 0.0
    case, flow = _case_readings(i, (tank, reservoir), (model_case, model_flow), (Q.taken if i else 0.0, single), errors)
    readings = dict(zip(VARIABLES, (P, Q, case, flow), strict=True))
    load = 0.0
    if i:
        load = (P.taken - reservoir - return_drop(Q.taken + flow.taken)) / Q.taken**2
    return InferredPoint(i + 1, tank, reservoir, readings, {n: 100.0 * e for n, e in errors.items()}, load)


def _case_readings(
    i: int,
    pressures: tuple[float, float],
    model: tuple[float, float],
    deliveries: tuple[float, float],
    errors: Mapping[str, float],
) -> tuple[Reading, Reading]:
    """Case pressure and case flow: of four combinations the one that the bench's law and table 3-8 leave standing.

    ``pressures``: nominal tank and reservoir; ``model``: case pressure and flow; ``deliveries``: measured, single fit's.
    """
    tank, reservoir = pressures
    scores: list[tuple[float, int, int]] = []
    for flow_sign in (1, -1):
        Q_c = model[1] / (1.0 + flow_sign * errors["case_flow_lpm"])
        for case_sign in (1, -1):
            P_c = model[0] / (1.0 + case_sign * errors["case_pressure_bar"])
            if Q_c > 0.0 and P_c > 0.0:
                by_law = _bench_case_pressure(reservoir, deliveries[0], Q_c)
                score = ((P_c - by_law) / _SIGMA_BENCH) ** 2
                score += 0.0 if tank else _single_fit_score(i, reservoir, deliveries[1], P_c, Q_c)
                scores.append((score, case_sign, flow_sign))
    # with the tank raised table 3-8 says nothing: point 4 keeps its side, which the bench alone does not tell
    scores.sort(key=lambda entry: entry[0] + (4.0 if tank and i == 3 and entry[2] < 0 else 0.0))
    score, case_sign, flow_sign = scores[0]
    rest = next((s for s, _, f in scores if f != flow_sign), math.nan)
    by = "the bench's law" if tank else "the bench's law and table 3-8"
    against = "" if math.isnan(rest) else f", the other case flow {rest:.1f}"
    why = f"squared misfit to {by} {score:.1f}{against}"
    if tank and i == 3:
        why += "; the bench alone does not tell them apart, and with the tank at 0 the lower one holds"
    return (
        _two(model[0], errors["case_pressure_bar"], case_sign, why),
        _two(model[1], errors["case_flow_lpm"], flow_sign, why),
    )


def _bench_case_pressure(reservoir: float, Q_d: float, Q_c: float) -> float:
    return reservoir + return_drop(Q_d + Q_c) + K_C * Q_c


def _single_fit_score(i: int, reservoir: float, Q_d: float, P_c: float, Q_c: float) -> float:
    """Squared misfit of table 3-8: the single fit's case pressure must be off by what is printed, on either side."""
    off_Q, off_P = single_fit_error("case_flow_lpm", i), single_fit_error("case_pressure_bar", i)
    fits = [Q_c + sign * off_Q for sign in (1, -1) if Q_c + sign * off_Q > 0.0]
    missed = [abs(abs(P_c - _bench_case_pressure(reservoir, Q_d, Q)) - off_P) for Q in fits]
    return (min(missed) / _SIGMA_FIT) ** 2


def least_worst_error(flows: Sequence[float]) -> float:
    """Smallest largest relative error of any law by which case flow does not fall with discharge pressure [-].

    Parameters
    ----------
    flows
        Measured flows from the highest pressure to the lowest.
    """
    worst = 0.0
    for i, high in enumerate(flows):
        for low in flows[i + 1 :]:
            worst = max(worst, (low - high) / (low + high))
    return worst
