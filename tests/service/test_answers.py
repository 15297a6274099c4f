"""Answers have shapes with units, real ones keep to them, and foreign query parameters are refused by name."""

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
from fastapi.testclient import TestClient

from detectors.words.states import CAUSES, VERDICTS
from detectors.words.verdict import ESTIMATES, Side
from service.answers import words
from service.answers.verdicts import Detectable, Estimates, Probabilities
from service.answers.words import SIDES, STATES, instant
from service.ingest.metadata import KNOWN
from service.web.answer_route import Checking
from service.web.api_document.document import operations, recorded_examples
from tests.openapi_document import DOCUMENT
from tests.service.guarded import guarded_client, key
from tests.service.matrix import MATRIX, OPEN, PAGE, filled, seeded

COMMITTED: dict[str, Any] = json.loads(DOCUMENT.read_text(encoding="utf-8"))
SCHEMAS: Mapping[str, Any] = COMMITTED["components"]["schemas"]
_UNIT = re.compile(
    r"\[[^\]]+\]|\bcounts?\b|\bshare\b|\bunits?\b|\bcode\b|number without unit|in the same unit|in `unit`|`limit_unit`"
)
"""How a description names a unit, or says that the number is a count or a share."""


def answers() -> Iterator[tuple[str, dict[str, Any]]]:
    """Every JSON answer of every call with its schema."""
    for method, path, operation in operations(COMMITTED):
        for status, response in operation["responses"].items():
            content = response.get("content", {}).get("application/json")
            if status.startswith("2") and content is not None and not path.endswith("/raw"):
                yield f"{method} {path} {status}", content.get("schema", {})


def resolved(schema: Mapping[str, Any]) -> Mapping[str, Any]:
    while "$ref" in schema:
        schema = SCHEMAS[schema["$ref"].rpartition("/")[2]]
    return schema


def is_numeric(schema: Mapping[str, Any]) -> bool:
    """A number, or a list or a map of numbers."""
    if schema.get("type") in ("number", "integer"):
        return True
    inner = [schema.get("items"), schema.get("additionalProperties"), *schema.get("anyOf", [])]
    return any(is_numeric(s) for s in inner if isinstance(s, dict))


