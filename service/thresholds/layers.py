"""Thresholds in layers: fleet, pump type, operator, pump; versioned by one counter, never changed in place."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Protocol

from sqlalchemy import ColumnElement, and_, func, or_, select, text
from sqlalchemy.orm import Session

from detectors.words.thresholds import KEYS, effective, limits_of, threshold_faults
from service.access import audit
from service.access.security import Principal
from service.errors import Fault, Invalid, NotFound, PreconditionRequired, StaleVersion
from service.pump_types.parameter_sets import find_type
from service.storage.tables import Pump, ThresholdVersion
from service.thresholds.pins import held_pumps, newest_number, pinned_version
from twin.parameters import PumpType

SCOPES: tuple[str, ...] = ("fleet", "pump-type", "operator", "pump")
"""Layers from the widest to the narrowest; the narrower wins."""
LIMITS = "pump-type limits"
"""Where a value comes from that no layer sets: the pump type's own limit."""


@dataclass(frozen=True, slots=True)
class Scope:
    """One layer; ``operator`` tells two operators' pumps of the same serial apart."""

    kind: str
    id: str
    operator: str | None = None


class Named(Protocol):
    """A pump by what its thresholds depend on: its row, or what lists hold of it."""

    @property
    def id(self) -> Any: ...
    @property
    def operator(self) -> Any: ...
    @property
    def serial(self) -> Any: ...
    @property
    def pump_type(self) -> Any: ...


@dataclass(frozen=True, slots=True)
class Effective:
    """Effective values with the layer each comes from, and the highest version number among the layers.

    ``origin`` is ``default``, ``pump-type limits`` or ``scope/id``.
    """

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


def latest(session: Session, scope: Scope) -> ThresholdVersion | None:
    """Newest version of one layer."""
    return _newest_of(session, (scope,), None, None).get(scope)


def versions(session: Session, scope: Scope) -> list[ThresholdVersion]:
    """Every version of one layer, the newest first."""
    query = select(ThresholdVersion).where(*_is(scope))
    return list(session.scalars(query.order_by(ThresholdVersion.number.desc())))


@dataclass(frozen=True, slots=True)
class Candidate:
    """Values that stand in for the newest version of one layer, to see what they would do."""

    scope: Scope
    values: Mapping[str, float]


def effective_thresholds(
    session: Session,
    scopes: tuple[Scope, ...],
    known_at: datetime | None = None,
    candidate: Candidate | None = None,
    up_to: int | None = None,
    kind: PumpType | None = None,
) -> Effective:
    """Values of several layers laid over each other and over the defaults, now or as known at an instant.

    The limits of ``kind``, a pump type, lie under every layer: whoever sets nothing is held to what the pump is made for.

    ``up_to`` takes no version above a number. Without it a pump that is held at one (``service.thresholds.pins``) has
    that one's, unless a candidate for one of its layers would end that.
    """
    pump = next((scope for scope in scopes if scope.kind == "pump"), None)
    if up_to is None and pump is not None and (candidate is None or candidate.scope not in scopes):
        layers = [and_(*_is(scope)) for scope in scopes]
        up_to = pinned_version(session, pump.operator, pump.id, layers, known_at)
    newest = _newest_of(session, scopes, known_at, up_to)
    laid: list[tuple[Scope, Mapping[str, float], int]] = []
    for scope in scopes:
        row = newest.get(scope)
        if candidate is not None and candidate.scope == scope:
            laid.append((scope, candidate.values, 0))
        elif row is not None:
            laid.append((scope, row.values, row.number))
    return _laid(laid, kind)


