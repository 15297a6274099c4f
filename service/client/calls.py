"""The core of both clients: every call as a request with the shape of its answer; nothing here waits or connects."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, Generic, TypeVar
from urllib.parse import quote

from service.answers.administration import AuditEntry, Key, KeyMade, Operator
from service.answers.alarms import Alarm, AlarmsHandled, AlarmStatistics
from service.answers.fleet import FleetSummary
from service.answers.history import Finding, MaintenanceEvent, PlaceInTime
from service.answers.jobs import Job, JobItem, JobWithItems
from service.answers.mappings import Mapping as ChannelMapping
from service.answers.mappings import MappingSuggestion
from service.answers.pumps import DamageIdentificationCurve, Forecast, Pump, PumpWithPlace, RankedPump, Trend
from service.answers.records import Record, RecordChannels, RecordSummary, Window
from service.answers.registry import Aircraft, Circuit, PumpType, PumpTypeSummary
from service.answers.thresholds import ThresholdKey, Thresholds
from service.answers.twin import Isolability, OperatingPoints, Simulation
from service.answers.verdicts import Verdict, VerdictChange
from service.client.requests import upload_request

Answer = TypeVar("Answer")
Progress = Callable[[int, int | None], None]
"""Called with the items done and their total, which is None until it is known."""
ENDED = frozenset({"succeeded", "failed", "cancelled"})
Body = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Call(Generic[Answer]):
    """One request; its type says what the answer looks like."""

    method: str
    path: str
    arguments: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class PagedCall(Generic[Answer]):
    """A list, page after page; its type says what an item looks like."""

    path: str
    params: Mapping[str, str] = field(default_factory=dict)


def _get(path: str, **params: object) -> Call[Any]:
    return Call("GET", path, {"params": _params(params)})


def _params(given: Mapping[str, object]) -> dict[str, str]:
    """Query parameters without those that were not given; ``from_`` stands for ``from``."""
    return {name.rstrip("_"): _text(value) for name, value in given.items() if value is not None}


def _text(value: object) -> str:
    return value.isoformat() if isinstance(value, datetime) else str(value)


def _name(text: str) -> str:
    return quote(text, "")


def upload(
    content: bytes,
    content_type: str,
    wait: bool,
    metadata: Mapping[str, str] | None,
    mapping: str | None,
    file_name: str | None = None,
) -> Call[Record]:
    """Upload one record."""
    return Call("POST", "/records", upload_request(content, content_type, wait, metadata, mapping, file_name))


def upload_many(content: bytes, content_type: str, mapping: str | None) -> Call[Job]:
    """Upload an archive of records."""
    return Call("POST", "/records/bulk", upload_request(content, content_type, True, None, mapping))


def record(record_id: str) -> Call[Record]:
    """Where a record stands."""
    return _get(f"/records/{_name(record_id)}")


def windows(record_id: str) -> PagedCall[Window]:
    """Windows of a record."""
    return PagedCall(f"/records/{_name(record_id)}/windows")


def withdraw(record_id: str, reason: str) -> Call[Record]:
    """Withdraw a record."""
    return Call("DELETE", f"/records/{_name(record_id)}", {"params": {"reason": reason}})


def channels(record_id: str, from_: float | None, to: float | None, points: int | None) -> Call[RecordChannels]:
    """Channels of one record over time."""
    return _get(f"/records/{_name(record_id)}/channels", from_=from_, to=to, points=points)


def records(**filters: object) -> PagedCall[RecordSummary]:
    """Records, the newest first."""
    return PagedCall("/records", _params(filters))


def pumps() -> PagedCall[Pump]:
    """All pumps."""
    return PagedCall("/pumps")


def pump(serial: str, operator: str | None) -> Call[PumpWithPlace]:
    """One pump."""
    return _get(f"/pumps/{_name(serial)}", operator=operator)


def verdict(
    serial: str, operator: str | None, at: datetime | str | None, known_at: datetime | str | None
) -> Call[Verdict]:
    """Verdict of one pump."""
    return _get(f"/pumps/{_name(serial)}/verdict", operator=operator, at=at, known_at=known_at)


def verdicts(serial: str, operator: str | None) -> PagedCall[VerdictChange]:
    """Every change of a pump's verdict."""
    return PagedCall(f"/pumps/{_name(serial)}/verdicts", _params({"operator": operator}))


def trend(serial: str, metric: str, **filters: object) -> Call[Trend]:
    """A metric of a pump over time."""
    return _get(f"/pumps/{_name(serial)}/trend", metric=metric, **filters)


def forecast(serial: str, operator: str | None) -> Call[Forecast]:
    """Flight hours to the limit."""
    return _get(f"/pumps/{_name(serial)}/forecast", operator=operator)


def curve(serial: str, **conditions: object) -> Call[DamageIdentificationCurve]:
    """The damage identification curve."""
    return _get(f"/pumps/{_name(serial)}/damage-identification-curve", **conditions)


def installations(serial: str, operator: str | None) -> PagedCall[PlaceInTime]:
    """Where a pump sat."""
    return PagedCall(f"/pumps/{_name(serial)}/installations", _params({"operator": operator}))


def maintenance(serial: str, operator: str | None) -> PagedCall[MaintenanceEvent]:
    """What was done to a pump."""
    return PagedCall(f"/pumps/{_name(serial)}/maintenance", _params({"operator": operator}))


def maintain(serial: str, body: Body, operator: str | None) -> Call[MaintenanceEvent]:
    """Say what was done to a pump."""
    path = f"/pumps/{_name(serial)}/maintenance"
    return Call("POST", path, {"params": _params({"operator": operator}), "json": dict(body)})


