"""One look after another at an inbox: what is complete is sent once, noted, and moved.

The order is the promise: bytes are sent, then the journal notes what the service said, then the file is moved. Whoever is
killed in between sends the same bytes again, which the service knows, or moves what was noted.
"""

import hashlib
import json
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import httpx2

from service.answers.records import Record
from service.client import RefusedError
from service.inbox.journal import Entry, Journal
from service.inbox.place import DONE, PROBLEM, REFUSED, Look, Place, target_of

Send = Callable[[str, bytes], Record]
"""Sends one file by name and bytes: the service's answer."""
LONGEST_WAIT_S = 300.0
_LATER = frozenset({408, 425, 429})
_OURS = frozenset({401, 403, 404, 405, 428})
"""What a file cannot mend: the key, the address or the mapping is wrong."""


class WrongSetUpError(Exception):
    """The service refuses whoever asks, not the file."""


@dataclass(frozen=True, slots=True)
class Event:
    """What became of one file, or of a look.

    Attributes
    ----------
    kind
        ``stored``, ``refused``; ``waiting`` for a file that could not be read, ``delayed`` where the service or
        the store does not answer, ``passed over`` for a file of no known type.
    name
        Of the file; empty for ``delayed``.
    words
        Why, for people.
    answer
        The service's, or None.
    problem
        Problem document of a refusal, or None.
    """

    kind: Literal["stored", "refused", "waiting", "delayed", "passed over"]
    name: str
    words: str = ""
    answer: Record | None = None
    problem: Any = None


@dataclass(frozen=True, slots=True)
class Rules:
    """How an inbox is watched.

    Attributes
    ----------
    settle_s
        How long a file's size and time of change must have stayed before it is complete [s].
    marker
        Suffix of a file beside it that says so instead, e.g. ``.ok``; None: none is needed.
    leave
        Whether files stay where they are; the journal alone then remembers them.
    """

    settle_s: float = 5.0
    marker: str | None = None
    leave: bool = False


@dataclass
class Inbox:
    """One inbox at work.

    Attributes
    ----------
    place, journal, send, rules
        What it looks at, remembers with, sends through, and goes by.
    now
        A clock [s] that goes on over restarts.
    unsettled
        Files that the last look found and that are not complete yet.
    """

    place: Place
    journal: Journal
    send: Send
    rules: Rules = field(default_factory=Rules)
    now: Callable[[], float] = time.time
    unsettled: int = 0
    _told: set[tuple[str, str]] = field(default_factory=set)

    def look(self) -> Iterator[Event]:
        """Take what is complete.

        Raises
        ------
        WrongSetUpError
            when no file can be sent as things are.
        """
        self.unsettled = 0
        try:
            found = self.place.look()
        except OSError as error:
            yield Event("delayed", "", f"the inbox cannot be listed: {error}")
            return
        for name in found.passed_over:
            if not self._is_marker(name) and self._is_news(name, "passed over"):
                yield Event("passed over", name, "is of no known type")
        for name, state in list(found.states.items()):
            noted = self.journal.entry(name, state)
            if noted is not None and (self.rules.leave or not noted.put_away):
                self._put_away(noted)
                del found.states[name]
        complete = self._complete(found)
        self.unsettled = len(found.states) - len(complete) + len(found.empty)
        for name in complete:
            event = self._taken(name, found.states[name])
            if event is None:
                continue
            yield event
            if event.kind == "delayed":
                return

    def _complete(self, found: Look) -> list[str]:
        now = self.now()
        since = self.journal.steady_since(found.states, now)
        if self.rules.marker is not None:
            return [name for name in found.states if f"{name}{self.rules.marker}" in found.markers]
        # a clock that was set back would keep a file waiting for ever
        return [n for n in found.states if not 0.0 <= now - since[n] < self.rules.settle_s]

    def _is_marker(self, name: str) -> bool:
        return self.rules.marker is not None and name.endswith(self.rules.marker)

    def _is_news(self, name: str, what: str) -> bool:
        is_news = (name, what) not in self._told
        self._told.add((name, what))
        return is_news

    def _taken(self, name: str, state: str) -> Event | None:
        """Send one file; None where there is nothing to tell."""
        try:
            content = self.place.read(name)
        except FileNotFoundError:
            return None
        except OSError as error:
            self.unsettled += 1
            return Event("waiting", name, f"cannot be read: {error}") if self._is_news(name, state) else None
        if self.place.state(name) != state:  # it grew while it was read
            self.unsettled += 1
            return None
        return self._sent(Entry(name, state, "stored", hashlib.sha256(content).hexdigest(), None, None, None), content)

    def _sent(self, entry: Entry, content: bytes) -> Event | None:
        try:
            answer = self.send(entry.name, content)
        except RefusedError as error:
            status = error.problem.get("status", 500)
            if status in _OURS:
                raise WrongSetUpError(str(error)) from None
            if status >= 500 or status in _LATER:
                return Event("delayed", "", f"the service does not take records now: {error}")
            refusal = replace(entry, outcome="refused", problem=json.dumps(error.problem))
            self._settle(refusal)
            return Event("refused", entry.name, str(error), problem=error.problem)
        except httpx2.HTTPError as error:
            return Event("delayed", "", f"the service does not answer ({type(error).__name__}: {error})")
        done = replace(entry, record_id=answer["record_id"])
        self._settle(done)
        return Event(done.outcome, entry.name, answer=answer)

    def _settle(self, entry: Entry) -> None:
        """Note what became of a file, then move it."""
        if not self.rules.leave:
            folder = REFUSED if entry.outcome == "refused" else DONE
            target = target_of(entry.name, folder, entry.digest, taken=False)
            if self.place.state(target) is not None:
                target = target_of(entry.name, folder, entry.digest, taken=True)
            entry = replace(entry, target=target)
        else:
            entry = replace(entry, put_away=True)
        self.journal.note(entry)
        self._put_away(entry)

    def _put_away(self, entry: Entry) -> None:
        if entry.target is None or entry.put_away:
            return
        if entry.problem is not None:
            document = json.dumps(json.loads(entry.problem) | {"file": entry.name}, indent=1)
            self.place.write(f"{entry.target}{PROBLEM}", document.encode())
        if self.rules.marker is not None:  # before its file: alone it would make the next of this name complete
            self.place.move(f"{entry.name}{self.rules.marker}", f"{entry.target}{self.rules.marker}")
        self.place.move(entry.name, entry.target)
        self.journal.note(replace(entry, put_away=True))


def waits(interval_s: float) -> Iterator[float]:
    """Seconds until the next look while the service or the store does not answer: doubled each time, up to a bound."""
    wait = interval_s
    while True:
        yield wait
        wait = min(2.0 * wait, max(LONGEST_WAIT_S, interval_s))
