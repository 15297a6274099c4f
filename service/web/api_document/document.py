"""The OpenAPI document: FastAPI's own, completed with errors, security and recorded examples."""

import json
from collections.abc import Iterator, Mapping
from copy import deepcopy
from http import HTTPStatus
from importlib.resources import files
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from pydantic import TypeAdapter

from service.access.turns import TooMany
from service.answers.documents import JsonObject
from service.answers.job_documents import JOB_DOCUMENTS
from service.answers.problems import Problem as ProblemShape
from service.answers.words import SHAPES
from service.errors import (
    PROBLEM_JSON,
    Conflict,
    Fault,
    Forbidden,
    Invalid,
    Misdirected,
    NotFound,
    PreconditionRequired,
    Problem,
    StaleVersion,
    StorageFull,
    TooLarge,
    TooSlow,
    Unauthenticated,
    Unavailable,
    Undecodable,
    UnknownType,
)
from service.web.answer_route import SHAPE_KEY

_DESCRIPTION = """
Flight records go in, verdicts come out: which pump needs attention, on which side the fault lies, and why.

Send a key as `Authorization: Bearer ...`. Pressures are bar gauge, instants RFC 3339 in UTC, intervals 90 %.
Lists are paged: hand `next` back as `cursor`. Every error is a problem document (RFC 9457); for bad input its
`errors` list every fault that was found.
"""
_TAGS = {
    "records": "Flight records: upload, status, windows, original bytes.",
    "pumps": "One pump: verdict, history, trends, damage identification curve.",
    "history": "Beside a pump's records: installations, maintenance, findings.",
    "registry": "Pumps, aircraft, pump types, and all of them as CSV files.",
    "mappings": "An operator's own exports, uploaded as they are.",
    "jobs": "Work that outlasts a request: bulk imports, reprocessing, large previews.",
    "exports": "Trends, verdicts and windows, streamed.",
    "fleet": "All pumps: counts, ranking with reasons, trends by group.",
    "alarms": "Alarms in event time, and what is done about them (ISA-18.2).",
    "thresholds": "Adjustable numbers in layers, versioned, previewed on history.",
    "administration": "Keys, users, webhooks, operators, the audit log.",
    "twin": "The simulated pump.",
    "operations": "Liveness, readiness, metrics; without a key.",
}
_API = "/api/v1/"
_EXAMPLES: tuple[Problem, ...] = (
    Undecodable("the body is no JSON document: it ends early, at line 3"),
    Unauthenticated("send a key: Authorization: Bearer <key>"),
    Forbidden("this needs the role analyst; hums-office is viewer"),
    NotFound("there is no pump P-7"),
    Conflict("record 5f3c stands for this flight already: repeat with ?supersedes=5f3c to replace it"),
    StaleVersion('the latest version is "4": read it again and repeat your change on top of it'),
    TooLarge("the upload is larger than 67108864 bytes: split the record into segments"),
    UnknownType("no adapter reads application/pdf"),
    Invalid("the request has 1 fault(s)", [Fault("query.limit", "Input should be less than or equal to 500")]),
    PreconditionRequired('send If-Match with the version you read ("4"), or * for the first'),
    TooMany("the operator north has used up its quota of requests: try again in 3 s"),
    Unavailable("the raw store does not answer: try again"),
    TooSlow("the body does not arrive: send it again"),
    Misdirected("without authentication this service answers to localhost only: call it http://127.0.0.1"),
    StorageFull("the disk is full; nothing was changed: what is stored can be read, uploads wait for space"),
    Problem("something went wrong on our side; the log has it under the request id 5f3c29aa10be"),
)
_BY_STATUS = {int(problem.status): problem for problem in _EXAMPLES}
_FURTHER: Mapping[tuple[str, str], tuple[int, ...]] = {
    ("POST", "/records"): (400, 404, 409, 413, 415, 503),
    ("GET", "/records/{record_id}/raw"): (503,),
    ("GET", "/pump-types/{name}/reference-curve"): (403,),
    ("POST", "/alarms/{alarm_id}/acknowledge"): (409,),
    ("POST", "/alarms/{alarm_id}/shelve"): (409,),
    ("POST", "/alarms/{alarm_id}/unshelve"): (409,),
    ("POST", "/alarms/{alarm_id}/close"): (409,),
    ("POST", "/alarms/{alarm_id}/comments"): (409,),
    ("PATCH", "/alarms/{alarm_id}"): (409,),
    ("PUT", "/thresholds/{scope}/{scope_id}"): (412, 428),
    ("POST", "/thresholds/{scope}/{scope_id}/versions/{number}/restore"): (412,),
    ("POST", "/thresholds/preview"): (404,),
    ("POST", "/records/bulk"): (400, 404, 413, 415),
    ("GET", "/records/{record_id}/spectrum"): (409, 503),
    ("POST", "/records/{record_id}/marks"): (409, 503),
    ("DELETE", "/records/{record_id}/marks/{mark_id}"): (409, 503),
    ("POST", "/mappings"): (409,),
    ("PUT", "/mappings/{name}"): (409, 412, 428),
    ("POST", "/mappings/preview"): (400, 404, 413, 415),
    ("POST", "/mappings/suggest"): (400, 413, 415),
    ("POST", "/jobs"): (404,),
    ("POST", "/jobs/{job_id}/cancel"): (409,),
    ("GET", "/jobs/{job_id}/result"): (409, 503),
    ("GET", "/exports/{name}.{form}"): (415,),
    ("POST", "/users"): (409,),
    ("DELETE", "/records/{record_id}"): (409, 503),
    ("POST", "/pumps"): (409,),
    ("POST", "/aircraft"): (409,),
    ("POST", "/circuits"): (409,),
    ("POST", "/pump-types"): (400, 409, 413, 415),
    ("PATCH", "/pumps/{serial}"): (503,),
    ("PATCH", "/aircraft/{name}"): (503,),
    ("GET", "/pumps/{serial}/verdict"): (503,),
    ("POST", "/pumps/{serial}/installations"): (409, 503),
    ("PATCH", "/pumps/{serial}/installations/{entry_id}"): (409, 503),
    ("DELETE", "/pumps/{serial}/installations/{entry_id}"): (503,),
    ("POST", "/pumps/{serial}/maintenance"): (503,),
    ("PATCH", "/pumps/{serial}/maintenance/{entry_id}"): (503,),
    ("DELETE", "/pumps/{serial}/maintenance/{entry_id}"): (503,),
    ("POST", "/registry/{kind}.csv"): (400, 413, 503),
    ("DELETE", "/operators/{operator}"): (409,),
    ("PATCH", "/users/{name}"): (409,),
    ("DELETE", "/users/{name}/sessions"): (409,),
}
"""Answers beyond those that follow from a route's shape: 401, 403, 422 and, with a name in its path, 404."""
_EVERYWHERE = (400, 408, 413, 421, 422, 500)
"""A head that breaks its own grammar, a body that does not come or is too large, a host that is not served, a parameter
that is not known, a mistake of ours: before or behind any call."""
_OF_WRITES = (403, 503, 507)
"""Another site that writes, a database that is away, a disk that is full; the API's reads need the database too."""
_PROBES = ("/healthz", "/readyz", "/metrics")
"""Who is never told that too much is asked (429), or that the service is busy (503)."""
_GUARDED_READS = ("/audit", "/keys", "/mappings/{name}", "/operators", "/users", "/webhooks")
"""What not everybody may read; of other reads a foreign name is one that does not exist."""
_RECORD: JsonObject = {
    "pump_serial": "P-7",
    "aircraft": "F-HCAA",
    "position": "LH",
    "flight_id": "2026-05-02-1",
    "started_at": "2026-05-02T07:11:00Z",
}
_CHANNELS: dict[str, list[float]] = {
    "time_s": [0.0, 1.0],
    "discharge_pressure_bar": [174.1, 174.0],
    "case_pressure_bar": [0.91, 0.92],
    "shaft_speed_rpm": [4600.0, 4601.0],
    "fluid_temperature_degc": [50.1, 50.1],
}
_BODIES: Mapping[tuple[str, str], Mapping[str, Any]] = {
    ("POST", "/records"): {
        "application/json": {**_RECORD, "channels": _CHANNELS},
        "text/csv": "".join(f"# {name}: {value}\n" for name, value in _RECORD.items())
        + ",".join(_CHANNELS)
        + "\n"
        + "".join(",".join(f"{v:g}" for v in row) + "\n" for row in zip(*_CHANNELS.values(), strict=True)),
    },
    ("POST", "/registry/{kind}.csv"): {"text/csv": "serial,pump_type\nP-7,h225\n"},
}
"""Bodies that are no JSON document of ours, shortened: a real record lasts minutes."""
_WITHOUT_FORBIDDEN = ("/twin/",)
_ALL_NAMES_KNOWN = "/registry/{kind}.csv"
"""Another name in its path is refused as one that the document does not have."""


