"""What a pump's verdicts take over from the pumps that sat where it sat: who that is, and what their folds hold.

Whom a record takes over from follows from where everybody's records lie. The link of that record's stored verdict names
everything that its own fold rests on, so that a change there is seen here without being looked for.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime

import structlog
from sqlalchemy import ColumnElement, Select, and_, not_, or_, select
from sqlalchemy.orm import Session

from detectors.judgement.assessment import Fold
from detectors.judgement.events import due
from detectors.judgement.handover import FromOthers
from detectors.judgement.snapshot import fold_from
from detectors.judgement.succession import Place, Seat, Sources, sources_of
from detectors.words.observation import Maintenance
from service.errors import Unavailable
from service.history.archive import Archive
from service.history.knowledge import Knowledge, installation_intervals, knowledge, maintenance_of
from service.history.known import ALONE, Known, Others
from service.history.placement import changes
from service.monitoring import snapshots
from service.monitoring.chain import chain
from service.monitoring.fold import steps
from service.monitoring.precedence import made_with
from service.storage.tables import Installation, Pump, Record, StoredAssessment

log = structlog.get_logger("casedrain")


@dataclass(frozen=True, slots=True)
class _Asked(Mapping[str, FromOthers]):
    """What is looked up when it is asked for, never before: a fold asks for nothing that lies behind where it stands."""

    names: Collection[str]
    answer: Callable[[str], FromOthers]

    def __getitem__(self, name: str) -> FromOthers:
        """The answer; raises ``KeyError`` where there is none."""
        if name not in self.names:
            raise KeyError(name)
        return self.answer(name)

    def __iter__(self) -> Iterator[str]:
        """Names with an answer."""
        return iter(self.names)

    def __len__(self) -> int:
        """Their number."""
        return len(self.names)


@dataclass(slots=True)
class Neighbourhood:
    """Pumps of one operator that follow each other, as known now (None) or at an instant.

    What was gathered of a pump is kept, so that each is gathered once.
    """

    session: Session
    archive: Archive
    known_at: datetime | None = None
    _gathered: dict[int, Knowledge] = field(default_factory=dict)
    _seats: dict[int, list[Seat]] = field(default_factory=dict)
    _folds: dict[tuple[int, str], Fold | None] = field(default_factory=dict)
    _quiet: set[frozenset[Place]] = field(default_factory=set)

    def of(self, pump: Pump, found: Knowledge, kind: str | None = None) -> Knowledge:
        """What is known of a pump with whom its records take over from; what they hold is looked up when it is folded.

        ``kind`` is the type that the others have, where that is not the pump's own as it is known.
        """
        own = seats_of_known(pump.id, found.known)
        sources = self.sources(pump, own, kind or found.kind)
        if not sources.wanted():
            return found
        links = self._links(sources.wanted())
        borrowed: dict[str, tuple[object, ...]] = {}
        for seat in own:
            arrival, hindsight = sources.arrivals.get(seat.record_id), sources.hindsights.get(seat.record_id)
            if arrival is None and hindsight is None:
                continue
            done = [] if arrival is None else self._done(arrival, seat.at)
            # entries about this pump between the last record there and its own first one touch the position as well
            done += due(found.known.maintenance, self._seat(arrival).at, seat.at) if arrival and seat is own[0] else []
            entries = tuple((m.at.isoformat(), m.action, m.fluid or "", m.channel or "") for m in done)
            borrowed[seat.record_id] = (links.get(arrival), links.get(hindsight), entries)

        taking = {seat.record_id: seat for seat in own if seat.record_id in borrowed}
        others = _Asked(taking.keys(), lambda i: self._from(found, sources, taking[i]))
        return replace(found, known=replace(found.known, borrowed=borrowed), others=others)

    def sources(
        self,
        pump: Pump,
        own: Sequence[Seat],
        kind: str,
        instead: Mapping[int, Sequence[Seat]] | None = None,
    ) -> Sources:
        """Whom a pump takes over from by where its records lie; ``instead`` holds seats that stand in for those of others."""
        places = {seat.place for seat in own}
        others = self._others_at(pump, kind, places)
        if not others:
            return Sources({}, {})
        there: dict[Place, list[Seat]] = {place: [] for place in places}
        for other in (pump.id, *others):
            seats = own if other == pump.id else (instead or {}).get(other, self.seats_of(other))
            for seat in seats:
                if seat.place in there:
                    there[seat.place].append(seat)
        for seats in there.values():
            seats.sort()
        return sources_of(own, there, changes(installation_intervals(self.session, pump.id, self.known_at)))

    def near(self, pump: Pump, places: Collection[Place]) -> set[int]:
        """Other pumps of the operator that sat at a place, by a record or by an entry; asked once where there are none."""
        wanted = frozenset(places)
        if not any(wanted <= known for known in self._quiet):
            found = neighbours_at(self.session, pump.operator, wanted) - {pump.id}
            if found:
                return found
            self._quiet.add(wanted)
        return set()

    def _others_at(self, pump: Pump, kind: str, places: Collection[Place]) -> list[int]:
        """Other pumps of the same type that sat at a place, by a record or by an entry."""
        ids = self.near(pump, places)
        query = select(Pump.id).where(Pump.id.in_(ids), Pump.pump_type == kind)
        return sorted(self.session.scalars(query)) if ids else []

    def seats_of(self, pump_id: int) -> list[Seat]:
        """Where the records of another pump lie: as its stored verdicts say, or as it was known at an earlier instant."""
        if pump_id not in self._seats:
            if self.known_at is not None:
                self._seats[pump_id] = seats_of_known(pump_id, self._knowledge(pump_id).known)
            else:
                row = StoredAssessment
                query = select(row.at, row.record_id, row.aircraft, row.position).where(row.pump_id == pump_id)
                found = self.session.execute(query)
                self._seats[pump_id] = sorted(Seat(r.at, r.record_id, pump_id, (r.aircraft, r.position)) for r in found)
        return self._seats[pump_id]

    def _seat(self, source: tuple[int, str]) -> Seat:
        return next(s for s in self.seats_of(source[0]) if s.record_id == source[1])

    def _links(self, wanted: Iterable[tuple[int, str]]) -> dict[tuple[int, str] | None, str | None]:
        """Links of the stored verdicts that are taken over from; none at an earlier instant, where nothing is stored."""
        if self.known_at is not None:
            return {}
        row = StoredAssessment
        query = select(row.pump_id, row.record_id, row.chain).where(row.record_id.in_([i for _, i in wanted]))
        return {(r.pump_id, r.record_id): r.chain for r in self.session.execute(query)}

    def _from(self, found: Knowledge, sources: Sources, seat: Seat) -> FromOthers:
        """What one record takes over."""
        arrival, hindsight = sources.arrivals.get(seat.record_id), sources.hindsights.get(seat.record_id)
        handover = None
        if arrival is not None:
            before = self._fold_behind(arrival)
            if before is not None and _same_surroundings(before, found.known, seat.record_id):
                handover = before.handover(self._done(arrival, seat.at))
        after = None if hindsight is None else self._fold_behind(hindsight)
        return FromOthers(handover, None if after is None else after.survival())

    def _done(self, source: tuple[int, str], until: datetime) -> list[Maintenance]:
        """Entries about the pump that left, between its last record there and the next pump's first, or its own next one."""
        last = self._seat(source)
        later = [seat.at for seat in self.seats_of(source[0]) if seat > last]
        return due(maintenance_of(self.session, source[0], self.known_at), last.at, min([until, *later[:1]]))

    def _knowledge(self, pump_id: int) -> Knowledge:
        if pump_id not in self._gathered:
            pump = self.session.get_one(Pump, pump_id)
            self._gathered[pump_id] = knowledge(self.session, pump, self.archive, self.known_at)
        return self._gathered[pump_id]

    def _fold_behind(self, source: tuple[int, str]) -> Fold | None:
        """A fold that is looked at and left as it is, made once; None where it cannot be made now.

        A pump whose raw bytes are gone while its records would have to be read again holds up no other pump.
        """
        if source not in self._folds:
            try:
                self._folds[source] = self._folded(*source)
            except Unavailable as problem:
                log.warning("nothing is taken over", pump_id=source[0], problem=problem.detail)
                self._folds[source] = None
        return self._folds[source]

    def _folded(self, pump_id: int, record_id: str) -> Fold | None:
        """A pump's fold behind one of its records, from the newest snapshot before it that holds; None where it has none."""
        pump = self.session.get_one(Pump, pump_id)
        found = self.of(pump, self._knowledge(pump_id))
        known = found.known
        number = next((i for i, p in enumerate(known.placed, 1) if p.outline.record_id == record_id), 0)
        if not number:
            return None
        start = None
        if self.known_at is None:
            links = chain(known, found.twin_version, found.thresholds.version)
            start = snapshots.start_of(self.session, pump_id, known, links, number)
        if start is not None and start.records == number:
            return start.fold
        begin = start.records if start else 0
        for n, step in enumerate(
            steps(known, found.observations(self.session), start, {number}, found.others), begin + 1
        ):
            if n == number and step.snapshot is not None:
                setting = known.placed[number - 1].setting
                kind, healthy = setting.pump_type(known.kind), known.healthy_in(setting)
                return fold_from(step.snapshot, kind, setting.circuit_parameters, known.thresholds, healthy)
        return None


