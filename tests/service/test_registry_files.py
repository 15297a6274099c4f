"""The registry as CSV: what goes out comes back in, faults are named by line, all or nothing."""

from typing import Any

from fastapi.testclient import TestClient

from tests.service.records import body

API = "/api/v1"
CSV = {"content-type": "text/csv"}


def send(client: TestClient, kind: str, text: str | bytes) -> Any:
    return client.post(f"{API}/registry/{kind}.csv", content=text, headers=CSV)


def faults_of(answer: Any) -> list[tuple[str, str]]:
    return [(fault["where"], fault["problem"]) for fault in answer.json()["errors"]]


PUMPS = "serial,pump_type\nP-1,h225\nP-2,h225_thesis\n"
AIRCRAFT = "aircraft,circuit,fluid\nF-1,separate_drain,MIL-PRF-83282\nF-2,shared_return,\n"
INSTALLATIONS = (
    "pump,aircraft,position,from,to\n"
    "P-1,F-1,LH,2026-01-01T00:00:00Z,2026-02-01T00:00:00Z\n"
    "P-2,F-1,LH,2026-02-01T00:00:00Z,\n"
)


def test_there_and_back(client: TestClient) -> None:
    for kind, text in (("pumps", PUMPS), ("aircraft", AIRCRAFT), ("installations", INSTALLATIONS)):
        first = send(client, kind, text)
        assert first.status_code == 200, first.text
        assert first.json() == {"created": 2, "changed": 0, "unchanged": 0}
        assert send(client, kind, text).json() == {"created": 0, "changed": 0, "unchanged": 2}
        out = client.get(f"{API}/registry/{kind}.csv")
        assert out.headers["content-type"] == "text/csv; charset=utf-8"
        assert len(out.text.splitlines()) == 3
        assert send(client, kind, out.content).json() == {"created": 0, "changed": 0, "unchanged": 2}
    assert client.get(f"{API}/aircraft/F-1").json()["circuit"] == "separate_drain"
    assert client.get(f"{API}/pumps/P-2").json()["pump_type"] == "h225_thesis"
    assert client.get(f"{API}/pumps/P-2").json()["installation"]["aircraft"] == "F-1"
    changed = send(client, "pumps", "serial,pump_type,confirmed\nP-1,h225_thesis,true\nP-2,h225_thesis,false\n")
    assert changed.json() == {"created": 0, "changed": 2, "unchanged": 0}
    assert client.get(f"{API}/pumps/P-2").json()["confirmed"] is False


def test_an_import_folds_anew(client: TestClient) -> None:
    client.post(f"{API}/records", content=body(), headers={"content-type": "application/json"})
    send(client, "installations", "pump,aircraft,position,from\nP-1,F-7,RH,2026-01-01T00:00:00Z\n")
    assert client.get(f"{API}/pumps/P-1").json()["aircraft"] == "F-7"


def test_every_fault_is_named_by_line_and_nothing_changes(client: TestClient) -> None:
    bad = "serial,pump_type,confirmed\nP-1,h225,yes\n,h225,perhaps\nP-3,h160,\nP-4,h225\n\nP-5,h225,true\n"
    answer = send(client, "pumps", bad)
    assert answer.status_code == 422
    assert sorted({where for where, _ in faults_of(answer)}) == [
        "line 3.confirmed",
        "line 3.serial",
        "line 4.pump_type",
        "line 5",
    ]
    assert client.get(f"{API}/pumps").json()["items"] == []


def test_overlapping_and_unknown_installations_are_named_by_line(client: TestClient) -> None:
    send(client, "pumps", PUMPS)
    clash = (
        INSTALLATIONS.replace("P-2,F-1,LH,2026-02-01", "P-2,F-1,LH,2026-01-31") + "P-9,F-1,RH,2026-01-01T00:00:00Z,\n"
    )
    answer = send(client, "installations", clash)
    assert answer.status_code == 422
    places = dict(faults_of(answer))
    assert set(places) == {"line 3.from", "line 4"}
    assert "P-1" in places["line 3.from"]
    assert "P-9" in places["line 4"]
    assert client.get(f"{API}/pumps/P-1/installations").json()["items"] == []


def test_headers_and_encodings(client: TestClient) -> None:
    wrong = send(client, "aircraft", "aircraft;circuit\nF-1;shared_return\n")
    assert wrong.status_code == 422
    assert len(faults_of(wrong)) == 3
    twice = send(client, "aircraft", "aircraft,circuit,circuit\nF-1,shared_return,shared_return\n")
    assert faults_of(twice) == [("line 1", "column circuit is there twice")]
    assert send(client, "aircraft", b"aircraft,circuit\n\xff\xfe,shared_return\n").status_code == 400
    assert send(client, "aircraft", 'aircraft,circuit\n"F-1,shared_return\n').status_code == 400
    assert send(client, "aircraft", "\ufeff" + AIRCRAFT).status_code == 200
    assert send(client, "moods", "a\n").status_code in (404, 422)
    assert client.get(f"{API}/registry/moods.csv").status_code in (404, 422)
    assert send(client, "aircraft", "aircraft,circuit\n" + "x" * 2_100_000).status_code == 413
