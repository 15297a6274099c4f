"""Circuits: what stands round a pump, as documents; the twin's own and those that were added."""

from typing import Annotated, cast

from fastapi import APIRouter, Body, Query, Response

from service.access import audit
from service.answers.documents import JsonObject
from service.answers.registry import Circuit
from service.answers.words import Page
from service.errors import Forbidden, NotFound
from service.pump_types.circuits import circuits, store_circuit
from service.web.addresses import location
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf
from twin.pumps.circuit_sets import CircuitSet, circuit_document

router = APIRouter(prefix="/circuits", tags=["registry"], route_class=AnswerRoute)
_EXAMPLE = {
    "id": "ironbird",
    "base": "shared_return",
    "drain": "separate",
    "changes": {"k_c": {"value": 0.41, "unit": "bar/(L/min)", "source": "hose bench, 12 March", "uncertainty": 0.05}},
    "consumers": [{"name": "landing gear selector", "flow_lpm": 0.3}],
    "accumulator": {"gas_volume_l": 0.5, "precharge_bar": 100.0},
}


@router.get("", summary="List circuits")
def listed(context: ContextOf, asker: Asker) -> Page[Circuit]:
    """The circuits that the twin brings, and those that were added for all or for this operator."""
    with context.database.reading() as session:
        return {"items": [_shown(found) for found in circuits(session, asker.operator).values()], "next": None}


@router.post("", status_code=201, summary="Add a circuit")
def create(
    response: Response,
    context: ContextOf,
    asker: Asker,
    body: Annotated[JsonObject, Body(examples=[_EXAMPLE])],
    operator: Annotated[str | None, Query(description="For whom; a key of one operator always means its own")] = None,
) -> Circuit:
    """Store a whole circuit, or a base with changes; it is never changed afterwards.

    Consumers leak at rest, counted at 175 bar, and add to a call's system leakage; an accumulator moves nothing at rest. The
    name then stands for the circuit in calls of the twin and on aircraft of the operator.
    """
    asker.require("engineer")
    if asker.operator is not None and operator not in (None, asker.operator):
        raise Forbidden(f"the key belongs to operator {asker.operator}")
    wanted = asker.operator or operator
    with context.database.writing() as session:
        found = store_circuit(session, wanted, body, asker.owner)
        audit.note(session, asker, "circuit.add", f"circuit/{found.name}", wanted, {"title": found.title})
    response.headers["Location"] = location("circuits", found.name)
    return _shown(found)


@router.get("/{name}", summary="One circuit")
def one(name: str, context: ContextOf, asker: Asker) -> Circuit:
    """A circuit, every number with unit, source and uncertainty: in the shape that POST takes."""
    with context.database.reading() as session:
        known = circuits(session, asker.operator)
    if name not in known:
        raise NotFound(f"there is no circuit {name}; known: {', '.join(known)}")
    return _shown(known[name])


def _shown(found: CircuitSet) -> Circuit:
    return cast("Circuit", circuit_document(found))
