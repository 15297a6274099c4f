"""Zone and units chosen in Chromium, from first click to what every page then says; the job card is fetched as PDF."""

from typing import Any

import pytest

pytestmark = [pytest.mark.pages, pytest.mark.timeout(600)]


def chosen(page: Any, zone: str, units: str) -> None:
    page.get_by_role("contentinfo").get_by_role("link", name="choose").click()
    page.get_by_label("Zone").fill(zone)
    page.get_by_label("Units").select_option(units)
    page.get_by_role("button", name="Keep it").click()


def test_psi_and_a_zone_are_chosen_used_and_left_again(page: Any, names: dict[str, str]) -> None:
    page.goto(f"/pumps/{names['worn']}")
    assert "pressure setting, change [bar]" in page.inner_text("main")
    chosen(page, "Europe/Paris", "us")
    # back where the way began, in the new words
    assert page.url.split("?")[0].endswith(f"/pumps/{names['worn']}")
    text = page.inner_text("main")
    assert "pressure setting, change [psi]" in text
    assert "[bar]" not in text
    foot = page.get_by_role("contentinfo").inner_text()
    assert "pressures in psi gauge" in foot
    assert "Europe/Paris with UTC beside" in foot
    # the cursor reads the axis that is drawn
    chart = page.get_by_role("figure", name="Trend of case residual")
    chart.focus()
    page.keyboard.press("ArrowLeft")
    assert " psi" in chart.locator("output").inner_text()
    page.goto(f"/thresholds?scope=pump&id={names['worn']}")
    field = page.locator("[name='value.case_pressure_limit_bar']")
    field.fill("50")
    page.locator("form[action='/thresholds'][method=post] [name=reason]").first.fill("their manual says psi")
    page.get_by_role("button", name="Publish").click()
    assert "case_pressure_limit_bar set to 50 psi" in page.inner_text("main")
    assert field.input_value() == "50"
    page.goto(f"/pumps/{names['worn']}")
    link = page.get_by_role("link", name="Job card (PDF)").get_attribute("href")
    card = page.request.get(link)
    assert card.status == 200
    assert card.body()[:5] == b"%PDF-"
    chosen(page, "UTC", "metric")
    assert "pressure setting, change [bar]" in page.inner_text("main")
    page.goto(f"/thresholds?scope=pump&id={names['worn']}")
    assert "case_pressure_limit_bar set to 3.44738" in page.inner_text("main")


def test_a_zone_that_there_is_none_of_is_told(page: Any) -> None:
    page.goto("/preferences")
    page.get_by_label("Zone").fill("Mars/Olympus")
    page.get_by_role("button", name="Keep it").click()
    assert "is no zone like Europe/Paris" in page.inner_text("main")