def openapi_document(app: FastAPI) -> JsonObject:
    """The complete document of an application; computed once."""
    if app.openapi_schema is None:
        app.openapi_schema = _completed(app)
    return app.openapi_schema


def operations(document: Mapping[str, Any]) -> Iterator[tuple[str, str, JsonObject]]:
    """Method, path and operation of everything in a document."""
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            yield method.upper(), path, operation


def recorded_examples() -> JsonObject:
    """Answers of a real run by ``METHOD /path``."""
    text = (files("service.web.api_document") / "examples.json").read_text(encoding="utf-8")
    found: JsonObject = json.loads(text)
    return found


def _completed(app: FastAPI) -> JsonObject:
    document = get_openapi(
        title=app.title, version=app.version, summary=app.summary, description=_DESCRIPTION.strip(), routes=app.routes
    )
    document["tags"] = [{"name": name, "description": words} for name, words in _TAGS.items()]
    components = document.setdefault("components", {})
    schemas = components.setdefault("schemas", {})
    for name in ("HTTPValidationError", "ValidationError"):
        schemas.pop(name, None)
    schemas |= _problem_schemas()
    for kind in JOB_DOCUMENTS:
        schemas |= _described(kind)
    components["responses"] = {f"Problem{status}": _problem_response(status) for status in _BY_STATUS}
    components["securitySchemes"] = {"key": {"type": "http", "scheme": "bearer", "description": "An API key"}}
    for _, _, operation in operations(document):
        _name_shapes(operation, schemas)
    _inherit(schemas)
    examples = recorded_examples()
    for method, path, operation in operations(document):
        _complete(method, path, operation, examples.get(f"{method} {path}"))
    return document