def put(
    session: Session,
    scope: Scope,
    values: Mapping[str, float],
    reason: str,
    principal: Principal,
    if_match: str | None,
) -> ThresholdVersion:
    """Append a version to one layer, and note it in the audit log.

    Raises
    ------
    PreconditionRequired, StaleVersion
        when ``If-Match`` is missing or names another version than the latest.
    Invalid
        with every fault of the values, alone and where they meet those of other layers.
    """
    _lock(session)
    current = latest(session, scope)
    _check_version(current, if_match)
    faults = value_faults(session, scope, values)
    if not reason.strip():
        faults.append(Fault("reason", "is empty: say why, whoever reads this in a year will ask"))
    if faults:
        raise Invalid(f"{len(faults)} fault(s) in the thresholds; nothing was changed", faults)
    number = newest_number(session) + 1
    row = ThresholdVersion(
        number=number,
        scope=scope.kind,
        scope_id=scope.id,
        operator=scope.operator,
        values=dict(values),
        author=principal.owner,
        reason=reason,
        created_at=datetime.now(UTC),
    )
    session.add(row)
    session.flush()
    details = {"version": number, "before": dict(current.values) if current else {}, "after": row.values}
    tenant = scope.operator or (scope.id if scope.kind == "operator" else None)
    subject = f"thresholds/{scope.kind}/{scope.id}"
    audit.note(session, principal, "thresholds.put", subject, tenant, {**details, "reason": reason})
    return row


def restore(
    session: Session, scope: Scope, number: int, reason: str | None, principal: Principal, if_match: str | None
) -> ThresholdVersion:
    """Put an earlier version of a layer back as a new one; ``If-Match`` is checked where it is sent.

    Raises
    ------
    NotFound
        when the layer has no such version.
    StaleVersion, Invalid
        as ``put`` does.
    """
    _lock(session)
    earlier = next((row for row in versions(session, scope) if row.number == number), None)
    if earlier is None:
        raise NotFound(f"thresholds {scope.kind}/{scope.id} have no version {number}")
    condition = etag(latest(session, scope)) if if_match is None else if_match
    return put(session, scope, earlier.values, reason or f"version {number} restored", principal, condition)


def value_faults(session: Session, scope: Scope, values: Mapping[str, float]) -> list[Fault]:
    """Faults of a layer's values: alone, and laid over or under the newest values of every other layer."""
    own = [Fault(f"values.{name}", problem) for name, problem in threshold_faults(values)]
    if own:
        return own
    newest = _newest(session) | {scope: values}
    found: dict[tuple[str, str], Fault] = {}
    for layers in _combinations(session, newest):
        if scope not in layers:
            continue
        merged: dict[str, float] = {}
        for layer in layers:
            merged |= newest.get(layer, {})
        for name, problem in threshold_faults(merged):
            where = " with ".join(f"{s.kind}/{s.id}" for s in layers if s in newest)
            found.setdefault((name, problem), Fault(f"values.{name}", f"{problem} ({where})"))
    return list(found.values())


def _check_version(current: ThresholdVersion | None, if_match: str | None) -> None:
    tag = etag(current)
    if if_match is None:
        raise PreconditionRequired(f"send If-Match with the version you read ({tag}), or * for the first")
    accepted = {"*", tag} if current is None else {tag}
    if not {t.strip() for t in if_match.split(",")} & accepted:
        raise StaleVersion(f"the latest version is {tag}: read it again and repeat your change on top of it")


def _lock(session: Session) -> None:
    """Let changes follow each other, so that no two take the same number; SQLite's write transactions do anyway."""
    if session.get_bind().dialect.name == "postgresql":
        session.execute(text("SELECT pg_advisory_xact_lock(hashtext('threshold_versions'))"))


def _is(scope: Scope) -> tuple[ColumnElement[bool], ...]:
    table = ThresholdVersion
    operator = table.operator.is_(None) if scope.operator is None else table.operator == scope.operator
    return table.scope == scope.kind, table.scope_id == scope.id, operator


def _newest_of(
    session: Session, scopes: Sequence[Scope], known_at: datetime | None, up_to: int | None
) -> dict[Scope, ThresholdVersion]:
    """The newest version of each of several layers, in one statement: every upload asks twice."""
    table = ThresholdVersion
    numbers = select(func.max(table.number)).where(or_(*(and_(*_is(scope)) for scope in scopes)))
    if known_at is not None:
        numbers = numbers.where(table.created_at <= known_at)
    if up_to is not None:
        numbers = numbers.where(table.number <= up_to)
    numbers = numbers.group_by(table.scope, table.scope_id, table.operator)
    rows = session.scalars(select(table).where(table.number.in_(numbers)))
    return {Scope(row.scope, row.scope_id, row.operator): row for row in rows}


