"""Pump types: the twin's parameter sets, and healthy curves measured for them."""

import json
import tomllib
from typing import Annotated, cast

from fastapi import APIRouter, BackgroundTasks, Query, Request, Response
from sqlalchemy.orm import Session
from starlette.concurrency import run_in_threadpool

from detectors.judgement.version import twin_version
from service.access import audit
from service.access.security import Principal
from service.answers import registry as answers
from service.answers.documents import JsonObject
from service.answers.registry import PumpTypeSummary, ReferenceCurve
from service.answers.words import Page
from service.context import Context
from service.errors import Fault, Forbidden, Invalid, NotFound, TooLarge, Undecodable, UnknownType
from service.history.healthy_curves import reference_curve
from service.jobs.refolding import refold_after
from service.pump_types.parameter_sets import find_type, store, types
from service.registry import reference_curves
from service.thresholds.layers import Scope
from service.web.addresses import location
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf
from twin.parameters import PumpType
from twin.pumps.fluids import FLUIDS
from twin.pumps.written import document_of
from twin.recording import MAY_LACK

router = APIRouter(prefix="/pump-types", tags=["registry"], route_class=AnswerRoute)
Operator = Annotated[str | None, Query(description="For whom; a key of one operator always means its own")]


_EXAMPLES = [
    {
        "id": "h225-rebuilt",
        "base": "h225",
        "changes": {"slipper.h": {"value": 8.2, "unit": "um", "source": "bench run 12", "uncertainty": 0.05}},
    }
]
_TOML = "application/toml"
_QUANTITY = {
    "type": "object",
    "required": ["value", "unit", "source"],
    "properties": {
        "value": {
            "type": ["number", "string"],
            "description": "A number; of a choice of law also its name, as `mare` of `compensator.edge_law`",
        },
        "unit": {"type": "string"},
        "source": {"type": "string"},
        "uncertainty": {"type": ["number", "null"]},
    },
}
_SCHEMA = {
    "type": "object",
    "required": ["id"],
    "properties": {
        "id": {"type": "string"},
        "base": {"type": "string", "description": "pump type that the changes start from"},
        "title": {"type": "string"},
        "fluid": {"enum": sorted(FLUIDS), "description": "product that fills the base, before the changes"},
        "changes": {"type": "object", "additionalProperties": _QUANTITY},
        "nominal_speed_rpm": {"type": "number"},
        "nominal_reservoir_pressure_bar": {"type": "number"},
        "sensors": {"type": "object"},
        "lacks": {
            "type": "array",
            "items": {"enum": list(MAY_LACK)},
            "description": "required channels that records of the type do not have; never both pressures",
        },
        "own_twin": {
            "type": "boolean",
            "description": "false: nobody has modelled it, and it is watched for change against its measured healthy curve",
        },
        **{
            group: {"type": "object", "additionalProperties": _QUANTITY}
            for group in ("quantities", "limits", "population")
        },
    },
}
_MOST_BYTES = 2**20


@router.get("", summary="List pump types")
def listed(context: ContextOf, asker: Asker) -> Page[PumpTypeSummary]:
    """The parameter sets that the twin brings, and those that were added for all or for this operator."""
    with context.database.reading() as session:
        return {"items": [_summary(kind) for kind in types(session, asker.operator)], "next": None}


@router.post(
    "",
    status_code=201,
    summary="Add a pump type",
    openapi_extra={
        "requestBody": {
            "required": True,
            "content": {
                "application/json": {"schema": _SCHEMA, "examples": {"derived": {"value": _EXAMPLES[0]}}},
                _TOML: {},
            },
        }
    },
)
async def create(
    request: Request, response: Response, context: ContextOf, asker: Asker, operator: Operator = None
) -> PumpTypeSummary:
    """Store a whole parameter set, or a base with changes, as JSON or TOML; it is never changed afterwards.

    A key of one operator adds it for that operator; a key of none for everybody unless it names an operator.
    """
    asker.require("engineer")
    content = bytearray()
    async for piece in request.stream():
        content += piece
        if len(content) > _MOST_BYTES:
            raise TooLarge(f"a parameter set has at most {_MOST_BYTES} bytes")
    document = _document(bytes(content), request.headers.get("content-type", ""))
    wanted = _whose(asker.operator, operator)
    kind = await run_in_threadpool(_stored, context, asker, wanted, document)
    response.headers["Location"] = location("pump-types", kind.name)
    return _summary(kind)


