"""Every route of the service: who may use it, with a request that names things of one operator.

``{…}`` in a URL or body stands for a thing that ``seeded`` made. A route that is missing here fails a test.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any

from fastapi import FastAPI
from fastapi.testclient import TestClient

from service.storage.tables import SUCCEEDED, Job
from tests.service.guarded import key
from tests.service.histories import write_history
from tests.service.records import body as record_body
from tests.service.records import document as record_document

API = "/api/v1"
OPEN = "open"
PAGE = "page"
"""Instead of a role: needs no key, but a session; ``page_role`` says of which role at least."""


@dataclass(frozen=True)
class Entry:
    """One route.

    ``role`` is the lowest that may use it. ``named`` says that the request names a thing of one operator, so that
    another operator's key gets 404; else it is answered from the asker's own data. ``refused`` says that no request
    at all succeeds, whatever the role. ``page_role`` is the lowest role whose session sees a page.
    """

    role: str
    url: str
    named: bool = False
    body: Any = None
    content: bytes | None = None
    headers: Mapping[str, str] = field(default_factory=dict)
    refused: bool = False
    page_role: str = "viewer"


_SOON = (datetime.now(UTC) + timedelta(days=2)).isoformat()
_JSON = {"content-type": "application/json"}
_RUN = {"duration_s": 0.02, "sample_rate_hz": 100.0}
_POINT = {"conditions": [{"speed_rpm": 4600, "fluid_temperature_degc": 50}]}
_PUT = {"values": {"case_flow_limit_lpm": 1.4}, "reason": "earlier warning"}

_ENTRIES = f"{API}/pumps/{{pump}}"
_HISTORY = f"{API}/pumps/{{serial}}"
_PLACE = {"aircraft": "{aircraft}", "position": "RH", "from": "2021-01-01T00:00:00Z", "to": "2021-02-01T00:00:00Z"}
_EVENT = {"at": "2021-01-01T00:00:00Z", "action": "filter_changed"}
_FINDING = {"at": "2021-01-01T00:00:00Z", "found": "no_fault_found"}
_CURVE = {
    "points": [
        {
            "discharge_pressure_bar": 174.0,
            "case_minus_reservoir_bar": 0.35,
            "fluid_temperature_degc": 50.0,
            "speed_rpm": speed,
        }
        for speed in (4500.0, 4600.0)
    ]
}
_TIGHT = {"slipper.h": {"value": 8.2, "unit": "um", "source": "bench run 12"}}
_MAPPING = {"channels": [{"source": "HYD1_P", "channel": "discharge_pressure_bar", "unit": "psi"}]}
MARK = {"start_s": 100.0, "end_s": 110.0, "mark": "bad", "reason": "plug was moved"}
ENDING = ("DELETE", f"{API}/operators/{{operator}}")
"""Takes away everything that the other entries name."""

MATRIX: dict[tuple[str, str], Entry] = {
    ("POST", f"{API}/records"): Entry("analyst", f"{API}/records", content=record_body(), headers=_JSON),
    ("GET", f"{API}/records"): Entry("viewer", f"{API}/records"),
    ("GET", f"{API}/records/{{record_id}}"): Entry("viewer", f"{API}/records/{{record}}", True),
    ("GET", f"{API}/records/{{record_id}}/windows"): Entry("viewer", f"{API}/records/{{record}}/windows", True),
    ("GET", f"{API}/records/{{record_id}}/raw"): Entry("viewer", f"{API}/records/{{record}}/raw", True),
    ("GET", f"{API}/records/{{record_id}}/marks"): Entry("viewer", f"{API}/records/{{record}}/marks", True),
    ("POST", f"{API}/records/{{record_id}}/marks"): Entry("engineer", f"{API}/records/{{record}}/marks", True, MARK),
    ("DELETE", f"{API}/records/{{record_id}}/marks/{{mark_id}}"): Entry(
        "engineer", f"{API}/records/{{record}}/marks/{{mark}}", True
    ),
    ("GET", f"{API}/records/refusals"): Entry("viewer", f"{API}/records/refusals"),
    ("GET", f"{API}/records/{{record_id}}/channels"): Entry("viewer", f"{API}/records/{{record}}/channels", True),
    ("GET", f"{API}/pumps"): Entry("viewer", f"{API}/pumps"),
    ("GET", f"{API}/pumps/{{serial}}"): Entry("viewer", f"{API}/pumps/{{pump}}", True),
    ("GET", f"{API}/pumps/{{serial}}/verdict"): Entry("viewer", f"{API}/pumps/{{pump}}/verdict", True),
    ("GET", f"{API}/pumps/{{serial}}/verdicts"): Entry("viewer", f"{API}/pumps/{{pump}}/verdicts", True),
    ("GET", f"{API}/pumps/{{serial}}/trend"): Entry(
        "viewer", f"{API}/pumps/{{pump}}/trend?metric=case_residual_bar", True
    ),
    ("GET", f"{API}/pumps/{{serial}}/forecast"): Entry("viewer", f"{API}/pumps/{{pump}}/forecast", True),
    ("GET", f"{API}/pumps/{{serial}}/damage-identification-curve"): Entry(
        "viewer", f"{API}/pumps/{{pump}}/damage-identification-curve", True
    ),
    ("GET", f"{API}/pumps/{{serial}}/state.svg"): Entry("viewer", f"{API}/pumps/{{pump}}/state.svg", True),
    ("DELETE", f"{API}/records/{{record_id}}"): Entry("analyst", f"{API}/records/{{record}}?reason=mistaken", True),
    ("GET", f"{API}/pumps/{{serial}}/verdicts/revisions"): Entry("viewer", f"{_ENTRIES}/verdicts/revisions", True),
    ("POST", f"{API}/pumps"): Entry("engineer", f"{API}/pumps", body={"serial": "P-new"}),
    ("PATCH", f"{API}/pumps/{{serial}}"): Entry("engineer", _ENTRIES, True, {"confirmed": True}),
    ("GET", f"{_HISTORY}/installations"): Entry("viewer", f"{_ENTRIES}/installations", True),
    ("POST", f"{_HISTORY}/installations"): Entry("engineer", f"{_ENTRIES}/installations", True, _PLACE),
    ("PATCH", f"{_HISTORY}/installations/{{entry_id}}"): Entry(
        "engineer", f"{_ENTRIES}/installations/{{installation}}", True, {"to": "2020-03-01T00:00:00Z"}
    ),
    ("DELETE", f"{_HISTORY}/installations/{{entry_id}}"): Entry(
        "engineer", f"{_ENTRIES}/installations/{{installation}}", True
    ),
    ("GET", f"{_HISTORY}/maintenance"): Entry("viewer", f"{_ENTRIES}/maintenance", True),
    ("POST", f"{_HISTORY}/maintenance"): Entry("engineer", f"{_ENTRIES}/maintenance", True, _EVENT),
    ("PATCH", f"{_HISTORY}/maintenance/{{entry_id}}"): Entry(
        "engineer", f"{_ENTRIES}/maintenance/{{maintenance}}", True, {"note": "both filters"}
    ),
    ("DELETE", f"{_HISTORY}/maintenance/{{entry_id}}"): Entry(
        "engineer", f"{_ENTRIES}/maintenance/{{maintenance}}", True
    ),
    ("GET", f"{_HISTORY}/findings"): Entry("viewer", f"{_ENTRIES}/findings", True),
    ("POST", f"{_HISTORY}/findings"): Entry("analyst", f"{_ENTRIES}/findings", True, _FINDING),
    ("PATCH", f"{_HISTORY}/findings/{{entry_id}}"): Entry(
        "analyst", f"{_ENTRIES}/findings/{{finding}}", True, {"measured_case_flow_lpm": 1.6}
    ),
    ("DELETE", f"{_HISTORY}/findings/{{entry_id}}"): Entry("analyst", f"{_ENTRIES}/findings/{{finding}}", True),
    ("GET", f"{API}/aircraft"): Entry("viewer", f"{API}/aircraft"),
    ("POST", f"{API}/aircraft"): Entry("engineer", f"{API}/aircraft", body={"aircraft": "F-new"}),
    ("GET", f"{API}/aircraft/{{name}}"): Entry("viewer", f"{API}/aircraft/{{aircraft}}", True),
    ("PATCH", f"{API}/aircraft/{{name}}"): Entry(
        "engineer", f"{API}/aircraft/{{aircraft}}", True, {"aircraft_type": "H225"}
    ),
    ("GET", f"{API}/aircraft/{{name}}/positions/{{position}}/trend"): Entry(
        "viewer", f"{API}/aircraft/{{aircraft}}/positions/LH/trend?metric=case_residual_bar", True
    ),
    ("GET", f"{API}/circuits"): Entry("viewer", f"{API}/circuits"),
    ("POST", f"{API}/circuits"): Entry("engineer", f"{API}/circuits", body={"id": "ironbird", "drain": "separate"}),
    ("GET", f"{API}/circuits/{{name}}"): Entry("viewer", f"{API}/circuits/shared_return"),
    ("GET", f"{API}/pump-types"): Entry("viewer", f"{API}/pump-types"),
    ("POST", f"{API}/pump-types"): Entry(
        "engineer", f"{API}/pump-types", body={"id": "rebuilt", "base": "h225", "changes": _TIGHT}
    ),
    ("GET", f"{API}/pump-types/{{name}}"): Entry("viewer", f"{API}/pump-types/h225"),
    ("GET", f"{API}/pump-types/{{name}}/reference-curve"): Entry("viewer", f"{API}/pump-types/h225/reference-curve"),
    ("PUT", f"{API}/pump-types/{{name}}/reference-curve"): Entry(
        "engineer", f"{API}/pump-types/h225/reference-curve", body=_CURVE
    ),
    ("GET", f"{API}/registry/{{kind}}.csv"): Entry("viewer", f"{API}/registry/pumps.csv"),
    ("POST", f"{API}/registry/{{kind}}.csv"): Entry(
        "engineer",
        f"{API}/registry/pumps.csv",
        content=b"serial,pump_type\nP-listed,h225\n",
        headers={"content-type": "text/csv"},
    ),
    ("GET", f"{API}/operators"): Entry("admin", f"{API}/operators"),
    ("GET", f"{API}/operators/deletions"): Entry("admin", f"{API}/operators/deletions"),
    ("PATCH", f"{API}/operators/{{operator}}"): Entry(
        "admin", f"{API}/operators/{{operator}}", True, {"retention_days": 730}
    ),
    ("GET", f"{API}/operators/{{operator}}/export"): Entry("admin", f"{API}/operators/{{operator}}/export", True),
    ENDING: Entry("admin", f"{API}/operators/{{operator}}?confirm={{operator}}&reason=contract+ended", True),
    ("GET", f"{API}/records/{{record_id}}/spectrum"): Entry(
        "viewer", f"{API}/records/{{burst}}/spectrum?channel=discharge_pressure_bar", True
    ),
    ("POST", f"{API}/records/bulk"): Entry(
        "analyst",
        f"{API}/records/bulk",
        content=record_body() + b"\n",
        headers={"content-type": "application/x-ndjson"},
    ),
    ("GET", f"{API}/mappings"): Entry("viewer", f"{API}/mappings"),
    ("POST", f"{API}/mappings"): Entry("analyst", f"{API}/mappings", body={"name": "new-export", **_MAPPING}),
    ("GET", f"{API}/mappings/{{name}}"): Entry("viewer", f"{API}/mappings/{{mapping}}", True),
    ("PUT", f"{API}/mappings/{{name}}"): Entry(
        "analyst", f"{API}/mappings/{{mapping}}", True, _MAPPING, headers={"If-Match": '"1"'}
    ),
    ("POST", f"{API}/mappings/suggest"): Entry(
        "viewer", f"{API}/mappings/suggest?position=LH", False, content=record_body(), headers=_JSON
    ),
    ("POST", f"{API}/mappings/preview"): Entry(
        "viewer", f"{API}/mappings/preview?mapping={{mapping}}&rows=2", True, content=record_body(), headers=_JSON
    ),
    ("GET", f"{API}/jobs"): Entry("viewer", f"{API}/jobs"),
    ("POST", f"{API}/jobs"): Entry(
        "analyst", f"{API}/jobs", True, {"kind": "reprocess", "parameters": {"pump": "{pump}", "only": "verdicts"}}
    ),
    ("GET", f"{API}/jobs/{{job_id}}"): Entry("viewer", f"{API}/jobs/{{job}}", True),
    ("GET", f"{API}/jobs/{{job_id}}/items"): Entry("viewer", f"{API}/jobs/{{job}}/items", True),
    ("GET", f"{API}/jobs/{{job_id}}/result"): Entry("viewer", f"{API}/jobs/{{report}}/result?format=json", True),
    ("POST", f"{API}/jobs/{{job_id}}/cancel"): Entry("analyst", f"{API}/jobs/{{job}}/cancel", True),
    ("GET", f"{API}/exports/{{name}}.{{form}}"): Entry("viewer", f"{API}/exports/windows.csv"),
    ("GET", f"{API}/fleet/summary"): Entry("viewer", f"{API}/fleet/summary"),
    ("GET", f"{API}/fleet/ranking"): Entry("viewer", f"{API}/fleet/ranking"),
    ("GET", f"{API}/fleet/trend"): Entry("viewer", f"{API}/fleet/trend?metric=case_residual_bar&group_by=operator"),
    ("GET", f"{API}/alarms"): Entry("viewer", f"{API}/alarms"),
    ("GET", f"{API}/alarms/statistics"): Entry("viewer", f"{API}/alarms/statistics"),
    ("POST", f"{API}/alarms/actions"): Entry(
        "analyst", f"{API}/alarms/actions", body={"alarms": ["{alarm}"], "action": "comment", "reason": "seen"}
    ),
    ("PATCH", f"{API}/alarms/{{alarm_id}}"): Entry("analyst", f"{API}/alarms/{{alarm}}", True, {"assignee": "line 2"}),
    ("POST", f"{API}/alarms/{{alarm_id}}/comments"): Entry(
        "analyst", f"{API}/alarms/{{alarm}}/comments", True, {"text": "oil analysis asked for"}
    ),
    ("GET", f"{API}/alarms/{{alarm_id}}"): Entry("viewer", f"{API}/alarms/{{alarm}}", True),
    ("POST", f"{API}/alarms/{{alarm_id}}/acknowledge"): Entry("analyst", f"{API}/alarms/{{alarm}}/acknowledge", True),
    ("POST", f"{API}/alarms/{{alarm_id}}/shelve"): Entry(
        "analyst", f"{API}/alarms/{{alarm}}/shelve", True, {"reason": "spare arrives on Friday", "until": _SOON}
    ),
    ("POST", f"{API}/alarms/{{alarm_id}}/unshelve"): Entry("analyst", f"{API}/alarms/{{alarm}}/unshelve", True),
    ("POST", f"{API}/alarms/{{alarm_id}}/close"): Entry(
        "analyst", f"{API}/alarms/{{alarm}}/close", True, {"reason": "pump replaced"}
    ),
    ("GET", f"{API}/thresholds/keys"): Entry("viewer", f"{API}/thresholds/keys"),
    ("POST", f"{API}/thresholds/preview"): Entry(
        "analyst", f"{API}/thresholds/preview", True, {"scope": "pump", "id": "{pump}", "values": {"alarm_records": 5}}
    ),
    ("PUT", f"{API}/thresholds/{{scope}}/{{scope_id}}"): Entry(
        "engineer", f"{API}/thresholds/pump/{{pump}}", True, _PUT, headers={"If-Match": "*"}
    ),
    ("GET", f"{API}/thresholds/{{scope}}/{{scope_id}}"): Entry(
        "viewer", f"{API}/thresholds/operator/{{operator}}", True
    ),
    ("GET", f"{API}/thresholds/{{scope}}/{{scope_id}}/versions"): Entry(
        "viewer", f"{API}/thresholds/pump/{{pump}}/versions", True
    ),
    ("POST", f"{API}/thresholds/{{scope}}/{{scope_id}}/versions/{{number}}/restore"): Entry(
        "engineer", f"{API}/thresholds/operator/{{operator}}/versions/{{version}}/restore", True
    ),
    ("GET", f"{API}/keys"): Entry("admin", f"{API}/keys"),
    ("POST", f"{API}/keys"): Entry("admin", f"{API}/keys", body={"owner": "office", "role": "viewer"}),
    ("DELETE", f"{API}/keys/{{key_id}}"): Entry("admin", f"{API}/keys/{{key}}", True),
    ("GET", f"{API}/users"): Entry("admin", f"{API}/users"),
    ("POST", f"{API}/users"): Entry(
        "admin", f"{API}/users", body={"name": "j.dupont", "password": "a long enough sentence", "role": "viewer"}
    ),
    ("PATCH", f"{API}/users/{{name}}"): Entry("admin", f"{API}/users/{{user}}", True, {"role": "analyst"}),
    ("DELETE", f"{API}/users/{{name}}/sessions"): Entry("admin", f"{API}/users/{{user}}/sessions", True),
    ("GET", f"{API}/webhooks"): Entry("admin", f"{API}/webhooks"),
    ("POST", f"{API}/webhooks"): Entry("admin", f"{API}/webhooks", body={"url": "https://hooks.test/casedrain"}),
    ("GET", f"{API}/webhooks/{{webhook_id}}/deliveries"): Entry(
        "admin", f"{API}/webhooks/{{webhook}}/deliveries", True
    ),
    ("DELETE", f"{API}/webhooks/{{webhook_id}}"): Entry("admin", f"{API}/webhooks/{{webhook}}", True),
    ("GET", f"{API}/audit"): Entry("admin", f"{API}/audit"),
    ("GET", f"{API}/audit/export"): Entry("admin", f"{API}/audit/export"),
    ("GET", f"{API}/pumps/{{serial}}/bundle"): Entry("engineer", f"{API}/pumps/{{pump}}/bundle", True),
    ("POST", f"{API}/twin/operating-point"): Entry("viewer", f"{API}/twin/operating-point", body=_POINT),
    ("POST", f"{API}/twin/isolability"): Entry("viewer", f"{API}/twin/isolability", body={"flights": 10}),
    ("POST", f"{API}/twin/simulation"): Entry("viewer", f"{API}/twin/simulation", body=_RUN),
    ("GET", "/"): Entry(PAGE, "/"),
    ("GET", "/pumps/{serial}"): Entry(PAGE, "/pumps/{pump}", True),
    ("GET", "/pumps/{serial}/curve.svg"): Entry(PAGE, "/pumps/{pump}/curve.svg", True),
    ("GET", "/preferences"): Entry(PAGE, "/preferences"),
    ("POST", "/preferences"): Entry(OPEN, "/preferences"),
    ("GET", "/records"): Entry(PAGE, "/records"),
    ("GET", "/records/{record_id}"): Entry(PAGE, "/records/{record}", True),
    ("GET", "/alarms"): Entry(PAGE, "/alarms"),
    ("GET", "/pumps/{serial}/job-card.pdf"): Entry(PAGE, "/pumps/{pump}/job-card.pdf", True),
    ("GET", "/alarms/statistics"): Entry(PAGE, "/alarms/statistics"),
    ("GET", "/alarms/{alarm_id}"): Entry(PAGE, "/alarms/{alarm}", True),
    ("GET", "/thresholds"): Entry(PAGE, "/thresholds?scope=operator&id={operator}", True),
    ("GET", "/upload"): Entry(PAGE, "/upload", page_role="analyst"),
    ("GET", "/keys"): Entry(PAGE, "/keys", page_role="admin"),
    ("GET", "/users"): Entry(PAGE, "/users", page_role="admin"),
    ("GET", "/webhooks"): Entry(PAGE, "/webhooks", page_role="admin"),
    ("GET", "/audit"): Entry(PAGE, "/audit", page_role="admin"),
    ("GET", "/jobs"): Entry(PAGE, "/jobs"),
    ("GET", "/jobs/{job_id}"): Entry(PAGE, "/jobs/{job}", True),
    ("GET", "/reports/{job_id}"): Entry(PAGE, "/reports/{job}", True),
    ("GET", "/registry"): Entry(PAGE, "/registry"),
    ("GET", "/mappings"): Entry(PAGE, "/mappings"),
    ("GET", "/engineer"): Entry(PAGE, "/engineer"),
    # forms: they ask for a session and its token, which tests/service/test_page_forms.py has
    ("POST", "/alarms/{alarm_id}/{action}"): Entry(OPEN, "/alarms/{alarm}/acknowledge"),
    ("POST", "/pumps/{serial}/findings"): Entry(OPEN, "/pumps/{pump}/findings"),
    ("POST", "/pumps/{serial}/maintenance"): Entry(OPEN, "/pumps/{pump}/maintenance"),
    ("POST", "/alarms"): Entry(OPEN, "/alarms"),
    ("POST", "/thresholds"): Entry(OPEN, "/thresholds"),
    ("POST", "/thresholds/preview"): Entry(OPEN, "/thresholds/preview"),
    ("POST", "/thresholds/restore"): Entry(OPEN, "/thresholds/restore"),
    ("POST", "/upload"): Entry(OPEN, "/upload"),
    ("POST", "/upload/preview"): Entry(OPEN, "/upload/preview"),
    ("POST", "/keys"): Entry(OPEN, "/keys"),
    ("POST", "/keys/{key_id}/revoke"): Entry(OPEN, "/keys/{key}/revoke"),
    ("POST", "/users"): Entry(OPEN, "/users"),
    ("POST", "/users/{name}"): Entry(OPEN, "/users/{user}"),
    ("POST", "/users/{name}/sign-out"): Entry(OPEN, "/users/{user}/sign-out"),
    ("POST", "/webhooks"): Entry(OPEN, "/webhooks"),
    ("POST", "/webhooks/{webhook_id}/remove"): Entry(OPEN, "/webhooks/{webhook}/remove"),
    ("POST", "/jobs"): Entry(OPEN, "/jobs"),
    ("POST", "/jobs/{job_id}/cancel"): Entry(OPEN, "/jobs/{job}/cancel"),
    ("POST", "/mappings"): Entry(OPEN, "/mappings"),
    ("POST", "/registry/pumps"): Entry(OPEN, "/registry/pumps"),
    ("POST", "/registry/pumps/{serial}"): Entry(OPEN, "/registry/pumps/{pump}"),
    ("POST", "/registry/pumps/{serial}/installations"): Entry(OPEN, "/registry/pumps/{pump}/installations"),
    ("POST", "/registry/pumps/{serial}/installations/{entry_id}"): Entry(
        OPEN, "/registry/pumps/{pump}/installations/{installation}"
    ),
    ("POST", "/registry/pumps/{serial}/maintenance/{entry_id}/withdraw"): Entry(
        OPEN, "/registry/pumps/{pump}/maintenance/{maintenance}/withdraw"
    ),
    ("POST", "/registry/pumps/{serial}/findings/{entry_id}/withdraw"): Entry(
        OPEN, "/registry/pumps/{pump}/findings/{finding}/withdraw"
    ),
    ("POST", "/registry/aircraft"): Entry(OPEN, "/registry/aircraft"),
    ("POST", "/registry/aircraft/{name}"): Entry(OPEN, "/registry/aircraft/{aircraft}"),
    ("POST", "/registry/aircraft/{name}/sensors"): Entry(OPEN, "/registry/aircraft/{aircraft}/sensors"),
    ("POST", "/records/{record_id}/marks"): Entry(OPEN, "/records/{record}/marks"),
    ("POST", "/records/{record_id}/marks/{mark_id}/withdraw"): Entry(OPEN, "/records/{record}/marks/{mark}/withdraw"),
    ("POST", "/records/{record_id}/withdraw"): Entry(OPEN, "/records/{record}/withdraw"),
    ("GET", "/sign-in"): Entry(OPEN, "/sign-in"),
    ("POST", "/sign-in"): Entry(OPEN, "/sign-in"),
    ("GET", "/sign-in/oidc"): Entry(OPEN, "/sign-in/oidc"),
    ("GET", "/sign-in/oidc/callback"): Entry(OPEN, "/sign-in/oidc/callback"),
    ("POST", "/sign-out"): Entry(OPEN, "/sign-out"),
    ("GET", "/docs"): Entry(OPEN, "/docs"),
    ("GET", "/openapi.json"): Entry(OPEN, "/openapi.json"),
    ("GET", "/healthz"): Entry(OPEN, "/healthz"),
    ("GET", "/readyz"): Entry(OPEN, "/readyz"),
    ("GET", "/metrics"): Entry(OPEN, "/metrics"),
}


def routes_of(app: FastAPI) -> Iterator[tuple[str, str]]:
    """Method and path of every route; HEAD goes with GET, and files that everybody may read are no routes."""
    for route in app.routes:
        inner: Callable[[], Sequence[Any]] = getattr(route, "effective_route_contexts", lambda route=route: [route])
        for context in inner():
            for method in (getattr(context, "methods", None) or set()) - {"HEAD"}:
                yield method, context.path


def filled(value: Any, names: Mapping[str, str]) -> Any:
    """A URL or a body with the names of things in it."""
    if isinstance(value, str):
        for name, text in names.items():
            value = value.replace(f"{{{name}}}", text)
        return value
    if isinstance(value, list):
        return [filled(v, names) for v in value]
    return {k: filled(v, names) for k, v in value.items()} if isinstance(value, dict) else value


def sent(client: TestClient, method: str, entry: Entry, names: Mapping[str, str], **headers: str) -> Any:
    """The answer to an entry's request."""
    return client.request(
        method,
        filled(entry.url, names),
        json=None if entry.body is None else filled(entry.body, names),
        content=entry.content,
        headers={**entry.headers, **headers},
        follow_redirects=False,
    )


