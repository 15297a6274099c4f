"""A service in memory, for tests of programs that use the client: uploads become records with a verdict of your choice.

    service = MemoryService()
    with Client("http://test", transport=service.transport) as client:
        answer = client.upload(b"# pump_serial: P-7 ...")

Nothing is analysed: every pump has the verdict that ``service.verdicts`` holds for it, else that of too few records.
"""

import copy
import hashlib
import json
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, cast
from urllib.parse import unquote

import httpx2

from service.answers.problems import Problem, ProblemError
from service.answers.pumps import PumpWithPlace
from service.answers.records import Record, RecordSummary
from service.answers.verdicts import Verdict
from service.answers.words import CAUSES
from service.client.requests import API_PREFIX

_NEEDED = ("pump_serial", "aircraft", "position", "flight_id", "started_at")
_METADATA = re.compile(r"^# *([a-z_]+): *(.*?)\s*$", re.MULTILINE)
_RECEIVED = "2026-05-02T09:00:00Z"


def verdict_of(state: str = "insufficient_data", side: str = "unknown", confidence: float | None = None) -> Verdict:
    """A complete verdict in the shape of the API; the rest of the probability is shared alike by the other states."""
    least = 1.0 / len(CAUSES)
    first = least if confidence is None else confidence
    rest = (1.0 - first) / (len(CAUSES) - 1)
    shares = {name: first if name == state or state not in CAUSES else rest for name in CAUSES}
    return {
        "state": state,
        "side": side,
        "since": None,
        "confidence": first,
        "probabilities": cast("Any", shares),
        "candidates": [],
        "secondary": None,
        "sensor": None,
        "estimates": {},
        "minimum_detectable": {},
        "quality": {"records_used": 0, "windows_rejected": 0, "reservoir_pressure": "nominal", "flags": []},
        "advice": f"a made-up verdict: {state.replace('_', ' ')}",
        "resolving_measurement": None,
        "twin_version": "made-up",
        "threshold_version": 0,
    }


