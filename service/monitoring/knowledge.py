"""What is known of a pump, now or at an earlier instant, gathered from the database for the fold."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, TypeVar

from sqlalchemy import or_, select
from sqlalchemy.orm import Session

from detectors.observation import Maintenance
from service.ingest.decode import DEFAULT_PUMP_TYPE
from service.monitoring.analysis import RecordAnalysis, analysed, analysis_key, observation_of, thresholds_of
from service.monitoring.archive import Archive
from service.monitoring.fold import Known, PlacedObservation
from service.monitoring.placement import Interval, Place, changes, place_at
from service.monitoring.setting import Setting, setting_at
from service.registry.reference_curves import healthy_curve
from service.tables import (
    ANALYSED,
    SUPERSEDED,
    WITHDRAWN,
    Entry,
    Installation,
    MaintenanceEvent,
    Pump,
    Record,
    RegistryVersion,
)
from service.threshold_layers import Candidate, Effective
from twin.pumps import pump_type
from twin.version import twin_version

AnyEntry = TypeVar("AnyEntry", bound=Entry)


@dataclass(frozen=True, slots=True)
class Knowledge:
    """Input of the fold with what the stored verdicts say beside it.

    ``anew`` holds the analyses that differ from the stored ones, by record: other thresholds, surroundings or
    pump type than they were made with.
    """

    known: Known
    kind: str
    thresholds: Effective
    places: Mapping[str, Place]
    anew: Mapping[str, RecordAnalysis]

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
    candidate: Candidate | None = None,
    *,
    reduce_anew: bool = False,
) -> Knowledge:
    """Gather what is known of a pump.

    Parameters
    ----------
    known_at
        Instant whose knowledge counts; None for now. Records that were superseded or withdrawn later count again,
        and so do entries, thresholds and registry values of that time.
    candidate
        Thresholds that stand in for those of one layer; None for the stored ones alone.
    reduce_anew
        Read every record again from its raw bytes, where they are kept.
    """
    rows = counting_records(session, pump.id, known_at)
    kind, registered = _kind(session, pump, rows, known_at)
    thresholds = thresholds_of(session, pump.operator, pump.serial, kind, known_at, candidate)
    intervals = installation_intervals(session, pump.id, known_at)
    places, placed, anew = {}, [], {}
    aircraft: dict[str, Mapping[str, Any]] = {}
    keys: dict[Setting, str] = {}
    for row in rows:
        if row.started_at is None:
            raise RuntimeError(f"record {row.id} counts without a start")
        place = place_at(intervals, row.aircraft or "", row.position or "", row.started_at)
        if place.aircraft not in aircraft:
            aircraft[place.aircraft] = registry_values(session, pump.operator, "aircraft", place.aircraft, known_at)
        setting = setting_at(aircraft[place.aircraft], row.started_at)
        reduction, flags = row.reduction, place.flags + _record_flags(row, kind, registered, setting)
        if setting not in keys:
            keys[setting] = analysis_key(kind, setting, thresholds)
        if reduce_anew or reduction is None or row.reduced_with != keys[setting]:
            if reduction is not None and row.raw_removed_at is not None:
                flags += ("raw bytes are no longer kept: analysed as they were before",)
            else:
                analysis = analysed(archive.recording(row, kind), kind, setting, thresholds)
                anew[row.id], reduction = analysis, analysis.reduction
        placed.append(PlacedObservation(observation_of(row, place, reduction), setting, flags))
        places[row.id] = place
    maintenance = tuple(Maintenance(e.at, e.action) for e in entries(session, MaintenanceEvent, pump.id, known_at))
    healthy = healthy_curve(session, pump.operator, kind, known_at)
    known = Known(pump_type(kind), thresholds.values, tuple(placed), maintenance, changes(intervals), healthy)
    return Knowledge(known, kind, thresholds, places, anew)


def counting_records(session: Session, pump_id: int, known_at: datetime | None) -> list[Record]:
    """Records that count now, or that counted at an instant."""
    query = select(Record).where(Record.pump_id == pump_id)
    if known_at is None:
        query = query.where(Record.status == ANALYSED)
    else:
        query = query.where(
            Record.status.in_((ANALYSED, SUPERSEDED, WITHDRAWN)),
            Record.received_at <= known_at,
            or_(Record.ended_at.is_(None), Record.ended_at > known_at),
        )
    return list(session.scalars(query.order_by(Record.started_at, Record.id)))


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


def installation_intervals(session: Session, pump_id: int, known_at: datetime | None = None) -> list[Interval]:
    """Entered installations of a pump in event order."""
    found = entries(session, Installation, pump_id, known_at)
    intervals = [Interval(i.aircraft, i.position, i.installed_at, i.removed_at) for i in found]
    return sorted(intervals, key=lambda i: i.installed_at)


def registry_values(
    session: Session, operator: str, kind: str, name: str, known_at: datetime | None = None
) -> dict[str, Any]:
    """What the registry says of a pump or an aircraft; empty where nobody has said anything."""
    query = select(RegistryVersion.values).where(
        RegistryVersion.operator == operator, RegistryVersion.kind == kind, RegistryVersion.name == name
    )
    if known_at is not None:
        query = query.where(RegistryVersion.recorded_at <= known_at)
    return session.scalar(query.order_by(RegistryVersion.id.desc()).limit(1)) or {}


def setting_of(session: Session, operator: str, serial: str, aircraft: str, position: str, at: datetime) -> Setting:
    """Surroundings of a record before it is stored."""
    pump_id = session.scalar(select(Pump.id).where(Pump.operator == operator, Pump.serial == serial))
    intervals = [] if pump_id is None else installation_intervals(session, pump_id)
    place = place_at(intervals, aircraft, position, at)
    return setting_at(registry_values(session, operator, "aircraft", place.aircraft), at)


def _kind(session: Session, pump: Pump, rows: Sequence[Record], known_at: datetime | None) -> tuple[str, bool]:
    """Pump type, and whether somebody has registered it: else the earliest record that names one decides."""
    registered = registry_values(session, pump.operator, "pump", pump.serial, known_at).get("pump_type")
    if registered is not None:
        return registered, True
    return next((row.pump_type for row in rows if row.pump_type), DEFAULT_PUMP_TYPE), False


def _record_flags(row: Record, kind: str, registered: bool, setting: Setting) -> tuple[str, ...]:
    flags = []
    if row.pump_type not in (None, kind):
        source = "is registered as" if registered else "was first named as"
        flags.append(f"records name pump type {row.pump_type}, the pump {source} {kind}")
    if setting.unknown_fluid is not None:
        flags.append(f"the twin has no properties of {setting.unknown_fluid}: computed with the pump type's fluid")
    return tuple(flags)
