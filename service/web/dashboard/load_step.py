"""A load step on the engineer's page: the transient twin while a consumer opens, healthy and with other health values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, TypedDict

from fastapi import Query
from markupsafe import Markup

from detectors.drawing.svg import AS_DRAWN
from service.access.security import Principal
from service.answers.problems import Problem
from service.answers.twin import Simulation
from service.context import Context
from service.reports.twin_chart import Line, twin_svg
from service.units import UnitSystem, unit_of
from service.web.dashboard.forms import checked
from service.web.routes import twin_simulation

CHANNELS = {
    "discharge_pressure_bar": "discharge pressure",
    "case_pressure_bar": "case pressure",
    "case_flow_lpm": "case flow",
    "swashplate_angle_deg": "tilt of the swashplate [deg]",
}
"""What is drawn, where the run has it; the unit that a name ends in follows the words."""
_RATE_HZ = 2000.0
_LONGEST_S = 1.0
_DRAWN = 400


@dataclass(frozen=True, slots=True)
class Step:
    """A load step as the page asks for it: at ``step_at_s`` the discharge flow goes from one value to the other."""

    step: Annotated[bool, Query(description="Whether to make it")] = False
    flow_before_lpm: float = 0.0
    flow_after_lpm: float = 20.0
    step_at_s: Annotated[float, Query(gt=0.0, lt=_LONGEST_S)] = 0.1
    run_s: Annotated[float, Query(gt=0.0, le=_LONGEST_S)] = 0.3


class _StepRow(TypedDict):
    """A channel in the table of a load step: figures in ``unit`` by name, for the healthy run and the other."""

    words: str
    unit: str
    runs: list[dict[str, float | None]]


class ShownRuns(TypedDict):
    """A load step as the page shows it; or why there is none."""

    problem: Problem | None
    pictures: list[Markup]
    rows: list[_StepRow]


def load_runs(
    context: Context, asker: Principal, condition: Mapping[str, Any], health: Mapping[str, float], step: Step
) -> list[Simulation]:
    """The healthy run and the other; ``condition`` holds pump type, circuit, fluid, speed, temperature and tank.

    Called on a thread of a request: the runs wait for their turn with those of the API.

    Raises
    ------
    Invalid
        with every fault of the values.
    """
    return [_run(context, asker, condition, given, step) for given in ({}, health)]


def shown_runs(runs: Sequence[Simulation], step: Step, system: UnitSystem) -> ShownRuns:
    """Pictures of both runs in the reader's units, and a table whose numbers are in ours."""
    pictures: list[Markup] = []
    rows: list[_StepRow] = []
    for channel, words in CHANNELS.items():
        held = [run["channels"].get(channel) for run in runs]
        if held[0] is None or held[1] is None:
            continue
        times, unit = runs[0]["channels"]["time_s"], unit_of(channel)
        named = words if unit == "-" else f"{words} [{system.word(unit)}]"
        scales = (AS_DRAWN, system.scale(unit))
        lines = [
            Line(name, _thinned(times, values))
            for name, values in zip(("healthy pump", "with these values"), held, strict=True)
            if values is not None
        ]
        svg = twin_svg(f"Load step, {named}", ("time [s]", named), lines, None, 0.001, scales)
        pictures.append(Markup(svg))  # noqa: S704
        figures = [_figures(times, values, step.step_at_s) for values in held if values]
        rows.append({"words": named, "unit": unit, "runs": figures})
    return {"problem": None, "pictures": pictures, "rows": rows}


def _run(
    context: Context, asker: Principal, condition: Mapping[str, Any], health: Mapping[str, float], step: Step
) -> Simulation:
    at = min(step.step_at_s, step.run_s)
    schedule = {
        "time_s": [0.0, at, at, step.run_s],
        "discharge_flow_lpm": [step.flow_before_lpm, step.flow_before_lpm, step.flow_after_lpm, step.flow_after_lpm],
        **{name: [condition[name]] * 4 for name in ("speed_rpm", "fluid_temperature_degc", "reservoir_pressure_bar")},
    }
    values = {
        "pump_type": condition["pump_type"],
        "circuit": condition["circuit"],
        "fluid": condition["fluid"] or None,
        "duration_s": step.run_s,
        "sample_rate_hz": _RATE_HZ,
        "schedule": schedule,
        "health": dict(health),
    }
    return twin_simulation.simulated(checked(twin_simulation.SimulationRequest, values, "run"), context, asker)


def _thinned(times: list[float | None], values: list[float | None]) -> list[tuple[float, float] | None]:
    stride = max(len(times) // _DRAWN, 1)
    pairs = list(zip(times, values, strict=True))[::stride]
    return [None if t is None or v is None else (t, v) for t, v in pairs]


def _figures(times: list[float | None], values: list[float | None], at_s: float) -> dict[str, float | None]:
    """Level before the step, lowest and highest after it, and the level at the end (mean of the last tenth)."""
    known = [(t, v) for t, v in zip(times, values, strict=True) if t is not None and v is not None]
    before = [v for t, v in known if 0.8 * at_s <= t < at_s]
    after = [v for t, v in known if t >= at_s]
    last = after[-max(len(after) // 10, 1) :]
    return {
        "before": sum(before) / len(before) if before else None,
        "lowest": min(after, default=None),
        "highest": max(after, default=None),
        "end": sum(last) / len(last) if last else None,
    }
