"""Accepting an upload: safe before it is acknowledged, known when it comes again, refused as a whole or not at all.

An upload takes two short transactions. The first keeps the record, read and analysed, where it counts for nothing yet; the
second lets it count, with the pump's new verdicts. The fold between them is made without a lock, and made again where the
second finds that the pump has changed meanwhile.
"""

import uuid
from contextlib import nullcontext
from dataclasses import dataclass
from datetime import UTC, datetime

from prometheus_client import Counter
from sqlalchemy import ColumnElement, or_, select
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from service.access import audit
from service.access.account import NOBODY, current_account, in_background
from service.access.security import Principal
from service.errors import Conflict, Fault, Invalid, Problem, is_ours
from service.history.archive import Archive
from service.history.knowledge import Incoming
from service.identity import release_number
from service.ingest.decode import DEFAULT_PUMP_TYPE, DecodedRecord
from service.ingest.mapping_version import MappingVersion
from service.ingest.names import look_of
from service.ingest.parse import check_type
from service.monitoring.counting import Counting
from service.monitoring.flights import check_flight
from service.monitoring.settling import Settling
from service.monitoring.surroundings import Surroundings
from service.monitoring.uploads import Upload, fill, identity_hash_of, new_row, request_hash_of
from service.storage.database import Database
from service.storage.tables import REFUSED, STORED, Pump, Record, Refusal

__all__ = ["Acceptance", "Accepted", "Upload"]
_REFUSALS = Counter("casedrain_refusals_total", "Uploads that were refused for what is wrong with them")


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
        self.settling = Settling(database, archive)
        self._counting = Counting(database, archive, self.settling)

    def accept(self, upload: Upload, principal: Principal) -> Accepted:
        """Check, store and analyse an upload before answering.

        Raises
        ------
        Problem
            with every fault; nothing is stored then but the fact of the refusal.
        """
        operator = principal.operator_of(upload.overrides.get("operator"))
        request_hash = request_hash_of(operator, upload)
        known = self._known(request_hash)
        if known is not None and known[1] != REFUSED:
            return self._again(*known)
        try:
            surroundings = Surroundings(self._database, operator)
            decoded = self._decoded(upload, surroundings)
            operator = principal.operator_of(decoded.metadata.operator)
            arrival = _Arrival(decoded, operator, upload, request_hash, surroundings)
            return self._store(arrival, principal, was_refused=known is not None)
        except Problem as problem:
            if not is_ours(problem):
                self._refuse(upload, operator, problem)
            raise

    def store(self, upload: Upload, principal: Principal) -> Accepted:
        """Store an upload and answer at once; ``process`` analyses it later."""
        operator = principal.operator_of(upload.overrides.get("operator"))
        request_hash = request_hash_of(operator, upload)
        known = self._known(request_hash)
        if known is not None and known[1] != REFUSED:
            return Accepted(known[0], known=True)
        check_type(upload.content_type, upload.content_encoding)
        if not upload.file.size:
            self._decoded(upload, Surroundings(self._database, operator))  # raises what an empty body deserves
        self._archive.raw_store.put_file(upload.file.path, upload.file.digest)
        row = new_row(upload, operator, request_hash)
        try:
            with self._database.writing() as session:
                _add(session, row, principal, was_refused=known is not None)
        except IntegrityError:
            return Accepted(row.id, known=True)
        return Accepted(row.id, known=False)

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
            known = Surroundings(self._database, row.operator)
            # what nobody waits for is read in its operator's turn
            with in_background(row.operator) if current_account().tenant == NOBODY else nullcontext():
                decoded = self._archive.decoded_again(row, known.registered, known.types, known.full_scales)
            if decoded.metadata.operator not in (None, row.operator):
                raise Invalid("the file names another operator", [Fault("operator", "is not the uploader's")])
            self._counting.count(self._read(row, decoded, known), decoded, known)
        except Problem as problem:
            if is_ours(problem):
                raise  # it says nothing about the record, which stays stored
            with self._database.writing() as session:
                stored = session.get(Record, record_id)
                if stored is not None and stored.status == STORED:
                    stored.status, stored.problem = REFUSED, problem.body()
                    stored.pump_id = stored.identity_hash = None

    def _decoded(self, upload: Upload, known: Surroundings) -> DecodedRecord:
        return self._archive.decoded(
            upload.file,
            upload.content_type,
            upload.content_encoding,
            upload.overrides,
            upload.mapping,
            known.registered,
            known.types,
            known.full_scales,
        )

    def _known(self, request_hash: str) -> tuple[str, str] | None:
        """Id and status of the record of the same request; a refused one only where there is no other."""
        with self._database.reading() as session:
            query = select(Record.id, Record.status).where(Record.request_hash == request_hash)
            row = session.execute(query.order_by(Record.status == REFUSED, Record.received_at).limit(1)).first()
            return None if row is None else (row.id, row.status)

    def _again(self, record_id: str, status: str) -> Accepted:
        if status == STORED:
            self.process(record_id)  # an earlier attempt may have ended right after it stored the bytes
        return Accepted(record_id, known=True)

    def _store(self, new: "_Arrival", principal: Principal, *, was_refused: bool) -> Accepted:
        upload, decoded = new.upload, new.decoded
        identity = identity_hash_of(new.operator, upload.file.digest, decoded, upload.mapping)
        found = new.surroundings.dossier_of(decoded.metadata, new.operator)
        pump = found.pump if found else None
        with self._database.reading() as session:
            known = check_flight(session, new.operator, pump, decoded, identity, upload.supersedes)
        if known is not None:
            return self._again(known.id, known.status)
        analysis = new.surroundings.analysed(decoded, new.operator)
        self._archive.raw_store.put_file(upload.file.path, upload.file.digest)
        row = new_row(upload, new.operator, new.request_hash)
        try:
            with self._database.writing() as session:
                number = pump.id if pump else _pump_made(session, new.operator, decoded)
                fill(row, number, decoded, identity, analysis)
                _add(session, row, principal, was_refused=was_refused)
        except IntegrityError:
            return self._stored_meanwhile(row.id, identity)
        # the record is safe from here on; a crash leaves it stored, and the next start goes on
        try:
            counts = self._counting.count((row, Incoming(row.id, row.supersedes, analysis)), decoded, new.surroundings)
        except Problem as problem:
            if is_ours(problem):
                raise
            with self._database.writing() as session:
                stored = session.get(Record, row.id)
                if stored is not None and stored.status == STORED:
                    session.delete(stored)
            raise
        return Accepted(row.id, known=False, waiting=not counts)

    def _stored_meanwhile(self, record_id: str, identity: str) -> Accepted:
        """The record of the same request, or of the same bytes and metadata, that another upload was quicker with."""
        with self._database.reading() as session:
            same = or_(Record.id == record_id, Record.identity_hash == identity)
            row = session.execute(select(Record.id, Record.status).where(same).limit(1)).first()
        if row is None:
            raise Conflict("another upload of the same record ended at the same moment: send it again")
        return self._again(row.id, row.status)

    def _read(self, row: Record, decoded: DecodedRecord, known: Surroundings) -> tuple[Record, Incoming]:
        """Write what a stored record says into its row: where it belongs, and what was made of it."""
        mapping = MappingVersion.from_json(row.request["mapping"]) if row.request.get("mapping") else None
        identity = identity_hash_of(row.operator, row.content_hash, decoded, mapping)
        found = known.dossier_of(decoded.metadata, row.operator)
        with self._database.reading() as session:
            pump = found.pump if found else None
            same = check_flight(session, row.operator, pump, decoded, identity, row.supersedes, row.id)
        if same is not None:
            raise Conflict(f"record {same.id} is the same record", extra={"record_id": same.id})
        analysis = known.analysed(decoded, row.operator)
        try:
            with self._database.writing() as session:
                stored = session.get(Record, row.id, populate_existing=True)
                if stored is not None and stored.status == STORED:
                    number = pump.id if pump else _pump_made(session, row.operator, decoded)
                    fill(stored, number, decoded, identity, analysis)
                    row = stored
        except IntegrityError:
            raise Conflict("the same record was stored at the same moment by another upload") from None
        return row, Incoming(row.id, row.supersedes, analysis)

    def _refuse(self, upload: Upload, operator: str, problem: Problem) -> None:
        _REFUSALS.inc()
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


