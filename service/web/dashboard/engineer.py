"""The engineer's page: an operating point with health values beside the healthy pump, and what given sensors can tell."""

from dataclasses import asdict, dataclass, fields, replace
from typing import Annotated, Any, Literal, TypedDict, TypeVar

from fastapi import APIRouter, Depends, Query, Request
from fastapi.responses import HTMLResponse, Response
from markupsafe import Markup

from service.access.security import Principal
from service.answers import problems as answers
from service.answers.twin import Isolability, OperatingPoint
from service.context import Context
from service.errors import Problem
from service.reports.twin_chart import Line, twin_svg
from service.reports.words import WORDS
from service.units import METRIC, SYSTEMS, UnitSystem
from service.web.dashboard.forms import checked, in_ours
from service.web.dashboard.frame import PageRoute, html_page
from service.web.dashboard.load_step import ShownRuns, Step, load_runs, shown_runs
from service.web.dashboard.preferences import system_of
from service.web.dependencies import Asker, ContextOf
from service.web.routes import circuits, pump_types, twin, twin_isolability
from twin.pumps.fluids import FLUIDS

engineer_router = APIRouter(include_in_schema=False, route_class=PageRoute)
Units = Literal["metric", "us", ""]
_LEAKS_LPM = [0.5 * i for i in range(17)]
_TEMPERATURES_DEGC = [20.0 + 4.0 * i for i in range(19)]
HEALTH = {
    "pump_leakage_scale": ("leakage of the pump, times healthy", 1.0),
    "system_leakage_lpm": ("leak of the circuit", 0.0),
    "pressure_setting_change_bar": ("pressure setting, change", 0.0),
    "drain_resistance_scale": ("resistance of the drain, times healthy", 1.0),
    "control_bleed_lpm": ("bleed of the compensator", 0.0),
    "droop_scale": ("droop, times healthy", 1.0),
}
OUTPUTS = {
    "discharge_pressure_bar": "discharge pressure",
    "case_pressure_bar": "case pressure",
    "return_pressure_bar": "return pressure",
    "control_pressure_bar": "control pressure",
    "case_flow_lpm": "case flow",
    "discharge_flow_lpm": "discharge flow",
    "suction_flow_lpm": "suction flow",
    "swashplate_angle_deg": "tilt of the swashplate [deg]",
    "shaft_torque_nm": "torque of the shaft [N m]",
    "case_temperature_degc": "fluid in the case",
}
"""Words for numbers; the unit that a name ends in follows them, as the reader has it."""


@dataclass(frozen=True, slots=True)
class Point:
    """An operating point as the page asks for it."""

    pump_type: str = "h225"
    circuit: str = "shared_return"
    fluid: str = ""
    speed_rpm: float = 4600.0
    fluid_temperature_degc: float = 60.0
    reservoir_pressure_bar: float = 0.5
    discharge_flow_lpm: float = 0.0
    pump_leakage_scale: float = 1.0
    system_leakage_lpm: float = 0.0
    pressure_setting_change_bar: float = 0.0
    drain_resistance_scale: float = 1.0
    control_bleed_lpm: float = 0.0
    droop_scale: float = 1.0


@dataclass(frozen=True, slots=True)
class Study:
    """A study of isolability as the page asks for it; accuracies that are left out are the pump type's own."""

    study: Annotated[bool, Query(description="Whether to make it")] = False
    case_accuracy_percent: float | None = None
    case_full_scale_bar: float | None = None
    discharge_accuracy_percent: float | None = None
    reservoir: bool = True
    flights: int = 30
    coldest_degc: float = 30.0
    warmest_degc: float = 80.0
    burst: bool = False


class _Points(TypedDict):
    """Operating points of the healthy pump and with other health values, and curves through them; or why there are none."""

    problem: answers.Problem | None
    sound: OperatingPoint | None
    worn: OperatingPoint | None
    pictures: list[Markup]


class _Bound(TypedDict):
    """A row of the table of bounds: sizes in ``unit``, None where there is none; faults that cannot be told from it."""

    fault: str
    state: str
    unit: str
    detectable: float | None
    isolable: float | None
    group: list[str]


class _Bounds(TypedDict):
    """What given sensors could see; or why that is not known."""

    problem: answers.Problem | None
    rows: list[_Bound]
    remarks: list[str]


@engineer_router.get("/engineer", response_class=HTMLResponse)
def engineer_page(
    request: Request,
    context: ContextOf,
    asker: Asker,
    point: Annotated[Point, Depends()],
    study: Annotated[Study, Depends()],
    step: Annotated[Step, Depends()],
    units: Annotated[Units, Query(description="Units that the numbers of this address are in")] = "",
) -> Response:
    """Operating point beside the healthy pump's, two curves through it, a load step, and what sensors could see."""
    system, given_in = system_of(request), SYSTEMS.get(units, METRIC)
    point, study = _in_ours(point, request, given_in), _in_ours(study, request, given_in)
    step = _in_ours(step, request, given_in)
    found: _Points = {"problem": None, "sound": None, "worn": None, "pictures": []}
    bounds: _Bounds = {"problem": None, "rows": [], "remarks": []}
    stepped: ShownRuns = {"problem": None, "pictures": [], "rows": []}
    status = 200
    try:
        found = _point(context, asker, point, system)
    except Problem as problem:
        found["problem"], status = problem.body(), int(problem.status)
    if study.study:
        try:
            bounds = _bounds(_study(context, asker, point, study))
        except Problem as problem:
            bounds["problem"], status = problem.body(), int(problem.status)
    if step.step:
        given = asdict(point)
        try:
            runs = load_runs(context, asker, given, {name: given[name] for name in HEALTH}, step)
            stepped = shown_runs(runs, step, system)
        except Problem as problem:
            stepped["problem"], status = problem.body(), int(problem.status)
    values = {
        "request": request,
        "stepped": stepped,
        "step": asdict(step),
        "point": asdict(point),
        "study": asdict(study),
        "found": found,
        "bounds": bounds,
        "health": HEALTH,
        "outputs": OUTPUTS,
        "pump_types": [t["id"] for t in pump_types.listed(context, asker)["items"]],
        "circuits": [c["id"] for c in circuits.listed(context, asker)["items"]],
        "fluids": sorted(FLUIDS),
    }
    return html_page("engineer.html", status, values)


