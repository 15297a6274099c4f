"""The transient twin: a short run under a schedule, its channels as a record would hold them."""

import json
from typing import Literal

from anyio import CapacityLimiter, from_thread, to_thread
from anyio.lowlevel import RunVar
from fastapi import APIRouter, Response
from pydantic import ConfigDict, FiniteFloat
from starlette.concurrency import run_in_threadpool

from service.access.security import Principal
from service.answers.twin import Simulation
from service.bodies import Numbers
from service.context import Context
from service.pump_types.circuits import circuits
from service.pump_types.parameter_sets import types
from service.studies.simulation.requested import Asked, Checked, checked, simulated_json
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf
from twin.recording import TIME

router = APIRouter(prefix="/twin", tags=["twin"], route_class=AnswerRoute)
AT_ONCE = 2
"""Simulations that run beside each other; further ones wait, and take no thread from other requests meanwhile."""

_LIMITER: RunVar[CapacityLimiter] = RunVar("simulations")


class HealthSchedule(Numbers):
    """A health input over time, linear between its points; a step is two points at one instant."""

    model_config = ConfigDict(extra="forbid")
    time_s: list[FiniteFloat]
    value: list[FiniteFloat]


class SimulationRequest(Numbers):
    """One run; speed and temperature are the pump type's nominal speed and 50 degC where the schedule is silent.

    Without ``fluid`` the pump is filled with its type's own. ``slipper_gaps`` is for a type whose slippers' gap follows from
    forces: ``resolved``, or by their ``metamodel``, some ten times as fast.
    """

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [
                {
                    "duration_s": 0.3,
                    "sample_rate_hz": 1000.0,
                    "schedule": {"time_s": [0.0, 0.1, 0.1, 0.3], "discharge_flow_lpm": [0.0, 0.0, 10.0, 10.0]},
                }
            ]
        },
    )
    pump_type: str = "h225"
    circuit: str = "shared_return"
    fluid: str | None = None
    slipper_gaps: Literal["resolved", "metamodel"] = "resolved"
    duration_s: FiniteFloat
    sample_rate_hz: FiniteFloat = 1000.0
    schedule: dict[str, FiniteFloat | list[FiniteFloat]] = {}  # noqa: RUF012 - pydantic copies it
    health: dict[str, FiniteFloat | HealthSchedule] = {}  # noqa: RUF012


@router.post("/simulation", summary="Short run of the transient twin", response_model=Simulation)
async def simulation(body: SimulationRequest, context: ContextOf, asker: Asker) -> Response:
    """Simulate at most ten seconds and 30 000 samples; too long a run is refused with the limit."""
    asked = await run_in_threadpool(_checked, body, context, asker)
    return Response(await _in_turn(asked), media_type="application/json")


def simulated(body: SimulationRequest, context: Context, asker: Principal) -> Simulation:
    """The same for a page, on a thread of its request; waits for its turn as every run does."""
    asked = _checked(body, context, asker)
    found: Simulation = json.loads(from_thread.run(_in_turn, asked))
    return found


async def _in_turn(asked: Checked) -> bytes:
    return await to_thread.run_sync(simulated_json, asked, limiter=_limiter())


def _checked(body: SimulationRequest, context: Context, asker: Principal) -> Checked:
    with context.database.reading() as session:
        known = {kind.name: kind for kind in types(session, asker.operator)}
        return checked(_asked(body), known, circuits(session, asker.operator))


def _limiter() -> CapacityLimiter:
    """The limiter of the running event loop."""
    try:
        return _LIMITER.get()
    except LookupError:
        _LIMITER.set(CapacityLimiter(AT_ONCE))
        return _LIMITER.get()


def _asked(body: SimulationRequest) -> Asked:
    schedule = dict(body.schedule)
    time = schedule.pop(TIME, None)
    return Asked(
        pump_type=body.pump_type,
        circuit=body.circuit,
        fluid=body.fluid,
        slipper_gaps=body.slipper_gaps,
        duration_s=body.duration_s,
        sample_rate_hz=body.sample_rate_hz,
        schedule_time_s=[float(time)] if isinstance(time, int | float) else time,
        schedule=schedule,
        health={
            name: (given.time_s, given.value) if isinstance(given, HealthSchedule) else given
            for name, given in body.health.items()
        },
    )