@dataclass(frozen=True, slots=True)
class _Arrival:
    """An upload that was read, with what it is recognised by and what is known of its pump."""

    decoded: DecodedRecord
    operator: str
    upload: Upload
    request_hash: str
    surroundings: Surroundings


def _add(session: Session, row: Record, principal: Principal, *, was_refused: bool) -> None:
    if was_refused:
        earlier = session.get(Record, row.id)
        if earlier is not None and earlier.status == REFUSED:
            session.delete(earlier)
            session.flush()
    session.add(row)
    details = {"supersedes": row.supersedes} if row.supersedes else {}
    audit.note(session, principal, "record.upload", f"record/{row.id}", row.operator, details)
    session.flush()


def _is_for_us() -> ColumnElement[bool]:
    return or_(Record.waits_for.is_(None), Record.waits_for <= release_number())


def _pump_made(session: Session, operator: str, decoded: DecodedRecord) -> int:
    """Number of a pump that a record brings along: made, unconfirmed, unless somebody was quicker."""
    metadata = decoded.metadata
    values = {
        "operator": operator,
        "serial": metadata.pump_serial,
        "pump_type": metadata.pump_type or DEFAULT_PUMP_TYPE,
        "confirmed": False,
        "created_at": datetime.now(UTC),
        "look": look_of(metadata.pump_serial),
    }
    insert = sqlite.insert if session.get_bind().dialect.name == "sqlite" else postgresql.insert
    wanted = insert(Pump).values(**values).on_conflict_do_nothing(index_elements=["operator", "serial"])
    session.execute(wanted)
    return session.scalars(select(Pump.id).where(Pump.operator == operator, Pump.serial == metadata.pump_serial)).one()
