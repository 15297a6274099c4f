"""Aircraft that a record brings along."""

from datetime import UTC, datetime

from sqlalchemy import select
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.orm import Session

from service.tables import Aircraft


def known_aircraft(session: Session, operator: str, name: str) -> None:
    """Make an aircraft known, unconfirmed, unless it is; shut out a change of it until the transaction ends."""
    values = {"operator": operator, "name": name, "created_at": datetime.now(UTC)}
    insert = sqlite.insert if session.get_bind().dialect.name == "sqlite" else postgresql.insert
    session.execute(insert(Aircraft).values(**values).on_conflict_do_nothing(index_elements=["operator", "name"]))
    query = select(Aircraft.id).where(Aircraft.operator == operator, Aircraft.name == name)
    session.execute(query.with_for_update(read=True))
