"""Aircraft that a record brings along."""

from datetime import UTC, datetime

from sqlalchemy import select
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.orm import Session

from service.storage.tables import Aircraft


def known_aircraft(session: Session, operator: str, name: str, *, for_change: bool = False) -> None:
    """Make an aircraft known, unconfirmed, unless it is, and lock it until the transaction ends.

    Records share the lock among themselves; ``for_change`` shuts out everybody else. It is taken at once in its final
    strength: two holders of a shared lock that both wish for more would wait for each other.
    """
    query = select(Aircraft.id).where(Aircraft.operator == operator, Aircraft.name == name)
    query = query.with_for_update(read=not for_change)
    if session.scalar(query) is not None:  # all but the first record of an aircraft
        return
    values = {"operator": operator, "name": name, "created_at": datetime.now(UTC)}
    insert = sqlite.insert if session.get_bind().dialect.name == "sqlite" else postgresql.insert
    session.execute(insert(Aircraft).values(**values).on_conflict_do_nothing(index_elements=["operator", "name"]))
    session.execute(query)
