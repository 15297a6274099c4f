"""What follows from a pump's history alone, read once for every state of that history and kept in this process.

An assessment carries its link in the chain of all that it was folded from (``service.monitoring.chain``). Whatever changes a
history changes its last link, in this process or in another one. The fold keeps that link in the pump's row, with the revision
that it was kept at: whoever asks has the row already, and nothing more is asked of the database where that still holds.
"""

from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from threading import Lock
from typing import Generic, TypeVar

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.reading import queries
from service.reading.queries import Listed
from service.storage.tables import Pump, StoredAssessment

Held = TypeVar("Held")
Key = tuple[str, str, int, str]


class ByLink(Generic[Held]):
    """Values by pump and state of its history, the longest unused of ``most`` forgotten first."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._kept: OrderedDict[Key, Held | None] = OrderedDict()
        self._lock = Lock()

    def of(
        self,
        session: Session,
        pumps: Sequence[Pump | Listed],
        read: Callable[[list[int]], Mapping[int, Held]],
        what: str = "",
    ) -> dict[int, Held]:
        """Value of each pump that has one; ``read`` gives those of pumps that are not known as they are now.

        ``what`` tells questions apart that are kept together, such as metrics. A pump whose newest assessment has no link
        is read every time.
        """
        keys = keys_of(session, pumps, what)
        with self._lock:
            held = {i: self._kept[key] for i, key in keys.items() if key is not None and key in self._kept}
            for known in filter(None, (keys[i] for i in held)):
                self._kept.move_to_end(known)
        found = {i: value for i, value in held.items() if value is not None}
        unknown = [i for i in keys if i not in held]
        if unknown:
            anew = read(unknown)
            with self._lock:
                self._kept.update({key: anew.get(i) for i in unknown if (key := keys[i]) is not None})
                while len(self._kept) > self._most:
                    self._kept.popitem(last=False)
            found.update(anew)
        return found


def keys_of(session: Session, pumps: Sequence[Pump | Listed], what: str = "") -> dict[int, Key | None]:
    """What names the state of each pump's history: pumps without a record may be missing, None is to be read every time."""
    place = str(session.get_bind().engine.url)
    keys: dict[int, Key | None] = {
        pump.id: None if pump.standing_link is None else (place, what, pump.id, pump.standing_link)
        for pump in pumps
        if pump.standing_at == pump.revision
    }
    others = [pump.id for pump in pumps if pump.id not in keys]
    if others:
        for pump_id, chain in links(session, others).items():
            keys[pump_id] = None if chain is None else (place, what, pump_id, chain)
    return keys


def links(session: Session, pump_ids: Sequence[int]) -> dict[int, str | None]:
    """Link of the newest assessment of each pump that has one, as it is stored there."""
    kept = StoredAssessment
    query = select(kept.pump_id, kept.chain).where(kept.record_id.in_(queries.newest_records(pump_ids)))
    return {row[0]: row[1] for row in session.execute(query)}
