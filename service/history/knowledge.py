"""What is known of a pump, now or at an earlier instant, gathered from the database for the fold."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import Any, TypeAlias, TypeVar

from sqlalchemy import ColumnElement, Row, and_, or_, select
from sqlalchemy.orm import Session

from detectors.judgement.version import twin_version
from detectors.words.flights import Outline
from detectors.words.observation import Maintenance, Mark, Observation
from service.answers.documents import JsonObject
from service.answers.records import StoredReduction
from service.history.analysis import RecordAnalysis, analysed, analysis_key, marked_key, observation_at
from service.history.archive import Archive
from service.history.contradictions import COPIED_ELSEWHERE, PLACE_TAKEN, copies, misdated, names_alike, remarks_on
from service.history.dossier import ChangedError, Dossier
from service.history.healthy_curves import healthy_curve
from service.history.known import Known, Observations, Others, PlacedRecord
from service.history.neighbours import copied_elsewhere, counting, look_alikes, place_taken, said_by
from service.history.placement import Interval, Place, changes, place_at
from service.history.setting import Setting, setting_at
from service.history.traits import without_evidence
from service.ingest.decode import DEFAULT_PUMP_TYPE
from service.pump_types.parameter_sets import held_type
from service.storage.tables import (
    Entry,
    Installation,
    MaintenanceEvent,
    Pump,
    Record,
    RecordMark,
    ReductionOutline,
    RegistryVersion,
)
from service.thresholds.layers import Effective, default_thresholds, thresholds_of

AnyEntry = TypeVar("AnyEntry", bound=Entry)
AnyRow: TypeAlias = Row[*tuple[Any, ...]]


@dataclass(frozen=True, slots=True)
class Incoming:
    """A record that is stored and shall count from now on, in place of the one that it ``supersedes``.

    ``analysis`` is what was made of it, where it is at hand.
    """

    record_id: str
    supersedes: str | None = None
    analysis: RecordAnalysis | None = None


@dataclass(frozen=True, slots=True)
class Knowledge:
    """Input of the fold with what the stored verdicts say beside it.

    ``anew`` holds the analyses that differ from the stored ones, by record: other thresholds, surroundings or
    pump type than they were made with. ``flight_hours`` are those of the records that state them. ``copies`` are
    records whose samples are another's, or whose date is wrong, which are evidence of nothing. ``incoming`` is the
    analysis of a record that comes, ``contradicted`` what records of other pumps say against it, ``without_outline``
    are records older than outlines. ``others`` gives what records take over
    from other pumps: nothing until somebody has looked for them (``service.monitoring.succession``).
    """

    known: Known
    kind: str
    thresholds: Effective
    anew: Mapping[str, RecordAnalysis]
    flight_hours: Mapping[str, float]
    copies: frozenset[str]
    incoming: Mapping[str, RecordAnalysis]
    contradicted: tuple[bool, bool]
    without_outline: tuple[str, ...]
    others: Others = field(default_factory=dict)

    def observations(self, session: Session) -> Observations:
        """What reads the observations of records from the database."""
        outlines = {p.outline.record_id: p.outline for p in self.known.placed}

        def read(ids: Sequence[str]) -> Mapping[str, Observation]:
            at_hand = {**self.incoming, **self.anew}
            documents = {i: at_hand[i].reduction for i in ids if i in at_hand}
            stored = _reductions(session, [i for i in ids if i not in at_hand])
            documents |= {i: document for i, document in stored.items() if document is not None}
            found = {i: observation_at(outlines[i], documents[i], self.flight_hours.get(i)) for i in ids}
            again = {
                i: replace(o, reduction=without_evidence(o.reduction)) for i, o in found.items() if i in self.copies
            }
            return found | again

        return read

    @property
    def twin_version(self) -> str:
        """Version of the twin, with that of the measured curve which stands in for it."""
        version = twin_version(self.known.kind)
        return version if self.known.healthy is None else f"{version}+{self.known.healthy.version}"


def knowledge(
    session: Session,
    pump: Pump,
    archive: Archive,
    known_at: datetime | None = None,
    *,
    thresholds: Effective | None = None,
    reduce_anew: bool = False,
    pump_type_name: str | None = None,
    most_anew: int | None = None,
    dossier: Dossier | None = None,
    incoming: Incoming | None = None,
) -> Knowledge:
    """Gather what is known of a pump; no reduction is read that was made as it would be made now.

    Parameters
    ----------
    known_at
        Instant whose knowledge counts; None for now. Records that were superseded or withdrawn later count again,
        and so do entries, thresholds and registry values of that time.
    thresholds
        Thresholds that stand in for the pump's own; None for its own.
    reduce_anew
        Read every record again from its raw bytes, where they are kept.
    pump_type_name
        Parameter set of the twin that stands in for the pump's own; None for its own.
    most_anew
        Stop behind so many new analyses: they are all that is of use then. None for no bound; 0 reads nothing anew and sees
        only that the bytes are there of every record that would have to be.
    dossier
        What was read of the pump already, for knowledge of now: what it has not is not asked for.
    incoming
        A record that counts as if it were analysed.
    """
    revision = select(Pump.revision).where(Pump.id == pump.id).scalar_subquery().label("revision")
    columns = (*_LIGHT, copied_elsewhere(known_at), place_taken(known_at), revision)
    rows = session.execute(select(*columns).where(*_counting(pump.id, known_at, incoming))).all()
    if dossier is not None and rows and rows[0].revision != dossier.pump.revision:
        raise ChangedError
    there = dict(dossier.registry) if dossier else {}
    name, registered = _kind(session, pump, rows, known_at, there.get(("pump", pump.serial)))
    name = pump_type_name or name
    kind = held_type(session, pump.operator, name)
    if thresholds is None:
        thresholds = thresholds_now(session, dossier, name) if dossier else None
        thresholds = thresholds or thresholds_of(session, pump.operator, pump.serial, name, known_at)

    def may_have(what: str) -> bool:
        return dossier is None or dossier.has(what)

    healthy = healthy_curve(session, pump.operator, name, known_at) if may_have("curves") else None
    intervals = installation_intervals(session, pump.id, known_at) if may_have("installations") else []
    placed: list[PlacedRecord] = []
    anew: dict[str, RecordAnalysis] = {}
    aircraft = {registry_name: values for (kind_of, registry_name), values in there.items() if kind_of == "aircraft"}
    keys: dict[Setting, str] = {}
    marks = marks_of(session, pump.id, known_at) if may_have("marks") else {}
    older = [row.id for row in rows if row.reduction_digest is None]
    without_outline = {i: ReductionOutline.of(d) for i, d in _reductions(session, older).items() if d is not None}
    maintenance = maintenance_of(session, pump.id, known_at) if may_have("maintenance") else ()
    own = [said_by(pump.serial, row) for row in rows]
    remarks, again = remarks_on(own, _elsewhere(rows), maintenance), copies(own) | misdated(own, maintenance)
    for row in rows:
        if most_anew and len(anew) == most_anew:
            break
        place = place_at(intervals, row.aircraft or "", row.position or "", row.started_at)
        if place.aircraft not in aircraft:
            aircraft[place.aircraft] = registry_values(session, pump.operator, "aircraft", place.aircraft, known_at)
        setting = setting_at(aircraft[place.aircraft], row.started_at)
        flags = place.flags + _record_flags(row, name, registered, setting)
        flags += (*(row.remarks or ()), *remarks.get(row.id, ()))
        if healthy is not None and not setting.has_own_fluid(kind):
            flags += (f"the measured healthy curve is not one with {setting.fluid}: judged against the twin",)
        if setting not in keys:
            keys[setting] = analysis_key(kind, setting, thresholds)
        outline = without_outline.get(row.id) or _stored_outline(row)
        marked = marks.get(row.id, ())
        if reduce_anew or outline is None or row.reduced_with != marked_key(keys[setting], marked):
            if outline is not None and row.raw_removed_at is not None:
                flags += ("raw bytes are no longer kept: analysed as they were before",)
            elif most_anew == 0:
                archive.must_have(row.content_hash)
                continue
            else:
                recording = archive.recording(session.get_one(Record, row.id), kind)
                analysis = analysed(recording, kind, setting, thresholds, marked)
                anew[row.id], outline = analysis, ReductionOutline.of(analysis.reduction)
        if row.id in again:
            outline = ReductionOutline(f"{outline.digest} again", has_zero_flow=False, has_spectrum=False)
        placed.append(PlacedRecord(_outline(row, place, outline), outline.digest, setting, flags))
    placed.sort(key=lambda p: (p.outline.at, p.outline.record_id))
    others = look_alikes(session, pump) if may_have("alike") else []
    alike = [f"pump {other.serial} looks like this one: the same pump twice?" for other in others]
    alike += names_alike(own)
    known = Known(kind, thresholds.values, tuple(placed), maintenance, changes(intervals), healthy, tuple(alike))
    hours = {row.id: row.flight_hours for row in rows if row.flight_hours is not None}
    coming = {incoming.record_id: incoming.analysis} if incoming and incoming.analysis else {}
    against = [(row.copied_elsewhere, row.place_taken) for row in rows if incoming and row.id == incoming.record_id]
    said_against = (bool(against[0][0]), bool(against[0][1])) if against else (False, False)
    return Knowledge(known, name, thresholds, anew, hours, again, coming, said_against, tuple(older))


def _elsewhere(rows: Sequence[AnyRow]) -> dict[str, list[str]]:
    """Remarks on records that records of other pumps contradict."""
    kinds = ((COPIED_ELSEWHERE, "copied_elsewhere"), (PLACE_TAKEN, "place_taken"))
    return {row.id: [words for words, name in kinds if getattr(row, name)] for row in rows}


_LIGHT = (
    Record.id,
    Record.pump_id,
    Record.started_at,
    Record.finished_at,
    Record.samples_hash,
    Record.content_hash,
    Record.remarks,
    Record.aircraft,
    Record.position,
    Record.flight_id,
    Record.segment,
    Record.pump_type,
    Record.flight_hours,
    Record.raw_removed_at,
    Record.reduced_with,
    Record.reduction_digest,
    Record.has_zero_flow,
    Record.has_spectrum,
)
"""All that is read of every record, whatever the fold needs; a reduction is a hundred times as much."""
_MOST_IDS = 500
"""Ids of one query: SQLite allows 999 bound values in old builds."""


def counting_records(session: Session, pump_id: int) -> list[Record]:
    """Records that count now, whole."""
    query = select(Record).where(*_counting(pump_id, None))
    return list(session.scalars(query.order_by(Record.started_at, Record.id)))


def _counting(
    pump_id: int, known_at: datetime | None, incoming: Incoming | None = None
) -> tuple[ColumnElement[bool], ...]:
    """What picks the records of a pump that count now, or that counted at an instant, with one that comes."""
    if incoming is None:
        return Record.pump_id == pump_id, *counting(known_at)
    counts = or_(and_(*counting(known_at)), Record.id == incoming.record_id)
    return Record.pump_id == pump_id, counts, Record.id != (incoming.supersedes or "")


def _reductions(session: Session, ids: Sequence[str]) -> dict[str, StoredReduction | None]:
    """Stored reductions of records, as JSON objects."""
    found: dict[str, StoredReduction | None] = {}
    for start in range(0, len(ids), _MOST_IDS):
        query = select(Record.id, Record.reduction).where(Record.id.in_(ids[start : start + _MOST_IDS]))
        found |= {row.id: row.reduction for row in session.execute(query)}
    return found


def _stored_outline(row: AnyRow) -> ReductionOutline | None:
    if row.reduction_digest is None:
        return None
    return ReductionOutline(row.reduction_digest, bool(row.has_zero_flow), bool(row.has_spectrum))


def _outline(row: AnyRow, place: Place, outline: ReductionOutline) -> Outline:
    return Outline(
        # the content decides the order of records of the same instant, not the order of their arrival
        record_id=row.id,
        at=row.started_at,
        aircraft=place.aircraft,
        position=place.position,
        flight_id=row.flight_id or "",
        segment=row.segment or None,
        has_zero_flow=outline.has_zero_flow,
        has_spectrum=outline.has_spectrum,
    )


def entries(
    session: Session, table: type[AnyEntry], pump_id: int, known_at: datetime | None = None
) -> Sequence[AnyEntry]:
    """Entries about a pump that count now, or that counted at an instant."""
    query = select(table).where(table.pump_id == pump_id)
    if known_at is None:
        query = query.where(table.withdrawn_at.is_(None))
    else:
        query = query.where(
            table.recorded_at <= known_at, or_(table.withdrawn_at.is_(None), table.withdrawn_at > known_at)
        )
    return session.scalars(query.order_by(table.row_id)).all()


def maintenance_of(session: Session, pump_id: int, known_at: datetime | None) -> tuple[Maintenance, ...]:
    """What was done to a pump, in an order that does not depend on when it was entered."""
    found = entries(session, MaintenanceEvent, pump_id, known_at)
    events = (Maintenance(e.at, e.action, e.fluid, e.channel) for e in found)
    return tuple(sorted(events, key=lambda m: (m.at, m.action, m.fluid or "", m.channel or "")))


def marks_of(session: Session, pump_id: int, known_at: datetime | None = None) -> dict[str, tuple[Mark, ...]]:
    """What engineers have marked on a pump's records, by record, in an order that does not depend on when."""
    found: dict[str, list[Mark]] = {}
    for row in entries(session, RecordMark, pump_id, known_at):
        found.setdefault(row.record_id, []).append(Mark(row.start_s, row.end_s, good=row.mark == "good"))
    return {record_id: tuple(sorted(marks, key=repr)) for record_id, marks in found.items()}


