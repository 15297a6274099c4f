"""Where a pump sat at an event time: what was entered wins over what its records say."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime


@dataclass(frozen=True, slots=True)
class Interval:
    """One entered installation; ``removed_at`` None while it lasts."""

    aircraft: str
    position: str
    installed_at: datetime
    removed_at: datetime | None

    def covers(self, at: datetime) -> bool:
        """True from the installation on, up to the removal."""
        return self.installed_at <= at and (self.removed_at is None or at < self.removed_at)


@dataclass(frozen=True, slots=True)
class Place:
    """Aircraft and position at one event time, with remarks where the sources disagree."""

    aircraft: str
    position: str
    flags: tuple[str, ...] = ()


def place_at(intervals: Sequence[Interval], aircraft: str, position: str, at: datetime) -> Place:
    """Place of a record that says it was taken on ``aircraft`` at ``position``."""
    for interval in intervals:
        if not interval.covers(at):
            continue
        if (interval.aircraft, interval.position) == (aircraft, position):
            return Place(aircraft, position)
        said = f"records say {aircraft} {position}, the registered installation says"
        return Place(interval.aircraft, interval.position, (f"{said} {interval.aircraft} {interval.position}",))
    removed = any(
        i.removed_at is not None
        and i.removed_at <= at
        and (i.aircraft, i.position) == (aircraft, position)
        and not any(i.removed_at <= j.installed_at <= at for j in intervals)
        for i in intervals
    )
    flags = (f"records come from {aircraft} {position} after the registered removal from there",) if removed else ()
    return Place(aircraft, position, flags)


def changes(intervals: Sequence[Interval]) -> tuple[datetime, ...]:
    """Instants at which an entered installation starts or ends: from each on drain, circuit and sensors are others."""
    instants = {i.installed_at for i in intervals} | {i.removed_at for i in intervals if i.removed_at is not None}
    return tuple(sorted(instants))
