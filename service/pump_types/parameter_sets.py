"""Parameter sets by name: the twin's own, and those stored in the database; the twin itself never looks there."""

import json
from datetime import UTC, datetime
from functools import lru_cache
from typing import Any

from sqlalchemy import or_, select
from sqlalchemy.orm import Session

from service.answers.documents import JsonObject
from service.errors import Conflict, Fault, Invalid
from service.storage.tables import StoredPumpType
from twin.parameters import PumpType
from twin.pumps import PUMP_TYPES
from twin.pumps.own_limits import limit_faults
from twin.pumps.written import ParameterFaultsError, document_of, pump_type_from


def find_type(session: Session, operator: str | None, name: str) -> PumpType | None:
    """Pump type of a name as one operator means it: the twin's, everybody's, or its own.

    ``operator`` None stands for somebody who sees every operator's. No two of the three share a name.
    """
    if name in PUMP_TYPES:
        return PUMP_TYPES[name]
    query = _visible(operator).where(StoredPumpType.name == name)
    row = session.scalar(query.order_by(StoredPumpType.operator.is_not(None), StoredPumpType.id).limit(1))
    return None if row is None else _read(json.dumps(row.document, sort_keys=True))


def held_type(session: Session, operator: str | None, name: str) -> PumpType:
    """Pump type that a stored row names: it was there when the row was written, and none is ever taken away.

    Raises
    ------
    KeyError
        when it is not there.
    """
    found = find_type(session, operator, name)
    if found is None:
        raise KeyError(f"no pump type {name!r} for operator {operator}")
    return found


def asked_type(session: Session, operator: str | None, name: str, where: str) -> PumpType:
    """Pump type that a request names at ``where``.

    Raises
    ------
    Invalid
        naming those that there are.
    """
    found = find_type(session, operator, name)
    if found is None:
        known = ", ".join(kind.name for kind in types(session, operator))
        raise Invalid("the pump type does not exist", [Fault(where, f"{name!r} is not one of {known}")])
    return found


def types(session: Session, operator: str | None) -> list[PumpType]:
    """Every pump type that an operator may use, by name."""
    rows = session.scalars(_visible(operator)).all()
    stored = {row.name: _read(json.dumps(row.document, sort_keys=True)) for row in rows}
    return [kind for _, kind in sorted((stored | dict(PUMP_TYPES)).items())]


def store(session: Session, operator: str | None, document: JsonObject, author: str) -> PumpType:
    """Store a pump type for one operator or, with None, for everybody.

    Raises
    ------
    Conflict
        when the name is taken: names of everybody's types mean the same for all.
    Invalid
        with every fault of the document, or of its healthy pump against its own limits.
    """
    name = document.get("id")
    if isinstance(name, str):
        query = select(StoredPumpType.id).where(StoredPumpType.name == name.strip())
        if operator is not None:
            query = query.where(or_(StoredPumpType.operator.is_(None), StoredPumpType.operator == operator))
        if name.strip() in PUMP_TYPES or session.scalar(query.limit(1)) is not None:
            raise Conflict(f"pump type {name} exists already: verdicts rest on it; give the new one another id")
    try:
        kind = pump_type_from(document, {kind.name: kind for kind in types(session, operator)})
    except ParameterFaultsError as error:
        faults = [Fault(f"body.{where}", words) for where, words in error.faults]
        raise Invalid(f"the pump type has {len(faults)} fault(s); nothing was stored", faults) from None
    held = [Fault(f"body.{where}", words) for where, words in limit_faults(kind)]
    if held:
        raise Invalid(f"the pump type breaks its own limits ({len(held)} fault(s)); nothing was stored", held)
    row = StoredPumpType(
        operator=operator, name=kind.name, document=document_of(kind), created_at=datetime.now(UTC), author=author
    )
    session.add(row)
    session.flush()
    return kind


def _visible(operator: str | None) -> Any:
    query = select(StoredPumpType)
    if operator is not None:
        query = query.where(or_(StoredPumpType.operator.is_(None), StoredPumpType.operator == operator))
    return query


@lru_cache(maxsize=256)
def _read(text: str) -> PumpType:
    """A stored document is checked again: what the twin does not take any more must not be judged with."""
    return pump_type_from(json.loads(text))