def with_neighbours(
    session: Session,
    pump: Pump,
    archive: Archive,
    found: Knowledge,
    known_at: datetime | None = None,
    *,
    kind: str | None = None,
) -> Knowledge:
    """What is known of a pump with what it takes over from others, as ``Neighbourhood.of`` gives it."""
    return Neighbourhood(session, archive, known_at).of(pump, found, kind)


def taken_over(session: Session, pump: Pump, archive: Archive) -> Others:
    """What a pump's records take over from others, for a picture: nothing as long as older code has judged it."""
    if pump.made_with != made_with():
        return ALONE
    row = StoredAssessment
    sat = session.execute(select(row.aircraft, row.position).where(row.pump_id == pump.id).distinct())
    if neighbours_at(session, pump.operator, {(s.aircraft, s.position) for s in sat}) <= {pump.id}:
        return ALONE
    return with_neighbours(session, pump, archive, knowledge(session, pump, archive)).others


def neighbours_at(session: Session, operator: str, places: Collection[Place]) -> set[int]:
    """Pumps of an operator with a record or an entered installation at one of some places, whether they count or not."""
    if not places:
        return set()
    recorded, entered = _sat_at(operator, places)
    return {pump_id for pump_id in session.scalars(recorded.union(entered)) if pump_id is not None}


