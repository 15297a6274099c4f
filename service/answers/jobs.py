"""Jobs: what was asked for, how far it is, what became of each item."""

from collections.abc import Mapping
from typing import NotRequired

from typing_extensions import TypedDict

from service.answers.alarms import AlarmChanges, AlarmOutline
from service.answers.documents import JsonObject
from service.answers.problems import Problem
from service.answers.thresholds import FirstAlarm, JudgedFindings, PreviewTotals
from service.answers.words import Instant, State, shape


@shape
class Progress(TypedDict):
    """How far a job is."""

    done: int
    """Number of items that are done (a count)."""
    total: int | None
    """Number of all items (a count); null until it is known."""


DOCUMENT_TYPES: Mapping[str, str] = {
    "html": "text/html; charset=utf-8",
    "json": "application/json",
    "pdf": "application/pdf",
}
"""Formats that documents of jobs come in, with their media types."""


@shape
class JobFile(TypedDict):
    """A document that a job has left."""

    content_hash: str
    """SHA-256 of its bytes."""
    bytes: int
    """Its size [byte]."""


@shape
class JobResult(TypedDict):
    """What a job came to beside its items."""

    counts: dict[str, int]
    """Number of items by their status (counts)."""
    files: NotRequired[dict[str, JobFile]]
    """Documents by format, at `/jobs/{id}/result`."""
    totals: NotRequired[PreviewTotals]
    """Of a preview: all pumps together."""


@shape
class Job(TypedDict):
    """A job without its items."""

    id: str
    """Id of the job."""
    job_id: str
    """The same."""
    kind: str
    """What it does."""
    operator: str | None
    """Operator whose data it works on; null for all that its author may see."""
    status: str
    """`queued`, `running`, `succeeded`, `failed` or `cancelled`."""
    progress: Progress
    """How far it is."""
    parameters: JsonObject
    """What it was asked to do; each kind has parameters of its own, in the units that their names end in."""
    result: JobResult | None
    """What it came to; null until then."""
    problem: Problem | None
    """Why it failed."""
    cancel_requested: bool
    """Whether somebody asked it to stop."""
    author: str
    """Who asked for it."""
    created_at: Instant
    """When it was asked for."""
    started_at: Instant | None
    """When it began."""
    finished_at: Instant | None
    """When it ended."""


@shape
class VerdictDifference(TypedDict):
    """A record whose verdict changed by a reprocessing."""

    record_id: str
    """The record."""
    at: Instant
    """Its event time."""
    before: State | None
    """State before; null where there was no verdict."""
    after: State
    """State afterwards."""


class PumpChange(TypedDict):
    """What a reprocessing did, or would do, to one pump."""

    pump: str
    operator: str
    records: int
    changed: int
    changes: list[VerdictDifference]
    state_before: State | None
    state_after: State | None
    alarms: AlarmChanges
    twin_version: str
    threshold_version: int


@shape
class JobItem(TypedDict):
    """What became of one item; beside position, name and status each kind of job has members of its own."""

    position: int
    """Place among the items, from 0 (a count)."""
    name: str
    """What the item is: a file's name, a serial number …"""
    status: str
    """What became of it, for example `analysed`, `refused`, `changed` or `unchanged`."""
    problem: NotRequired[Problem | None]
    """Why it failed."""
    record_id: NotRequired[str | None]
    """Bulk import: the record; null where it was refused."""
    pump: NotRequired[str]
    """Reprocessing: serial number of the pump."""
    pump_serial: NotRequired[str]
    """Preview: serial number of the pump."""
    operator: NotRequired[str]
    """Operator that it belongs to."""
    records: NotRequired[int]
    """Reprocessing: number of records (a count)."""
    changed: NotRequired[int | bool]
    """Reprocessing: number of verdicts that changed (a count). Preview: whether any alarm differs."""
    changes: NotRequired[list[VerdictDifference]]
    """Reprocessing: the first verdicts that changed."""
    state_before: NotRequired[State | None]
    """Reprocessing: state of the newest verdict before."""
    state_after: NotRequired[State | None]
    """Reprocessing: state of the newest verdict afterwards."""
    alarms: NotRequired[AlarmChanges]
    """Reprocessing: alarms gained and lost."""
    twin_version: NotRequired[str]
    """Reprocessing: version of the twin."""
    threshold_version: NotRequired[int]
    """Reprocessing: number of the thresholds' version (a count)."""
    alarms_now: NotRequired[int]
    """Preview: number of alarms with today's thresholds (a count)."""
    alarms_with_candidate: NotRequired[int]
    """Preview: number of alarms with the candidate (a count)."""
    gained: NotRequired[list[AlarmOutline]]
    """Preview: alarms that only the candidate raises."""
    lost: NotRequired[list[AlarmOutline]]
    """Preview: alarms that the candidate does not raise."""
    first_alarm: NotRequired[FirstAlarm]
    """Preview: the first alarm on either side."""
    findings: NotRequired[JudgedFindings]
    """Preview: beside what the workshop found."""
    state: NotRequired[State | None]
    """Report: state of the pump."""
    pumps: NotRequired[int]
    """Evaluation: number of simulated pumps (a count)."""


@shape
class JobWithItems(Job):
    """A job with its first items."""

    items: list[JobItem]
    """The first items in order."""
    items_complete: bool
    """Whether these are all that are done so far."""
