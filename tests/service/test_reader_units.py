"""Units that a reader chooses: pages, pictures and forms speak them, what is stored and what the API says does not change."""

import html
import re
from collections.abc import Iterator
from fractions import Fraction
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from hypothesis import example, given, settings
from hypothesis import strategies as st

from detectors.drawing.svg import Frame, axes
from service.demo.fleet import DemoRecord
from service.ingest.conversion import conversion
from service.reports.sentences import in_units
from service.units import METRIC, SYSTEMS, US, unit_of
from tests.service.guarded import guarded_client, key
from tests.service.histories import write_history
from tests.service.test_page_forms import come_in

API = "/api/v1"
ORIGIN = {"origin": "http://localhost"}
PSI = Fraction("0.45359237") * Fraction("9.80665") / Fraction("0.0254") ** 2 / 100_000
"""Bar: pound (avoirdupois), standard gravity and inch by their definitions."""
GPM = 231 * Fraction("0.254") ** 3
"""L/min: a US gallon is 231 cubic inches."""
EXACT: dict[str, tuple[Fraction, Fraction]] = {
    "bar": (PSI, Fraction(0)),
    "L/min": (GPM, Fraction(0)),
    "degC": (Fraction(5, 9), Fraction(-160, 9)),
    "K": (Fraction(5, 9), Fraction(0)),
}
OF_UNIT = {"bar": "x_bar", "L/min": "x_lpm", "degC": "x_degc"}


@settings(max_examples=80, deadline=None)
@example("K", 8.904822805482961e-203, "us")
@example("bar", 3.5, "us")
@example("degC", float(Fraction(-160, 9)), "us")
@given(
    st.sampled_from(sorted(EXACT)),
    st.floats(-1e6, 1e6).map(lambda v: v if abs(v) > 1e-9 else 0.0),
    st.sampled_from(sorted(SYSTEMS)),
)
def test_what_a_field_shows_is_stored_as_it_was(unit: str, value: float, system: str) -> None:
    assert SYSTEMS[system].stored(SYSTEMS[system].text(value, unit), unit) == value


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(sorted(EXACT)), st.decimals(-9999, 9999, places=3))
def test_what_is_typed_is_rounded_once(unit: str, typed: Any) -> None:
    slope, intercept = EXACT[unit]
    stored = US.stored(str(typed), unit)
    assert stored == float(Fraction(typed) * slope + intercept)
    # and comes back as it was typed
    assert float(US.text(stored, unit)) == float(typed)
    assert len(US.text(stored, unit)) <= max(len(str(typed)), 1)
    assert METRIC.stored(str(typed), unit) == float(typed)


def test_files_and_readers_have_the_same_units() -> None:
    for unit, name in OF_UNIT.items():
        line = conversion(US.foreign[unit][0], name)
        assert (line.slope, line.intercept) == pytest.approx([float(x) for x in EXACT[unit]], rel=1e-14)
        assert unit_of(name) == unit
        # a number of the page is the inverse of it
        assert line.slope * US.value(3.21, unit) + line.intercept == pytest.approx(3.21, rel=1e-12)


def test_numbers_as_fine_as_ours_and_texts_that_are_none() -> None:
    assert (US.figure(1.0, "bar", 2), US.figure(1.0, "L/min", 2), US.figure(100.0, "degc", 1)) == (
        "14.5",
        "0.264",
        "212.0",
    )
    assert (US.size(10.0, "degC", 1), US.said(3.5, "bar"), US.word("bar^2/Hz")) == ("18.0", "50.76 psi", "psi^2/Hz")
    assert (METRIC.said(1.5, "L/min", 2), METRIC.figure(None, "bar", 2), METRIC.figure(-0.001, "bar", 2)) == (
        "1.50 L/min", "–", "0.00",
    )  # fmt: skip
    assert (US.said(0.5, "-"), US.said(700.0, "bar")) == ("0.5", "10153 psi")
    assert US.stored("1e999999999", "bar") == float("inf")
    assert US.stored("1e-999999999", "degC") == float(Fraction(-160, 9))
    for text in ("1,5", "five", "", "1/3", "0x10"):
        with pytest.raises(ValueError, match="could not convert"):
            US.stored(text, "bar")


