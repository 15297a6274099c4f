"""Who is no guest does not come in: other sites, other names, other tenants, formulas, addresses inside, the deleted."""

import csv
import io
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from hypothesis import given
from hypothesis import strategies as st

from service.access.users import with_password
from service.answers import cells
from service.notifications.guard import Blocked, is_public, target_of
from service.storage.tables import FailedSignIn, ThresholdVersion
from service.thresholds.pins import newest_number
from tests.service.guarded import guarded_client, key
from tests.service.records import body, document

API = "/api/v1"
JSON = {"content-type": "application/json"}
FOREIGN = ("evil.example", "localhost.evil.example", "127.0.0.1.evil.example:8000", "10.0.0.1", "[2001:db8::1]:80")
HERE = ("localhost", "LOCALHOST:8000", "127.0.0.1:1", "127.9.9.9", "[::1]:8150")
KEY = {"owner": "x", "role": "admin"}


class TestWithoutAuthentication:
    """Only this machine is served, and no other site writes: a name that leads here makes no admin."""

    def test_other_host_names_are_not_served(self, client: TestClient) -> None:
        for path in (f"{API}/pumps", "/", "/healthz", "/metrics"):
            for host in FOREIGN:
                assert client.get(path, headers={"host": host}).status_code == 421, (path, host)
            for host in HERE:
                assert client.get(path, headers={"host": host}).status_code == 200, (path, host)

    def test_other_sites_change_nothing(self, client: TestClient) -> None:
        foreign: list[dict[str, str]] = [
            {"origin": "http://evil.example"},
            {"origin": "http://localhost:3000"},
            {"origin": "null"},
            {"sec-fetch-site": "cross-site"},
            {"sec-fetch-site": "same-site"},
        ]
        for headers in foreign:
            assert client.post(f"{API}/keys", json=KEY, headers=headers).status_code == 403, headers
            assert client.get(f"{API}/keys", headers=headers).json()["items"] == []
        own: list[dict[str, str]] = [{}, {"origin": "http://localhost"}, {"sec-fetch-site": "same-origin"}]
        for headers in own:
            assert client.post(f"{API}/keys", json=KEY, headers=headers).status_code == 201, headers

    def test_heads_that_are_none(self, client: TestClient) -> None:
        for name, value in (("host", "["), ("host", "a:b"), ("origin", "http://["), ("origin", "x")):
            assert client.post(f"{API}/keys", json=KEY, headers={name: value}).status_code == 400, (name, value)


def test_a_name_s_other_host_is_served_with_authentication(database_url: str, tmp_path: Path) -> None:
    with guarded_client(database_url, tmp_path) as guarded:
        headers = {**key(guarded, "viewer"), "host": "pumps.example.org"}
        assert guarded.get(f"{API}/pumps", headers=headers).status_code == 200


def test_every_answer_forbids_guessing_and_frames(client: TestClient) -> None:
    for path in (f"{API}/pumps", "/", "/healthz", "/nothing", f"{API}/exports/trends.csv", "/static/casedrain.css"):
        headers = client.get(path).headers
        assert headers["x-content-type-options"] == "nosniff", path
        assert "frame-ancestors 'none'" in headers["content-security-policy"], path
        assert "strict-transport-security" not in headers
    encrypted = TestClient(client.app, base_url="https://localhost")
    assert encrypted.get("/healthz").headers["strict-transport-security"].startswith("max-age=")


def test_bodies_are_bounded_before_a_key_is_looked_at(database_url: str, tmp_path: Path) -> None:
    with guarded_client(database_url, tmp_path) as guarded:
        large = b"[" + b"0," * 600_000 + b"0]"
        assert guarded.post(f"{API}/keys", content=large, headers=JSON).status_code == 413

        def dripping() -> Any:
            for _ in range(40):
                yield b" " * 40_000

        assert guarded.post(f"{API}/keys", content=dripping(), headers=JSON).status_code == 413
        assert guarded.post(f"{API}/keys", content=b"{}", headers=JSON).status_code == 401


INSIDE = [
    "10.0.0.1",
    "127.0.0.1",
    "0.0.0.0",
    "100.64.0.1",
    "169.254.169.254",
    "192.0.0.8",
    "192.168.1.1",
    "198.18.0.1",
    "224.0.0.1",
    "240.0.0.1",
    "192.88.99.1",
    "::1",
    "::",
    "fe80::1",
    "fec0::1",
    "fc00::1",
    "fd12::1",
    "ff02::1",
    "::ffff:10.0.0.1",
    "::10.0.0.1",
    "64:ff9b::a00:1",
    "64:ff9b:1::1",
    "2002:a00:1::",
    "2001:0:a00:1::1",
    "2001:db8::1",
    "3fff::1",
    "5f00::1",
    "100::1",
    "fe80::1%eth0",
]
OUTSIDE = ["93.184.215.14", "2606:4700::1111", "64:ff9b::5db8:d70e", "::ffff:93.184.215.14", "2002:5db8:d70e::1"]


def test_only_public_addresses_are_called() -> None:
    assert [a for a in INSIDE if is_public(a)] == []
    assert [a for a in OUTSIDE if not is_public(a)] == []
    for url in ("https://a..b/x", "https://" + "a" * 64 + ".org", "https://\ud800.org", "https://.", "https://[::1"):
        with pytest.raises(Blocked):
            target_of(url, frozenset())
    assert target_of("https://häck.example/", frozenset(), lambda *_: ["93.184.215.14"]).host == "xn--hck-qla.example"


@given(st.text(alphabet="'=+-@\t\r\n＝aé1", max_size=6))
def test_cells_are_no_formulas_and_come_back(text: str) -> None:
    cell = cells.written(text)
    assert cells.read(cell) == text
    assert not cell.startswith(("=", "+", "-", "@", "\t", "\r", "\n", "＝"))