def _problem_schemas() -> JsonObject:
    return _described(ProblemShape)


def _described(kind: type) -> JsonObject:
    """Schema of a shape under its name, and of every shape in it."""
    schema = TypeAdapter(kind).json_schema(ref_template="#/components/schemas/{model}", mode="serialization")
    inner: JsonObject = schema.pop("$defs", {})
    return {kind.__name__: schema, **inner}


def _name_shapes(operation: JsonObject, schemas: JsonObject) -> None:
    """An answer's shape stands among the components under its own name."""
    for response in operation["responses"].values():
        content = response.get("content", {}).get("application/json", {})
        schema = content.get("schema", {})
        name = schema.pop(SHAPE_KEY, "")
        if name and "$ref" not in schema:
            schemas.setdefault(name, {**schema, "title": name})
            content["schema"] = {"$ref": f"#/components/schemas/{name}"}


def _inherit(schemas: JsonObject) -> None:
    """Fields that a shape has from another one are described there."""
    for name, kind in SHAPES.items():
        fields = schemas.get(name, {}).get("properties", {})
        for base in _bases(kind):
            described = TypeAdapter(base).json_schema(mode="serialization")["properties"]
            for field, schema in fields.items():
                if "description" not in schema and "description" in described.get(field, {}):
                    schema["description"] = described[field]["description"]


def _bases(kind: type) -> Iterator[type]:
    for base in getattr(kind, "__orig_bases__", ()):
        if base.__name__ in SHAPES:
            yield base
            yield from _bases(base)


def _complete(method: str, path: str, operation: JsonObject, example: Any) -> None:
    responses = operation["responses"]
    responses.pop("default", None)
    good = next(status for status in responses if status.startswith("2"))
    if example is not None:
        for content in responses[good].get("content", {}).values():
            content["example"] = example
    if path.startswith(_API):
        operation["security"] = [{"key": []}]
    for kind, body in _BODIES.get((method, path.removeprefix(_API.rstrip("/"))), {}).items():
        operation["requestBody"]["content"].setdefault(kind, {})["example"] = body
    own = _problems(method, path, "requestBody" in operation or "parameters" in operation)
    for status in sorted({*own, *_anywhere(method, path, operation)}):
        shared = {"$ref": f"#/components/responses/Problem{status}"}
        responses[str(status)] = _problem_response(status) if status in own else shared


def _anywhere(method: str, path: str, operation: Mapping[str, Any]) -> set[int]:
    """Statuses of the ring around all calls, and of the reading of a body."""
    statuses = set(_EVERYWHERE)
    if path not in _PROBES:
        statuses |= {429, 503}
    if method != "GET":
        statuses |= set(_OF_WRITES)
    if "application/json" in operation.get("requestBody", {}).get("content", {}):
        statuses.add(415)
    return statuses


def _problems(method: str, path: str, has_input: bool) -> list[int]:
    if not path.startswith(_API):
        return []
    short = path.removeprefix(_API.rstrip("/"))
    statuses = {401, *_FURTHER.get((method, short), ())}
    if short.startswith(_GUARDED_READS) if method == "GET" else not short.startswith(_WITHOUT_FORBIDDEN):
        statuses.add(403)
    if "{" in path and short != _ALL_NAMES_KNOWN:
        statuses.add(404)
    if has_input:
        statuses.add(422)
    return sorted(statuses)


def _problem_response(status: int) -> JsonObject:
    problem = _BY_STATUS[status]
    content = {"schema": {"$ref": "#/components/schemas/Problem"}, "example": deepcopy(problem.body())}
    response: JsonObject = {"description": HTTPStatus(status).phrase, "content": {PROBLEM_JSON: content}}
    if status in (429, 503):
        response["headers"] = {"Retry-After": {"description": "Seconds to wait", "schema": {"type": "integer"}}}
    return response
