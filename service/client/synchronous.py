"""The synchronous client."""

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from types import TracebackType
from typing import Any, Self

import httpx2

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
from service.client import calls
from service.client.calls import Answer, Call, PagedCall, Progress
from service.client.requests import API_PREFIX, Retries, document_of

Value = str | int | float | datetime | None
Moment = datetime | str | None
_POLLING_S = 0.5


class Client:
    """Synchronous client.

    Parameters
    ----------
    base_url
        Where the service listens, without the API prefix.
    key
        API key; None where authentication is off.
    retries
        How often a request is repeated that found no connection or was told to come back. An upload may be
        repeated safely: the same bytes with the same metadata are the same record.
    needs_answer
        Whether the first connection that is not found is said at once: who waits for a service to come back has met it.
    timeout_s
        Longest wait for an answer [s].
    transport
        In place of the network: ``service.client.testing.MemoryService().transport`` in tests.
    """

    def __init__(
        self,
        base_url: str,
        key: str | None = None,
        *,
        retries: int = 4,
        needs_answer: bool = False,
        timeout_s: float = 120.0,
        transport: httpx2.BaseTransport | None = None,
    ) -> None:
        headers = {"Authorization": f"Bearer {key}"} if key else {}
        self._http = httpx2.Client(base_url=base_url, headers=headers, timeout=timeout_s, transport=transport)
        self._retries, self._knows = retries, not needs_answer

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def upload(
        self,
        content: bytes,
        content_type: str = "text/csv",
        *,
        wait: bool = True,
        metadata: Mapping[str, str] | None = None,
        mapping: str | None = None,
        file_name: str | None = None,
    ) -> Record:
        """Upload one record; where it stands then is the answer. A mapping may read metadata from ``file_name``.

        Raises
        ------
        RefusedError
            with every fault that the service found.
        httpx2.HTTPError
            when the service cannot be reached.
        """
        return self.answer(calls.upload(content, content_type, wait, metadata, mapping, file_name))

    def upload_many(self, content: bytes, content_type: str = "application/zip", *, mapping: str | None = None) -> Job:
        """Upload a ZIP file or NDJSON of many records: the job that imports them."""
        return self.answer(calls.upload_many(content, content_type, mapping))

    def record(self, record_id: str) -> Record:
        """Where a record stands."""
        return self.answer(calls.record(record_id))

    def records(self, **filters: Value) -> Iterator[RecordSummary]:
        """Records, the newest first; filters are those of ``GET /records``, ``from_`` for ``from``."""
        return self.items(calls.records(**filters))

    def channels(
        self, record_id: str, from_s: float | None = None, to_s: float | None = None, points: int | None = None
    ) -> RecordChannels:
        """Channels of one record over time, thinned without losing extremes."""
        return self.answer(calls.channels(record_id, from_s, to_s, points))

    def windows(self, record_id: str) -> Iterator[Window]:
        """Windows of one record in time order."""
        return self.items(calls.windows(record_id))

    def withdraw(self, record_id: str, reason: str) -> Record:
        """Withdraw one record; its bytes are kept."""
        return self.answer(calls.withdraw(record_id, reason))

    def pumps(self) -> Iterator[Pump]:
        """All pumps that the key may see."""
        return self.items(calls.pumps())

    def pump(self, serial: str, operator: str | None = None) -> PumpWithPlace:
        """One pump; ``operator`` tells apart pumps of the same serial number."""
        return self.answer(calls.pump(serial, operator))

    def verdict(
        self, serial: str, operator: str | None = None, *, at: Moment = None, known_at: Moment = None
    ) -> Verdict:
        """Verdict of one pump now, at an event time, or as it stood with what was known at an instant."""
        return self.answer(calls.verdict(serial, operator, at, known_at))

    def verdicts(self, serial: str, operator: str | None = None) -> Iterator[VerdictChange]:
        """Every change of a pump's verdict, the oldest first."""
        return self.items(calls.verdicts(serial, operator))

    def trend(self, serial: str, metric: str, **filters: Value) -> Trend:
        """A metric over time; filters are those of the call, ``from_`` for ``from``."""
        return self.answer(calls.trend(serial, metric, **filters))

    def forecast(self, serial: str, operator: str | None = None) -> Forecast:
        """Flight hours [h] to the limit, or why none can be given."""
        return self.answer(calls.forecast(serial, operator))

    def curve(self, serial: str, **conditions: Value) -> DamageIdentificationCurve:
        """The damage identification curve [bar] at the given or the latest conditions."""
        return self.answer(calls.curve(serial, **conditions))

    def installations(self, serial: str, operator: str | None = None) -> Iterator[PlaceInTime]:
        """Where a pump sat."""
        return self.items(calls.installations(serial, operator))

    def maintenance(self, serial: str, operator: str | None = None) -> Iterator[MaintenanceEvent]:
        """What was done to a pump."""
        return self.items(calls.maintenance(serial, operator))

    def maintain(self, serial: str, body: calls.Body, operator: str | None = None) -> MaintenanceEvent:
        """Say what was done: ``at``, ``action``, perhaps ``fluid`` or ``channel``, ``note``."""
        return self.answer(calls.maintain(serial, body, operator))

    def findings(self, serial: str, operator: str | None = None) -> Iterator[Finding]:
        """What the workshop found."""
        return self.items(calls.findings(serial, operator))

    def aircraft(self) -> Iterator[Aircraft]:
        """All aircraft that the key may see."""
        return self.items(calls.aircraft())

    def fleet_summary(self) -> FleetSummary:
        """How the fleet is."""
        return self.answer(calls.fleet_summary())

    def ranking(self) -> Iterator[RankedPump]:
        """Pumps by urgency, each with its reasons."""
        return self.items(calls.ranking())

    def alarms(self, **filters: Value) -> Iterator[Alarm]:
        """Alarms, the newest first; filters are those of ``GET /alarms``."""
        return self.items(calls.alarms(**filters))

    def act_on_alarm(self, alarm_id: str, action: str, **body: Value) -> Alarm:
        """``acknowledge``, ``shelve``, ``unshelve`` or ``close`` an alarm."""
        return self.answer(calls.act_on_alarm(alarm_id, action, body))

    def act_on_alarms(self, alarm_ids: Iterable[str], action: str, **body: Value) -> AlarmsHandled:
        """The same for many, ``plan`` and ``comment`` too; what could not be done is said of each."""
        return self.answer(calls.act_on_alarms(alarm_ids, action, body))

    def plan_alarm(self, alarm_id: str, **body: Value) -> Alarm:
        """Set ``assignee``, ``due_at``, ``work_order`` of an alarm; None takes back, what is not named stays."""
        return self.answer(calls.plan_alarm(alarm_id, body))

    def comment_on_alarm(self, alarm_id: str, text: str) -> Alarm:
        """Add a comment to an alarm's history."""
        return self.answer(calls.comment_on_alarm(alarm_id, text))

    def alarm_statistics(self, **filters: Value) -> AlarmStatistics:
        """How often, how long, how many for nothing; filters are those of ``GET /alarms/statistics``."""
        return self.answer(calls.alarm_statistics(**filters))

    def thresholds(self, scope: str, scope_id: str, operator: str | None = None) -> Thresholds:
        """What holds in one layer."""
        return self.answer(calls.thresholds(scope, scope_id, operator))

    def threshold_keys(self) -> Iterator[ThresholdKey]:
        """What can be set, with unit and range."""
        return self.items(calls.threshold_keys())

    def pump_types(self) -> Iterator[PumpTypeSummary]:
        """All pump types."""
        return self.items(calls.pump_types())

    def pump_type(self, name: str) -> PumpType:
        """One parameter set."""
        return self.answer(calls.pump_type(name))

    def circuits(self) -> Iterator[Circuit]:
        """All circuits."""
        return self.items(calls.circuits())

    def add_circuit(self, body: calls.Body) -> Circuit:
        """Add a circuit; the body is that of ``POST /circuits``."""
        return self.answer(calls.add_circuit(body))

    def mappings(self) -> Iterator[ChannelMapping]:
        """All channel mappings."""
        return self.items(calls.mappings())

    def mapping(self, name: str, operator: str | None = None) -> ChannelMapping:
        """The newest version of a channel mapping."""
        return self.answer(calls.mapping(name, operator))

    def store_mapping(self, body: calls.Body, operator: str | None = None) -> ChannelMapping:
        """Store a channel mapping under a new name."""
        return self.answer(calls.store_mapping(body, operator))

    def suggest_mapping(
        self, content: bytes, content_type: str = "text/csv", file_name: str | None = None
    ) -> MappingSuggestion:
        """What a file seems to need; nothing is stored."""
        return self.answer(calls.suggest_mapping(content, content_type, file_name))

    def operating_points(self, body: calls.Body) -> OperatingPoints:
        """Steady states of the twin; the body is that of ``POST /twin/operating-point``."""
        return self.answer(calls.operating_points(body))

    def simulation(self, body: calls.Body) -> Simulation:
        """A short run of the transient twin; the body is that of ``POST /twin/simulation``."""
        return self.answer(calls.simulation(body))

    def isolability(self, body: calls.Body) -> Isolability:
        """What given sensors can see; the body is that of ``POST /twin/isolability``."""
        return self.answer(calls.isolability(body))

    def start_job(self, kind: str, parameters: calls.Body, operator: str | None = None) -> Job:
        """Ask for a job."""
        return self.answer(calls.start_job(kind, parameters, operator))

    def job(self, job_id: str) -> JobWithItems:
        """A job with its first items."""
        return self.answer(calls.job(job_id))

    def cancel_job(self, job_id: str) -> Job:
        """Stop a job between two items."""
        return self.answer(calls.cancel_job(job_id))

    def job_items(self, job_id: str) -> Iterator[JobItem]:
        """Every item of a job in order."""
        return self.items(calls.job_items(job_id))

    def keys(self) -> Iterator[Key]:
        """Keys that an admin may manage."""
        return self.items(calls.keys())

    def make_key(
        self, owner: str, role: str, operator: str | None = None, scopes: Sequence[str] | None = None
    ) -> KeyMade:
        """Make a key, with ``scopes`` for these only; it is in this answer and nowhere else."""
        return self.answer(calls.make_key(owner, role, operator, scopes))

    def operators(self) -> Iterator[Operator]:
        """Operators that an admin may manage."""
        return self.items(calls.operators())

    def audit(self, **filters: Value) -> Iterator[AuditEntry]:
        """Who changed what, the newest first; filters are those of ``GET /audit``."""
        return self.items(calls.audit(**filters))

    def finished_job(self, job_id: str, progress: Progress | None = None) -> JobWithItems:
        """Wait until a job has ended; ``progress`` is told how far it is."""
        while True:
            job = self.job(job_id)
            if progress is not None:
                progress(job["progress"]["done"], job["progress"]["total"])
            if job["status"] in calls.ENDED:
                return job
            time.sleep(_POLLING_S)

    def is_ready(self) -> bool:
        """Whether the service can do its work."""
        try:
            return (self._http.get("/readyz")).status_code == httpx2.codes.OK
        except httpx2.TransportError:
            return False

    def items(self, call: PagedCall[Answer]) -> Iterator[Answer]:
        """Items of a paged list, page after page."""
        cursor: str | None = None
        while True:
            params = {**call.params, **({"cursor": cursor} if cursor else {})}
            page = self.request("GET", call.path, params=params)
            yield from page["items"]
            cursor = page["next"]
            if cursor is None:
                return

    def answer(self, call: Call[Answer]) -> Answer:
        """The answer to a call of ``service.client.calls``, in its shape."""
        found: Answer = self.request(call.method, call.path, **call.arguments)
        return found

    def request(self, method: str, path: str, **arguments: Any) -> Any:
        """Any call of the API, repeated where that is safe and useful.

        Raises
        ------
        RefusedError
            with the service's problem document.
        httpx2.HTTPError
            when the service cannot be reached.
        """
        retries = Retries(self._retries)
        while True:
            try:
                response = self._http.request(method, API_PREFIX + path, **arguments)
            except httpx2.TransportError:
                wait = retries.wait_after_loss()
                if wait is None or not self._knows:
                    raise
            else:
                self._knows = True
                wait = retries.wait_after(response)
                if wait is None:
                    return document_of(response)
            time.sleep(wait)
