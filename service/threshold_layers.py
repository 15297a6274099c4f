"""Thresholds in layers: fleet, pump type, operator, pump; versioned by one counter, never changed in place."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from detectors.thresholds import KEYS, effective, threshold_faults
from service.errors import Fault, Invalid, PreconditionRequired, StaleVersion
from service.tables import ThresholdVersion

SCOPES: tuple[str, ...] = ("fleet", "pump-type", "operator", "pump")
"""Layers from the widest to the narrowest; the narrower wins."""


@dataclass(frozen=True, slots=True)
class Scope:
    """One layer; ``operator`` tells two operators' pumps of the same serial apart."""

    kind: str
    id: str
    operator: str | None = None


@dataclass(frozen=True, slots=True)
class Effective:
    """Effective values with the layer each comes from, and the highest version number among the layers."""

    values: Mapping[str, float]
    origin: Mapping[str, str]
    version: int


def pump_scopes(operator: str, serial: str, pump_type: str) -> tuple[Scope, ...]:
    """Layers that hold for one pump, widest first."""
    return (
        Scope("fleet", "default"),
        Scope("pump-type", pump_type),
        Scope("operator", operator),
        Scope("pump", serial, operator),
    )


def latest(session: Session, scope: Scope, known_at: datetime | None = None) -> ThresholdVersion | None:
    """Newest version of one layer, of those that were known at an instant."""
    query = select(ThresholdVersion).where(
        ThresholdVersion.scope == scope.kind,
        ThresholdVersion.scope_id == scope.id,
        ThresholdVersion.operator.is_(None) if scope.operator is None else ThresholdVersion.operator == scope.operator,
    )
    if known_at is not None:
        query = query.where(ThresholdVersion.created_at <= known_at)
    return session.scalar(query.order_by(ThresholdVersion.number.desc()).limit(1))


def effective_thresholds(session: Session, scopes: tuple[Scope, ...], known_at: datetime | None = None) -> Effective:
    """Values of several layers laid over each other and over the defaults, now or as known at an instant."""
    values: dict[str, float] = {}
    origin = {key.name: "default" for key in KEYS}
    version = 0
    for scope in scopes:
        row = latest(session, scope, known_at)
        if row is not None:
            values |= row.values
            origin |= dict.fromkeys(row.values, f"{scope.kind}/{scope.id}")
            version = max(version, row.number)
    return Effective(effective(values), origin, version)


def put(
    session: Session, scope: Scope, values: Mapping[str, float], reason: str, author: str, if_match: str | None
) -> ThresholdVersion:
    """Append a version to one layer.

    Raises
    ------
    PreconditionRequired, StaleVersion
        when ``If-Match`` is missing or names another version than the latest.
    Invalid
        with every fault of the values.
    """
    current = latest(session, scope)
    tag = etag(current)
    if if_match is None:
        raise PreconditionRequired(f"send If-Match with the version you read ({tag}), or * for the first")
    expected = {"*"} if current is None else {tag}
    if not {t.strip() for t in if_match.split(",")} & (expected | ({'"0"'} if current is None else set())):
        raise StaleVersion(f"the latest version is {tag}: read it again and repeat your change on top of it")
    faults = [Fault(f"values.{name}", problem) for name, problem in threshold_faults(values)]
    if not reason.strip():
        faults.append(Fault("reason", "is empty: say why, whoever reads this in a year will ask"))
    if faults:
        raise Invalid(f"{len(faults)} fault(s) in the thresholds; nothing was changed", faults)
    number = (session.scalar(select(func.max(ThresholdVersion.number))) or 0) + 1
    row = ThresholdVersion(
        number=number,
        scope=scope.kind,
        scope_id=scope.id,
        operator=scope.operator,
        values=dict(values),
        author=author,
        reason=reason,
        created_at=datetime.now(UTC),
    )
    session.add(row)
    session.flush()
    return row


def etag(row: ThresholdVersion | None) -> str:
    """Entity tag of a version; ``"0"`` before the first."""
    return f'"{row.number if row else 0}"'
