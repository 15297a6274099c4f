"""Withdrawing a record: it no longer counts, its bytes are kept, its pump is folded anew behind the commit."""

from datetime import UTC, datetime

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.access import audit
from service.access.security import Principal
from service.errors import Conflict
from service.history.archive import Archive
from service.history.neighbours import newly_contradicted
from service.monitoring.behind import fold_behind
from service.monitoring.refold import Cause
from service.reading import queries
from service.storage.tables import ANALYSED, WITHDRAWN, Pump, Record


def withdraw_record(session: Session, asker: Principal, record_id: str, reason: str, archive: Archive) -> Record:
    """Withdraw a record that counts; withdrawing it again changes nothing.

    Raises
    ------
    NotFound
        when there is none that the asker may see.
    Conflict
        when it never counted or counts no longer for another reason.
    """
    found = queries.record(session, asker, record_id)
    if found.pump_id is None:
        raise Conflict(f"record {record_id} is {found.status}: only an analysed record can be withdrawn")
    own = session.get_one(Pump, found.pump_id)
    others = newly_contradicted(session, found)
    # in the order of their numbers, as everywhere, so that nobody waits in a circle
    query = select(Pump).where(Pump.id.in_({own.id, *others})).order_by(Pump.id).with_for_update()
    pumps = session.scalars(query.execution_options(populate_existing=True)).all()
    session.refresh(found)
    if found.status == WITHDRAWN:
        return found
    if found.status != ANALYSED:
        raise Conflict(f"record {record_id} is {found.status}: only an analysed record can be withdrawn")
    found.status, found.ended_at = WITHDRAWN, datetime.now(UTC)
    found.withdrawal = {"reason": reason, "author": asker.owner}
    audit.note(session, asker, "record.withdraw", f"record/{record_id}", found.operator, {"reason": reason})
    session.flush()
    fold_behind(session, pumps, archive, Cause("record_withdrawn", record_id))
    return found
