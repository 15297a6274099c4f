"""Thresholds: what holds, from which layer, and how to change it."""

from collections.abc import Mapping
from typing import Annotated, Literal

from fastapi import APIRouter, BackgroundTasks, Header, Response
from pydantic import ConfigDict, Field, FiniteFloat
from sqlalchemy.orm import Session

from detectors.words.thresholds import KEYS
from service.access.security import Principal
from service.answers import thresholds as answers
from service.answers.jobs import Job
from service.answers.thresholds import Preview, ThresholdKey, Thresholds
from service.answers.words import Page, instant
from service.bodies import Body
from service.errors import Forbidden, NotFound, TooLarge
from service.jobs.refolding import refold_after
from service.jobs.requests import ask_for
from service.monitoring.preview import Workbench, preview
from service.pump_types.parameter_sets import find_type
from service.reading import queries
from service.storage.tables import ThresholdVersion
from service.thresholds.layers import (
    SCOPES,
    Effective,
    Scope,
    effective_thresholds,
    etag,
    latest,
    pump_scopes,
    put,
    restore,
    versions,
)
from service.web.addresses import location
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf
from service.web.routes.jobs import shown

router = APIRouter(prefix="/thresholds", tags=["thresholds"], route_class=AnswerRoute)
_UNITS = {key.name: key.unit for key in KEYS}


class NewThresholds(Body):
    """A new version of one layer: it replaces the layer's values as a whole."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {"values": {"case_flow_limit_lpm": 1.4}, "reason": "earlier warning wished by the fleet office"}
            ]
        },
    )
    values: dict[str, FiniteFloat]
    reason: str = Field(max_length=2000)


class Restoration(Body):
    """Why an earlier version is put back; it may be left out."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"reason": "too many alarms in May"}]})
    reason: str | None = Field(default=None, max_length=2000)


class Candidate(Body):
    """Values that would stand in for those of one layer as a whole; ``operator`` tells two pumps of a serial apart."""

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"scope": "operator", "id": "north", "values": {"alarm_records": 5}}]},
    )
    scope: Literal["fleet", "pump-type", "operator", "pump"]
    id: str = Field(max_length=200)
    values: dict[str, FiniteFloat]
    operator: str | None = Field(default=None, max_length=200)


@router.get("/keys", summary="All thresholds with unit, range and meaning")
def keys(_asker: Asker) -> Page[ThresholdKey]:
    """What can be set at all."""
    items: list[ThresholdKey] = [
        {"key": k.name, "unit": k.unit, "default": k.default, "low": k.low, "high": k.high, "meaning": k.meaning}
        for k in KEYS
    ]
    return {"items": items, "next": None}


@router.post(
    "/preview",
    summary="What other thresholds would have done",
    responses={202: {"description": "More history than one answer may take: a job compares it"}},
)
def previewed(body: Candidate, response: Response, context: ContextOf, asker: Asker) -> Preview | Job:
    """Fold the stored history with a candidate for one layer, without writing, and compare the alarms."""
    asker.require("analyst")
    with context.database.reading() as session:
        layer = _layers(session, asker, body.scope, body.id, body.operator)[-1]
        try:
            bench = Workbench(session, context.archive, context.settings.max_preview_records)
            return preview(bench, asker, layer, body.values)
        except TooLarge:
            values = {"scope": layer.kind, "id": layer.id, "operator": layer.operator, "values": body.values}
    job = ask_for(context, asker, "preview", None, values)
    response.status_code = 202
    response.headers["Location"] = location("jobs", job.id)
    return shown(job)


@router.get("/{scope}/{scope_id}/versions", summary="History of one layer")
def history(
    scope: str, scope_id: str, context: ContextOf, asker: Asker, operator: str | None = None
) -> Page[answers.ThresholdVersion]:
    """Every version of a layer with author and reason, the newest first."""
    with context.database.reading() as session:
        layers = _layers(session, asker, scope, scope_id, operator)
        return {"items": [_version(row) for row in versions(session, layers[-1])], "next": None}


