"""Five static points of figure 3-1: one set of numbers for all of them, beside tables 3-8 to 3-11 of the thesis.

Fitted to the five inferred points with the tank at 0 bar; those at 2.5 bar are left to check it, as in the thesis.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.condition import Condition, Health
from twin.identification.static_points import Box, JointFit, StaticPoint, joint_fit, predicted
from twin.parameters import Pump
from twin.pumps import circuit_parameters, pump_type
from twin.validation.evidence import FITTED, INDEPENDENT, Curve, Evidence, Plot, Row, Table
from twin.validation.inferred_points import (
    NORMALISATION,
    TANK_PRESSURES_BAR,
    UNITS,
    VARIABLES,
    InferredPoint,
    inferred_points,
    least_worst_error,
)

ACCURACY: Mapping[str, float] = dict(zip(VARIABLES, (3.5, 0.297, 0.17, 0.3), strict=True))
"""What the bench tells apart: 1 % of full scale (table 3-2) of both pressures and the delivery, and 0.3 L/min of case flow,
which the thesis' bench model misses on average (section 3.3.1)."""
FOUR: tuple[Box, ...] = (
    Box("swashplate.alpha_max", "rad", 0.25, 0.28, 1.0),
    Box("slipper.h", "um", 2.0, 30.0, 1.0e-6),
    Box("port_plate.h", "um", 0.0, 15.0, 1.0e-6),
    Box("servo.F_rate", "N", 100.0, 1500.0, 1.0),
)
"""Table 3-6, P_yoke as the force of its spring at full tilt."""
SEVEN: tuple[Box, ...] = (
    *FOUR,
    Box("compensator.d_bleed", "mm", 0.0, 0.6, 1.0e-3),
    Box("slipper.d_throttle", "mm", 0.1, 1.0, 1.0e-3),
    Box("compensator.F_preload", "N", 433.0, 489.0, 1.0),
)
"""And two passages whose flow does not go with pressure alone, and the setting, 6 % to either side as its screw has it: where it
is held, the bleed, which lowers the regulated pressure, is what the fit sets it by, and case flow pays for that."""
_WORDS = dict(zip(VARIABLES, ("discharge pressure", "discharge flow", "case pressure", "case flow"), strict=True))
_CASE_FLOW_GOAL = 20.0
_GENERATIONS = 40

Vector = NDArray[np.float64]
Errors = dict[tuple[float, str], Vector]


class Model(NamedTuple):
    """A pump that is compared: in words, and how far it is from each reading [%], by tank pressure and variable."""

    words: str
    pump: Pump
    errors: Errors
    other: Errors


def static_points(points: Sequence[InferredPoint]) -> list[StaticPoint]:
    """Inferred points as the fit takes them, the readings that were taken as measured."""
    return [
        StaticPoint(
            Condition(4600.0, 50.0, p.reservoir_pressure_bar), p.load, {name: p.value(name) for name in VARIABLES}
        )
        for p in points
    ]


def model_of(words: str, pump: Pump, points: Mapping[float, Sequence[InferredPoint]]) -> Model:
    """Errors of a pump at all points, against both readings."""
    circuit = circuit_parameters("shared_return")
    errors: Errors = {}
    other: Errors = {}
    for tank, five in points.items():
        values = predicted(pump, static_points(five), circuit, VARIABLES, Health())
        for name in VARIABLES:
            taken, second = (np.array([getattr(p.readings[name], which) for p in five]) for which in ("taken", "other"))
            errors[tank, name] = 100.0 * np.abs(values[name] / taken - 1.0)
            other[tank, name] = 100.0 * np.abs(values[name] / second - 1.0)
    return Model(words, pump, errors, other)


def averages(
    model: Model, points: Mapping[float, Sequence[InferredPoint]]
) -> dict[tuple[float, str], tuple[float, float]]:
    """Mean error of the thesis' model and of ours [%], of the delivery [L/min]; by tank pressure and variable."""
    found = {}
    for tank, five in points.items():
        for name in VARIABLES:
            printed = np.array([p.printed_error_percent[name] for p in five])
            ours = model.errors[tank, name]
            if name == "discharge_flow_lpm":
                measured = np.array([p.value(name) for p in five])
                printed, ours = 0.01 * printed * measured, 0.01 * ours * measured
            found[tank, name] = (float(printed.mean()), float(ours.mean()))
    return found


