"""Charts in Chromium: a cursor and a zoom by mouse and keyboard; records compared and marked; a load step run."""

import os
import re
from pathlib import Path
from typing import Any

import pytest

from tests.pages.conftest import SCREENS

PARTS = {
    "trends": "/pumps/{worn}?range=all&compare=both",
    "marks": "/records/{record}?from=20&to=200",
    "step": "/engineer?step=true&run_s=0.15",
}
pytestmark = [pytest.mark.pages, pytest.mark.timeout(600)]


def test_a_trend_is_read_and_zoomed_by_mouse_and_keyboard(page: Any, names: dict[str, str]) -> None:
    page.goto(f"/pumps/{names['worn']}?range=all")
    assert page.locator("img.curve").evaluate("e => e.complete && e.naturalWidth > 100")
    figure = page.locator("figure.chart").first
    shape = figure.locator("svg").bounding_box()
    figure.locator("svg").hover(position={"x": 0.6 * shape["width"], "y": 0.5 * shape["height"]})
    assert re.search(r"2026-\d\d-\d\d \d\d:\d\d UTC · this pump [\d.e+-]+ L/min", figure.locator("output").inner_text())
    figure.focus()
    for key in ("End", "ArrowLeft", "ArrowLeft"):
        page.keyboard.press(key)
    said = figure.locator("output").inner_text()
    page.keyboard.press("Shift+ArrowLeft")
    page.keyboard.press("Shift+ArrowLeft")
    assert "look closer" in figure.locator("output").inner_text()
    page.keyboard.press("Escape")
    assert figure.locator("output").inner_text() == ""
    page.keyboard.press("End")
    for _ in range(6):
        page.keyboard.press("Shift+ArrowLeft")
    with page.expect_navigation():
        page.keyboard.press("Enter")
    assert "from=2026" in page.url
    assert said != ""
    rows = page.locator("figure.chart").first.locator("tbody tr").count()
    assert 5 <= rows <= 7
    page.get_by_role("link", name="Whole").click()
    # and by the mouse
    figure = page.locator("figure.chart").first
    figure.scroll_into_view_if_needed()
    shape = figure.locator("svg").bounding_box()
    middle = shape["y"] + 0.5 * shape["height"]
    page.mouse.move(shape["x"] + 0.4 * shape["width"], middle)
    page.mouse.down()
    page.mouse.move(shape["x"] + 0.7 * shape["width"], middle, steps=4)
    with page.expect_navigation():
        page.mouse.up()
    assert "from=2026" in page.url
    page.get_by_role("link", name="over flight hours").click()
    assert "flight hours [h]" in page.locator("figure.chart").first.inner_html()
    page.get_by_label("Beside it").select_option("none")
    page.get_by_role("button", name="Look").click()
    assert "compare=none" in page.url


@pytest.mark.skipif(not os.environ.get("CASEDRAIN_IMAGES"), reason="pictures are made where a folder for them is named")
@pytest.mark.parametrize("screen", [*SCREENS, "print"])
def test_parts_of_pages_are_pictured(browser: Any, address: str, names: dict[str, str], screen: str) -> None:
    folder = Path(os.environ["CASEDRAIN_IMAGES"])
    context = browser.new_context(base_url=address, **SCREENS.get(screen, SCREENS["light"]))
    page = context.new_page()
    for part, url in PARTS.items():
        page.goto(url.format(**names))
        if screen == "print":
            page.emulate_media(media="print")
        page.locator(f"section[aria-labelledby={part}]").screenshot(path=folder / f"part-{part}-{screen}.png")
    context.close()


def test_two_records_are_compared_and_one_is_marked(page: Any, names: dict[str, str]) -> None:
    page.goto(f"/records/{names['record']}")
    page.get_by_label("Lay over it").select_option(index=1)
    page.get_by_role("button", name="Compare").click()
    assert page.locator("svg path.other").count() >= 4
    assert "line is the record of flight" in page.inner_text("main")
    figure = page.locator("figure.chart").first
    shape = figure.locator("svg").bounding_box()
    figure.locator("svg").hover(position={"x": 0.5 * shape["width"], "y": 100})
    assert "other record" in figure.locator("output").inner_text()
    page.goto(f"/records/{names['record']}?from=20&to=40")
    form = page.locator("form", has=page.get_by_role("button", name="Mark it"))
    assert float(form.get_by_label("From [s]").input_value()) >= 20.0
    form.get_by_label("It is").select_option("bad")
    form.get_by_label("Why").fill("plug was moved")
    form.get_by_role("button").click()
    assert "plug was moved" in page.inner_text("main")
    assert page.locator("svg rect.mark.bad").count() >= 1
    page.get_by_role("button", name="Take back the mark").click()
    assert "Nothing is marked" in page.inner_text("main")


def test_a_load_step_is_run(page: Any) -> None:
    page.goto("/engineer?pump_leakage_scale=3")
    page.get_by_label("Length of the run").fill("0.15")
    page.get_by_role("button", name="Run it").click()
    assert page.locator("#step ~ .columns svg").count() >= 3
    assert "with these values" in page.locator("section", has=page.locator("#step")).inner_text()
