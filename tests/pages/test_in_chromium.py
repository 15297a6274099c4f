"""Every page in Chromium: accessible, no wider than the screen, nothing blocked, and a day's tasks from first click to result.

Run by ``make pages``. ``CASEDRAIN_IMAGES`` names a folder that the screenshots are written to.
"""

import os
from pathlib import Path
from typing import Any

import pytest

from tests.pages.conftest import SCREENS
from tests.service.records import body

pytestmark = [pytest.mark.pages, pytest.mark.timeout(1800)]
SHOWN = ("light", "dark", "phone")
"""Screens of which pictures are kept."""
PAGES = {
    "fleet": "/",
    "pump": "/pumps/{worn}",
    "records": "/records?pump={worn}",
    "record": "/records/{record}",
    "alarms": "/alarms",
    "alarm": "/alarms/{alarm}",
    "alarm-statistics": "/alarms/statistics",
    "upload": "/upload",
    "thresholds": "/thresholds?scope=pump&id={worn}",
    "engineer": "/engineer?pump_leakage_scale=2&study=true",
    "jobs": "/jobs",
    "registry": "/registry",
    "registry-pump": "/registry?pump={worn}",
    "registry-aircraft": "/registry?name={aircraft}",
    "mappings": "/mappings",
    "keys": "/keys",
    "users": "/users",
    "webhooks": "/webhooks",
    "audit": "/audit",
    "sign-in": "/sign-in",
    "docs": "/docs",
    "preferences": "/preferences",
    "nothing": "/nothing-here",
}


@pytest.mark.parametrize("screen", SCREENS)
@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_usable(browser: Any, address: str, names: dict[str, str], name: str, screen: str) -> None:
    from axe_playwright_python.sync_playwright import Axe

    context = browser.new_context(base_url=address, **SCREENS[screen])
    page, said = context.new_page(), []
    page.on("console", lambda message: said.append(message.text))
    answer = page.goto(PAGES[name].format(**names))
    assert answer.status == (404 if name == "nothing" else 200)
    assert [m for m in said if "Content Security Policy" in m] == []
    assert page.evaluate("document.documentElement.scrollWidth") <= SCREENS[screen]["viewport"]["width"]  # type: ignore[index]
    found = Axe().run(page)
    assert [(v["id"], v["nodes"][0]["html"]) for v in found.response["violations"]] == []
    assert page.locator("h1").count() == 1
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.textContent") == "Skip to content"
    page.evaluate("document.activeElement.blur()")
    folder = os.environ.get("CASEDRAIN_IMAGES")
    if folder and screen in SHOWN:
        page.screenshot(path=Path(folder) / f"page-{name}-{screen}.png")
    page.emulate_media(media="print")
    assert not page.locator("header nav").is_visible()
    context.close()


def test_a_file_is_uploaded_and_one_is_refused(page: Any) -> None:
    page.goto("/")
    page.get_by_role("link", name="Upload").click()
    good = {"name": "good.json", "mimeType": "application/json", "buffer": body()}
    bad = {"name": "bad.csv", "mimeType": "text/csv", "buffer": b"time_s,case_pressure_bar\n0,x\n"}
    page.locator("input[type=file]").set_input_files([good, bad])
    page.get_by_role("button", name="Look first").click()
    assert "It would be taken" in page.inner_text("main")
    page.locator("input[type=file]").set_input_files([good, bad])
    page.get_by_role("button", name="Upload").click()
    assert "1 taken, 1 refused" in page.inner_text("main")
    assert "channels.discharge_pressure_bar is missing" in page.inner_text("main")
    page.get_by_role("link", name="Record of flight F1").click()
    assert page.locator("figure svg .twin").count() == 2
    page.get_by_role("link", name="first half").click()
    assert "from=" in page.url
    page.get_by_role("navigation", name="Main").get_by_role("link", name="Records").click()
    assert "Refused at the door" in page.inner_text("main")


