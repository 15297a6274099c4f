"""Accepting an upload: safe before it is acknowledged, known when it comes again, refused as a whole or not at all."""

import hashlib
import json
import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import ColumnElement, or_, select
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from service.access import audit
from service.access.security import Principal
from service.errors import Conflict, Fault, Invalid, Problem, is_ours
from service.history.analysis import analysed, keep_analysis
from service.history.archive import Archive, RegisteredType
from service.history.arrival import known_aircraft
from service.history.knowledge import setting_of
from service.history.neighbours import look_alikes, newly_contradicted
from service.history.overview import overview_of
from service.identity import release_number
from service.ingest.decode import DEFAULT_PUMP_TYPE, DecodedRecord, FullScales
from service.ingest.mapping_version import MappingVersion
from service.ingest.metadata import RecordMetadata, TypeLookup
from service.ingest.names import look_of
from service.ingest.parse import check_type
from service.monitoring.flights import check_flight
from service.monitoring.precedence import made_with, newer_release
from service.monitoring.refold import Cause, refold, refold_others
from service.monitoring.renewal import reduced_again
from service.pump_types.parameter_sets import find_type, held_type
from service.storage.database import Database
from service.storage.spool import SpooledFile
from service.storage.tables import ANALYSED, REFUSED, STORED, SUPERSEDED, Pump, Record, Refusal
from service.thresholds.layers import thresholds_of
from twin.parameters import PumpType


@dataclass(frozen=True, slots=True)
class Upload:
    """One upload as it came; ``overrides`` are metadata of the request, which win over those of the file.

    ``mapping`` is the version of a channel mapping that the request names.
    """

    file: SpooledFile
    content_type: str
    content_encoding: str
    overrides: Mapping[str, str]
    supersedes: str | None = None
    mapping: MappingVersion | None = None


@dataclass(frozen=True, slots=True)
class Accepted:
    """Id of the record, and whether it was known before.

    ``waiting`` is True for one that is stored and left to processes of the newer release that has judged its pump.
    """

    record_id: str
    known: bool
    waiting: bool = False


