"""Thresholds: what holds, from which layer, and how to change it."""

from collections.abc import Mapping
from typing import Annotated, Any

from fastapi import APIRouter, BackgroundTasks, Header, Response
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from detectors.thresholds import KEYS
from service import queries
from service.context import Asker, Context, ContextOf
from service.errors import Forbidden, NotFound
from service.jobs.requests import ask_for
from service.monitoring.reanalysis import pumps_of_scope, refold_scope
from service.security import Principal
from service.threshold_layers import SCOPES, Effective, Scope, effective_thresholds, etag, latest, pump_scopes, put
from twin.pumps import PUMP_TYPES

router = APIRouter(prefix="/thresholds", tags=["thresholds"])
_MOST_PUMPS_AT_ONCE = 20
_UNITS = {key.name: key.unit for key in KEYS}


class NewThresholds(BaseModel):
    """A new version of one layer: it replaces the layer's values as a whole."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [
                {"values": {"case_flow_limit_lpm": 1.4}, "reason": "earlier warning wished by the fleet office"}
            ]
        },
    )
    values: dict[str, float]
    reason: str = Field(max_length=2000)


@router.get("/keys", summary="All thresholds with unit, range and meaning")
def keys(_asker: Asker) -> dict[str, Any]:
    """What can be set at all."""
    items = [
        {"key": k.name, "unit": k.unit, "default": k.default, "low": k.low, "high": k.high, "meaning": k.meaning}
        for k in KEYS
    ]
    return {"items": items, "next": None}


@router.get("/{scope}/{scope_id}", summary="Effective thresholds of one layer")
def effective(
    scope: str, scope_id: str, response: Response, context: ContextOf, asker: Asker, operator: str | None = None
) -> dict[str, Any]:
    """Effective values with the layer each comes from; the ETag is this layer's own version."""
    with context.database.reading() as session:
        layers = _layers(session, asker, scope, scope_id, operator)
        found, own = effective_thresholds(session, layers), latest(session, layers[-1])
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
) -> dict[str, Any]:
    """Append a version; the verdicts of the pumps it holds for are folded anew."""
    everybodys = scope in ("fleet", "pump-type")
    asker.require("admin" if everybodys else "analyst")
    if everybodys and asker.operator is not None:
        raise Forbidden(f"{scope} thresholds hold for every operator; the key of {asker.owner} is one operator's")
    with context.database.writing() as session:
        layers = _layers(session, asker, scope, scope_id, operator)
        own = put(session, layers[-1], body.values, body.reason, asker.owner, if_match)
        found = effective_thresholds(session, layers)
        answer = _document(scope, scope_id, found, own.number, own.values)
        response.headers["ETag"] = etag(own)
    _refold(context, asker, background, layers[-1], own.number)
    return answer


def _refold(context: Context, asker: Principal, background: BackgroundTasks, layer: Scope, version: int) -> None:
    """Fold anew what the layer holds for: a few pumps right after the answer, more of them by a job."""
    with context.database.reading() as session:
        n_pumps = session.scalar(select(func.count()).select_from(pumps_of_scope(layer).order_by(None).subquery())) or 0
    if n_pumps <= _MOST_PUMPS_AT_ONCE:
        background.add_task(refold_scope, context.database, context.acceptance, layer)
        return
    operator = layer.id if layer.kind == "operator" else layer.operator
    values = {"scope": layer.kind, "id": layer.id, "operator": layer.operator, "version": version}
    ask_for(context, asker, "refold", operator, values)


def _layers(session: Session, asker: Principal, scope: str, scope_id: str, operator: str | None) -> tuple[Scope, ...]:
    """Layers up to and including the one that was asked for."""
    if scope == "fleet" and scope_id == "default":
        return (Scope("fleet", "default"),)
    if scope == "pump-type" and scope_id in PUMP_TYPES:
        return (Scope("fleet", "default"), Scope("pump-type", scope_id))
    if scope == "operator" and asker.operator in (None, scope_id):
        return (Scope("fleet", "default"), Scope("operator", scope_id))
    if scope == "pump":
        row = queries.pump(session, asker, scope_id, operator)
        return pump_scopes(row.operator, row.serial, row.pump_type)
    known = ", ".join(f"{s}/…" for s in SCOPES)
    raise NotFound(f"there are no thresholds {scope}/{scope_id}; scopes: {known}")


def _document(scope: str, scope_id: str, found: Effective, version: int, own: Mapping[str, float]) -> dict[str, Any]:
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
