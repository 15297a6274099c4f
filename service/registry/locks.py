"""Rows locked for a change: pumps first, by their number, then an aircraft; so nobody waits in a circle."""

from collections.abc import Collection

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.access.security import Principal
from service.reading import queries
from service.storage.tables import Aircraft, Pump


def locked_pump(session: Session, asker: Principal, serial: str, operator: str | None) -> Pump:
    """One pump, locked until the transaction ends.

    Raises
    ------
    NotFound
        when there is none that the asker may see.
    """
    found = queries.pump(session, asker, serial, operator)
    return locked_pumps(session, (found.id,))[0]


def locked_pumps(session: Session, ids: Collection[int]) -> list[Pump]:
    """Several pumps, locked in the order of their numbers."""
    query = select(Pump).where(Pump.id.in_(ids)).order_by(Pump.id).with_for_update()
    return list(session.scalars(query.execution_options(populate_existing=True)))


def lock_aircraft(session: Session, row: Aircraft) -> None:
    """Shut out every other change of an aircraft and of what is installed on it."""
    session.execute(select(Aircraft.id).where(Aircraft.id == row.id).with_for_update())