def test_an_axis_says_round_numbers_of_its_unit_where_they_lie() -> None:
    frame = Frame(0.0, 0.0, 100.0, 100.0, 20.0, 90.0, 176.9, 177.05)
    drawn = "".join(axes(frame, "", "", x_scale=US.scale("degC"), y_scale=US.scale("bar")))
    words = [
        (float(x), float(y), float(n)) for x, y, n in re.findall(r'x="([-\d.]+)" y="([-\d.]+)"[^>]*>([-\d.]+)<', drawn)
    ]
    across, up = [w for w in words if w[1] == 118.0], [w for w in words if w[0] == -8.0]
    assert len(across) > 3
    assert len(up) > 3
    for x, _, fahrenheit in across:
        assert x == pytest.approx(frame.x((fahrenheit - 32.0) / 1.8), abs=0.06)
        assert fahrenheit % 5.0 == 0.0
    for _, y, psi in up:
        assert y - 4.0 == pytest.approx(frame.y(psi * float(PSI)), abs=0.06)
    assert len({n for *_, n in up}) == len(up)


class _Seen(HTMLParser):
    """Words of cells, labels, pictures and sentences, and attributes that are read out."""

    WATCHED = ("th", "td", "label", "text", "title", "desc", "summary", "dt", "footer")
    SENTENCES = ("p", "li", "dd")
    READ = ("aria-label", "data-unit", "data-label", "alt")
    VOID = ("input", "meta", "link", "br", "img", "hr", "option")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.words: list[str] = []
        self.sentences: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        held = dict(attrs)
        self.words += [held[name] or "" for name in self.READ if name in held]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        while tag in self.open and self.open.pop() != tag:
            pass

    def handle_data(self, data: str) -> None:
        if any(tag in self.WATCHED for tag in self.open):
            self.words.append(data)
        elif any(tag in self.SENTENCES for tag in self.open):
            self.sentences.append(data)


MEASURED = re.compile(r"\d (bar|L/min|degC|°C|K)(?![\w/])")
OURS = re.compile(r"\bbar\b|L/min|\blpm\b|°C|\[degC\]|\d degC")


def choose(client: TestClient, units: str, token: str = "") -> None:
    form = {"zone": "UTC", "units": units, "back": "/", "csrf_token": token}
    assert client.post("/preferences", data=form, headers=ORIGIN, follow_redirects=False).status_code == 303


def spoken(client: TestClient, path: str) -> list[str]:
    page = client.get(path)
    assert page.status_code == 200, path
    seen = _Seen()
    seen.feed(page.text)
    assert seen.words, path
    # a sentence may name a unit that data have, and holds no number in it
    return [*seen.words, *(said for said in seen.sentences if MEASURED.search(said))]