def chapter_3() -> Evidence:
    """Joint fits of the pump's numbers, and errors at ten points beside the thesis'."""
    points, pump, circuit = inferred_points(), pump_type("h225").pump, circuit_parameters("shared_return")
    five = static_points(points[0.0])
    printed = joint_fit(pump, five, circuit, FOUR, NORMALISATION, "sqp")
    searched = joint_fit(pump, five, circuit, FOUR, NORMALISATION, "evolution", _GENERATIONS)
    alone = joint_fit(pump, five, circuit, FOUR, ACCURACY, "sqp")
    four = joint_fit(pump, five, circuit, FOUR, ACCURACY, "evolution", _GENERATIONS)
    seven = joint_fit(pump, five, circuit, SEVEN, ACCURACY, "evolution", _GENERATIONS)
    models = (
        model_of("h225, not fitted", pump, points),
        model_of("four numbers, factors of table 3-7", printed.pump, points),
        model_of("four numbers, by accuracy", four.pump, points),
        model_of("seven numbers, by accuracy", seven.pump, points),
    )
    bounds = {tank: 100.0 * least_worst_error([p.value("case_flow_lpm") for p in five[1:]])
              for tank, five in points.items()}  # fmt: skip
    rows = [
        *_average_rows(models[3], points),
        *_flow_rows(models[3], points, bounds),
        *_fit_rows(printed, searched, alone, four),
    ]
    tables = (
        _readings_table(points),
        *(_errors_table(tank, models, points[tank]) for tank in TANK_PRESSURES_BAR),
        _numbers_table((("printed factors, SQP", printed), ("printed factors, evolution", searched),
                        ("by accuracy, SQP", alone), ("by accuracy, evolution", four), ("seven, by accuracy", seven))),
    )  # fmt: skip
    return Evidence(
        "Chapter 3: five static points", tuple(rows), _plots(models, points), _remarks(bounds, four), tables
    )


def _average_rows(model: Model, points: Mapping[float, Sequence[InferredPoint]]) -> list[Row]:
    rows = []
    for (tank, name), (thesis, ours) in averages(model, points).items():
        unit = "L/min" if name == "discharge_flow_lpm" else "%"
        rows.append(
            Row(f"table 3-{10 if tank == 0.0 else 11}", f"tank {tank:g} bar: mean error of {_WORDS[name]}", unit, thesis,
                ours, 0.0, FITTED if tank == 0.0 else INDEPENDENT, -1, "measured points are inferred: see the table of readings")
        )  # fmt: skip
    return rows


def _flow_rows(
    model: Model, points: Mapping[float, Sequence[InferredPoint]], bounds: Mapping[float, float]
) -> list[Row]:
    rows = []
    for tank, five in points.items():
        for point, error in zip(five, model.errors[tank, "case_flow_lpm"].tolist(), strict=True):
            note = f"the thesis' model: {point.printed_error_percent['case_flow_lpm']:g} %"
            missed = error > _CASE_FLOW_GOAL
            if missed:
                note += f"; no law that rises with pressure errs by less than {bounds[tank]:.0f} % at worst: see the remarks"
            rows.append(
                Row(f"table 3-{10 if tank == 0.0 else 11}", f"tank {tank:g} bar, point {point.number}: error of case flow",
                    "%", _CASE_FLOW_GOAL, error, 0.0, FITTED if tank == 0.0 else INDEPENDENT, -1, note, missed)
            )  # fmt: skip
    return rows


def _fit_rows(printed: JointFit, searched: JointFit, alone: JointFit, four: JointFit) -> list[Row]:
    tilt = four.found[0]
    note = "four numbers; where they differ SQP stopped at a minimum of its neighbourhood"
    return [
        Row("equation 3-15", "factors of table 3-7: objective of the evolution over that of SQP", "-", 1.0,
            searched.objective / printed.objective, 5.0e-3, note=note),
        Row("equation 3-15", "by accuracy: objective of the evolution over that of SQP", "-", np.nan,
            four.objective / alone.objective, np.nan, note=note),
        Row("table 3-9", "largest tilt of the joint fit", "rad", 0.264, tilt.value, 0.0035, note=
            f"90 % {tilt.low:.4f} to {tilt.high:.4f}; tolerance is the thesis' standard deviation of five single fits"),
    ]  # fmt: skip


def _cell(value: float, digits: int = 3) -> str:
    return "–" if math.isnan(value) else f"{value:.{digits}g}" if abs(value) < 100.0 else f"{value:.1f}"


def _readings_table(points: Mapping[float, Sequence[InferredPoint]]) -> Table:
    rows = []
    for tank, five in points.items():
        for p in five:
            for name in VARIABLES:
                r = p.readings[name]
                rows.append((f"tank {tank:g} bar, point {p.number}, {_WORDS[name]} [{UNITS[name]}]",
                             _cell(r.taken, 4), _cell(r.other, 4), r.why))  # fmt: skip
    return Table(
        "Measured points, inferred: both readings",
        ("point and variable", "taken", "other reading", "why"),
        tuple(rows),
        "The thesis prints relative errors without their sign, so that every measurement has two readings. "
        f"The tank stood at {points[0.0][0].reservoir_pressure_bar:.3f} bar when it is called 0: only so does the thesis' "
        "model sweep the same flow at points 2, 3 and 4.",
    )


