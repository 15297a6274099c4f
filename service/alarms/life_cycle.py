"""The life of a pump's alarms: a pure function of its assessments in event order and of what operators did.

The words are those of ISA-18.2: an alarm's condition is active or cleared, it is acknowledged or not, it can be
shelved for a limited time, on-delay and off-delay keep it from chattering, and an escalation asks for attention anew.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime

from detectors.words.states import QUIET, Side, State, row_of
from service.answers.alarms import AlarmEvent

PRIORITIES: tuple[str, ...] = ("low", "medium", "high", "critical")
"""Rising order. Sensors are low, what cannot be told yet is medium, a named fault is high (``detectors.words.states``);
wear beyond the pump type's limit is critical, and so is case pressure beyond its plain rule, whatever the verdict."""
CASE_PRESSURE = "case over reservoir pressure is at twice its own reference or beyond its limit"
"""What an alarm's history says of the plain rule, which accuses nobody."""
ACKNOWLEDGE, SHELVE, UNSHELVE, CLOSE = "acknowledge", "shelve", "unshelve", "close"
COMMENT, PLAN = "comment", "plan"
"""What is done beside the life of an alarm: a word about it; who sees to it, until when and under which work order."""
_SAID = {
    ACKNOWLEDGE: "acknowledged", SHELVE: "shelved", UNSHELVE: "unshelved", CLOSE: "closed", COMMENT: "commented",
    PLAN: "planned",
}  # fmt: skip
_UNNAMED = (*QUIET, State.INDETERMINATE)


@dataclass(frozen=True, slots=True)
class Point:
    """What an alarm needs of one assessment; ``case_flow_lpm`` is the case flow at the reference condition.

    ``case_pressure_beyond`` is the plain rule's word (``detectors.words.verdict.CasePressure``).
    """

    record_id: str
    at: datetime
    flight_id: str
    state: str
    side: str
    candidates: tuple[str, ...] = ()
    case_flow_lpm: float | None = None
    case_pressure_beyond: bool = False

    @property
    def is_faulty(self) -> bool:
        """True where the verdict names a fault or cannot tell, and where the case pressure is beyond its rule."""
        return self.state not in QUIET or self.case_pressure_beyond

    @property
    def where_to_look(self) -> str:
        """Side of the verdict; ``unknown`` where it names none and something is wrong all the same."""
        return Side.UNKNOWN.value if self.side == Side.NONE and self.case_pressure_beyond else self.side


@dataclass(frozen=True, slots=True)
class Plan:
    """Who sees to an alarm, until when, and the number of the work order elsewhere; None where nobody said."""

    assignee: str | None = None
    due_at: datetime | None = None
    work_order: str | None = None


NO_PLAN = Plan()


@dataclass(frozen=True, slots=True)
class Action:
    """What somebody did, and what there was to see then; ``number`` orders actions of the same moment."""

    number: int
    kind: str
    by: str
    reason: str | None
    until: datetime | None
    onset_at: datetime
    seen_at: datetime
    seen_state: str
    seen_priority: str
    done_at: datetime
    plan: Plan = NO_PLAN


@dataclass(frozen=True, slots=True)
class Rules:
    """Delays and limits, from the pump's thresholds."""

    on_flights: int
    off_flights: int
    limit_lpm: float
    limit_off_lpm: float


@dataclass(frozen=True, slots=True)
class Life:
    """One alarm from its onset on.

    ``onset_at`` is the first record of the unbroken run that raised it at ``raised_at``; ``cleared_at`` is None while
    its condition is active. ``history`` lists what happened, in order.
    """

    onset_at: datetime
    raised_at: datetime
    record_id: str
    state: str
    side: str
    candidates: tuple[str, ...]
    priority: str
    beyond_limit: bool
    case_pressure_beyond: bool = False
    cleared_at: datetime | None = None
    acknowledged: bool = False
    shelved_until: datetime | None = None
    closed_at: datetime | None = None
    plan: Plan = NO_PLAN
    comments: int = 0
    history: tuple[AlarmEvent, ...] = field(default=())

    def covers(self, instant: datetime) -> bool:
        """True when the instant lies between onset and clearance."""
        return self.onset_at <= instant and (self.cleared_at is None or instant <= self.cleared_at)

    def overlaps(self, start: datetime, end: datetime | None) -> bool:
        """True when it shares an instant with a stretch; an ``end`` of None is open."""
        return (end is None or self.onset_at <= end) and (self.cleared_at is None or start <= self.cleared_at)