def test_every_page_in_psi_has_no_bar_in_tables_pictures_and_forms(
    worn_client: TestClient, worn_records: list[DemoRecord]
) -> None:
    client = worn_client
    (pump,) = client.get(f"{API}/pumps").json()["items"]
    serial, aircraft = pump["serial"], pump["aircraft"]
    record = client.get(f"{API}/records?pump={serial}").json()["items"][-1]["record_id"]
    (alarm, *_) = client.get(f"{API}/alarms?pump={serial}").json()["items"]
    fitted = {"channel": "case_pressure_bar", "identity": "K-1", "since": "2026-01-01T00:00", "units": "us"}
    fitted |= {"full_scale_bar": "100"}
    sent = client.post(f"/registry/aircraft/{aircraft}/sensors", data=fitted, headers=ORIGIN, follow_redirects=False)
    assert sent.status_code == 303, sent.text
    (sensor,) = client.get(f"{API}/aircraft/{aircraft}").json()["sensors"]
    assert sensor["full_scale_bar"] == float(100 * PSI)
    found = {"at": "2026-05-10T12:00", "found": "pump_degradation", "measured_case_flow_lpm": "0.45", "units": "us"}
    client.post(f"/pumps/{serial}/findings", data=found, headers=ORIGIN)
    (finding,) = client.get(f"{API}/pumps/{serial}/findings").json()["items"]
    assert finding["measured_case_flow_lpm"] == float(Fraction("0.45") * GPM)
    told = client.get(f"{API}/pumps/{serial}/verdict").json()
    curve = client.get(f"{API}/pumps/{serial}/damage-identification-curve?format=svg").text
    assert any(OURS.search(w) for w in spoken(client, f"/pumps/{serial}"))
    choose(client, "us")
    for path in (
        "/", f"/pumps/{serial}", f"/pumps/{serial}?axis=hours&range=all&compare=both", f"/pumps/{serial}/curve.svg",
        "/records", f"/records/{record}?spectrum=case_pressure_bar", "/alarms", f"/alarms/{alarm['id']}",
        "/alarms/statistics", "/upload", "/thresholds", f"/thresholds?scope=pump&id={serial}", "/engineer?step=true",
        "/jobs", "/registry", f"/registry?pump={serial}", f"/registry?name={aircraft}", "/keys", "/users", "/webhooks",
    ):  # fmt: skip
        assert [w for w in spoken(client, path) if OURS.search(w)] == [], path
    # the numbers are those of the API
    page = client.get(f"/pumps/{serial}").text
    for name, estimate in told["estimates"].items():
        unit = unit_of(name)
        shown = f'<td class="number">{US.figure(estimate["mean"], unit, 2)}</td>'
        assert shown in page, name
    assert "0.450" in page
    # sentences among them, which are stored in ours
    assert "L/min" in told["advice"]
    assert in_units(told["advice"], US) in html.unescape(page)
    assert 'data-unit="psi"' in client.get(f"/records/{record}").text
    # and those do not change
    assert client.get(f"{API}/pumps/{serial}/verdict").json() == told
    assert client.get(f"{API}/pumps/{serial}/damage-identification-curve?format=svg").text == curve
    assert "[psi]" in client.get(f"/pumps/{serial}/curve.svg").text
    preview = {"file": ("flight.csv", worn_records[0].content)}
    looked = client.post("/upload/preview", files=preview, headers=ORIGIN).text
    assert "discharge_pressure_bar [psi]" in looked or "refused" in looked


@pytest.fixture
def guarded(database_url: str, tmp_path: Path) -> Iterator[TestClient]:
    with guarded_client(database_url, tmp_path) as running:
        with running.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
            write_history(session, "hh")
        yield running