def fields(schema: Mapping[str, Any], seen: set[str]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Every field below a schema, each shape once."""
    name = schema.get("$ref", "").rpartition("/")[2]
    if name in seen:
        return
    if name:
        seen.add(name)
    schema = resolved(schema)
    for field, inner in schema.get("properties", {}).items():
        yield f"{name or schema.get('title')}.{field}", inner
        yield from fields(inner, seen)
    for inner in (schema.get("items"), schema.get("additionalProperties"), *schema.get("anyOf", [])):
        if isinstance(inner, dict):
            yield from fields(inner, seen)


def test_every_json_answer_has_a_shape() -> None:
    found = dict(answers())
    assert len(found) > 70
    for call, schema in found.items():
        for option in schema.get("anyOf", [schema]):
            shape = resolved(option)
            assert "$ref" in option, call
            assert shape["properties"], call
            assert shape["description"], call


def test_every_field_is_described_and_every_number_has_a_unit() -> None:
    seen: set[str] = set()
    found = {name: field for _, schema in answers() for name, field in fields(schema, seen)}
    assert len(found) > 400
    silent = [n for n, f in found.items() if not (f.get("description") or resolved(f).get("description"))]
    assert silent == []
    without = [n for n, f in found.items() if is_numeric(f) and not _UNIT.search(f["description"])]
    assert without == []


def test_a_shape_may_grow_without_breaking_its_readers() -> None:
    seen: set[str] = set()
    for _, schema in answers():
        list(fields(schema, seen))
    assert not [name for name in seen if SCHEMAS[name].get("additionalProperties") is False]


def faults(value: Any, schema: Mapping[str, Any], where: str) -> Iterator[str]:
    """A slow plain reading of JSON Schema, as far as the document uses it; unknown members are faults here."""
    schema = resolved(schema)
    if "anyOf" in schema:
        options = [list(faults(value, option, where)) for option in schema["anyOf"]]
        if all(options):
            yield from min(options, key=len)
        return
    kinds = {"string": str, "boolean": bool, "array": list, "object": dict, "null": type(None)}
    kind = schema.get("type")
    if kind in ("number", "integer"):
        good = isinstance(value, int | float if kind == "number" else int) and not isinstance(value, bool)
    else:
        good = kind is None or isinstance(value, kinds[kind])
    if not good:
        yield f"{where}: {value!r} is no {kind}"
        return
    if "enum" in schema and value not in schema["enum"]:
        yield f"{where}: {value!r} is not one of {schema['enum']}"
    if schema.get("format") == "date-time" and not re.fullmatch(
        r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?(Z|\+00:00)", value
    ):
        yield f"{where}: {value!r} is no instant in UTC"
    if isinstance(value, list) and "items" in schema:
        for i, item in enumerate(value):
            yield from faults(item, schema["items"], f"{where}[{i}]")
    if isinstance(value, dict):
        own, further = schema.get("properties", {}), schema.get("additionalProperties")
        yield from (f"{where}: {name} is missing" for name in schema.get("required", ()) if name not in value)
        for name, inner in value.items():
            if name in own or isinstance(further, dict):
                yield from faults(inner, own.get(name, further), f"{where}.{name}")
            elif own and not further:
                yield f"{where}: {name} is not described"


def test_recorded_answers_keep_to_the_document() -> None:
    schemas: dict[str, list[Any]] = {}
    for call, schema in answers():
        schemas.setdefault(call.rpartition(" ")[0], []).append(schema)
    examples = recorded_examples()
    assert len(examples) > 70
    for call, answer in examples.items():
        readings = [list(faults(answer, schema, call)) for schema in schemas[call]]
        assert [] in readings, readings


def test_examples_come_from_a_history_that_was_folded() -> None:
    verdict = recorded_examples()["GET /api/v1/pumps/{serial}/verdict"]
    assert verdict["state"] == "pump_degradation"
    assert verdict["quality"]["records_used"] >= 24
    assert "P-7-B" not in json.dumps(recorded_examples()), "no row that a test has written"


def test_words_are_those_of_the_judge() -> None:
    assert set(STATES) == {state.value for state in VERDICTS}
    assert list(words.CAUSES) == [cause.value for cause in CAUSES]
    assert set(SIDES) == {side.value for side in Side}
    assert set(Estimates.__annotations__) == set(Detectable.__annotations__) == set(ESTIMATES)
    assert list(Probabilities.__annotations__) == list(words.CAUSES)
    assert instant(None) is None


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[TestClient, dict[str, str], dict[str, str]]]:
    folder: Path = tmp_path_factory.mktemp("answers")
    with (
        mock.patch("service.notifications.guard._resolved", return_value=["93.184.215.14"]),
        mock.patch("service.jobs.engine.start"),
        mock.patch("service.jobs.engine.stop"),
        guarded_client(f"sqlite:///{folder}/answers.sqlite", folder) as client,
    ):
        yield client, seeded(client, "north", "P-7"), key(client, "admin", "north", owner="head of north")


ASKED = [(m, p) for (m, p), entry in MATRIX.items() if entry.role not in (PAGE, OPEN)]


def test_every_call_refuses_foreign_query_parameters_by_name(
    guarded: tuple[TestClient, dict[str, str], dict[str, str]],
) -> None:
    client, names, admin = guarded
    for method, path in [*ASKED, ("GET", "/healthz"), ("GET", "/readyz"), ("GET", "/metrics")]:
        entry = MATRIX[method, path]
        url = filled(entry.url, names)
        url += ("&" if "?" in url else "?") + "colour=red&colour=blue&sise=2"
        body = None if entry.body is None else filled(entry.body, names)
        answer = client.request(method, url, json=body, content=entry.content, headers={**entry.headers, **admin})
        assert answer.status_code == 422, (method, path, answer.text)
        assert [e["where"] for e in answer.json()["errors"]] == ["query.colour", "query.sise"], (method, path)


def test_one_answer_names_foreign_parameters_beside_other_faults(
    guarded: tuple[TestClient, dict[str, str], dict[str, str]],
) -> None:
    client, _, admin = guarded
    answer = client.get("/api/v1/records?limit=9999&colour=red", headers=admin)
    assert {e["where"] for e in answer.json()["errors"]} == {"query.limit", "query.colour"}
    assert "known: pump, from, to, status, limit, cursor" in answer.text
    assert client.get("/api/v1/records?colour=red").status_code == 401


def test_metadata_of_an_upload_is_declared() -> None:
    for path in ("/api/v1/records", "/api/v1/records/bulk"):
        declared = {p["name"] for p in COMMITTED["paths"][path]["post"]["parameters"] if p["in"] == "query"}
        assert declared >= set(KNOWN)


def test_a_running_service_shows_what_an_older_release_stored() -> None:
    assert Checking.is_on, "the tests check every answer; a service in use does not"
    assert "is_on = True" not in (Path(__file__).parents[2] / "service" / "web" / "answer_route.py").read_text()