def rules_of(thresholds: Mapping[str, float]) -> Rules:
    """Delays and limits of a pump's effective thresholds."""
    limit = thresholds["case_flow_limit_lpm"]
    return Rules(
        on_flights=int(thresholds["alarm_on_delay_flights"]),
        off_flights=int(thresholds["alarm_off_delay_flights"]),
        limit_lpm=limit,
        limit_off_lpm=limit * (1.0 - thresholds["alarm_limit_hysteresis_percent"] / 100.0),
    )


def lives(points: Sequence[Point], actions: Sequence[Action], rules: Rules) -> tuple[Life, ...]:
    """Every alarm of a pump, oldest first.

    Parameters
    ----------
    points
        The pump's assessments in event order.
    actions
        What operators did about its alarms, in any order. Each belongs to the alarm that covers the onset it was
        meant for, or else overlaps what was seen; one that finds none has no effect.
    rules
        Delays and limits.
    """
    episodes = _episodes(points, rules)
    mine = _assigned(actions, [e.life for e in episodes])
    return tuple(_lived(e, mine.get(i, [])) for i, e in enumerate(episodes))


@dataclass(slots=True)
class _Episode:
    """A stretch of active condition: its alarm as raised, and the levels that followed."""

    life: Life
    levels: list[tuple[Point, bool]]
    end: Point | None = None
    new_baseline: bool = False


def _episodes(points: Sequence[Point], rules: Rules) -> list[_Episode]:
    found: list[_Episode] = []
    open_: _Episode | None = None
    rising: list[Point] = []
    calm: set[str] = set()
    beyond = False
    for point in points:
        beyond = _beyond(point, beyond, rules)
        if open_ is None:
            rising = [*rising, point] if point.is_faulty else []
            # the plain rule waits for no second flight
            if len({p.flight_id for p in rising}) >= rules.on_flights or point.case_pressure_beyond:
                open_ = _Episode(_raised(rising[0], point, beyond), [(point, beyond)])
                found.append(open_)
                rising, calm = [], set()
        elif point.is_faulty:
            calm = set()
            open_.levels.append((point, beyond))
        else:
            calm.add(point.flight_id)
            # a new baseline says nothing about the old one: its alarm ends here
            new = point.state == "insufficient_data" and open_.levels[-1][0].state != "insufficient_data"
            if len(calm) >= rules.off_flights or new:
                open_.end, open_.new_baseline = point, new
                open_.life = replace(open_.life, cleared_at=point.at)
                open_ = None
    return found


def _beyond(point: Point, before: bool, rules: Rules) -> bool:
    if point.state != "pump_degradation" or point.case_flow_lpm is None:
        return False
    return point.case_flow_lpm > (rules.limit_off_lpm if before else rules.limit_lpm)


def _priority(point: Point, beyond_limit: bool) -> str:
    """Priority of a verdict's state; critical beyond either limit."""
    if beyond_limit or point.case_pressure_beyond:
        return "critical"
    return row_of(point.state).priority or PRIORITIES[0]


def _raised(first: Point, point: Point, beyond: bool) -> Life:
    return Life(
        onset_at=first.at,
        raised_at=point.at,
        record_id=first.record_id,
        state=point.state,
        side=point.where_to_look,
        candidates=point.candidates,
        priority=_priority(point, beyond),
        beyond_limit=beyond,
        case_pressure_beyond=point.case_pressure_beyond,
    )


def _assigned(actions: Sequence[Action], alarms: Sequence[Life]) -> dict[int, list[Action]]:
    mine: dict[int, list[Action]] = {}
    for action in sorted(actions, key=lambda a: a.number):
        places = [i for i, a in enumerate(alarms) if a.covers(action.onset_at)]
        places += [i for i, a in enumerate(alarms) if a.overlaps(action.onset_at, action.seen_at)]
        if places:
            mine.setdefault(places[0], []).append(action)
    return mine


@dataclass(slots=True)
class _Attention:
    """The most urgent priority and the state that somebody has dealt with, and whether case pressure was seen beyond."""

    rank: int = -1
    state: str = ""
    case_pressure: bool = False


