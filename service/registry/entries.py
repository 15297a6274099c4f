"""Entries about a pump: added, corrected, withdrawn; a row is ended, never changed."""

import uuid
from datetime import UTC, datetime
from typing import TypeVar

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.answers.documents import RowValues
from service.errors import NotFound
from service.storage.tables import Entry, Pump

AnyEntry = TypeVar("AnyEntry", bound=Entry)


def add(session: Session, table: type[AnyEntry], pump: Pump, author: str, values: RowValues) -> AnyEntry:
    """Add a new entry."""
    return _added(session, table, pump, uuid.uuid4().hex, author, datetime.now(UTC), values)


def entry(session: Session, table: type[AnyEntry], pump: Pump, entry_id: str) -> AnyEntry:
    """The row of an entry that counts.

    Raises
    ------
    NotFound
        when there is none of this pump.
    """
    query = select(table).where(table.id == entry_id, table.pump_id == pump.id, table.withdrawn_at.is_(None))
    row = session.scalar(query)
    if row is None:
        raise NotFound(f"pump {pump.serial} has no entry {entry_id} there that counts")
    return row


def correct(session: Session, row: AnyEntry, pump: Pump, author: str, values: RowValues) -> AnyEntry:
    """End a row and put a corrected one of the same id in its place, at the same instant."""
    row.withdrawn_at = now = datetime.now(UTC)
    return _added(session, type(row), pump, row.id, author, now, values)


def withdraw(session: Session, row: Entry) -> None:
    """End a row: the entry no longer counts."""
    row.withdrawn_at = datetime.now(UTC)
    session.flush()


def _added(
    session: Session,
    table: type[AnyEntry],
    pump: Pump,
    entry_id: str,
    author: str,
    now: datetime,
    values: RowValues,
) -> AnyEntry:
    own = {"id": entry_id, "pump_id": pump.id, "author": author, "recorded_at": now, "withdrawn_at": None}
    row = table(**own, **values)
    session.add(row)
    session.flush()
    return row
