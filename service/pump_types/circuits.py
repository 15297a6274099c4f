"""Circuits by name: the twin's own, and those stored in the database; the twin itself never looks there."""

import json
from datetime import UTC, datetime
from functools import lru_cache
from typing import Any

from sqlalchemy import or_, select
from sqlalchemy.orm import Session

from service.answers.documents import JsonObject
from service.errors import Conflict, Fault, Invalid
from service.storage.tables import StoredCircuit
from twin.pumps.circuit_sets import CIRCUIT_SETS, CircuitSet, circuit_document, circuit_set_from
from twin.pumps.written import ParameterFaultsError


def circuits(session: Session, operator: str | None) -> dict[str, CircuitSet]:
    """Every circuit that an operator may use, by name; ``operator`` None stands for somebody who sees all."""
    rows = session.scalars(_visible(operator).order_by(StoredCircuit.operator.is_(None), StoredCircuit.id.desc())).all()
    stored = {row.name: _read(json.dumps(row.document, sort_keys=True)) for row in rows}
    return dict(sorted((stored | dict(CIRCUIT_SETS)).items()))


def asked_circuit(session: Session, operator: str | None, name: str, where: str) -> CircuitSet:
    """Circuit that a request names at ``where``.

    Raises
    ------
    Invalid
        naming those that there are.
    """
    if name in CIRCUIT_SETS:
        return CIRCUIT_SETS[name]
    known = circuits(session, operator)
    if name not in known:
        raise Invalid("the circuit does not exist", [Fault(where, f"{name!r} is not one of {', '.join(known)}")])
    return known[name]


def store_circuit(session: Session, operator: str | None, document: JsonObject, author: str) -> CircuitSet:
    """Store a circuit for one operator or, with None, for everybody.

    Raises
    ------
    Conflict
        when the name is taken: names of everybody's circuits mean the same for all.
    Invalid
        with every fault of the document.
    """
    name = document.get("id")
    if isinstance(name, str):
        query = select(StoredCircuit.id).where(StoredCircuit.name == name.strip())
        if operator is not None:
            query = query.where(or_(StoredCircuit.operator.is_(None), StoredCircuit.operator == operator))
        if name.strip() in CIRCUIT_SETS or session.scalar(query.limit(1)) is not None:
            raise Conflict(f"circuit {name} exists already: verdicts rest on it; give the new one another id")
    try:
        found = circuit_set_from(document, circuits(session, operator))
    except ParameterFaultsError as error:
        faults = [Fault(f"body.{where}", words) for where, words in error.faults]
        raise Invalid(f"the circuit has {len(faults)} fault(s); nothing was stored", faults) from None
    row = StoredCircuit(
        operator=operator,
        name=found.name,
        document=circuit_document(found),
        created_at=datetime.now(UTC),
        author=author,
    )
    session.add(row)
    session.flush()
    return found


def _visible(operator: str | None) -> Any:
    query = select(StoredCircuit)
    if operator is not None:
        query = query.where(or_(StoredCircuit.operator.is_(None), StoredCircuit.operator == operator))
    return query


@lru_cache(maxsize=256)
def _read(text: str) -> CircuitSet:
    """A stored document is checked again: what the twin does not take any more must not be judged with."""
    return circuit_set_from(json.loads(text))