def _lived(episode: _Episode, actions: Sequence[Action]) -> Life:
    """Play levels and actions in event order; an action follows the records that were known when it was done."""
    waiting = list(actions)
    known = _Attention()
    life = episode.life
    for i, (point, beyond) in enumerate(episode.levels):
        why = CASE_PRESSURE if point.case_pressure_beyond else None
        life = _levelled(life, point, beyond, known) if i else _noted(life, "raised", point, reason=why)
        following = episode.levels[i + 1][0].at if i + 1 < len(episode.levels) else None
        if following is None:
            break
        # the history of a pump may have changed since: what was done before the alarm now begins counts at its start
        due = [a for a in waiting if max(a.seen_at, life.raised_at) < following]
        waiting = [a for a in waiting if a not in due]
        for action in due:
            life = _acted(life, action, known)
    if episode.end is not None:
        before = [a for a in waiting if a.seen_at < episode.end.at]
        waiting = [a for a in waiting if a not in before]
        for action in before:
            life = _acted(life, action, known)
        why = "a new baseline began" if episode.new_baseline else None
        life = _noted(life, "cleared", episode.end, reason=why)
    for action in waiting:
        life = _acted(life, action, known)
    return life


def _levelled(life: Life, point: Point, beyond: bool, known: _Attention) -> Life:
    priority = _priority(point, beyond)
    rank, before = PRIORITIES.index(priority), PRIORITIES.index(life.priority)
    changed = point.state != life.state
    pressed = point.case_pressure_beyond and not life.case_pressure_beyond
    why = CASE_PRESSURE if pressed else None
    said = (point.state, point.where_to_look, point.candidates, priority, beyond, point.case_pressure_beyond)
    if said != (life.state, life.side, life.candidates, life.priority, life.beyond_limit, life.case_pressure_beyond):
        life = replace(
            life,
            state=point.state,
            side=point.where_to_look,
            candidates=point.candidates,
            priority=priority,
            beyond_limit=beyond,
            case_pressure_beyond=point.case_pressure_beyond,
        )
    if rank > before:
        life = _noted(life, "escalated", point, reason=why)
    elif changed or pressed or rank < before:
        life = _noted(life, "changed", point, reason=why)
    renamed = changed and point.state not in _UNNAMED and known.state not in ("", *_UNNAMED, point.state)
    handled = life.acknowledged or life.shelved_until is not None or life.closed_at is not None
    unseen = (renamed and rank == known.rank) or (pressed and not known.case_pressure)
    if handled and (rank > known.rank or unseen):
        life = replace(life, acknowledged=False, shelved_until=None, closed_at=None)
        life = _noted(life, "reopened", point)
    return life


def _acted(life: Life, action: Action, known: _Attention) -> Life:
    if action.kind in (COMMENT, PLAN):
        return _told(life, action)
    rank = PRIORITIES.index(action.seen_priority)
    # somebody who saw less than there now is has not dealt with it
    covers = rank >= PRIORITIES.index(life.priority)
    known.rank = max(known.rank, rank)
    known.state = action.seen_state
    known.case_pressure |= covers and life.case_pressure_beyond
    if action.kind == ACKNOWLEDGE and covers:
        life = replace(life, acknowledged=True)
    elif action.kind == SHELVE and covers:
        life = replace(life, shelved_until=action.until)
    elif action.kind == UNSHELVE:
        life = replace(life, shelved_until=None)
    elif action.kind == CLOSE and covers:
        life = replace(life, closed_at=action.done_at, acknowledged=True, shelved_until=None)
    entry: AlarmEvent = {
        "event": _SAID[action.kind],
        "at": _text(action.done_at),
        "by": action.by,
        "reason": action.reason,
        "until": _text(action.until),
        "effective": covers or action.kind == UNSHELVE,
    }
    return replace(life, history=(*life.history, entry))


def _told(life: Life, action: Action) -> Life:
    """A comment or a plan: it says that somebody looks after the alarm, not that the alarm has been dealt with."""
    entry: AlarmEvent = {
        "event": _SAID[action.kind], "at": _text(action.done_at), "by": action.by, "reason": action.reason
    }  # fmt: skip
    if action.kind == COMMENT:
        return replace(life, comments=life.comments + 1, history=(*life.history, entry))
    plan = action.plan
    entry |= {"assignee": plan.assignee, "due_at": _text(plan.due_at), "work_order": plan.work_order}
    return replace(life, plan=plan, history=(*life.history, entry))


def _noted(life: Life, event: str, point: Point, reason: str | None = None) -> Life:
    entry: AlarmEvent = {
        "event": event,
        "at": _text(point.at),
        "record_id": point.record_id,
        "state": point.state,
        "priority": life.priority,
        "reason": reason,
    }
    return replace(life, history=(*life.history, entry))


def _text(instant: datetime | None) -> str | None:
    return None if instant is None else instant.isoformat().replace("+00:00", "Z")
