"""Static point 2 of chapter 3: the measured pump at 4600 rpm and 50 degC, inferred from the printed errors of table 3-10."""

from scipy.optimize import brentq

from twin.condition import Condition, OperatingPoints
from twin.operating_point import operating_point
from twin.pumps import circuit_parameters, pump_type
from twin.units import M3_PER_S_PER_LPM, PA_PER_BAR
from twin.validation.evidence import INDEPENDENT, Evidence, Row

_CONDITION = Condition(4600.0, 50.0)
_PRESSURE_BAR = 160.0
"""Measured discharge pressure (section 4.2.2), at which the twin is loaded."""
_FULL_SCALE = 0.01
"""Accuracy of the bench's sensors over full scale, tables 3-2 and 3-3."""
_INFERRED = "inferred: the thesis' model gave {model:g} {unit} and missed the measurement by {error:g} % (table 3-10)"
_CASE_NOTE = "the error is printed without its sign: 2.42 or 2.58 bar; the nearer one is taken"
_DELIVERY_NOTE = "the set delivers 1.7 % less; tables 2-1 and A-4 ask for still less"
_BENCH_NOTE = "the return line's printed law gives 2.05 bar of it at this flow, the drain's share is what is missing"


def _loaded(k_d: float) -> OperatingPoints:
    load = k_d * PA_PER_BAR / M3_PER_S_PER_LPM**2
    bench = circuit_parameters("shared_return")
    return operating_point(pump_type("h225").pump, _CONDITION, bench, load_coefficient=load)


def static_point() -> Evidence:
    """``h225`` at the measured 160 bar beside what was measured there, and beside what the thesis' model missed it by.

    Nothing of the set was fitted to case flow and case pressure of this point; the delivery of 29.1 L/min was looked at
    when the pistons were chosen, but is not met by them. Each quantity is held within the accuracy of its sensor.
    """
    k_d = brentq(lambda k: float(_loaded(k).value("discharge_pressure_bar")[0]) - _PRESSURE_BAR, 0.1, 0.4)
    point = _loaded(k_d)
    rows: list[Row] = []
    for words, name, unit, reference, full_scale, model, thesis, note in (
        ("delivery", "discharge_flow_lpm", "L/min", 29.1, 29.7, 26.87, 7.69, _DELIVERY_NOTE),
        ("case pressure", "case_pressure_bar", "bar", 2.42, 17.0, 2.498, 3.22, f"{_CASE_NOTE}; {_BENCH_NOTE}"),
        ("case flow", "case_flow_lpm", "L/min", 0.612, 5.2, 1.766, 188.74, ""),
    ):
        value = float(point.value(name)[0])
        missed = name != "case_flow_lpm"
        inferred = _INFERRED.format(model=model, unit=unit, error=thesis)
        rows.append(
            Row("section 4.2.2, table 3-10", f"static point 2: {words}", unit, reference, value,
                _FULL_SCALE * full_scale, INDEPENDENT, note="; ".join(filter(None, (inferred, note))),
                known_miss=missed)
        )  # fmt: skip
        rows.append(
            Row("table 3-10", f"static point 2: error of {words}, at most the thesis' model's", "%", thesis,
                100.0 * abs(value / reference - 1.0), 0.0, INDEPENDENT, -1, note, name == "case_pressure_bar")
        )  # fmt: skip
    remarks = (
        "The point is loaded to the measured 160 bar; with the load coefficient that follows from 160 bar and 29.1 L/min "
        "the twin stands at 154.9 bar, because it delivers less.",
    )
    return Evidence("Static point 2 of chapter 3", tuple(rows), (), remarks)