def test_thresholds_are_edited_in_psi_and_kept_in_bar(guarded: TestClient) -> None:
    token = come_in(guarded, "eve", "engineer", "north")
    headers = key(guarded, "viewer", "north")
    link, url = "/thresholds?scope=operator&id=north", f"{API}/thresholds/operator/north"
    name = "value.case_pressure_limit_bar"
    version = 0

    def post(path: str = "/thresholds", **fields: str) -> tuple[int, str]:
        form = {"csrf_token": token, "scope": "operator", "id": "north", "version": str(version), "reason": "ours"}
        answer = guarded.post(path, data={**form, **fields}, follow_redirects=False)
        return answer.status_code, answer.text

    def own() -> dict[str, float]:
        nonlocal version
        found = guarded.get(url, headers=headers).json()
        version = found["version"]
        return dict(found["own"])

    choose(guarded, "us", token)
    page = guarded.get(link).text
    assert re.findall(rf'name="{name}" value=""[^>]*aria-label="[^"]*\[psi\]"', page)
    assert 'name="units" value="us"' in page
    assert post(**{name: "50", "value.window_temperature_drift_k": "4.5", "units": "us"})[0] == 303
    assert own() == {"case_pressure_limit_bar": float(50 * PSI), "window_temperature_drift_k": 2.5}
    page = guarded.get(link).text
    assert f'name="{name}" value="50"' in page
    assert "case_pressure_limit_bar set to 50 psi" in page
    # a form that was shown in psi means psi, whatever its reader has chosen since; one that says nothing means bar
    choose(guarded, "metric", token)
    assert post(**{name: "60", "units": "us"})[0] == 303
    assert own()["case_pressure_limit_bar"] == float(60 * PSI)
    assert post(**{name: "3.7"})[0] == 303
    assert own()["case_pressure_limit_bar"] == 3.7
    # what nobody touches stays what it is, to the last digit
    choose(guarded, "us", token)
    shown = re.findall(rf'name="{name}" value="([^"]+)"', guarded.get(link).text)[0]
    assert post(**{name: shown, "units": "us", "value.alarm_records": "4"})[0] == 303
    assert own()["case_pressure_limit_bar"] == 3.7
    status, page = post(**{name: "500", "units": "us", "value.alarm_records": "many"})
    assert status == 422
    status, page = post(**{name: "500", "units": "us"})
    assert status == 422
    assert "the range is 1.45 to 290.1 psi" in page
    assert f'name="{name}" value="500"' in page
    status, page = post(**{name: "50", "units": "furlongs"})
    assert status == 422
    assert "is not one of metric, us" in page
    assert own()["case_pressure_limit_bar"] == 3.7


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_units_are_chosen_kept_and_refused_by_name(guarded: TestClient) -> None:
    token = come_in(guarded, "ann", "analyst", "north")
    assert "pressures in bar gauge, times in" in guarded.get("/").text
    choose(guarded, "us", token)
    assert "pressures in psi gauge" in guarded.get("/").text
    assert '<option value="us" selected>' in guarded.get("/preferences").text
    # a form of the zone alone leaves the units
    form = {"csrf_token": token, "zone": "Asia/Kathmandu", "back": "/"}
    assert guarded.post("/preferences", data=form, follow_redirects=False).status_code == 303
    assert "pressures in psi gauge" in guarded.get("/").text
    wrong = guarded.post("/preferences", data={**form, "zone": "Mars/Olympus", "units": "cubits"})
    assert wrong.status_code == 422
    assert re.findall(r"<li><strong>([^<]+)</strong>", wrong.text) == ["zone", "units"]
    guarded.cookies.delete("casedrain_units")
    guarded.cookies.set("casedrain_units", "<b>")
    assert "pressures in bar gauge" in guarded.get("/").text


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_an_address_of_the_engineer_means_the_same_to_everybody(client: TestClient) -> None:
    ours = "/engineer?fluid_temperature_degc=72&reservoir_pressure_bar=0.5&pressure_setting_change_bar=2"
    row = r'Case pressure \[bar\]</th><td class="number">([^<]+)</td><td class="number">([^<]+)</td>'
    (said,) = re.findall(row, client.get(ours).text)
    theirs = f"/engineer?units=us&fluid_temperature_degc=161.6&reservoir_pressure_bar={0.5 / float(PSI)!r}"
    theirs += f"&pressure_setting_change_bar={2 / float(PSI)!r}"
    assert re.findall(row, client.get(theirs).text) == [said]
    choose(client, "us")
    page = client.get(ours).text
    assert 'name="fluid_temperature_degc" value="161.6"' in page
    assert "Fluid in the case [°F]" in page
    (psi,) = re.findall(row.replace("bar", "psi"), page)
    assert [float(v) * float(PSI) for v in psi] == pytest.approx([float(v) for v in said], abs=1e-3)
    assert client.get("/engineer?units=furlongs").status_code == 422