def findings(serial: str, operator: str | None) -> PagedCall[Finding]:
    """What the workshop found."""
    return PagedCall(f"/pumps/{_name(serial)}/findings", _params({"operator": operator}))


def aircraft() -> PagedCall[Aircraft]:
    """All aircraft."""
    return PagedCall("/aircraft")


def fleet_summary() -> Call[FleetSummary]:
    """How the fleet is."""
    return _get("/fleet/summary")


def ranking() -> PagedCall[RankedPump]:
    """Pumps by urgency."""
    return PagedCall("/fleet/ranking")


def alarms(**filters: object) -> PagedCall[Alarm]:
    """Alarms, the newest first."""
    return PagedCall("/alarms", _params(filters))


def act_on_alarm(alarm_id: str, action: str, body: Body) -> Call[Alarm]:
    """Acknowledge, shelve, unshelve or close an alarm."""
    return Call("POST", f"/alarms/{_name(alarm_id)}/{action}", {"json": dict(body)})


def act_on_alarms(alarm_ids: Iterable[str], action: str, body: Body) -> Call[AlarmsHandled]:
    """Do the same about many alarms."""
    return Call("POST", "/alarms/actions", {"json": {"alarms": list(alarm_ids), "action": action, **body}})


def plan_alarm(alarm_id: str, body: Body) -> Call[Alarm]:
    """Say who sees to an alarm, until when, under which work order."""
    return Call("PATCH", f"/alarms/{_name(alarm_id)}", {"json": dict(body)})


def comment_on_alarm(alarm_id: str, text: str) -> Call[Alarm]:
    """Say something about an alarm."""
    return Call("POST", f"/alarms/{_name(alarm_id)}/comments", {"json": {"text": text}})


def alarm_statistics(**filters: object) -> Call[AlarmStatistics]:
    """How often alarms came, how long they lasted, how many were a nuisance."""
    return _get("/alarms/statistics", **filters)


def thresholds(scope: str, scope_id: str, operator: str | None) -> Call[Thresholds]:
    """What holds in one layer."""
    return _get(f"/thresholds/{_name(scope)}/{_name(scope_id)}", operator=operator)


def threshold_keys() -> PagedCall[ThresholdKey]:
    """What can be set at all."""
    return PagedCall("/thresholds/keys")


def pump_types() -> PagedCall[PumpTypeSummary]:
    """All pump types."""
    return PagedCall("/pump-types")


def pump_type(name: str) -> Call[PumpType]:
    """One parameter set."""
    return _get(f"/pump-types/{_name(name)}")


def circuits() -> PagedCall[Circuit]:
    """All circuits."""
    return PagedCall("/circuits")


def add_circuit(body: Body) -> Call[Circuit]:
    """Add a circuit."""
    return Call("POST", "/circuits", {"json": dict(body)})


def mappings() -> PagedCall[ChannelMapping]:
    """All channel mappings."""
    return PagedCall("/mappings")


def mapping(name: str, operator: str | None) -> Call[ChannelMapping]:
    """The newest version of a channel mapping."""
    return _get(f"/mappings/{_name(name)}", operator=operator)


def store_mapping(body: Body, operator: str | None) -> Call[ChannelMapping]:
    """Store a channel mapping under a new name."""
    return Call("POST", "/mappings", {"json": dict(body), "params": _params({"operator": operator})})


def suggest_mapping(content: bytes, content_type: str, file_name: str | None) -> Call[MappingSuggestion]:
    """What a file seems to need."""
    params = _params({"file_name": file_name})
    return Call(
        "POST", "/mappings/suggest", {"content": content, "params": params, "headers": {"Content-Type": content_type}}
    )


def operating_points(body: Body) -> Call[OperatingPoints]:
    """Steady states of the twin."""
    return Call("POST", "/twin/operating-point", {"json": dict(body)})


def simulation(body: Body) -> Call[Simulation]:
    """A short run of the transient twin."""
    return Call("POST", "/twin/simulation", {"json": dict(body)})


def isolability(body: Body) -> Call[Isolability]:
    """What given sensors can see."""
    return Call("POST", "/twin/isolability", {"json": dict(body)})


def start_job(kind: str, parameters: Body, operator: str | None) -> Call[Job]:
    """Ask for a job."""
    wanted = {"kind": kind, "parameters": dict(parameters), **({"operator": operator} if operator else {})}
    return Call("POST", "/jobs", {"json": wanted})


def job(job_id: str) -> Call[JobWithItems]:
    """A job with its first items."""
    return _get(f"/jobs/{_name(job_id)}")


def cancel_job(job_id: str) -> Call[Job]:
    """Cancel a job."""
    return Call("POST", f"/jobs/{_name(job_id)}/cancel")


def job_items(job_id: str) -> PagedCall[JobItem]:
    """Every item of a job in order."""
    return PagedCall(f"/jobs/{_name(job_id)}/items")


def keys() -> PagedCall[Key]:
    """Keys that an admin may manage."""
    return PagedCall("/keys")


def make_key(owner: str, role: str, operator: str | None, scopes: Sequence[str] | None = None) -> Call[KeyMade]:
    """Make a key; with ``scopes`` for these only."""
    wanted: dict[str, object] = {"owner": owner, "role": role, **({"operator": operator} if operator else {})}
    if scopes is not None:
        wanted["scopes"] = list(scopes)
    return Call("POST", "/keys", {"json": wanted})


def operators() -> PagedCall[Operator]:
    """Operators that an admin may manage."""
    return PagedCall("/operators")


def audit(**filters: object) -> PagedCall[AuditEntry]:
    """Who changed what."""
    return PagedCall("/audit", _params(filters))