def installation_intervals(session: Session, pump_id: int, known_at: datetime | None = None) -> list[Interval]:
    """Entered installations of a pump in event order."""
    return intervals_of(entries(session, Installation, pump_id, known_at))


def intervals_of(found: Iterable[Installation]) -> list[Interval]:
    """Installations in event order, as the history takes them."""
    intervals = [Interval(i.aircraft, i.position, i.installed_at, i.removed_at) for i in found]
    return sorted(intervals, key=lambda i: i.installed_at)


def registry_values(
    session: Session, operator: str, kind: str, name: str, known_at: datetime | None = None
) -> JsonObject:
    """What the registry says of a pump or an aircraft; empty where nobody has said anything."""
    query = select(RegistryVersion.values).where(
        RegistryVersion.operator == operator, RegistryVersion.kind == kind, RegistryVersion.name == name
    )
    if known_at is not None:
        query = query.where(RegistryVersion.recorded_at <= known_at)
    return session.scalar(query.order_by(RegistryVersion.id.desc()).limit(1)) or {}


def thresholds_now(session: Session, found: Dossier, kind: str) -> Effective:
    """Effective thresholds of a pump now; nothing is asked where no layer has any."""
    pump = found.pump
    if not found.has("thresholds"):
        return default_thresholds(session, pump.operator, kind)
    return thresholds_of(session, pump.operator, pump.serial, kind)