class Acceptance:
    """Takes uploads into one database and one raw store."""

    def __init__(self, database: Database, archive: Archive) -> None:
        self._database = database
        self._archive = archive

    def accept(self, upload: Upload, principal: Principal) -> Accepted:
        """Check, store and analyse an upload before answering.

        Raises
        ------
        Problem
            with every fault; nothing is stored then but the fact of the refusal.
        """
        operator = principal.operator_of(upload.overrides.get("operator"))
        request_hash = _request_hash(operator, upload)
        known = self._known(request_hash)
        if known is not None:
            self.process(known)  # an earlier attempt may have ended right after it stored the bytes
            return Accepted(known, known=True)
        try:
            decoded = self._decoded(upload, operator)
            operator = principal.operator_of(decoded.metadata.operator)
            return self._store(upload, decoded, operator, request_hash, principal)
        except Problem as problem:
            if not is_ours(problem):
                self._refuse(upload, operator, problem)
            raise

    def store(self, upload: Upload, principal: Principal) -> Accepted:
        """Store an upload and answer at once; ``process`` analyses it later."""
        operator = principal.operator_of(upload.overrides.get("operator"))
        request_hash = _request_hash(operator, upload)
        known = self._known(request_hash)
        if known is not None:
            return Accepted(known, known=True)
        check_type(upload.content_type, upload.content_encoding)
        if not upload.file.size:
            self._decoded(upload, operator)  # raises what an empty body deserves
        return Accepted(*self._keep(upload, operator, request_hash, principal))

    def _keep(self, upload: Upload, operator: str, request_hash: str, principal: Principal) -> tuple[str, bool]:
        """Keep the bytes and commit a ``stored`` row: its id, and whether another upload was there first."""
        self._archive.raw_store.put_file(upload.file.path, upload.file.digest)
        row = _new_row(upload, operator, request_hash)
        try:
            with self._database.writing() as session:
                earlier = session.get(Record, row.id)
                if earlier is not None and earlier.status != REFUSED:
                    return row.id, True
                if earlier is not None:
                    session.delete(earlier)
                    session.flush()
                session.add(row)
                details = {"supersedes": upload.supersedes} if upload.supersedes else {}
                audit.note(session, principal, "record.upload", f"record/{row.id}", operator, details)
        except IntegrityError:
            return row.id, True
        return row.id, False

    def pending(self) -> list[str]:
        """Ids of records that are stored but not analysed yet, oldest first."""
        with self._database.reading() as session:
            query = (
                select(Record.id).where(Record.status == STORED, _is_for_us()).order_by(Record.received_at, Record.id)
            )
            return list(session.scalars(query))

    def left(self) -> list[str]:
        """Ids of records that older processes have left to this release or an older one, oldest first."""
        with self._database.reading() as session:
            query = select(Record.id).where(Record.status == STORED, Record.waits_for <= release_number())
            return list(session.scalars(query.order_by(Record.received_at, Record.id)))

    def process(self, record_id: str) -> None:
        """Analyse a stored record: it becomes ``analysed`` or ``refused``. Safe to repeat."""
        with self._database.reading() as session:
            row = session.get(Record, record_id)
            if row is None or row.status != STORED:
                return
        try:
            operator = row.operator
            lookups = self._registered(operator), self._types(operator), self._full_scales(operator)
            decoded = self._archive.decoded_again(row, *lookups)
            if decoded.metadata.operator not in (None, row.operator):
                raise Invalid("the file names another operator", [Fault("operator", "is not the uploader's")])
            self._finish(record_id, decoded, row.operator)
        except Problem as problem:
            if is_ours(problem):
                raise  # it says nothing about the record, which stays stored
            with self._database.writing() as session:
                stored = session.get(Record, record_id)
                if stored is not None and stored.status == STORED:
                    stored.status, stored.problem = REFUSED, problem.body()

    def _decoded(self, upload: Upload, operator: str) -> DecodedRecord:
        return self._archive.decoded(
            upload.file,
            upload.content_type,
            upload.content_encoding,
            upload.overrides,
            upload.mapping,
            self._registered(operator),
            self._types(operator),
            self._full_scales(operator),
        )

    def _full_scales(self, operator: str) -> FullScales:
        def fitted(metadata: RecordMetadata) -> Mapping[str, float]:
            with self._database.reading() as session:
                owner = metadata.operator or operator
                place = metadata.aircraft, metadata.position
                setting = setting_of(session, owner, metadata.pump_serial, *place, metadata.started_at)
            return {sensor.channel: sensor.full_scale_bar for sensor in setting.sensors}

        return fitted

    def _registered(self, operator: str) -> RegisteredType:
        def registered(named: str | None, serial: str) -> str | None:
            with self._database.reading() as session:
                query = select(Pump.pump_type).where(Pump.operator == (named or operator), Pump.serial == serial)
                return session.scalar(query)

        return registered

    def _types(self, operator: str) -> TypeLookup:
        def known(named: str | None, name: str) -> PumpType | None:
            with self._database.reading() as session:
                return find_type(session, named or operator, name)

        return known

    def _known(self, request_hash: str) -> str | None:
        with self._database.reading() as session:
            query = select(Record.id).where(Record.request_hash == request_hash, Record.status != REFUSED)
            return session.scalar(query.order_by(Record.received_at).limit(1))

    def _store(
        self, upload: Upload, decoded: DecodedRecord, operator: str, request_hash: str, principal: Principal
    ) -> Accepted:
        identity = _identity_hash(operator, upload.file.digest, decoded, upload.mapping)
        with self._database.reading() as session:
            known = session.scalar(select(Record.id).where(Record.identity_hash == identity))
            if known is not None:
                return Accepted(known, known=True)
            check_flight(session, decoded, operator, upload.supersedes)
        record_id, known_now = self._keep(upload, operator, request_hash, principal)
        if known_now:
            return Accepted(record_id, known=True)
        # the bytes are safe from here on; a crash leaves a stored record that the next start analyses
        try:
            waiting = not self._finish(record_id, decoded, operator)
        except Problem as problem:
            if is_ours(problem):
                raise
            with self._database.writing() as session:
                stored = session.get(Record, record_id)
                if stored is not None:
                    session.delete(stored)
            with self._database.reading() as session:
                known = session.scalar(select(Record.id).where(Record.identity_hash == identity))
            if known is not None:
                return Accepted(known, known=True)
            raise
        return Accepted(record_id, known=False, waiting=waiting)

    def _finish(self, record_id: str, decoded: DecodedRecord, operator: str) -> bool:
        """Analyse, then store everything about the record and its pump's new verdicts in one transaction.

        False where a newer release has judged the pump: the record stays stored and waits for one of its processes.
        """
        metadata = decoded.metadata
        serial, started_at = metadata.pump_serial, metadata.started_at
        self._renew(operator, serial)
        with self._database.reading() as session:
            held = _pump(session, operator, serial)
            name = held.pump_type if held else (metadata.pump_type or DEFAULT_PUMP_TYPE)
            kind = held_type(session, operator, name)
            thresholds = thresholds_of(session, operator, serial, name)
            setting = setting_of(session, operator, serial, metadata.aircraft, metadata.position, started_at)
        # the long part comes before the lock; what changes meanwhile, the fold notices by the key
        analysis, overview = analysed(decoded.recording, kind, setting, thresholds), overview_of(decoded.recording)
        cause, others = Cause("record_received", record_id), set[int]()
        try:
            with self._database.writing() as session:
                pump, is_new = _locked_pump(session, operator, serial, name)
                known_aircraft(session, operator, metadata.aircraft)
                row = session.get(Record, record_id, populate_existing=True)
                if row is None or row.status != STORED:
                    return True
                newer = newer_release(session, pump.id)
                if newer is not None:
                    row.waits_for = release_number(newer)
                    return False
                check_flight(session, decoded, operator, row.supersedes)
                if row.supersedes:
                    older = session.get(Record, row.supersedes)
                    if older is not None:
                        others |= newly_contradicted(session, older)
                        older.status, older.ended_at = SUPERSEDED, row.received_at
                        session.flush()
                row.pump_id = pump.id
                row.aircraft, row.position = metadata.aircraft, metadata.position
                row.flight_id, row.segment = metadata.flight_id, metadata.segment
                row.started_at, row.flight_hours = started_at, metadata.flight_hours
                row.pump_type = metadata.pump_type
                row.attributes = dict(decoded.recording.attributes)
                mapping = MappingVersion.from_json(row.request["mapping"]) if row.request.get("mapping") else None
                row.identity_hash = _identity_hash(operator, row.content_hash, decoded, mapping)
                keep_analysis(row, analysis)
                row.overview = overview
                row.status, row.waits_for = ANALYSED, None
                session.flush()
                refold(session, pump, self._archive, cause)
                others |= newly_contradicted(session, row)
                if is_new:
                    others |= {other.id for other in look_alikes(session, pump)}
        except IntegrityError:
            raise Conflict(
                "the same flight, pump and segment was stored at the same moment by another upload"
            ) from None
        refold_others(self._database, self._archive, others, cause)
        return True

    def _renew(self, operator: str, serial: str) -> None:
        """Reduce again what older code has left of a pump: it may take long, and must not happen under the lock."""
        with self._database.reading() as session:
            held = _pump(session, operator, serial)
        if held is not None and held.made_with != made_with():
            reduced_again(self._database, self._archive, held.id)

    def _refuse(self, upload: Upload, operator: str, problem: Problem) -> None:
        with self._database.writing() as session:
            session.add(
                Refusal(
                    id=uuid.uuid4().hex,
                    operator=operator,
                    content_hash=upload.file.digest,
                    received_at=datetime.now(UTC),
                    problem=problem.body(),
                )
            )


