"""Uploads, what the analysis made of them, and those that were refused."""

import hashlib
import json
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import ForeignKey, Index, false, text
from sqlalchemy.orm import Mapped, mapped_column, validates

from service.answers.documents import JsonObject
from service.answers.problems import Problem
from service.answers.records import Residual, StoredReduction, Withdrawal
from service.answers.verdicts import Estimate, Verdict
from service.storage.tables.base import JSON_COLUMN, Base

STORED = "stored"
ANALYSED = "analysed"
REFUSED = "refused"
SUPERSEDED = "superseded"
WITHDRAWN = "withdrawn"


@dataclass(frozen=True, slots=True)
class ReductionOutline:
    """A stored reduction in short: SHA-256 of its canonical JSON, an accepted zero-flow window, a spectrum."""

    digest: str
    has_zero_flow: bool
    has_spectrum: bool

    @classmethod
    def of(cls, reduction: StoredReduction) -> "ReductionOutline":
        """Outline of a reduction as it is stored."""
        canonical = json.dumps(reduction, sort_keys=True, separators=(",", ":"))
        return cls(
            digest=hashlib.sha256(canonical.encode()).hexdigest(),
            has_zero_flow=any(w["accepted"] and w["kind"] == "zero_flow" for w in reduction.get("windows", ())),
            has_spectrum=reduction.get("spectrum") is not None,
        )


class Record(Base):
    """One upload: its identity, where it belongs, and what the analysis made of it.

    ``request_hash`` recognises the same request, ``identity_hash`` the same operator, bytes and effective
    metadata. ``pump_id`` and the flight's fields are empty until the bytes are decoded; ``pump_type`` is what the upload
    itself names. At most one record that counts may stand for a flight, pump and segment; one that was superseded or
    withdrawn counted until ``ended_at``. ``raw_removed_at`` is when the retention took
    the bytes, and ``overview`` with them: a thinned copy of a long record's channels. ``reduced_with`` names everything
    that reduction and residuals depend on
    besides the bytes. ``reduction_digest``, ``has_zero_flow`` and ``has_spectrum`` are what the fold needs of a reduction
    that it does not read; they follow every reduction that is assigned, and are empty on rows older than they.
    ``finished_at`` is the instant of the last sample, ``samples_hash`` recognises the same samples under another name,
    ``remarks`` are what looks odd in them: all three come with a reduction and are empty on rows older than they.
    ``reduced_by`` is the software that made the reduction, ``waits_for`` the release, as a number that sorts, whose
    processes are to analyse a stored record because they have judged its pump.
    """

    __tablename__ = "records"
    __table_args__ = (
        Index("ix_records_pump_id_started_at", "pump_id", "started_at"),
        Index(
            "uq_records_flight",
            "pump_id",
            "flight_id",
            "segment",
            unique=True,
            sqlite_where=text("status = 'analysed'"),
            postgresql_where=text("status = 'analysed'"),
        ),
        Index("ix_records_status", "status"),
        Index("ix_records_operator_samples_hash", "operator", "samples_hash"),
        Index("ix_records_place", "operator", "aircraft", "position", "started_at"),
        Index("ix_records_received_at_id", "received_at", "id"),
        Index("ix_records_operator_received_at_id", "operator", "received_at", "id"),
    )

    id: Mapped[str] = mapped_column(primary_key=True)
    operator: Mapped[str]
    pump_id: Mapped[int | None] = mapped_column(ForeignKey("pumps.id"))
    aircraft: Mapped[str | None]
    position: Mapped[str | None]
    flight_id: Mapped[str | None]
    segment: Mapped[str] = mapped_column(default="")
    started_at: Mapped[datetime | None]
    finished_at: Mapped[datetime | None]
    pump_type: Mapped[str | None]
    flight_hours: Mapped[float | None]
    status: Mapped[str]
    problem: Mapped[Problem | None] = mapped_column(JSON_COLUMN)
    request: Mapped[JsonObject]
    attributes: Mapped[JsonObject] = mapped_column(default=dict)
    content_hash: Mapped[str]
    content_type: Mapped[str]
    request_hash: Mapped[str] = mapped_column(index=True)
    identity_hash: Mapped[str | None] = mapped_column(unique=True)
    supersedes: Mapped[str | None]
    received_at: Mapped[datetime]
    ended_at: Mapped[datetime | None]
    withdrawal: Mapped[Withdrawal | None] = mapped_column(JSON_COLUMN)
    raw_removed_at: Mapped[datetime | None]
    reduced_with: Mapped[str | None]
    reduction: Mapped[StoredReduction | None] = mapped_column(JSON_COLUMN)
    residuals: Mapped[dict[str, dict[str, Residual]] | None] = mapped_column(JSON_COLUMN)
    reduction_digest: Mapped[str | None]
    has_zero_flow: Mapped[bool | None]
    has_spectrum: Mapped[bool | None]
    samples_hash: Mapped[str | None]
    remarks: Mapped[list[Any] | None]
    reduced_by: Mapped[JsonObject | None]
    waits_for: Mapped[int | None]
    overview: Mapped[bytes | None] = mapped_column(deferred=True)

    @validates("reduction")
    def _outlined(self, _name: str, reduction: StoredReduction | None) -> StoredReduction | None:
        outline = None if reduction is None else ReductionOutline.of(reduction)
        self.reduction_digest = outline.digest if outline else None
        self.has_zero_flow = outline.has_zero_flow if outline else None
        self.has_spectrum = outline.has_spectrum if outline else None
        return reduction