def _errors_table(tank: float, models: Sequence[Model], five: Sequence[InferredPoint]) -> Table:
    rows = []
    for name in VARIABLES:
        printed = np.array([p.printed_error_percent[name] for p in five])
        rows.append((f"{_WORDS[name]}: thesis", *(_cell(v) for v in printed.tolist()), _cell(float(printed.mean()))))
        for model in models:
            ours = model.errors[tank, name]
            rows.append(
                (f"{_WORDS[name]}: {model.words}", *(_cell(v) for v in ours.tolist()), _cell(float(ours.mean())))
            )
        second = models[-1].other[tank, name]
        rows.append((f"{_WORDS[name]}: {models[-1].words}, against the other reading", *(_cell(v) for v in second.tolist()),
                     _cell(float(np.nanmean(second)))))  # fmt: skip
    return Table(
        f"Table 3-{10 if tank == 0.0 else 11} side by side: absolute relative error [%], tank {tank:g} bar",
        ("variable and model", "1", "2", "3", "4", "5", "mean"),
        tuple(rows),
        "Fitted to these points." if tank == 0.0 else "Nothing was fitted to these points.",
    )


def _numbers_table(fits: Sequence[tuple[str, JointFit]]) -> Table:
    rows = []
    for words, fit in fits:
        for f in fit.found:
            told = "not told by the points" if f.open else "told"
            told += ", best at its bound" if f.at_bound else ""
            beside = f"; not apart from {', '.join(f.beside)}" if f.beside else ""
            rows.append((f"{words}: {f.path} [{f.unit}]", _cell(f.value, 4), f"{_cell(f.low, 4)} to {_cell(f.high, 4)}",
                         told + beside, _cell(fit.objective, 4)))  # fmt: skip
    return Table(
        "Numbers of the joint fits (tables 3-6 to 3-9)",
        ("fit and number", "value", "90 % interval", "what the points tell", "objective 3-15"),
        tuple(rows),
        "The thesis' means of five single fits: tilt 0.264 rad, slipper gap 15.7 um, port-plate gap 3.43 um, spring 20.3 MPa, "
        "spread by 1, 39, 90 and 34 %.",
    )


def _plots(models: Sequence[Model], points: Mapping[float, Sequence[InferredPoint]]) -> tuple[Plot, ...]:
    number = np.arange(1.0, 6.0)
    plots = []
    for name in ("case_pressure_bar", "case_flow_lpm"):
        measured = np.array([p.value(name) for p in points[0.0]])
        thesis = 0.01 * np.array([p.printed_error_percent[name] for p in points[0.0]]) * measured
        curves = [Curve("thesis, averaged numbers", number, thesis)]
        curves += [Curve(m.words, number, 0.01 * m.errors[0.0, name] * measured) for m in models[1:]]
        plots.append(
            Plot(f"Figure 3-24: absolute error of {_WORDS[name]}", "static point [-]", f"error [{UNITS[name]}]",
                 tuple(curves), "Tank 0 bar, 4600 rpm, 50 degC.")
        )  # fmt: skip
    return tuple(plots)


def _remarks(bounds: Mapping[float, float], four: JointFit) -> tuple[str, ...]:
    open_numbers = ", ".join(f.path for f in four.found if f.open)
    return (
        "Case flow below 20 % at every point cannot be had from these points: over points 2 to 5 the inferred case flow does "
        "not rise with discharge pressure (0.61, 0.79, 0.40, 0.67 L/min from 162 to 20 bar), and any law by which it does errs "
        f"by at least {bounds[0.0]:.0f} % at one of them with the tank at 0 bar, by {bounds[2.5]:.0f} % at 2.5 bar. Fluid of "
        "45 to 60 degC (figure 3-17), which the thesis does not print by point, changes leakage by a factor of 1.5: that "
        "can be points 2 and 4, and not point 5, where 20 bar drive a tenth of the inferred flow through every gap of the "
        "model. A temperature of its own for each point would be as many numbers as measurements and is not fitted.",
        "The factors of table 3-7 are the sizes of the variables, so that 1 % of each weighs the same; where case flow cannot be "
        "met, the fit gives up 6 to 8 % of delivery for a little of it (points 3 to 5). Weighed by what the bench tells apart all "
        "four variables become better than the thesis' at once.",
        f"What the points do not tell: {open_numbers}. Slipper gap, port-plate gap and spring all make case flow; five points "
        "of one temperature tell their sum. The thesis' scatter of 39, 90 and 34 % is the same fact.",
        "Section 4.2.2 calls point 2 160 bar at 29 L/min. Tables 3-8, 3-10 and 4-3 agree at 161.7 bar and 28.2 L/min: with 29.1 "
        "L/min the thesis' model would sweep 28.6 L/min there and 27.8 at points 3 to 5, with one tilt.",
    )