def _new_row(upload: Upload, operator: str, request_hash: str) -> Record:
    return Record(
        # a function of what was uploaded, so that records of one instant fold in the same order everywhere
        id=request_hash[:32],
        operator=operator,
        segment="",
        request={
            "encoding": upload.content_encoding,
            "overrides": dict(upload.overrides),
            "mapping": upload.mapping.to_json() if upload.mapping else None,
        },
        attributes={},
        content_hash=upload.file.digest,
        content_type=upload.content_type,
        status=STORED,
        request_hash=request_hash,
        supersedes=upload.supersedes,
        received_at=datetime.now(UTC),
    )


def _is_for_us() -> ColumnElement[bool]:
    return or_(Record.waits_for.is_(None), Record.waits_for <= release_number())


def _pump(session: Session, operator: str, serial: str) -> Pump | None:
    return session.scalar(select(Pump).where(Pump.operator == operator, Pump.serial == serial))


def _locked_pump(session: Session, operator: str, serial: str, kind: str) -> tuple[Pump, bool]:
    """The pump's row, locked until the transaction ends, and whether it is new: made, unconfirmed, when not known."""
    values = {
        "operator": operator,
        "serial": serial,
        "pump_type": kind,
        "confirmed": False,
        "created_at": datetime.now(UTC),
        "look": look_of(serial),
    }
    insert = sqlite.insert if session.get_bind().dialect.name == "sqlite" else postgresql.insert
    wanted = insert(Pump).values(**values).on_conflict_do_nothing(index_elements=["operator", "serial"])
    made = session.execute(wanted.returning(Pump.id)).first()
    query = select(Pump).where(Pump.operator == operator, Pump.serial == serial).with_for_update()
    return session.scalars(query.execution_options(populate_existing=True)).one(), made is not None


def _request_hash(operator: str, upload: Upload) -> str:
    parts: dict[str, Any] = {
        "operator": operator,
        "bytes": upload.file.digest,
        "type": upload.content_type.partition(";")[0].strip().lower(),
        "encoding": upload.content_encoding.strip().lower(),
        "overrides": dict(sorted(upload.overrides.items())),
        "supersedes": upload.supersedes,
    }
    if upload.mapping is not None:
        parts["mapping"] = upload.mapping.to_json()
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def _identity_hash(operator: str, digest: str, decoded: DecodedRecord, mapping: MappingVersion | None) -> str:
    metadata = decoded.metadata
    effective: dict[str, Any] = {
        name: str(getattr(metadata, name)) for name in metadata.__slots__ if name not in ("foreign", "operator")
    }
    parts = {"operator": operator, "bytes": digest, "metadata": effective}
    if mapping is not None:
        # what the bytes mean depends on how their channels are read, not on the name of the mapping
        parts["mapping"] = mapping.to_json()["document"]
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()