@router.post("/{scope}/{scope_id}/versions/{number}/restore", summary="Put a version back")
def restored(
    scope: str,
    scope_id: str,
    number: int,
    response: Response,
    background: BackgroundTasks,
    context: ContextOf,
    asker: Asker,
    body: Restoration | None = None,
    operator: str | None = None,
    if_match: Annotated[str | None, Header()] = None,
) -> Thresholds:
    """Append an earlier version once more as the newest; ``If-Match`` is checked where it is sent."""
    _require_setter(asker, scope)
    with context.database.writing() as session:
        layers = _layers(session, asker, scope, scope_id, operator)
        own = restore(session, layers[-1], number, body.reason if body else None, asker, if_match)
        answer = _answered(response, layers[-1], _holds(session, asker, layers), own)
    refold_after("thresholds_changed", own.number, context, asker, background, layers[-1])
    return answer


@router.get("/{scope}/{scope_id}", summary="Effective thresholds of one layer")
def effective(
    scope: str, scope_id: str, response: Response, context: ContextOf, asker: Asker, operator: str | None = None
) -> Thresholds:
    """Effective values with the layer each comes from; the ETag is this layer's own version."""
    with context.database.reading() as session:
        layers = _layers(session, asker, scope, scope_id, operator)
        found, own = _holds(session, asker, layers), latest(session, layers[-1])
        response.headers["ETag"] = etag(own)
        return _document(scope, scope_id, found, own.number if own else 0, own.values if own else {})


@router.put("/{scope}/{scope_id}", summary="A new version of one layer")
def change(
    scope: str,
    scope_id: str,
    body: NewThresholds,
    response: Response,
    background: BackgroundTasks,
    context: ContextOf,
    asker: Asker,
    operator: str | None = None,
    if_match: Annotated[str | None, Header()] = None,
) -> Thresholds:
    """Append a version; the verdicts of the pumps it holds for are folded anew."""
    _require_setter(asker, scope)
    with context.database.writing() as session:
        layers = _layers(session, asker, scope, scope_id, operator)
        own = put(session, layers[-1], body.values, body.reason, asker, if_match)
        answer = _answered(response, layers[-1], _holds(session, asker, layers), own)
    refold_after("thresholds_changed", own.number, context, asker, background, layers[-1])
    return answer


def _require_setter(asker: Principal, scope: str) -> None:
    asker.require("engineer")
    if scope in ("fleet", "pump-type") and asker.operator is not None:
        raise Forbidden(f"{scope} thresholds hold for every operator; {asker.owner} belongs to one")


def _answered(response: Response, layer: Scope, found: Effective, own: ThresholdVersion) -> Thresholds:
    response.headers["ETag"] = etag(own)
    return _document(layer.kind, layer.id, found, own.number, own.values)


def _holds(session: Session, asker: Principal, layers: tuple[Scope, ...]) -> Effective:
    """What layers give, over the limits of the pump type that is among them."""
    operator = next((layer.operator for layer in layers if layer.kind == "pump"), asker.operator)
    names = [layer.id for layer in layers if layer.kind == "pump-type"]
    kind = find_type(session, operator, names[0]) if names else None
    return effective_thresholds(session, layers, kind=kind)


def _layers(session: Session, asker: Principal, scope: str, scope_id: str, operator: str | None) -> tuple[Scope, ...]:
    """Layers up to and including the one that was asked for."""
    if scope == "fleet" and scope_id == "default":
        return (Scope("fleet", "default"),)
    if scope == "pump-type" and find_type(session, asker.operator, scope_id) is not None:
        return (Scope("fleet", "default"), Scope("pump-type", scope_id))
    if scope == "operator" and asker.operator in (None, scope_id):
        return (Scope("fleet", "default"), Scope("operator", scope_id))
    if scope == "pump":
        row = queries.pump(session, asker, scope_id, operator)
        return pump_scopes(row.operator, row.serial, row.pump_type)
    known = ", ".join(f"{s}/…" for s in SCOPES)
    raise NotFound(f"there are no thresholds {scope}/{scope_id}; scopes: {known}")


def _version(row: ThresholdVersion) -> answers.ThresholdVersion:
    return {
        "version": row.number,
        "values": row.values,
        "author": row.author,
        "reason": row.reason,
        "created_at": instant(row.created_at),
    }


def _document(scope: str, scope_id: str, found: Effective, version: int, own: Mapping[str, float]) -> Thresholds:
    return {
        "scope": scope,
        "id": scope_id,
        "version": version,
        "effective_version": found.version,
        "own": dict(own),
        "values": {
            name: {"value": value, "unit": _UNITS[name], "from": found.origin[name]}
            for name, value in found.values.items()
        },
    }
