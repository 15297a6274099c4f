"""A pump folded: what its verdicts shall be, made from what a session reads, and stored by whoever holds the pump's lock."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from opentelemetry import trace
from prometheus_client import Histogram
from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from detectors.judgement.succession import Place, Seat
from detectors.words.verdict import Assessment
from service.alarms.ledger import actions_of, follow, point_of_row
from service.alarms.life_cycle import Life, Point, lives, rules_of
from service.history.analysis import keep_analysis
from service.history.archive import Archive
from service.history.codec import trend_to_json, verdict_to_json
from service.history.dossier import ChangedError, Dossier
from service.history.knowledge import AnyRow, Incoming, Knowledge, knowledge
from service.history.known import Known, PlacedRecord
from service.identity import software
from service.monitoring import snapshots
from service.monitoring.chain import chain
from service.monitoring.fold import Start, Step, steps
from service.monitoring.snapshots import Kept
from service.monitoring.succession import Neighbourhood, seats_of_known
from service.reading.silence import NEWEST_RECORDS
from service.reading.standing import Newest, Standing, standing
from service.storage.tables import Pump, Record, StoredAssessment, VerdictRevision

_tracer = trace.get_tracer("casedrain")
_FOLD_SECONDS = Histogram("casedrain_fold_seconds", "Time to fold a pump's history anew")
_MOST_IDS = 500
"""Ids of one query: SQLite allows 999 bound values in old builds."""
MOST_AT_ONCE = 48
"""Records behind one that came late whose verdicts are made before it is answered; of more, right after it (our choice)."""


class GivenUpError(Exception):
    """Nobody wants a fold any more that is being made."""


@dataclass(frozen=True, slots=True)
class Cause:
    """Why a pump is folded anew: ``record_received``, ``installation_changed`` …, and the id of what came."""

    kind: str
    id: str | None = None


@dataclass(frozen=True, slots=True)
class Folded:
    """What a pump's stored verdicts become.

    Attributes
    ----------
    found
        What is known of the pump.
    links
        Its chain, a link per record.
    assessments
        Rows that are new, or take the place of ``gone`` ones, by record.
    before
        Instant and state of those that go, by record.
    seats
        Where the pump's records lay by what was stored.
    alone_at
        Where its records lay and lie, if no other pump was ever seen there; empty otherwise.
    kept
        Snapshots.
    alarms
        Alarms of the whole history; None where they are to be made from what is stored then.
    has_alarms
        Whether the pump may have stored ones.
    is_whole
        False where verdicts of records behind these are left to be made.
    standing
        How the pump stands by its newest record; None without one, or where verdicts are left to be made.
    """

    found: Knowledge
    links: Sequence[str]
    assessments: Sequence[StoredAssessment]
    before: Mapping[str, tuple[datetime, str]]
    seats: Sequence[Seat]
    alone_at: frozenset[Place]
    goes_whole: bool
    kept: Kept
    alarms: tuple[Life, ...] | None
    has_alarms: bool
    is_whole: bool
    standing: Standing | None


def folded(
    session: Session,
    pump: Pump,
    archive: Archive,
    dossier: Dossier | None = None,
    incoming: Incoming | None = None,
    *,
    from_scratch: bool = False,
    given_up: Callable[[], bool] = lambda: False,
) -> Folded:
    """Fold a pump's history as a session sees it; nothing is written.

    Records whose thresholds, surroundings or pump type changed are analysed anew. Assessments before the first change stay
    as they are, and the fold begins at the newest snapshot before it.

    Parameters
    ----------
    dossier
        What was read of the pump already.
    incoming
        A record that counts as if it were analysed. Where many follow it, those are left: see ``MOST_AT_ONCE``.
    from_scratch
        Trust neither snapshots nor stored assessments.
    given_up
        Asked between two records.

    Raises
    ------
    Unavailable
        when a record must be analysed anew and its raw bytes are gone.
    ChangedError
        when a verdict that holds is no longer stored: somebody else has folded the pump meanwhile.
    GivenUpError
        when ``given_up`` has said so.
    """
    with _FOLD_SECONDS.time(), _tracer.start_as_current_span("fold"):
        return _folded(session, pump, archive, dossier, incoming, from_scratch=from_scratch, given_up=given_up)


def _folded(
    session: Session,
    pump: Pump,
    archive: Archive,
    dossier: Dossier | None,
    incoming: Incoming | None,
    *,
    from_scratch: bool,
    given_up: Callable[[], bool],
) -> Folded:
    here = Neighbourhood(session, archive)
    found = here.of(pump, knowledge(session, pump, archive, dossier=dossier, incoming=incoming))
    version = found.twin_version
    links = chain(found.known, version, found.thresholds.version)
    stored = _stored(session, pump)
    same = 0 if from_scratch else _unchanged(found.known, links, stored)
    placed = found.known.placed
    end = _end(placed, incoming, same)
    known_ids = {p.outline.record_id for p in placed}
    gone = {i for i in stored if i not in known_ids} | {i for i in _ids(placed, same, end) if i in stored}
    made: list[Assessment] = []
    kept = Kept()
    if same < len(links):
        start = None if from_scratch else snapshots.start_of(session, pump.id, found.known, links, same)
        made, taken = _made(session, found, start, (same, end, len(links)), given_up)
        kept = snapshots.kept_of(session, pump.id, links, start, taken, appended=same >= len(stored))
    outlines, made_by = {p.outline.record_id: p.outline for p in placed}, software().to_json()
    rows = [
        StoredAssessment(
            record_id=a.record_id,
            pump_id=pump.id,
            at=a.at,
            aircraft=outlines[a.record_id].aircraft,
            position=outlines[a.record_id].position,
            state=a.verdict.state.value,
            trend=trend_to_json(a.trend),
            verdict=verdict_to_json(a.verdict, version, found.thresholds.version, made_by),
            chain=link,
        )
        for a, link in zip(made, links[same:end], strict=True)
    ]
    is_whole = end == len(links)
    seats = [Seat(row.at, i, pump.id, (row.aircraft, row.position)) for i, row in stored.items()]
    places = frozenset(seat.place for seat in (*seats, *seats_of_known(pump.id, found.known)))
    return Folded(
        found,
        links,
        rows,
        {i: (stored[i].at, stored[i].state) for i in gone},
        seats,
        places if places and not here.near(pump, places) else frozenset(),
        len(gone) == len(stored),
        kept,
        _alarms(session, pump, found, dossier, [*(stored[i] for i in _ids(placed, 0, same)), *rows])
        if is_whole
        else None,
        dossier is None or dossier.has("alarms"),
        is_whole,
        _standing(session, found, rows) if is_whole else None,
    )


def _standing(session: Session, found: Knowledge, rows: Sequence[StoredAssessment]) -> Standing | None:
    """How the pump stands, by its newest record: the last of ``rows``, or one that is stored already."""
    placed = found.known.placed
    if not placed:
        return None
    last = placed[-1].outline
    verdict: Any = rows[-1].verdict if rows and rows[-1].record_id == last.record_id else None
    if verdict is None:
        kept = select(StoredAssessment.verdict).where(StoredAssessment.record_id == last.record_id)
        verdict = session.scalar(kept)
        if verdict is None:
            raise ChangedError
    newest = Newest(last.record_id, last.aircraft, last.position, last.at, found.flight_hours.get(last.record_id))
    return standing(newest, verdict, len(placed), [p.outline.at for p in placed[-NEWEST_RECORDS:]])


def keep(session: Session, pump: Pump, made: Folded, cause: Cause) -> None:
    """Store what a pump was folded to, with a note of every past verdict that changed; its alarms follow.

    The caller holds the pump's lock, and nothing that the fold rests on has changed since.
    """
    found = made.found
    if found.without_outline:
        for row in session.scalars(select(Record).where(Record.id.in_(found.without_outline))):
            row.reduction = row.reduction  # the row outlines whatever is assigned
    if found.anew:
        for row in session.scalars(select(Record).where(Record.id.in_(found.anew))):
            keep_analysis(row, found.anew[row.id])
    snapshots.keep(session, pump.id, made.links, made.kept)
    _remove(session, pump, made.before, everything=made.goes_whole)
    session.add_all(made.assessments)
    session.add_all(_revisions(pump, made, cause))
    session.flush()
    if made.is_whole and (made.has_alarms or made.alarms is None or made.alarms):
        follow(session, pump, found.thresholds.values, made.alarms)


def _end(placed: Sequence[PlacedRecord], incoming: Incoming | None, same: int) -> int:
    """Number of records up to which verdicts are made now: to the incoming one where too many follow it."""
    if incoming is None or len(placed) - same <= MOST_AT_ONCE:
        return len(placed)
    ids = [p.outline.record_id for p in placed]
    place = ids.index(incoming.record_id) + 1 if incoming.record_id in ids else len(ids)
    return len(placed) if len(placed) - place <= MOST_AT_ONCE else place


def _ids(placed: Sequence[PlacedRecord], first: int, end: int) -> list[str]:
    return [p.outline.record_id for p in placed[first:end]]


def _made(
    session: Session,
    found: Knowledge,
    start: Start | None,
    stretch: tuple[int, int, int],
    given_up: Callable[[], bool],
) -> tuple[list[Assessment], dict[int, Step]]:
    """Assessments behind the first records of a history up to some end, and the snapshots that were left on the way."""
    same, end, n = stretch
    begin = start.records if start else 0
    places = snapshots.wanted(start, end, n)
    assessments: list[Assessment] = []
    taken: dict[int, Step] = {}
    made = steps(found.known, found.observations(session), start, places, found.others, end)
    for number, step in enumerate(made, begin + 1):
        if number > same:
            assessments.append(step.assessment)
        if step.snapshot is not None:
            taken[number] = step
        if given_up():
            raise GivenUpError
    return assessments, taken


def _unchanged(known: Known, links: Sequence[str], stored: Mapping[str, AnyRow]) -> int:
    """Number of records from the first on whose stored assessments still hold."""
    for i, (here, link) in enumerate(zip(known.placed, links, strict=True)):
        row = stored.get(here.outline.record_id)
        if row is None or row.chain != link:
            return i
    return len(links)


_KEPT = (
    StoredAssessment.record_id,
    StoredAssessment.at,
    StoredAssessment.state,
    StoredAssessment.chain,
    StoredAssessment.aircraft,
    StoredAssessment.position,
    StoredAssessment.side,
    StoredAssessment.candidates,
    StoredAssessment.case_flow_lpm,
    StoredAssessment.case_pressure_beyond,
)


def _stored(session: Session, pump: Pump) -> dict[str, AnyRow]:
    return {row.record_id: row for row in session.execute(select(*_KEPT).where(StoredAssessment.pump_id == pump.id))}


def _alarms(
    session: Session,
    pump: Pump,
    found: Knowledge,
    dossier: Dossier | None,
    rows: Sequence[AnyRow | StoredAssessment],
) -> tuple[Life, ...] | None:
    if any(row.side is None for row in rows):  # older than what alarms need
        return None
    flights = {p.outline.record_id: p.outline.flight_id for p in found.known.placed}
    points: list[Point] = [point_of_row(row, flights[row.record_id]) for row in rows]
    has_some = dossier is None or dossier.has("alarms")
    return lives(points, actions_of(session, pump.id) if has_some else (), rules_of(found.thresholds.values))


def _remove(session: Session, pump: Pump, gone: Collection[str], *, everything: bool) -> None:
    """Delete the assessments of some records; in one statement where those are all."""
    if everything and gone:
        session.execute(delete(StoredAssessment).where(StoredAssessment.pump_id == pump.id))
        return
    ids = sorted(gone)
    for start in range(0, len(ids), _MOST_IDS):
        session.execute(delete(StoredAssessment).where(StoredAssessment.record_id.in_(ids[start : start + _MOST_IDS])))


def _revisions(pump: Pump, made: Folded, cause: Cause) -> list[VerdictRevision]:
    """Past verdicts that changed; a record's first verdict is news, not a revision."""
    now = datetime.now(UTC)
    later = {row.record_id: row.state for row in made.assessments}
    return [
        VerdictRevision(
            pump_id=pump.id,
            record_id=record_id,
            at=at,
            old_state=old,
            new_state=later.get(record_id),
            cause=cause.kind,
            cause_id=cause.id,
            changed_at=now,
        )
        for record_id, (at, old) in sorted(made.before.items())
        if later.get(record_id) != old
    ]