@dataclass
class MemoryService:
    """The calls about records, pumps and verdicts; others are answered ``501``.

    Attributes
    ----------
    verdicts
        Verdict by serial number, to be set by the test.
    refuse
        Faults by which the next uploads are refused; emptied by the test.
    requests
        Everything that was asked, in order.
    """

    verdicts: dict[str, Verdict] = field(default_factory=dict)
    refuse: list[ProblemError] = field(default_factory=list)
    requests: list[httpx2.Request] = field(default_factory=list)
    _records: dict[str, Record] = field(default_factory=dict)

    @property
    def transport(self) -> httpx2.MockTransport:
        """In place of the network, for either client."""
        return httpx2.MockTransport(self._answered)

    def _answered(self, request: httpx2.Request) -> httpx2.Response:
        self.requests.append(request)
        if request.url.path == "/readyz":
            return httpx2.Response(200, json={"status": "ready", "checks": {}})
        # names keep their slashes: the address is taken apart before it is decoded
        path = request.url.raw_path.decode("ascii").partition("?")[0].removeprefix(API_PREFIX)
        for method, pattern, answer in self._routes():
            found = re.fullmatch(pattern, path)
            if found and method == request.method:
                return answer(request, *map(unquote, found.groups()))
        return _problem(501, "Not implemented", f"the service in memory does not answer {request.method} {path}")

    def _routes(self) -> Iterable[tuple[str, str, Callable[..., httpx2.Response]]]:
        return (
            ("POST", "/records", self._upload),
            ("GET", "/records", lambda request: _page(self._listed(request))),
            ("GET", "/records/([^/]+)", lambda _request, name: _found(self._records.get(name), "record", name)),
            ("GET", "/pumps", lambda _request: _page([self._pump(s) for s in self._serials()])),
            ("GET", "/pumps/([^/]+)/verdict", lambda _request, name: self._of_pump(name, self._verdict)),
            ("GET", "/pumps/([^/]+)", lambda _request, name: self._of_pump(name, self._pump)),
        )

    def _upload(self, request: httpx2.Request) -> httpx2.Response:
        metadata = _metadata(request)
        faults: list[ProblemError] = list(self.refuse)
        faults += [{"where": n, "problem": "is missing"} for n in _NEEDED if n not in metadata]
        if faults:
            return _problem(422, "Invalid input", f"the record has {len(faults)} fault(s)", faults)
        content = request.content + json.dumps(metadata, sort_keys=True).encode()
        record_id = hashlib.sha256(content).hexdigest()[:32]
        known = record_id in self._records
        serial = metadata["pump_serial"]
        self._records[record_id] = {
            "record_id": record_id,
            "status": "analysed",
            "operator": metadata.get("operator", "default"),
            "aircraft": metadata["aircraft"],
            "position": metadata["position"],
            "flight_id": metadata["flight_id"],
            "segment": metadata.get("segment"),
            "started_at": metadata["started_at"],
            "received_at": _RECEIVED,
            "supersedes": None,
            "pump_serial": serial,
            "windows": [],
            "explanation": None,
            "flags": [],
            "residuals": None,
            "verdict": self._verdict(serial),
        }
        return httpx2.Response(200 if known else 201, json=self._records[record_id])

    def _listed(self, request: httpx2.Request) -> list[RecordSummary]:
        names = RecordSummary.__annotations__
        pump = request.url.params.get("pump")
        newest_first = list(self._records.values())[::-1]
        shown = [
            {**{name: record.get(name) for name in names}, "state": record["verdict"]["state"]}
            for record in newest_first
        ]
        return cast("list[RecordSummary]", [r for r in shown if pump in (None, r["pump_serial"])])

    def _serials(self) -> list[str]:
        return sorted({*self.verdicts, *(r["pump_serial"] for r in self._records.values())})

    def _of_pump(self, serial: str, shown: Callable[[str], Any]) -> httpx2.Response:
        return _found(shown(serial) if serial in self._serials() else None, "pump", serial)

    def _verdict(self, serial: str) -> Verdict:
        return copy.deepcopy(self.verdicts.get(serial) or verdict_of())

    def _pump(self, serial: str) -> PumpWithPlace:
        verdict, own = self._verdict(serial), [r for r in self._records.values() if r["pump_serial"] == serial]
        last = own[-1] if own else None
        return {
            "serial": serial,
            "operator": last["operator"] if last else "default",
            "pump_type": "h225",
            "confirmed": False,
            "aircraft": last["aircraft"] if last else None,
            "position": last["position"] if last else None,
            "records": len(own),
            "last_record_at": last["started_at"] if last else None,
            "flight_hours": None,
            "silent": False,
            "silence_unusual_from": None,
            "state": verdict["state"],
            "side": verdict["side"],
            "since": verdict["since"],
            "confidence": verdict["confidence"],
            "candidates": verdict["candidates"],
            "advice": verdict["advice"],
            "case_pressure_beyond": False,
            "installation": None,
        }


def _metadata(request: httpx2.Request) -> dict[str, str]:
    """Metadata of a CSV or JSON body; query parameters win. Other formats need all of it in the query."""
    found: dict[str, str] = {}
    kind = request.headers.get("content-type", "")
    if kind.startswith("text/csv"):
        found = dict(_METADATA.findall(request.content.decode("utf-8", "replace")))
    elif kind.startswith("application/json"):
        found = {k: str(v) for k, v in json.loads(request.content).items() if k != "channels"}
    return found | {
        k: v for k, v in request.url.params.items() if k not in ("wait", "supersedes", "mapping", "file_name")
    }


def _page(items: list[Any]) -> httpx2.Response:
    return httpx2.Response(200, json={"items": items, "next": None})


def _found(answer: object, kind: str, name: str) -> httpx2.Response:
    if answer is None:
        return _problem(404, "Not found", f"there is no {kind} {name}")
    return httpx2.Response(200, json=answer)


def _problem(status: int, title: str, detail: str, errors: list[ProblemError] | None = None) -> httpx2.Response:
    slug = title.lower().replace(" ", "-")
    body: Problem = {"type": f"urn:casedrain:problem:{slug}", "title": title, "status": status, "detail": detail}
    if errors:
        body["errors"] = errors
    return httpx2.Response(status, json=body, headers={"content-type": "application/problem+json"})