def _end_with_a_document(client: TestClient, job_id: str) -> None:
    """As the job's worker would have left it; none runs here."""
    context = client.app.state.context  # type: ignore[attr-defined]
    content = b'{"ranking": []}'
    files = {"json": {"content_hash": context.raw_store.put(content), "bytes": len(content)}}
    with context.database.writing() as session:
        job = session.get_one(Job, job_id)
        job.status, job.result = SUCCEEDED, {"counts": {}, "files": files}


def seeded(client: TestClient, operator: str, serial: str) -> dict[str, str]:
    """Everything that a request can name, made for one operator."""
    admin = key(client, "admin", operator, owner=f"head of {operator}")
    upload = record_body({**record_document(), "pump_serial": serial, "flight_id": f"flight-{operator}"})
    record = client.post(f"{API}/records", content=upload, headers={**_JSON, **admin}).json()["record_id"]
    wrong = record_body({**record_document(), "pump_serial": serial, "started_at": f"noon in the {operator}"})
    assert client.post(f"{API}/records", content=wrong, headers={**_JSON, **admin}).status_code == 422
    hook = client.post(f"{API}/webhooks", json={"url": f"https://hooks.test/{operator}"}, headers=admin).json()["id"]
    made = client.post(f"{API}/keys", json={"owner": f"office of {operator}", "role": "viewer"}, headers=admin).json()
    user = f"user-of-{operator}"
    for name in (user, f"reader-of-{operator}"):
        account = {"name": name, "password": "a long enough sentence", "role": "viewer"}
        assert client.post(f"{API}/users", json=account, headers=admin).status_code == 201
    put = {"values": {"alarm_records": 4}, "reason": f"rule of {operator}"}
    url = f"{API}/thresholds/operator/{operator}"
    version = client.put(url, json=put, headers={**admin, "If-Match": "*"}).json()["version"]
    with client.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
        write_history(session, "hhi", serial=f"{serial}-B", operator=operator, aircraft="F-2")
    mapping = {"name": f"export-of-{operator}", **_MAPPING}
    assert client.post(f"{API}/mappings", json=mapping, headers=admin).status_code == 201
    rehearsal = {"kind": "reprocess", "parameters": {"pump": serial, "dry_run": True}}
    job = client.post(f"{API}/jobs", json=rehearsal, headers=admin).json()["id"]
    wanted = {"kind": "report", "parameters": {"pump": serial}}
    report = client.post(f"{API}/jobs", json=wanted, headers=admin).json()["id"]
    _end_with_a_document(client, report)
    marked = client.post(f"{API}/records/{record}/marks", json=MARK, headers=admin)
    assert marked.status_code == 201, marked.text
    (alarm,) = client.get(f"{API}/alarms", headers=admin).json()["items"]
    return {
        "operator": operator,
        "pump": serial,
        "record": record,
        "mark": marked.json()["id"],
        "burst": record,
        "mapping": mapping["name"],
        "job": job,
        "report": report,
        "alarm": alarm["id"],
        "webhook": hook,
        "key": made["id"],
        "user": user,
        "version": str(version),
        "aircraft": f"F-{operator}",
        **entered(client, admin, serial, f"F-{operator}"),
    }


def entered(client: TestClient, who: Mapping[str, str], pump: str, aircraft: str) -> dict[str, str]:
    """Entries about a pump and an aircraft, from long before any record: their ids."""
    assert client.post(f"{API}/aircraft", json={"aircraft": aircraft}, headers=who).status_code == 201
    early = {"from": "2020-01-01T00:00:00Z", "to": "2020-02-01T00:00:00Z"}
    at = {"at": early["from"]}
    found = {}
    for what, name, new in (
        ("installations", "installation", {"aircraft": aircraft, "position": "LH", **early}),
        ("maintenance", "maintenance", {**at, "action": "filter_changed"}),
        ("findings", "finding", {**at, "found": "no_fault_found"}),
    ):
        made = client.post(f"{API}/pumps/{pump}/{what}", json=new, headers=who)
        assert made.status_code == 201, made.text
        found[name] = made.json()["id"]
    return found
