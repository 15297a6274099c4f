"""What a pump's history remembers of faults that are gone: they came and went, or ended with something that was done."""

from dataclasses import dataclass, replace
from datetime import datetime

from detectors.words.states import State
from detectors.words.verdict import Intermittent, Resolved

EXCHANGED = "pump_exchanged"
"""Word for an exchange beside the actions that can be entered."""
_LEAST_RECORDS = 3
"""Records on which a fault showed below which nothing is remembered (our choice: an alarm takes as many to be raised)."""


_NO_ALARM = (None, None, 0, 0)


@dataclass(frozen=True, slots=True)
class Showing:
    """Whether a fault shows on a record, and on how many of how many records just before it showed as well."""

    now: bool
    before: int = 0
    asked: int = 0


ON_THIS_RECORD = Showing(True)
"""A fault that does not come and go shows on every record of its alarm."""


@dataclass(frozen=True, slots=True)
class Entry:
    """What was done last, and when: the actions of one day are one entry."""

    actions: tuple[str, ...]
    at: datetime

    @property
    def words(self) -> str:
        """The actions in the order of the alphabet, joined by ``+``."""
        return "+".join(sorted(set(self.actions)))


@dataclass(frozen=True, slots=True)
class Memory:
    """Alarms so far.

    ``suspect`` leads the alarm that stands, which began ``since``; it has ``shown`` on so many of the ``standing`` records
    since it showed first. ``past`` is what came and went before, with the records on which it showed, and ``asked`` counts
    records since it came first.
    """

    suspect: State | None = None
    since: datetime | None = None
    shown: int = 0
    standing: int = 0
    past: State | None = None
    past_since: datetime | None = None
    past_shown: int = 0
    asked: int = 0
    entry: Entry | None = None
    resolved: Resolved | None = None

    def done(self, action: str, at: datetime) -> "Memory":
        """Something was done."""
        same_day = self.entry is not None and self.entry.at.date() == at.date()
        earlier = self.entry.actions if same_day and self.entry is not None else ()
        return replace(self, entry=Entry((*earlier, action), at))

    def moved(self) -> "Memory":
        """In another aircraft: what was suspected may have stayed behind, which is no coming and going."""
        return replace(self, suspect=None, since=None, shown=0, standing=0)

    def ended(self, state: State) -> "Memory":
        """A fault has ended with the last entry: it is explained and no longer one that comes and goes."""
        if self.entry is None:
            return self
        found = Resolved(state, self.entry.words, self.entry.at)
        return replace(self, suspect=None, since=None, shown=0, standing=0, resolved=found)

    def after(self, leader: State | None, at: datetime, showing: Showing = ON_THIS_RECORD) -> "Memory":
        """After a record with an alarm led by ``leader``, or with none; ``showing`` says on which records that shows."""
        asked = self.asked + (self.past is not None)
        if (
            leader is None
            and asked == self.asked
            and (self.suspect, self.since, self.shown, self.standing) == _NO_ALARM
        ):
            return self
        if leader is not None:
            began = self.suspect is not None
            shown = (self.shown if began else showing.before) + showing.now
            standing = (self.standing if began else showing.asked) + 1
            since = self.since or at
            return replace(self, suspect=leader, since=since, shown=shown, standing=standing, asked=asked)
        if self.suspect is None or self.shown < _LEAST_RECORDS:
            return replace(self, suspect=None, since=None, shown=0, standing=0, asked=asked)
        first = self.past_since if self.past is self.suspect else self.since
        earlier = self.past_shown if self.past is self.suspect else 0
        return replace(
            self,
            suspect=None,
            since=None,
            shown=0,
            standing=0,
            past=self.suspect,
            past_since=first,
            past_shown=earlier + self.shown,
            asked=asked if earlier else self.standing + 1,
        )

    def resolved_where(self, *, healthy: bool) -> Resolved | None:
        """What ended with what was done; an exchange is not said to have ended anything while something is wrong."""
        found = self.resolved
        return None if found is not None and not healthy and EXCHANGED in found.action.split("+") else found

    @property
    def came_and_went(self) -> Intermittent | None:
        """A fault that vanished without anything having been done."""
        if self.past is None or self.past_since is None:
            return None
        return Intermittent(self.past, self.past_shown, max(self.asked, self.past_shown), self.past_since)