def _newest(session: Session) -> dict[Scope, Mapping[str, float]]:
    """The newest values of every layer that has any."""
    return {scope: row.values for scope, row in _newest_rows(session).items()}


def _newest_rows(session: Session) -> dict[Scope, ThresholdVersion]:
    """The newest version of every layer that has any."""
    table = ThresholdVersion
    numbers = select(func.max(table.number)).group_by(table.scope, table.scope_id, table.operator)
    rows = session.scalars(select(table).where(table.number.in_(numbers)))
    return {Scope(row.scope, row.scope_id, row.operator): row for row in rows}


def _combinations(session: Session, layers: Iterable[Scope]) -> Iterator[tuple[Scope, ...]]:
    """Every way in which these layers can meet on a pump."""
    fleet = Scope("fleet", "default")
    kinds = {kind: [s for s in layers if s.kind == kind] for kind in SCOPES}
    for kind in (None, *kinds["pump-type"]):
        for operator in (None, *kinds["operator"]):
            yield tuple(s for s in (fleet, kind, operator) if s is not None)
    for scope in kinds["pump"]:
        query = select(Pump).where(Pump.serial == scope.id, Pump.operator == scope.operator)
        for pump in session.scalars(query):
            yield pump_scopes(pump.operator, pump.serial, pump.pump_type)


def etag(row: ThresholdVersion | None) -> str:
    """Entity tag of a version; ``"0"`` before the first."""
    return f'"{row.number if row else 0}"'


def thresholds_of(
    session: Session,
    operator: str,
    serial: str,
    kind: str,
    known_at: datetime | None = None,
    candidate: Candidate | None = None,
) -> Effective:
    """Effective thresholds of one pump, now, as they were known at an instant, or with a candidate for one layer."""
    layers, found = pump_scopes(operator, serial, kind), find_type(session, operator, kind)
    return effective_thresholds(session, layers, known_at, candidate, kind=found)


def default_thresholds(session: Session, operator: str, kind: str) -> Effective:
    """Effective thresholds of a pump of which it is known that no layer of it has any version."""
    return _laid((), find_type(session, operator, kind))


def thresholds_of_many(session: Session, pumps: Sequence[Named]) -> dict[int, Effective]:
    """Effective thresholds of many pumps now, by the pump's number: what ``thresholds_of`` gives for each.

    The layers are read once for all of them; pumps that are held at a version are looked at one by one.
    """
    newest, kinds = _newest_rows(session), {}
    own = {(scope.operator, scope.id) for scope in newest if scope.kind == "pump"}
    held = held_pumps(session)
    found: dict[int, Effective] = {}
    alike: dict[tuple[str, str], Effective] = {}
    for pump in pumps:
        place = (pump.operator, pump.pump_type)
        is_alone = pump.id in held or (pump.operator, pump.serial) in own
        # most pumps of a type have the same layers: what lies over what is worked out once for them
        if not is_alone and place in alike:
            found[pump.id] = alike[place]
            continue
        if place not in kinds:
            kinds[place] = find_type(session, *place)
        kind, layers = kinds[place], pump_scopes(pump.operator, pump.serial, pump.pump_type)
        if pump.id in held:
            found[pump.id] = effective_thresholds(session, layers, kind=kind)
            continue
        rows = [(scope, newest[scope]) for scope in layers if scope in newest]
        found[pump.id] = _laid([(scope, row.values, row.number) for scope, row in rows], kind)
        if not is_alone:
            alike[place] = found[pump.id]
    return found


def _laid(layers: Iterable[tuple[Scope, Mapping[str, float], int]], kind: PumpType | None) -> Effective:
    """Values of layers with their version's number, widest first, laid over each other and over the defaults."""
    values: dict[str, float] = {}
    origin = {key.name: "default" for key in KEYS}
    origin |= dict.fromkeys({} if kind is None else limits_of(kind), LIMITS)
    version = 0
    for scope, own, number in layers:
        values |= own
        origin |= dict.fromkeys(own, f"{scope.kind}/{scope.id}")
        version = max(version, number)
    return Effective(effective(values, kind), origin, version)