_Asked = TypeVar("_Asked", Point, Study, Step)


def _in_ours(asked: _Asked, request: Request, system: UnitSystem) -> _Asked:
    """What was asked for with every number that the address gives in our unit; what it leaves out is in ours already."""
    held = {f.name for f in fields(asked)}
    given = {name: text for name, text in request.query_params.items() if name in held and text}
    found = {name: in_ours(text, name, system) for name, text in given.items()}
    changed: Any = {name: value for name, value in found.items() if isinstance(value, float)}
    return replace(asked, **changed)


def _point(context: Context, asker: Principal, point: Point, system: UnitSystem) -> _Points:
    """Both operating points, and curves over a leak of the circuit and over temperature for either health."""
    given = asdict(point)
    worn = {name: given.pop(name) for name in HEALTH}
    kind, sound = given.pop("pump_type"), {name: usual for name, (_, usual) in HEALTH.items()}
    base = {**given, "fluid": given["fluid"] or None}
    conditions = [{**base, "health": health} for health in (sound, worn)]
    for health in (sound, worn):
        conditions += [{**base, "health": {**health, "system_leakage_lpm": leak}} for leak in _LEAKS_LPM]
    for health in (sound, worn):
        conditions += [{**base, "fluid_temperature_degc": t, "health": health} for t in _TEMPERATURES_DEGC]
    body = checked(twin.OperatingPointRequest, {"pump_type": kind, "conditions": conditions}, "operating point")
    items = twin.solve(body, context, asker)["items"]
    n, m = len(_LEAKS_LPM), len(_TEMPERATURES_DEGC)
    leaks, warm = items[2 : 2 + 2 * n], items[2 + 2 * n :]
    tank = point.reservoir_pressure_bar
    plane = [
        Line("healthy pump, growing leak of the circuit", [_in_plane(i, tank) for i in leaks[:n]]),
        Line("with these values", [_in_plane(i, tank) for i in leaks[n:]]),
    ]
    over = [
        Line("healthy pump", [_over(t, i) for t, i in zip(_TEMPERATURES_DEGC, warm[:m], strict=True)]),
        Line("with these values", [_over(t, i) for t, i in zip(_TEMPERATURES_DEGC, warm[m:], strict=True)]),
    ]
    marked = _in_plane(items[1], tank)
    bar, flow, warmth = (system.scale(unit) for unit in ("bar", "L/min", "degC"))
    planes = (f"discharge pressure [{bar.word}]", f"case minus reservoir [{bar.word}]")
    warm_names = (f"fluid temperature [{warmth.word}]", f"case flow [{flow.word}]")
    pictures = [
        twin_svg("Damage identification curve", planes, plane, marked, scales=(bar, bar)),
        twin_svg("Case flow over temperature", warm_names, over, None, scales=(warmth, flow)),
    ]
    drawn = [Markup(p) for p in pictures]  # noqa: S704 - made by us
    return {"problem": None, "sound": items[0], "worn": items[1], "pictures": drawn}


def _in_plane(item: OperatingPoint, tank_bar: float) -> tuple[float, float] | None:
    if "error" in item:
        return None
    return item["discharge_pressure_bar"], item["case_pressure_bar"] - tank_bar


def _over(x: float, item: OperatingPoint) -> tuple[float, float] | None:
    return None if "error" in item else (x, item["case_flow_lpm"])


def _study(context: Context, asker: Principal, point: Point, study: Study) -> Isolability:
    case = {"accuracy_percent": study.case_accuracy_percent, "full_scale_bar": study.case_full_scale_bar}
    discharge = {"accuracy_percent": study.discharge_accuracy_percent}
    values = {
        "pump_type": point.pump_type,
        "circuit": point.circuit,
        "fluid": point.fluid or None,
        "sensors": {
            "case_pressure_bar": case,
            "discharge_pressure_bar": discharge,
            "reservoir_pressure_bar": {} if study.reservoir else None,
        },
        "flights": study.flights,
        "temperature_range_degc": (study.coldest_degc, study.warmest_degc),
        "burst": study.burst,
    }
    return twin_isolability.study(checked(twin_isolability.IsolabilityRequest, values, "study"), context, asker)


def _bounds(found: Isolability) -> _Bounds:
    """Rows of the table of bounds, what is named best first."""
    rows: list[_Bound] = [
        {
            "fault": name.replace("_", " "),
            "state": WORDS.get(fault["state"], fault["state"]),
            "unit": fault["unit"],
            "detectable": fault["smallest_detectable"],
            "isolable": fault["smallest_isolable"],
            "group": [other.replace("_", " ") for other in fault["ambiguity_group"] if other != name],
        }
        for name, fault in found["faults"].items()
    ]
    return {"problem": None, "rows": rows, "remarks": found["remarks"]}
