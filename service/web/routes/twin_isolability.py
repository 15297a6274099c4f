"""Isolability: what given sensors could detect and isolate, before anybody buys them."""

from typing import Annotated, Any

from fastapi import APIRouter
from pydantic import AfterValidator, ConfigDict, Field, FiniteFloat

from detectors.isolability.bounds import isolability
from detectors.isolability.plan import MOST_GROUND_RUN_FLOWS, PLAN_RANGES, Plan, PlanFaultsError, Sensors
from detectors.isolability.table import REPEATABILITY_SHARE
from service.answers import twin as answers
from service.bodies import FluidName, Numbers
from service.errors import Fault, Invalid
from service.pump_types.circuits import circuits
from service.pump_types.parameter_sets import find_type, types
from service.studies.isolability_document import isolability_document
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf
from twin.parameters import PumpType, Sensor
from twin.pumps import PUMP_TYPES
from twin.pumps.fluids import with_fluid

router = APIRouter(prefix="/twin", tags=["twin"], route_class=AnswerRoute)
_CHANNELS = {
    "case": "case_pressure_bar",
    "discharge": "discharge_pressure_bar",
    "reservoir": "reservoir_pressure_bar",
}


def _rising(ends: tuple[float, float]) -> tuple[float, float]:
    if ends[0] > ends[1]:
        raise ValueError(f"{ends[0]:g} lies above {ends[1]:g}")
    return ends


def _within(key: str, factor: float = 1.0) -> Any:
    """Constraint by the plan's own range; ``factor`` brings it to the request's unit."""
    low, high = PLAN_RANGES[key]
    return Field(ge=factor * low, le=factor * high)


FullScale = Annotated[FiniteFloat, _within("full_scale_bar")]
Accuracy = Annotated[FiniteFloat, _within("accuracy_fs", 100.0)]
Repeatability = Annotated[FiniteFloat, _within("repeatability_fs", 100.0)]
GroundRunFlow = Annotated[FiniteFloat, _within("ground_run_flow_lpm")]
Temperature = Annotated[FiniteFloat, _within("temperature_degc")]


class SensorInput(Numbers):
    """One pressure sensor; what is not given is the pump type's own, repeatability a tenth of a given accuracy."""

    model_config = ConfigDict(extra="forbid")
    full_scale_bar: FullScale | None = None
    accuracy_percent: Accuracy | None = None
    repeatability_percent: Repeatability | None = None


class SensorsInput(Numbers):
    """The pressure sensors; ``reservoir_pressure_bar: null`` where none is fitted."""

    model_config = ConfigDict(extra="forbid")
    case_pressure_bar: SensorInput = SensorInput()
    discharge_pressure_bar: SensorInput = SensorInput()
    reservoir_pressure_bar: SensorInput | None = SensorInput()
    case_zero_measured: bool = True


class IsolabilityRequest(Numbers):
    """One study; the defaults are the pump type's own sensors and its own fluid."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={"examples": [{"flights": 30, "temperature_range_degc": [30.0, 80.0], "burst": True}]},
    )
    pump_type: str = "h225"
    circuit: str = "shared_return"
    fluid: FluidName | None = None
    sensors: SensorsInput = SensorsInput()
    temperature_range_degc: Annotated[tuple[Temperature, Temperature], AfterValidator(_rising)] = (30.0, 80.0)
    baseline_flights: Annotated[int, _within("baseline_flights")] = 30
    flights: Annotated[int, _within("flights")] = 30
    windows_per_flight: Annotated[int, _within("windows_per_flight")] = 1
    ground_run_flows_lpm: Annotated[list[GroundRunFlow], Field(max_length=MOST_GROUND_RUN_FLOWS)] = []  # noqa: RUF012 - pydantic copies it
    ground_run_every: Annotated[int, _within("ground_run_every")] = 10
    burst: bool = False
    false_alarm_probability: Annotated[FiniteFloat, _within("false_alarm_probability")] = 1.0e-4
    detection_probability: Annotated[FiniteFloat, _within("detection_probability")] = 0.9


@router.post("/isolability", summary="Smallest detectable and isolable faults")
def study(body: IsolabilityRequest, context: ContextOf, asker: Asker) -> answers.Isolability:
    """Bounds of every kind of fault for the given sensors, temperatures and flights."""
    with context.database.reading() as session:
        asked = find_type(session, asker.operator, body.pump_type)
        known = ", ".join(t.name for t in types(session, asker.operator)) if asked is None else ""
        around = circuits(session, asker.operator)
    # the rest of the study is looked at all the same: one answer names every fault
    kind = with_fluid(asked or PUMP_TYPES["h225"], body.fluid)
    wrong = [] if asked else [Fault("body.pump_type", f"{body.pump_type!r} is not one of {known}")]
    if body.circuit not in around:
        wrong.append(Fault("body.circuit", f"{body.circuit!r} is not one of {', '.join(around)}"))
    try:
        found = isolability(_plan(body, kind), kind, around.get(body.circuit, around["shared_return"]).circuit)
    except PlanFaultsError as error:
        faults = wrong + [Fault(_place(where), problem) for where, problem in error.faults]
        raise Invalid(f"the study has {len(faults)} fault(s)", faults) from None
    if wrong:
        raise Invalid(f"the study has {len(wrong)} fault(s)", wrong)
    return {**isolability_document(found), "pump_type": body.pump_type, "circuit": body.circuit, "fluid": body.fluid}


def _plan(body: IsolabilityRequest, kind: PumpType) -> Plan:
    given = body.sensors
    tank = given.reservoir_pressure_bar
    sensors = Sensors(
        case=_sensor(given.case_pressure_bar, kind.sensors["case_pressure_bar"]),
        discharge=_sensor(given.discharge_pressure_bar, kind.sensors["discharge_pressure_bar"]),
        reservoir=None if tank is None else _sensor(tank, kind.sensors["reservoir_pressure_bar"]),
        zero_measured=given.case_zero_measured,
    )
    return Plan(
        sensors=sensors,
        temperature_range_degc=body.temperature_range_degc,
        baseline_flights=body.baseline_flights,
        flights=body.flights,
        windows_per_flight=body.windows_per_flight,
        ground_run_flows_lpm=tuple(body.ground_run_flows_lpm),
        ground_run_every=body.ground_run_every,
        burst=body.burst,
        false_alarm_probability=body.false_alarm_probability,
        detection_probability=body.detection_probability,
    )


def _sensor(given: SensorInput, own: Sensor) -> Sensor:
    accuracy, repeatability = own.accuracy_fs, own.repeatability_fs
    if given.accuracy_percent is not None:
        accuracy = given.accuracy_percent / 100.0
        repeatability = REPEATABILITY_SHARE * accuracy
    if given.repeatability_percent is not None:
        repeatability = given.repeatability_percent / 100.0
    return Sensor(given.full_scale_bar or own.full_scale_bar, accuracy, repeatability)


def _place(where: str) -> str:
    """Place of a plan's fault in the request."""
    for name, channel in _CHANNELS.items():
        where = where.replace(f"sensors.{name}.", f"sensors.{channel}.")
    return where.replace("_fs", "_percent")