def nobody_else_at(pump: Pump, places: Collection[Place]) -> ColumnElement[bool]:
    """Condition under which no other pump of a pump's operator has sat at one of some places."""
    recorded, entered = _sat_at(pump.operator, places)
    return and_(
        not_(recorded.where(Record.pump_id != pump.id).exists()),
        not_(entered.where(Installation.pump_id != pump.id).exists()),
    )


def _sat_at(operator: str, places: Collection[Place]) -> tuple[Select[int | None], Select[int]]:
    """Pumps that sat somewhere by their records, and by what was entered."""
    recorded = or_(*(and_(Record.aircraft == a, Record.position == p) for a, p in sorted(places)))
    entered = or_(*(and_(Installation.aircraft == a, Installation.position == p) for a, p in sorted(places)))
    own = select(Installation.pump_id).join(Pump, Installation.pump_id == Pump.id)
    return (
        select(Record.pump_id).where(Record.operator == operator, Record.pump_id.is_not(None), recorded),
        own.where(Pump.operator == operator, entered),
    )


def successors(
    here: Neighbourhood, pump: Pump, before: Sequence[Seat], after: Sequence[Seat], changed: Collection[str]
) -> set[int]:
    """Other pumps whose verdicts rest on records of a pump whose own have changed or are gone.

    Parameters
    ----------
    before, after
        Where the pump's records lay as its stored verdicts said before the change, and where they lie now.
    changed
        Records whose verdicts were made anew, or are gone.
    """
    touched = [seat for seat in (*before, *after) if seat.record_id in changed]
    others = here.near(pump, {seat.place for seat in touched})
    if not others:
        return set()
    first, found = min(touched), set()
    for other in sorted(others):
        own = here.seats_of(other)
        if not own or own[-1] < first:
            continue
        neighbour = here.session.get_one(Pump, other)
        for seats in (sorted(after), sorted(before)):
            sources = here.sources(neighbour, own, neighbour.pump_type, {pump.id: seats})
            if any((pump.id, record_id) in sources.wanted() for record_id in changed):
                found.add(other)
    return found


def seats_of_known(pump_id: int, known: Known) -> list[Seat]:
    """Where the records of a pump lie."""
    outlines = [p.outline for p in known.placed]
    return [Seat(o.at, o.record_id, pump_id, (o.aircraft, o.position)) for o in outlines]


def _same_surroundings(before: Fold, known: Known, record_id: str) -> bool:
    """Whether a record lies in the circuit and the fluid that a fold before it has learnt in."""
    setting = next(p.setting for p in known.placed if p.outline.record_id == record_id)
    return (
        before.circuit == setting.circuit_parameters
        and before.pump.pump.fluid == setting.pump_type(known.kind).pump.fluid
    )
