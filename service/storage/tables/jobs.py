"""Work that outlasts a request, and what became of each of its items."""

from datetime import datetime

from sqlalchemy import ForeignKey, Index
from sqlalchemy.orm import Mapped, mapped_column

from service.answers.documents import JsonObject
from service.answers.jobs import JobResult
from service.answers.problems import Problem
from service.storage.tables.base import JSON_COLUMN, Base

QUEUED = "queued"
RUNNING = "running"
SUCCEEDED = "succeeded"
FAILED = "failed"
CANCELLED = "cancelled"


class Job(Base):
    """A job; ``operator`` None is work over all operators. ``heartbeat_at`` is when it was last got on with."""

    __tablename__ = "jobs"
    __table_args__ = (Index("ix_jobs_status", "status"), Index("ix_jobs_created_at_id", "created_at", "id"))

    id: Mapped[str] = mapped_column(primary_key=True)
    operator: Mapped[str | None]
    kind: Mapped[str]
    status: Mapped[str]
    done: Mapped[int]
    total: Mapped[int | None]
    parameters: Mapped[JsonObject]
    result: Mapped[JobResult | None] = mapped_column(JSON_COLUMN)
    problem: Mapped[Problem | None] = mapped_column(JSON_COLUMN)
    cancel_requested: Mapped[bool]
    author: Mapped[str]
    created_at: Mapped[datetime]
    started_at: Mapped[datetime | None]
    finished_at: Mapped[datetime | None]
    heartbeat_at: Mapped[datetime | None]


class JobItem(Base):
    """One item of a job: written once, in the transaction that counts it as done."""

    __tablename__ = "job_items"

    job_id: Mapped[str] = mapped_column(ForeignKey("jobs.id"), primary_key=True)
    position: Mapped[int] = mapped_column(primary_key=True)
    name: Mapped[str]
    status: Mapped[str]
    detail: Mapped[JsonObject]
