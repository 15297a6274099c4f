"""Times on pages in a chosen zone, with UTC beside; nobody else's page and no file changes."""

import re
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from zoneinfo import ZoneInfo

import pytest
from fastapi.testclient import TestClient
from hypothesis import given, settings
from hypothesis import strategies as st

from service.web.dashboard.preferences import FILTERS, spoken_in, zones
from tests.service.guarded import guarded_client
from tests.service.histories import write_history
from tests.service.test_page_forms import come_in


@pytest.fixture
def guarded(database_url: str, tmp_path: Path) -> Iterator[TestClient]:
    with guarded_client(database_url, tmp_path) as running:
        with running.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
            write_history(session, "hhppp")
        yield running


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_a_zone_is_chosen_and_left_again(guarded: TestClient) -> None:
    token = come_in(guarded, "ann", "analyst", "north")
    page = guarded.get("/alarms?priority=high")
    assert "times in UTC" in page.text
    way = re.findall(r'href="(/preferences\?back=[^"]+)"', page.text)[0]
    back = re.findall(r'name="back" value="([^"]+)"', guarded.get(way).text)[0]
    assert back == "/alarms?priority=high"
    alarm = re.findall(r'name="alarm" value="([^"]+)"', page.text)[0]

    def choose(zone: str, back: str = "/") -> tuple[int, str]:
        form = {"csrf_token": token, "zone": zone, "back": back}
        answer = guarded.post("/preferences", data=form, follow_redirects=False)
        return answer.status_code, answer.headers.get("location", answer.text)

    assert choose("Asia/Kathmandu", back) == (303, back)
    # raised on 3 May 2026 at 08:00 UTC, in Nepal 5 h 45 min later
    assert "03 May 2026 13:45 +0545 (08:00 UTC)" in guarded.get(f"/alarms/{alarm}").text
    assert "times in Asia/Kathmandu with UTC beside" in guarded.get("/").text
    assert choose("Asia/Kathmandu", "https://evil.example")[1] == "/"
    for wrong in ("Mars/Olympus", "", "../etc/passwd"):
        assert choose(wrong)[0] == 422
    assert choose("UTC")[0] == 303
    assert "03 May 2026 08:00 UTC" in guarded.get(f"/alarms/{alarm}").text
    guarded.cookies.set("casedrain_zone", "<b>")
    assert "times in UTC" in guarded.get("/").text


@settings(max_examples=40, deadline=None)
@given(st.integers(946_684_800, 2_840_140_800), st.sampled_from(zones()))
def test_both_times_are_the_same_instant(seconds: int, zone: str) -> None:
    at = datetime.fromtimestamp(seconds // 60 * 60, tz=UTC)
    with spoken_in(zone):
        said = FILTERS["day"](at)
    if zone == "UTC":
        assert said == f"{at:%d %b %Y %H:%M} UTC"
        return
    here = at.astimezone(ZoneInfo(zone))
    assert said.startswith(f"{here:%d %b %Y %H:%M} ")
    beside = re.findall(r"\((?:(\d\d \w{3}) )?(\d\d:\d\d) UTC\)$", said)
    assert beside == [("" if here.date() == at.date() else f"{at:%d %b}", f"{at:%H:%M}")]
    assert FILTERS["day"](at) == f"{at:%d %b %Y %H:%M} UTC"