@router.get("/{name}", summary="One pump type")
def one(name: str, context: ContextOf, asker: Asker) -> answers.PumpType:
    """A parameter set, every number with unit, source and uncertainty: in the shape that POST takes."""
    with context.database.reading() as session:
        kind = _known(session, asker, name)
    return cast("answers.PumpType", {**document_of(kind), "twin_version": twin_version(kind)})


@router.get("/{name}/reference-curve", summary="Healthy curve of a pump type")
def curve(name: str, context: ContextOf, asker: Asker, operator: Operator = None) -> ReferenceCurve:
    """Measured healthy points that hold for this operator; none where the twin's own curve does."""
    with context.database.reading() as session:
        _known(session, asker, name)
        wanted = _whose(asker.operator, operator)
        return reference_curves.document(name, reference_curve(session, wanted, name))


@router.put("/{name}/reference-curve", summary="Store a measured healthy curve")
def put_curve(
    name: str,
    body: reference_curves.NewReferenceCurve,
    background: BackgroundTasks,
    context: ContextOf,
    asker: Asker,
    operator: Operator = None,
) -> ReferenceCurve:
    """Replace the measured points of one operator; a key of no operator sets them for all unless it names one.

    The pumps of the type are judged against them from then on, their whole history included.
    """
    asker.require("engineer")
    with context.database.writing() as session:
        _known(session, asker, name)
        wanted = _whose(asker.operator, operator)
        row = reference_curves.put(session, wanted, name, body, asker.owner)
        details = {"points": len(body.points)}
        audit.note(session, asker, "reference_curve.put", f"pump-type/{name}", wanted, details)
        answer, version = reference_curves.document(name, row), row.id
    refold_after("reference_curve_changed", version, context, asker, background, Scope("pump-type", name, wanted))
    return answer


def _stored(context: Context, asker: Principal, operator: str | None, document: JsonObject) -> PumpType:
    with context.database.writing() as session:
        kind = store(session, operator, document, asker.owner)
        details = {"twin_version": twin_version(kind)} | {n: document[n] for n in ("base", "changes") if n in document}
        audit.note(session, asker, "pump_type.add", f"pump-type/{kind.name}", operator, details)
    return kind


def _document(content: bytes, content_type: str) -> JsonObject:
    kind = content_type.partition(";")[0].strip().lower() or "application/json"
    if kind not in ("application/json", _TOML):
        raise UnknownType(f"{kind} is not known here; send application/json or {_TOML}")
    try:
        text = content.decode("utf-8")
        document = tomllib.loads(text) if kind == _TOML else json.loads(text)
    except (ValueError, RecursionError) as error:
        raise Undecodable(f"the body is not {kind}: {str(error)[:200]}") from None
    if not isinstance(document, dict):
        raise Invalid("a pump type is an object", [Fault("body", "is not an object")])
    return document


def _known(session: Session, asker: Principal, name: str) -> PumpType:
    found = find_type(session, asker.operator, name)
    if found is None:
        known = ", ".join(kind.name for kind in types(session, asker.operator))
        raise NotFound(f"there is no pump type {name}; known: {known}")
    return found


def _whose(own: str | None, named: str | None) -> str | None:
    if own is not None and named not in (None, own):
        raise Forbidden(f"the key belongs to operator {own}")
    return own or named


def _summary(kind: PumpType) -> PumpTypeSummary:
    names = ("id", "title", "nominal_speed_rpm", "nominal_reservoir_pressure_bar", "sensors")
    document = document_of(kind)
    values = {name: document[name] for name in names} | {"twin_version": twin_version(kind)}
    return cast("PumpTypeSummary", values)
