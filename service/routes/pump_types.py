"""Pump types: the twin's parameter sets, and healthy curves measured for them."""

from typing import Annotated, Any

from fastapi import APIRouter, BackgroundTasks, Query, Response
from pydantic import ConfigDict, Field

from service import audit
from service.context import Asker, ContextOf
from service.errors import Conflict, Fault, Forbidden, Invalid, NotFound
from service.jobs.refolding import refold_after
from service.registry import reference_curves
from service.registry.fields import Body, Name
from service.threshold_layers import Scope
from twin.parameters import PumpType
from twin.pumps import PUMP_TYPES
from twin.version import twin_version

router = APIRouter(prefix="/pump-types", tags=["registry"])
Operator = Annotated[str | None, Query(description="Whose curve; a key of one operator always means its own")]


class NewPumpType(Body):
    """A variant of a built-in parameter set."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"id": "h225-rebuilt", "base": "h225"}]})
    id: Name
    base: Name
    limits: dict[str, float] = Field(default_factory=dict)
    population: dict[str, float] = Field(default_factory=dict)


@router.get("", summary="List pump types")
def listed(_asker: Asker) -> dict[str, Any]:
    """The parameter sets that the twin has."""
    return {"items": [_summary(PUMP_TYPES[name]) for name in sorted(PUMP_TYPES)], "next": None}


@router.post("", status_code=201, summary="Register a pump type", response_class=Response)
def create(body: NewPumpType, asker: Asker) -> None:
    """Not available: a parameter set is reviewed code; the answer says what to do instead."""
    asker.require("engineer")
    if body.id in PUMP_TYPES:
        raise Conflict(f"pump type {body.id} exists already")
    faults = [Fault("body.id", "a parameter set is part of the twin's version and is released with it")]
    if body.base not in PUMP_TYPES:
        faults.append(Fault("body.base", f"{body.base!r} is not known; known: {', '.join(sorted(PUMP_TYPES))}"))
    limits = "set acceptance limits with PUT /thresholds/pump-type/{id} or /thresholds/operator/{id} instead"
    faults += [Fault(f"body.limits.{name}", limits) for name in body.limits]
    faults += [Fault(f"body.population.{name}", "is part of the twin's version") for name in body.population]
    raise Invalid("pump types cannot be made over the API; nothing was changed", faults)


@router.get("/{name}", summary="One pump type")
def one(name: str, _asker: Asker) -> dict[str, Any]:
    """A parameter set, every number with unit, source and uncertainty."""
    kind = _known(name)
    numbers = {
        group: {
            key: {"value": q.value, "unit": q.unit, "source": q.source, "uncertainty": q.uncertainty}
            for key, q in quantities.items()
        }
        for group, quantities in (
            ("quantities", kind.quantities),
            ("limits", kind.limits),
            ("population", kind.population),
        )
    }
    return _summary(kind) | numbers


@router.get("/{name}/reference-curve", summary="Healthy curve of a pump type")
def curve(name: str, context: ContextOf, asker: Asker, operator: Operator = None) -> dict[str, Any]:
    """Measured healthy points that hold for this operator; none where the twin's own curve does."""
    _known(name)
    with context.database.reading() as session:
        wanted = _whose(asker.operator, operator)
        return reference_curves.document(name, reference_curves.reference_curve(session, wanted, name))


@router.put("/{name}/reference-curve", summary="Store a measured healthy curve")
def put_curve(
    name: str,
    body: reference_curves.NewReferenceCurve,
    background: BackgroundTasks,
    context: ContextOf,
    asker: Asker,
    operator: Operator = None,
) -> dict[str, Any]:
    """Replace the measured points of one operator; a key of no operator sets them for all unless it names one.

    The pumps of the type are judged against them from then on, their whole history included.
    """
    asker.require("engineer")
    _known(name)
    with context.database.writing() as session:
        wanted = _whose(asker.operator, operator)
        row = reference_curves.put(session, wanted, name, body, asker.owner)
        details = {"points": len(body.points)}
        audit.note(session, asker, "reference_curve.put", f"pump-type/{name}", wanted, details)
        answer, version = reference_curves.document(name, row), row.id
    refold_after("reference_curve_changed", version, context, asker, background, Scope("pump-type", name, wanted))
    return answer


def _known(name: str) -> PumpType:
    if name not in PUMP_TYPES:
        raise NotFound(f"there is no pump type {name}; known: {', '.join(sorted(PUMP_TYPES))}")
    return PUMP_TYPES[name]


def _whose(own: str | None, named: str | None) -> str | None:
    if own is not None and named not in (None, own):
        raise Forbidden(f"the key belongs to operator {own}")
    return own or named


def _summary(kind: PumpType) -> dict[str, Any]:
    return {
        "id": kind.name,
        "title": kind.title,
        "twin_version": twin_version(kind),
        "nominal_speed_rpm": kind.nominal_speed_rpm,
        "nominal_reservoir_pressure_bar": kind.nominal_reservoir_pressure_bar,
        "sensors": {
            channel: {
                "full_scale_bar": sensor.full_scale_bar,
                "accuracy_percent_full_scale": 100.0 * sensor.accuracy_fs,
                "repeatability_percent_full_scale": 100.0 * sensor.repeatability_fs,
            }
            for channel, sensor in kind.sensors.items()
        },
    }
