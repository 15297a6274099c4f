"""The validation report: one page that needs nothing else, all rows in words, JSON as promised."""

import json
import math
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from service.command_line.main import app
from service.studies.validation.report import Count, counts_of, news, report_html, rows_json
from twin.validation import catalogue
from twin.validation.evidence import FITTED, INDEPENDENT, Curve, Evidence, Plot, Row
from twin.validation.inferred_points import inferred_points

X = np.linspace(0.0, 1.0, 30)
EVIDENCE = {
    "good": Evidence(
        "Good & <sound>",
        (
            Row("table 1", "met quantity", "bar", 2.0, 2.01, 0.05, INDEPENDENT),
            Row("table 1", "fitted quantity", "bar", 2.0, 3.0, 0.05, FITTED),
            Row("table 2", "stated quantity", "um", math.nan, 6.08e-5, math.nan, note="a note to read"),
            Row("table 2", "limited quantity", "L/min", 0.0, 0.5, 0.0, limit=1),
        ),
        (
            Plot("First plot", "x [m]", "y [m]", (Curve("one", X, X**2), Curve("two", X[:5], X[:5])), "what to see"),
            Plot("Second plot", "x [m]", "y [m]", (Curve("alone", X, -X),)),
        ),
        ("A remark.",),
    )
}
MISSED = {"bad": Evidence("Bad", (Row("table 3", "missed quantity", "bar", 1.0, 2.0, 0.1, INDEPENDENT),))}
KNOWN = {
    "known": Evidence(
        "Known", (Row("table 4", "known quantity", "bar", 1.0, 2.0, 0.1, INDEPENDENT, note="why", known_miss=True),)
    )
}
runner = CliRunner()


class Words(HTMLParser):
    """Text of a page, its ids and what refers to them; void elements apart, every tag must be closed."""

    def __init__(self) -> None:
        super().__init__()
        self.text, self.open, self.ids, self.references = "", [], [], []  # type: ignore[var-annotated]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.ids += [values["id"]] if "id" in values else []
        self.references += [v[1:] for k, v in attrs if k in ("href", "xlink:href") and v]
        self.references += re.findall(r"url\(#([^)]+)\)", " ".join(v or "" for _, v in attrs))
        if tag not in ("meta", "link", "br"):
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data + " "


def test_report_needs_nothing_from_elsewhere() -> None:
    page = report_html(EVIDENCE)
    assert not re.search(r"https?:|//[a-z]|<script|<link|<img|@import|src=", page)
    parsed = Words()
    parsed.feed(page)
    assert parsed.open == []
    assert len(parsed.ids) == len(set(parsed.ids))
    assert set(parsed.references) <= set(parsed.ids)


def test_report_says_every_row_in_words() -> None:
    parsed = Words()
    parsed.feed(report_html({**EVIDENCE, **MISSED, **KNOWN}))
    text = re.sub(r"\s+", " ", parsed.text)
    for e in (*EVIDENCE.values(), *MISSED.values()):
        assert e.title in text
        assert all(row.quantity in text for row in e.rows)
        assert all(p.title in text and p.caption in text for p in e.plots)
        assert all(remark in text for remark in e.remarks)
    for verdict in (
        "2 2.010 ±0.050 independent met",
        "fitted not met",
        "independent not met, known why",
        "0.000061 – – only stated a note to read",
        "at least 0 0.5000",
    ):
        assert verdict in text
    assert "1 of 3 independent rows are met" in text
    assert "all 1 of 3 0 of 1 1 of 1 1" in text
    assert {"one", "two", "x [m]"} <= {w.strip() for w in re.findall(r">([^<]+)</text>", report_html(EVIDENCE))}


def test_json_rows_are_plain_values() -> None:
    rows = json.loads(json.dumps(rows_json(EVIDENCE), allow_nan=False))
    keys = {"evidence", "quantity", "unit", "reference", "value", "tolerance", "within", "fitted", "class"}
    keys |= {"known_miss", "note"}
    assert [set(row) for row in rows] == [keys] * 4
    assert [row["within"] for row in rows] == [True, False, None, True]
    assert rows[2]["reference"] is None
    assert rows[2]["tolerance"] is None
    assert rows[1]["fitted"] is True
    assert [row["class"] for row in rows] == ["independent", "fitted", "plausible", "plausible"]


def test_classes_are_counted_apart_and_a_known_miss_is_no_less_a_miss() -> None:
    counts = counts_of({**EVIDENCE, **MISSED, **KNOWN})
    assert counts.by_class() == {"independent": Count(1, 3), "fitted": Count(0, 1), "plausible": Count(1, 1)}
    assert counts.independent.missed == 2
    assert counts.stated == 1
    assert counts.sentence == "met: independent 1 of 3, fitted 0 of 1, plausible 1 of 1; 1 only stated"
    assert news({**EVIDENCE, **MISSED, **KNOWN}) == ["missed quantity"]


@pytest.fixture
def _catalogue(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    functions = {name: lambda e=e: e for name, e in {**EVIDENCE, **MISSED, **KNOWN}.items()}
    monkeypatch.setattr(catalogue, "EVIDENCE", functions)
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("_catalogue")
def test_command_writes_page_and_rows_and_fails_on_a_missed_row(tmp_path: Path) -> None:
    good = runner.invoke(app, ["validate", "--only", "good", "--output", "a/good.html", "--json", "rows.json"])
    assert good.exit_code == 0, good.output
    assert "independent 1 of 1, fitted 0 of 1, plausible 1 of 1; 1 only stated" in good.output
    assert (tmp_path / "a" / "good.html").read_text(encoding="utf-8").startswith("<!doctype html>")
    assert len(json.loads((tmp_path / "rows.json").read_text())) == 4
    everything = runner.invoke(app, ["validate"])
    assert everything.exit_code == 1
    assert "missed quantity" in everything.output
    assert "known quantity" not in everything.output
    assert (tmp_path / "report.html").exists()
    assert runner.invoke(app, ["validate", "--only", "known"]).exit_code == 0


@pytest.mark.usefixtures("_catalogue")
def test_command_names_what_it_knows() -> None:
    wrong = runner.invoke(app, ["validate", "--only", "nothing"])
    assert wrong.exit_code == 1
    assert "known: good, bad, known" in wrong.output


def test_the_catalogue_holds_the_slippers() -> None:
    assert "slippers" in catalogue.EVIDENCE


def test_the_evidence_says_what_the_twin_misses() -> None:
    """The rows that the acceptance sheet and static point 2 are known to contradict, each with its reason."""
    rows = {row.quantity: row for name in ("acceptance", "static-point") for row in catalogue.EVIDENCE[name]().rows}
    delivery = rows["full flow: delivery, 27 to 28"]
    assert (delivery.evidence_class, delivery.within) == ("independent", False)
    assert rows["zero flow: case pressure, 0.8 to 1"].within is False
    assert rows["full flow: shaft torque"].within is False
    assert rows["static point 2: case flow"].within is True
    # one measurement, one reading: the point of chapter 3, with the tank where it stood
    measured = inferred_points()[0.0][1]
    for words, name in (("delivery", "discharge_flow_lpm"), ("case pressure", "case_pressure_bar")):
        assert rows[f"static point 2: {words}"].reference == measured.value(name)
    assert rows["static point 2: case pressure"].within is True
    assert all(row.note for row in rows.values() if row.within is False)
    assert all(row.known_miss for row in rows.values() if row.within is False)
