"""On the wire: answers have a name by their content, travel compressed, and other sites call only where they may."""

import gzip
import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from pydantic import ValidationError

from service.settings import Settings
from tests.service.guarded import guarded_client, key
from tests.service.histories import write_history
from tests.service.lent_application import lent
from tests.service.test_page_forms import come_in

API = "/api/v1"
THERE = "https://boards.example.org"
pytestmark = pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)


@pytest.fixture
def guarded(database_url: str, tmp_path: Path) -> Iterator[TestClient]:
    with guarded_client(database_url, tmp_path, cors_origins=f"{THERE}, http://wall:3000") as running:
        with running.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
            for k in range(8):
                write_history(session, "hhppp", serial=f"P-{k}")
        yield running


def raw(client: TestClient, url: str, **headers: str) -> tuple[dict[str, str], bytes]:
    """Headers and bytes as they travelled."""
    with client.stream("GET", url, headers=headers) as answer:
        return dict(answer.headers), b"".join(answer.iter_raw())


@pytest.mark.parametrize(
    "path",
    [
        "/alarms",
        "/pumps",
        "/fleet/ranking",
        "/thresholds/fleet/default",
        "/exports/verdicts.csv",
        "/pumps/P-1/state.svg",
    ],
)
def test_text_travels_compressed_and_only_once(guarded: TestClient, path: str) -> None:
    who = key(guarded, "viewer", "north")
    plain, body = raw(guarded, API + path, **who, **{"accept-encoding": "identity"})
    packed, small = raw(guarded, API + path, **who, **{"accept-encoding": "br, gzip;q=0.8"})
    assert "content-encoding" not in plain
    assert "Accept-Encoding" in plain["vary"]
    if len(body) < 800 and "csv" not in path:
        assert small == body
    else:
        assert packed["content-encoding"] == "gzip"
        assert gzip.decompress(small) == body
        assert len(small) < 0.6 * len(body)
    assert raw(guarded, API + path, **who, **{"accept-encoding": "gzip;q=0"})[1] == body
    if "csv" in path:
        return
    assert int(packed["content-length"]) == len(small)
    assert plain["etag"] == packed["etag"]
    known = guarded.get(API + path, headers={**who, "if-none-match": f'"other", {packed["etag"]}'})
    assert (known.status_code, known.content, known.headers["etag"]) == (304, b"", packed["etag"])
    assert "content-type" not in known.headers
    assert guarded.get(API + path, headers={**who, "if-none-match": '"other"'}).status_code == 200
    assert guarded.get(API + path, headers={"if-none-match": packed["etag"]}).status_code == 401
    head = guarded.head(API + path, headers=who)
    assert (head.status_code, head.content) == (200, b"")


def test_what_changes_gets_another_name(guarded: TestClient) -> None:
    who = key(guarded, "analyst", "north")
    first = guarded.get(f"{API}/alarms", headers=who)
    alarm = first.json()["items"][0]["id"]
    guarded.post(f"{API}/alarms/{alarm}/acknowledge", headers=who)
    again = guarded.get(f"{API}/alarms", headers={**who, "if-none-match": first.headers["etag"]})
    assert again.status_code == 200
    assert again.headers["etag"] != first.headers["etag"]


def test_pages_are_compressed_but_kept_nowhere_and_repeat_no_secret(guarded: TestClient) -> None:
    come_in(guarded, "ann", "analyst", "north")
    headers, small = raw(guarded, "/alarms", **{"accept-encoding": "gzip"})
    text = gzip.decompress(small).decode()
    assert headers["cache-control"] == "no-store"
    tokens = [re.findall(r'name="csrf_token" value="([^"]+)"', t)[0] for t in (text, guarded.get("/alarms").text)]
    assert tokens[0] != tokens[1]
    alarm = re.findall(r'name="alarm" value="([^"]+)"', text)[0]
    for token, status in ((tokens[0], 303), (tokens[1], 303), (tokens[0][:-4] + "AAAA", 403), ("", 403), ("ä", 403)):
        form = {"csrf_token": token, "reason": "seen"}
        answer = guarded.post(f"/alarms/{alarm}/comment", data=form, follow_redirects=False)
        assert answer.status_code == status, token


def test_other_sites_call_where_they_may(guarded: TestClient) -> None:
    who = key(guarded, "viewer", "north")
    asks = {"access-control-request-method": "GET", "access-control-request-headers": "authorization"}
    for origin, may in ((THERE, True), ("http://wall:3000", True), ("https://evil.example", False)):
        before = guarded.options(f"{API}/alarms", headers={**asks, "origin": origin})
        after = guarded.get(f"{API}/alarms", headers={**who, "origin": origin})
        told = [a.headers.get("access-control-allow-origin") for a in (before, after)]
        assert told == ([origin, origin] if may else [None, None])
        assert "access-control-allow-credentials" not in after.headers
    assert "access-control-allow-origin" not in guarded.get("/sign-in", headers={"origin": THERE}).headers
    picture = guarded.get(f"{API}/pumps/P-1/state.svg", headers=who)
    assert picture.headers["cross-origin-resource-policy"] == "cross-origin"
    assert "Worn pump" in picture.text
    assert "alarm: high" in picture.text
    assert guarded.get(f"{API}/pumps/P-1/state.svg").status_code == 401


def test_without_the_setting_nobody_else_calls(database_url: str, tmp_path: Path) -> None:
    with lent(Settings(database_url=database_url, data_dir=tmp_path / "data")) as client:
        answer = client.get(f"{API}/alarms", headers={"origin": THERE})
        assert "access-control-allow-origin" not in answer.headers
    for text in ("boards.example.org", "https://a.example/path", "ftp://a.example", "https://u:p@a.example"):
        with pytest.raises(ValidationError, match="is no origin"):
            Settings(cors_origins=text)


def test_the_summary_is_bounded(guarded: TestClient) -> None:
    who = key(guarded, "viewer", "north")
    whole = guarded.get(f"{API}/fleet/summary", headers=who).json()
    assert (whole["attention_pumps"], len(whole["attention"])) == (8, 8)
    short = guarded.get(f"{API}/fleet/summary?limit=3", headers=who).json()
    assert (short["attention_pumps"], short["attention"]) == (8, whole["attention"][:3])
    assert (short["silent_pumps"], len(short["silent"])) == (whole["silent_pumps"], min(3, whole["silent_pumps"]))
    assert json.dumps(short["by_state"]) == json.dumps(whole["by_state"])