def test_files_for_spreadsheets_hold_no_formulas(client: TestClient) -> None:
    evil = '=HYPERLINK("http://evil.example","x")'
    content = {**document(), "pump_serial": evil, "aircraft": "@SUM(1)", "flight_id": "-2+3"}
    assert client.post(f"{API}/records", json=content).status_code == 201
    for name in ("exports/windows.csv", "exports/trends.csv", "registry/pumps.csv", "registry/aircraft.csv"):
        text = client.get(f"{API}/{name}").text
        rows = list(csv.reader(io.StringIO(text)))
        found = [cell for row in rows for cell in row]
        assert any(cell in (f"'{evil}", "'@SUM(1)") for cell in found), name
        assert not [c for c in found if c.startswith(("=", "+", "@")) or (c.startswith("-") and not _is_number(c))]
    listed = client.get(f"{API}/registry/pumps.csv").content
    taken = client.post(f"{API}/registry/pumps.csv", content=listed, headers={"content-type": "text/csv"}).json()
    assert taken == {"created": 0, "changed": 0, "unchanged": 1}
    changed = listed.replace(b"False", b"True")
    taken = client.post(f"{API}/registry/pumps.csv", content=changed, headers={"content-type": "text/csv"}).json()
    assert taken["changed"] == 1


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def test_namesakes_know_nothing_of_each_other(database_url: str, tmp_path: Path) -> None:
    with guarded_client(database_url, tmp_path) as guarded:
        whole = key(guarded, "admin")
        for operator in ("north", "south"):
            account = {"name": "m.keller", "password": f"a sentence of the {operator}", "role": "viewer"}
            admin = key(guarded, "admin", operator)
            assert guarded.post(f"{API}/users", json=account, headers=admin).status_code == 201
            assert guarded.post(f"{API}/users", json=account, headers=admin).status_code == 409
            url = f"{API}/users/m.keller"
            assert guarded.patch(url, json={"role": "analyst"}, headers=admin).json()["operator"] == operator
        assert guarded.patch(url, json={"role": "viewer"}, headers=whole).status_code == 409
        url = f"{API}/users/m.keller?operator=south"
        assert guarded.patch(url, json={"role": "viewer"}, headers=whole).json()["operator"] == "south"
        north = key(guarded, "admin", "north")
        assert guarded.patch(url, json={"role": "viewer"}, headers=north).status_code == 404
        names = {(u["operator"], u["role"]) for u in guarded.get(f"{API}/users", headers=whole).json()["items"]}
        assert names == {("north", "analyst"), ("south", "viewer")}
        with guarded.app.state.context.database.reading() as session:  # type: ignore[attr-defined]
            for operator in ("north", "south"):
                found = with_password(session, "m.keller", f"a sentence of the {operator}")
                assert found is not None
                assert found.operator == operator
                assert with_password(session, f"{operator}/m.keller", f"a sentence of the {operator}") is found
            assert with_password(session, "m.keller", "a sentence of nobody") is None


def test_a_deleted_operator_leaves_its_receipt_only(database_url: str, tmp_path: Path) -> None:
    """Everything carries a mark that no other row has: afterwards it is nowhere, in no page of the file either."""
    mark = "zebra-finch-77"
    with guarded_client(database_url, tmp_path) as guarded:
        context = guarded.app.state.context  # type: ignore[attr-defined]
        whole, admin = key(guarded, "admin"), key(guarded, "admin", mark)
        content = {**document(), "flight_id": f"{mark}-flight", "pump_serial": f"{mark}-pump", "note": f"{mark}-note"}
        assert guarded.post(f"{API}/records", content=body(content), headers={**JSON, **admin}).status_code == 201
        put = {"values": {"alarm_records": 4}, "reason": f"{mark}-reason"}
        for scope in (f"operator/{mark}", f"pump/{mark}-pump"):
            headers = {**admin, "If-Match": "*"}
            version = guarded.put(f"{API}/thresholds/{scope}", json=put, headers=headers).json()["version"]
        account = {"name": f"{mark}-user", "password": "a long enough sentence", "role": "viewer"}
        assert guarded.post(f"{API}/users", json=account, headers=admin).status_code == 201
        guarded.get("/sign-in")
        form = {"name": account["name"], "password": "wrong", "csrf_token": guarded.cookies["casedrain_sign_in"]}
        assert guarded.post("/sign-in", data=form).status_code == 401
        url = f"{API}/operators/{mark}?confirm={mark}&reason=contract+ended"
        receipt = guarded.delete(url, headers=whole).json()
        assert receipt["finished_at"]
        guarded.post(f"{API}/pumps", json={"serial": "P", "operator": mark}, headers=whole)
        namesake = guarded.get(f"{API}/thresholds/operator/{mark}", headers=whole).json()
        assert namesake["version"] == 0
        assert mark not in str(guarded.get(f"{API}/thresholds/pump/P?operator={mark}", headers=whole).json()["values"])
        with context.database.reading() as session:
            assert session.query(ThresholdVersion).count() == 0
            assert session.query(FailedSignIn).count() == 0
            assert newest_number(session) == version, "no later version may get a number that a verdict has named"
        if context.database.is_sqlite:
            _is_nowhere(context.database.url.removeprefix("sqlite:///"), mark)


def _is_nowhere(path: str, mark: str) -> None:
    for file in (Path(path), Path(f"{path}-wal")):
        content = file.read_bytes() if file.exists() else b""
        for word in ("flight", "note", "reason", "user"):
            assert f"{mark}-{word}".encode() not in content, (file.name, word)
