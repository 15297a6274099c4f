"""Tables, the same for SQLite and Postgres. Numbers that queries never look into stay in JSON columns."""

from service.storage.tables.access import ApiKey, FailedSignIn, PendingSignIn, SignedIn, User
from service.storage.tables.alarms import Alarm, AlarmAction, Delivery, Message, Webhook
from service.storage.tables.audit import AuditEntry, AuditHead, AuditLink
from service.storage.tables.backups import Backup
from service.storage.tables.base import Base, UtcDateTime
from service.storage.tables.circuits import StoredCircuit
from service.storage.tables.history import (
    Entry,
    Finding,
    Installation,
    MaintenanceEvent,
    RecordMark,
    VerdictRevision,
)
from service.storage.tables.installation import InstallationValue
from service.storage.tables.jobs import CANCELLED, FAILED, QUEUED, RUNNING, SUCCEEDED, Job, JobItem
from service.storage.tables.mappings import StoredMapping
from service.storage.tables.operators import Deletion, OperatorSettings
from service.storage.tables.pump_types import StoredPumpType
from service.storage.tables.records import (
    ANALYSED,
    REFUSED,
    STORED,
    SUPERSEDED,
    WITHDRAWN,
    Record,
    ReductionOutline,
    Refusal,
    StoredAssessment,
    case_flow_of,
    case_pressure_beyond,
)
from service.storage.tables.registry import Aircraft, Pump, ReferenceCurve, RegistryVersion
from service.storage.tables.snapshots import FoldSnapshot
from service.storage.tables.thresholds import ThresholdPin, ThresholdVersion

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
    "Aircraft",
    "Alarm",
    "AlarmAction",
    "ApiKey",
    "AuditEntry",
    "AuditHead",
    "AuditLink",
    "Backup",
    "Base",
    "Deletion",
    "Delivery",
    "Entry",
    "FailedSignIn",
    "Finding",
    "FoldSnapshot",
    "Installation",
    "InstallationValue",
    "Job",
    "JobItem",
    "MaintenanceEvent",
    "Message",
    "OperatorSettings",
    "PendingSignIn",
    "Pump",
    "Record",
    "RecordMark",
    "ReductionOutline",
    "ReferenceCurve",
    "Refusal",
    "RegistryVersion",
    "SignedIn",
    "StoredAssessment",
    "StoredCircuit",
    "StoredMapping",
    "StoredPumpType",
    "ThresholdPin",
    "ThresholdVersion",
    "User",
    "UtcDateTime",
    "VerdictRevision",
    "Webhook",
    "case_flow_of",
    "case_pressure_beyond",
]
