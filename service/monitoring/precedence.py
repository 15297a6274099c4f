"""Which process may write a pump's reductions and verdicts: one of the newest release that has, or of a newer one.

Replicas of two releases run beside each other while one takes the other's place. Whoever holds the pump's lock and is
not older takes the pump over; an older one leaves it alone, so that nothing is made twice in turn.
"""

import hashlib

from sqlalchemy import ColumnElement, or_, select
from sqlalchemy.orm import Session

from detectors.judgement.snapshot import judge_version
from service.errors import Unavailable
from service.history import reduced
from service.identity import release_number, release_of
from service.monitoring.chain import own_sources
from service.storage.tables import Pump


class HeldByNewerError(Unavailable):
    """The pump's verdicts were made by a newer release than this process is of."""


def made_with() -> str:
    """Hash of the code that stored reductions and verdicts are made with."""
    parts = (reduced.sources(), judge_version(), own_sources())
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]


def newer_release(session: Session, pump_id: int) -> str | None:
    """The newer release that made a pump's verdicts; None where this process may write them."""
    held = session.scalar(select(Pump.made_by).where(Pump.id == pump_id))
    return None if held is None or held <= release_number() else release_of(held)


def is_ours() -> ColumnElement[bool]:
    """Condition that picks the pumps whose verdicts this process may write."""
    return or_(Pump.made_by.is_(None), Pump.made_by <= release_number())


def take_over(pump: Pump, *, whole: bool) -> None:
    """Note that this process writes a pump's reductions; ``whole`` when all of them and the verdicts are its own."""
    pump.made_by = release_number()
    pump.made_with = made_with() if whole else None
    pump.changed()


def left_to_newer(session: Session, pump: Pump) -> bool:
    """True where a newer release made the pump's verdicts: a process of that release is asked to fold it anew.

    The caller holds the pump's lock.
    """
    if newer_release(session, pump.id) is None:
        return False
    pump.made_with = None
    pump.changed()
    return True


def held_by(release: str, serial: str) -> HeldByNewerError:
    """What an older process says of a pump that it leaves alone."""
    return HeldByNewerError(
        f"pump {serial} was judged by release {release}, this process is older: a process of that release folds it anew"
    )
