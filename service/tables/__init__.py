"""Tables, the same for SQLite and Postgres. Numbers that queries never look into stay in JSON columns."""

from service.tables.access import ApiKey
from service.tables.base import Base, UtcDateTime
from service.tables.jobs import CANCELLED, FAILED, QUEUED, RUNNING, SUCCEEDED, Job, JobItem
from service.tables.mappings import StoredMapping
from service.tables.records import (
    ANALYSED,
    REFUSED,
    STORED,
    SUPERSEDED,
    WITHDRAWN,
    Record,
    Refusal,
    StoredAssessment,
)
from service.tables.registry import Pump
from service.tables.thresholds import ThresholdVersion

__all__ = [
    "ANALYSED",
    "CANCELLED",
    "FAILED",
    "QUEUED",
    "REFUSED",
    "RUNNING",
    "STORED",
    "SUCCEEDED",
    "SUPERSEDED",
    "WITHDRAWN",
    "ApiKey",
    "Base",
    "Job",
    "JobItem",
    "Pump",
    "Record",
    "Refusal",
    "StoredAssessment",
    "StoredMapping",
    "ThresholdVersion",
    "UtcDateTime",
]
