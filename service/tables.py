"""Tables, the same for SQLite and Postgres. Numbers that queries never look into stay in JSON columns."""

from datetime import UTC, datetime
from typing import Any

from sqlalchemy import JSON, DateTime, Dialect, ForeignKey, Index, MetaData, String, UniqueConstraint, text
from sqlalchemy.dialects.postgresql import JSONB
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column
from sqlalchemy.types import TypeDecorator

STORED = "stored"
ANALYSED = "analysed"
REFUSED = "refused"
SUPERSEDED = "superseded"
WITHDRAWN = "withdrawn"


class UtcDateTime(TypeDecorator[datetime]):
    """Instants in UTC on both databases; a naive datetime is a programming error and raises."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        if value is None:
            return None
        if value.tzinfo is None:
            raise ValueError("an instant needs a time zone")
        value = value.astimezone(UTC)
        return value.replace(tzinfo=None) if dialect.name == "sqlite" else value

    def process_result_value(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        if value is None:
            return None
        return value.replace(tzinfo=UTC) if value.tzinfo is None else value.astimezone(UTC)


_JSON = JSON().with_variant(JSONB(), "postgresql")


class Base(DeclarativeBase):
    """Base of all tables, with names for every constraint so that migrations can speak of them."""

    metadata = MetaData(
        naming_convention={
            "ix": "ix_%(table_name)s_%(column_0_N_name)s",
            "uq": "uq_%(table_name)s_%(column_0_N_name)s",
            "fk": "fk_%(table_name)s_%(column_0_N_name)s",
            "pk": "pk_%(table_name)s",
        }
    )
    type_annotation_map = {  # noqa: RUF012 - SQLAlchemy's own protocol
        datetime: UtcDateTime(),
        dict[str, Any]: _JSON,
        str: String(),
    }


class ApiKey(Base):
    """A key's hash with what it may do; the key itself is shown once and never stored."""

    __tablename__ = "api_keys"

    id: Mapped[str] = mapped_column(primary_key=True)
    owner: Mapped[str]
    role: Mapped[str]
    operator: Mapped[str | None]
    key_hash: Mapped[str] = mapped_column(unique=True)
    created_at: Mapped[datetime]
    expires_at: Mapped[datetime | None]
    last_used_at: Mapped[datetime | None]


class Pump(Base):
    """A pump of an operator; ``confirmed`` is False for one that a record brought along."""

    __tablename__ = "pumps"
    __table_args__ = (UniqueConstraint("operator", "serial"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    operator: Mapped[str]
    serial: Mapped[str]
    pump_type: Mapped[str]
    confirmed: Mapped[bool]
    created_at: Mapped[datetime]


class Record(Base):
    """One upload: its identity, where it belongs, and what the analysis made of it.

    ``request_hash`` recognises the same request, ``identity_hash`` the same operator, bytes and effective
    metadata. ``pump_id`` and the flight's fields are empty until the bytes are decoded. At most one record that
    counts may stand for a flight, pump and segment.
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
    )

    id: Mapped[str] = mapped_column(primary_key=True)
    operator: Mapped[str]
    pump_id: Mapped[int | None] = mapped_column(ForeignKey("pumps.id"))
    aircraft: Mapped[str | None]
    position: Mapped[str | None]
    flight_id: Mapped[str | None]
    segment: Mapped[str] = mapped_column(default="")
    started_at: Mapped[datetime | None]
    flight_hours: Mapped[float | None]
    status: Mapped[str]
    problem: Mapped[dict[str, Any] | None]
    request: Mapped[dict[str, Any]]
    attributes: Mapped[dict[str, Any]] = mapped_column(default=dict)
    content_hash: Mapped[str]
    content_type: Mapped[str]
    request_hash: Mapped[str] = mapped_column(index=True)
    identity_hash: Mapped[str | None] = mapped_column(unique=True)
    supersedes: Mapped[str | None]
    received_at: Mapped[datetime]
    reduction: Mapped[dict[str, Any] | None]
    residuals: Mapped[dict[str, Any] | None]


class StoredAssessment(Base):
    """The fold's answer right after one record; rewritten when an earlier record arrives late."""

    __tablename__ = "assessments"
    __table_args__ = (Index("ix_assessments_pump_id_at", "pump_id", "at"),)

    record_id: Mapped[str] = mapped_column(ForeignKey("records.id"), primary_key=True)
    pump_id: Mapped[int] = mapped_column(ForeignKey("pumps.id"))
    at: Mapped[datetime]
    state: Mapped[str]
    trend: Mapped[dict[str, Any]]
    verdict: Mapped[dict[str, Any]]


class Refusal(Base):
    """The fact that an upload was refused, and why; its bytes are not kept."""

    __tablename__ = "refusals"

    id: Mapped[str] = mapped_column(primary_key=True)
    operator: Mapped[str]
    content_hash: Mapped[str]
    received_at: Mapped[datetime] = mapped_column(index=True)
    problem: Mapped[dict[str, Any]]


class ThresholdVersion(Base):
    """One version of one layer of thresholds; ``number`` counts for the whole service, rows are never changed."""

    __tablename__ = "threshold_versions"
    __table_args__ = (Index("ix_threshold_versions_scope_scope_id", "scope", "scope_id", "operator"),)

    number: Mapped[int] = mapped_column(primary_key=True)
    scope: Mapped[str]
    scope_id: Mapped[str]
    operator: Mapped[str | None]
    values: Mapped[dict[str, Any]]
    author: Mapped[str]
    reason: Mapped[str]
    created_at: Mapped[datetime]