class StoredAssessment(Base):
    """The fold's answer right after one record, and where the pump sat; rewritten when an earlier record arrives.

    ``chain`` names everything that it was folded from (``service.monitoring.chain``). ``side``, ``candidates``,
    ``case_flow_lpm`` (at the reference condition) and ``case_pressure_beyond`` repeat what alarms need of every verdict of a
    history; they follow every verdict that is assigned. The first four are empty on rows older than they, the last is false.
    """

    __tablename__ = "assessments"
    __table_args__ = (
        Index("ix_assessments_pump_id_at", "pump_id", "at"),
        Index("ix_assessments_aircraft_pump_id_at", "aircraft", "pump_id", "at"),
    )

    record_id: Mapped[str] = mapped_column(ForeignKey("records.id"), primary_key=True)
    pump_id: Mapped[int] = mapped_column(ForeignKey("pumps.id"))
    at: Mapped[datetime]
    aircraft: Mapped[str]
    position: Mapped[str]
    state: Mapped[str]
    trend: Mapped[dict[str, Estimate]] = mapped_column(JSON_COLUMN)
    verdict: Mapped[Verdict] = mapped_column(JSON_COLUMN)
    chain: Mapped[str | None]
    side: Mapped[str | None]
    candidates: Mapped[list[Any] | None]
    case_flow_lpm: Mapped[float | None]
    case_pressure_beyond: Mapped[bool] = mapped_column(server_default=false())

    @validates("verdict")
    def _repeated(self, _name: str, verdict: Verdict) -> Verdict:
        self.side, self.candidates = verdict["side"], list(verdict["candidates"])
        self.case_flow_lpm = case_flow_of(verdict)
        self.case_pressure_beyond = case_pressure_beyond(verdict)
        return verdict


def case_flow_of(verdict: Verdict) -> float | None:
    """Case flow at the reference condition of a verdict as it is stored; None where it has no estimate."""
    estimate = (verdict.get("estimates") or {}).get("case_flow_at_reference_lpm")
    return estimate["mean"] if estimate else None


def case_pressure_beyond(verdict: Verdict) -> bool:
    """What the plain rule of case pressure says in a verdict as it is stored; false where there is no word of it."""
    rule = verdict.get("case_pressure")
    return rule is not None and rule["beyond"]


class Refusal(Base):
    """The fact that an upload was refused, and why; its bytes are not kept."""

    __tablename__ = "refusals"

    id: Mapped[str] = mapped_column(primary_key=True)
    operator: Mapped[str]
    content_hash: Mapped[str]
    received_at: Mapped[datetime] = mapped_column(index=True)
    problem: Mapped[Problem] = mapped_column(JSON_COLUMN)
