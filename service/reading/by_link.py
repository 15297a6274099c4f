"""What follows from a pump's history alone, read once for every state of that history and kept in this process.

An assessment carries its link in the chain of all that it was folded from (``service.monitoring.chain``). Whatever changes a
history changes its last link, in this process or in another one: a later question asks the database for links only.
"""

from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from threading import Lock
from typing import Generic, TypeVar

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.reading import queries
from service.storage.tables import StoredAssessment

Held = TypeVar("Held")
_Key = tuple[str, str, int, str, str]


class ByLink(Generic[Held]):
    """Values by pump and last link, the longest unused of ``most`` forgotten first."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._kept: OrderedDict[_Key, Held] = OrderedDict()
        self._lock = Lock()

    def of(
        self, session: Session, pump_ids: Sequence[int], read: Callable[[list[int]], Mapping[int, Held]], what: str = ""
    ) -> dict[int, Held]:
        """Value of each pump that has one; ``read`` gives those of pumps that are not known as they are now.

        ``what`` tells questions apart that are kept together, such as metrics. A pump whose newest assessment has no link
        is read every time.
        """
        place = str(session.get_bind().engine.url)
        keys: dict[int, _Key | None] = {
            pump_id: None if chain is None else (place, what, pump_id, record_id, chain)
            for pump_id, record_id, chain in _links(session, pump_ids)
        }
        with self._lock:
            found = {i: self._kept[key] for i, key in keys.items() if key is not None and key in self._kept}
            for key in filter(None, (keys[i] for i in found)):
                self._kept.move_to_end(key)
        unknown = [i for i in keys if i not in found]
        if unknown:
            anew = read(unknown)
            with self._lock:
                self._kept.update({key: anew[i] for i, key in keys.items() if key is not None and i in anew})
                while len(self._kept) > self._most:
                    self._kept.popitem(last=False)
            found.update(anew)
        return found


def _links(session: Session, pump_ids: Sequence[int]) -> list[tuple[int, str, str | None]]:
    """Pump, record and link of the newest assessment of each pump that has one."""
    kept = StoredAssessment
    query = select(kept.pump_id, kept.record_id, kept.chain).where(kept.record_id.in_(queries.newest_records(pump_ids)))
    return [(pump_id, record_id, chain) for pump_id, record_id, chain in session.execute(query)]
