"""The twin itself: operating points for any condition and health."""

from typing import cast

from fastapi import APIRouter
from pydantic import ConfigDict, Field, FiniteFloat

from service.answers import twin as answers
from service.bodies import FluidName, Numbers
from service.errors import Fault, Invalid
from service.pump_types.circuits import circuits
from service.pump_types.parameter_sets import asked_type
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf
from twin.condition import CONDITION_INPUTS, HEALTH_INPUTS, OUTPUTS, Condition, Health, OperatingPoints, input_rows
from twin.operating_point import operating_points, outside, problem
from twin.pumps.fluids import with_fluid

router = APIRouter(prefix="/twin", tags=["twin"], route_class=AnswerRoute)
MOST_CONDITIONS = 10_000
_LEAKAGES = ("piston", "slipper", "port_plate", "compensator")
_PLURALS = {"piston": "pistons", "slipper": "slippers", "port_plate": "port_plate", "compensator": "compensator"}


class HealthInput(Numbers):
    """What wear and faults change; the defaults are the healthy pump."""

    model_config = ConfigDict(extra="forbid")
    pump_leakage_scale: FiniteFloat = 1.0
    system_leakage_lpm: FiniteFloat = 0.0
    pressure_setting_change_bar: FiniteFloat = 0.0
    drain_resistance_scale: FiniteFloat = 1.0
    control_bleed_lpm: FiniteFloat = 0.0
    throttled_leakage_lpm: FiniteFloat = 0.0
    slipper_leakage_scale: FiniteFloat = 1.0
    piston_leakage_scale: FiniteFloat = 1.0
    port_plate_leakage_scale: FiniteFloat = 1.0
    droop_scale: FiniteFloat = 1.0


class ConditionInput(Numbers):
    """Where the pump runs, and with which fluid; without one the pump type's own."""

    model_config = ConfigDict(extra="forbid")
    speed_rpm: FiniteFloat
    fluid_temperature_degc: FiniteFloat
    reservoir_pressure_bar: FiniteFloat = 0.0
    discharge_flow_lpm: FiniteFloat = 0.0
    circuit: str = "shared_return"
    fluid: FluidName | None = None
    health: HealthInput = HealthInput()


class OperatingPointRequest(Numbers):
    """Conditions to solve, all for one pump type."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [{"pump_type": "h225", "conditions": [{"speed_rpm": 4600, "fluid_temperature_degc": 50}]}]
        },
    )
    pump_type: str = "h225"
    conditions: list[ConditionInput] = Field(min_length=1, max_length=MOST_CONDITIONS)


@router.post("/operating-point", summary="Steady states of the twin")
def solve(body: OperatingPointRequest, context: ContextOf, asker: Asker) -> answers.OperatingPoints:
    """Solve every condition; one without a solution gets a problem in its place, one outside what was validated says so."""
    with context.database.reading() as session:
        kind = asked_type(session, asker.operator, body.pump_type, "pump_type")
        known = circuits(session, asker.operator)
    faults = [
        Fault(f"body.conditions.{i}.circuit", f"{c.circuit!r} is not one of {', '.join(known)}")
        for i, c in enumerate(body.conditions)
        if c.circuit not in known
    ]
    if faults:
        raise Invalid(f"the conditions have {len(faults)} fault(s)", faults)
    items: list[answers.OperatingPoint] = [{} for _ in body.conditions]
    around = [(c.circuit, c.fluid) for c in body.conditions]
    for circuit, fluid in sorted(set(around), key=str):
        places = [i for i, surroundings in enumerate(around) if surroundings == (circuit, fluid)]
        asked = [body.conditions[i] for i in places]
        conditions = [
            Condition(c.speed_rpm, c.fluid_temperature_degc, c.reservoir_pressure_bar, c.discharge_flow_lpm)
            for c in asked
        ]
        leak = known[circuit].leak_lpm
        healths = [Health(**c.health.model_dump()) for c in asked]
        healths = [h._replace(system_leakage_lpm=h.system_leakage_lpm + leak) for h in healths]
        filled = with_fluid(kind, fluid)
        points = operating_points(
            filled.pump, input_rows(conditions, healths), known[circuit].circuit, derivatives=True
        )
        beyond = outside(filled, points)
        for k, place in enumerate(places):
            items[place] = _item(points, k, beyond[k])
    return {"items": items}


def _item(points: OperatingPoints, k: int, beyond: tuple[str, ...]) -> answers.OperatingPoint:
    fault = problem(points, k)
    if fault is not None or points.derivatives is None:
        return {"error": Invalid(fault or "no derivatives").body()}
    values = dict(zip(OUTPUTS, points.values[k].tolist(), strict=True))
    leakage = {_PLURALS[part]: values.pop(f"{part}_leakage_lpm") for part in _LEAKAGES}
    inputs = (*CONDITION_INPUTS, *HEALTH_INPUTS)
    derivatives = {
        output: dict(zip(inputs, points.derivatives[k, i].tolist(), strict=True)) for i, output in enumerate(OUTPUTS)
    }
    found = values | {"leakage_lpm": leakage, "derivatives": derivatives}
    return cast("answers.OperatingPoint", found | ({"outside": list(beyond)} if beyond else {}))