def test_an_alarm_is_planned_commented_and_counted(page: Any, names: dict[str, str]) -> None:
    page.goto("/")
    page.get_by_role("navigation", name="Main").get_by_role("link", name="Alarms").click()
    page.goto(f"/alarms?every=true&pump={names['worn']}")
    page.locator("tbody input[type=checkbox]").first.check()
    page.locator("[name=action]").select_option("plan")
    page.get_by_label("Assign to").fill("line 2")
    page.get_by_label("Due (UTC)").fill("2099-05-08T12:00")
    page.get_by_role("button", name="Do it").click()
    row = page.locator("tbody tr", has=page.get_by_role("link", name=names["worn"], exact=True)).first
    assert "line 2" in row.inner_text()
    row.get_by_role("link", name="The alarm of pump").click()
    form = page.locator("form", has=page.get_by_role("button", name="Save the plan"))
    assert form.get_by_label("Seen to by").input_value() == "line 2"
    form.get_by_label("Work order").fill("WO-4711")
    form.get_by_role("button").click()
    page.get_by_label("Comment").fill("oil sample sent")
    page.get_by_role("button", name="Comment").click()
    said = page.inner_text("ol.history")
    assert "order WO-4711" in said
    assert "oil sample sent" in said
    page.get_by_role("link", name="inbox").click()
    page.goto("/alarms?every=true&assignee=line 2")
    assert "1 comment" in page.inner_text("tbody")
    page.get_by_role("link", name="How often, how long").click()
    assert names["worn"] in page.inner_text("main")
    page.get_by_role("link", name="a year").click()
    assert "within a year" in page.inner_text("main")


def test_an_alarm_is_acknowledged_shelved_and_closed(page: Any, names: dict[str, str]) -> None:
    page.goto("/")
    page.get_by_role("navigation", name="Main").get_by_role("link", name="Alarms").click()
    row = page.locator("tbody tr", has=page.get_by_role("link", name=names["worn"], exact=True)).first
    row.get_by_role("button", name="Acknowledge").click()
    row = page.locator("tbody tr", has=page.get_by_role("link", name=names["worn"], exact=True)).first
    assert "active, acknowledged" in row.inner_text()
    for action, words in (("shelve", "shelved until"), ("close", "closed")):
        page.goto(f"/alarms?every=true&pump={names['worn']}")
        page.locator("tbody input[type=checkbox]").first.check()
        page.locator("[name=action]").select_option(action)
        page.locator("form[action='/alarms'][method=post] [name=reason]").fill("spare arrives on Friday")
        page.get_by_role("button", name="Do it").click()
        page.goto(f"/alarms?every=true&pump={names['worn']}")
        assert words in page.inner_text("tbody")


def test_a_threshold_is_previewed_published_and_restored(page: Any, names: dict[str, str]) -> None:
    page.goto(f"/pumps/{names['worn']}")
    page.get_by_role("navigation", name="Of this pump").get_by_role("link", name="Thresholds").click()
    field = page.locator("[name='value.alarm_on_delay_flights']")
    for value, reason in (("4", "noise"), ("5", "more noise")):
        field.fill(value)
        page.get_by_role("button", name="Preview on history").click()
        assert "What these values would have done" in page.inner_text("main")
        assert field.input_value() == value
        page.locator("form[action='/thresholds'][method=post] [name=reason]").first.fill(reason)
        page.get_by_role("button", name="Publish").click()
    assert "alarm_on_delay_flights from 4 to 5" in page.inner_text("main")
    page.get_by_text("Restore …").click()
    page.get_by_role("button", name="Restore version").click()
    assert field.input_value() == "4"


def test_the_registry_maintenance_and_a_report(page: Any, names: dict[str, str]) -> None:
    page.goto("/")
    page.get_by_role("navigation", name="Main").get_by_role("link", name="Registry").click()
    page.get_by_role("link", name=names["worn"], exact=True).click()
    page.get_by_role("button", name="Confirm").click()
    assert "only records speak of it" not in page.inner_text("main")
    page.get_by_text("Enter maintenance …").click()
    form = page.locator("form", has=page.get_by_role("button", name="Enter maintenance"))
    form.get_by_label("Time (UTC)").fill("2026-03-20T10:00")
    form.get_by_label("Done").select_option("filter_changed")
    form.get_by_role("button").click()
    assert "Filter of the case drain changed" in page.inner_text("main")
    page.get_by_role("link", name="its page").click()
    page.get_by_role("button", name="Make a report").click()
    for _ in range(100):
        if "/reports/" in page.url and page.title() != "Report – casedrain":
            break
        page.wait_for_timeout(200)
        page.reload()
    assert names["worn"] in page.inner_text("body")


def test_a_key_is_shown_once(page: Any) -> None:
    page.goto("/keys")
    page.get_by_label("Who uses it").fill("office")
    page.get_by_role("button", name="Make the key").click()
    assert page.locator(".secret").inner_text().startswith("cd_")
    page.goto("/keys")
    assert page.locator(".secret").count() == 0
