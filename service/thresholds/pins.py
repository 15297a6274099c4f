"""Pumps that are held at an earlier version of the thresholds, until somebody changes thresholds that hold for them."""

from collections.abc import Sequence
from datetime import UTC, datetime

from sqlalchemy import ColumnElement, func, or_, select
from sqlalchemy.orm import Session

from service.storage.tables import InstallationValue, Pump, ThresholdPin, ThresholdVersion

_COUNTER = "threshold counter"


def pinned_version(
    session: Session,
    operator: str | None,
    serial: str,
    layers: Sequence[ColumnElement[bool]],
    known_at: datetime | None = None,
) -> int | None:
    """Number that a pump is held at, now or as known at an instant; None where it follows the newest thresholds.

    ``layers`` pick the versions of the layers that hold for the pump.
    """
    query = select(ThresholdPin).join(Pump, Pump.id == ThresholdPin.pump_id)
    query = query.where(Pump.operator == operator, Pump.serial == serial)
    if known_at is not None:
        query = query.where(ThresholdPin.recorded_at <= known_at)
    pin = session.scalar(query.order_by(ThresholdPin.id.desc()).limit(1))
    if pin is None or pin.number is None:
        return None
    later = select(ThresholdVersion.number).where(ThresholdVersion.number > pin.counter, or_(*layers))
    if known_at is not None:
        later = later.where(ThresholdVersion.created_at <= known_at)
    return pin.number if session.scalar(later.limit(1)) is None else None


def held_pumps(session: Session) -> set[int]:
    """Numbers of pumps that were ever held at a version: whether one still is, ``pinned_version`` says."""
    return set(session.scalars(select(ThresholdPin.pump_id).where(ThresholdPin.number.is_not(None)).distinct()))


def hold(session: Session, pump: Pump, number: int | None, author: str) -> None:
    """Hold a pump at a version of the thresholds; None lets it follow the newest again."""
    query = select(ThresholdPin.number).where(ThresholdPin.pump_id == pump.id).order_by(ThresholdPin.id.desc()).limit(1)
    if number is None and session.scalar(query) is None:
        return
    counter = newest_number(session)
    session.add(
        ThresholdPin(pump_id=pump.id, number=number, counter=counter, author=author, recorded_at=datetime.now(UTC))
    )
    session.flush()


def newest_number(session: Session) -> int:
    """Highest number that any version has or had; 0 before the first."""
    highest = session.scalar(select(func.max(ThresholdVersion.number))) or 0
    kept = session.get(InstallationValue, _COUNTER)
    return max(highest, int(kept.value) if kept else 0)


def keep_counter(session: Session) -> None:
    """Remember the highest number before versions are deleted: verdicts name it, and no other version may get it."""
    number = str(newest_number(session))
    kept = session.get(InstallationValue, _COUNTER)
    if kept is None:
        session.add(InstallationValue(name=_COUNTER, value=number))
    else:
        kept.value = number
    session.flush()