def setting_of(
    session: Session, operator: str, found: Dossier | None, aircraft: str, position: str, at: datetime
) -> Setting:
    """Surroundings of a record before it is stored; ``found`` is the dossier of its pump, None for an unknown one."""
    known = installation_intervals(session, found.pump.id) if found and found.has("installations") else []
    place = place_at(known, aircraft, position, at)
    said = found.registry.get(("aircraft", place.aircraft)) if found else None
    return setting_at(registry_values(session, operator, "aircraft", place.aircraft) if said is None else said, at)


def _kind(
    session: Session,
    pump: Pump,
    rows: Sequence[AnyRow],
    known_at: datetime | None,
    said: Mapping[str, Any] | None,
) -> tuple[str, bool]:
    """Pump type, and whether somebody has registered it: else the earliest record that names one decides."""
    if said is None:
        said = registry_values(session, pump.operator, "pump", pump.serial, known_at)
    registered = said.get("pump_type")
    if registered is not None:
        return registered, True
    naming = min((row for row in rows if row.pump_type), key=lambda r: (r.started_at, r.id), default=None)
    return (naming.pump_type if naming is not None else DEFAULT_PUMP_TYPE), False


def _record_flags(row: AnyRow, kind: str, registered: bool, setting: Setting) -> tuple[str, ...]:
    flags = []
    if row.pump_type not in (None, kind):
        source = "is registered as" if registered else "was first named as"
        flags.append(f"records name pump type {row.pump_type}, the pump {source} {kind}")
    if setting.unknown_fluid is not None:
        flags.append(f"the twin has no properties of {setting.unknown_fluid}: computed with the pump type's fluid")
    return tuple(flags)
