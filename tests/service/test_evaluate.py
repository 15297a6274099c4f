"""``casedrain evaluate``: the same numbers however it is run, and two files that need nothing else."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest
from pydantic import TypeAdapter
from typer.testing import CliRunner

from detectors.evaluation.reality import DIFFERENCES, REALITIES
from detectors.evaluation.rows import HEALTHY, PLAIN_ROWS, Growing, Row
from detectors.words.verdict import State
from service.answers.job_documents import StudyReport
from service.command_line.main import app
from service.identity import sentence, software
from service.studies.evaluation import store
from service.studies.evaluation.numbers import study_json
from service.studies.evaluation.plan import Study, StudyFaultsError, chosen_rows, chunks_of, pumps_in, sized
from service.studies.evaluation.report import report_html
from service.studies.evaluation.run import Results, run, scored

TINY = Study(
    (
        Row(HEALTHY, State.HEALTHY, 40, by_records=True),
        Row("slippers", State.PUMP_DEGRADATION, 40, Growing(("slippers",), 0.9, flights=15, onset=15), "L/min"),
    ),
    n_pumps=4,
    n_healthy_records=25,
)
runner = CliRunner()


class Page(HTMLParser):
    """Words of a page, its ids and what refers to them; every tag but void ones must be closed."""

    def __init__(self) -> None:
        super().__init__()
        self.words = ""
        self.open: list[str] = []
        self.ids: list[str] = []
        self.references: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.ids += [v for k, v in attrs if k == "id" and v]
        self.references += [v[1:] for k, v in attrs if k in ("href", "xlink:href") and v]
        if tag not in ("meta", "link", "br"):
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words += data + " "


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Judged chunks of the tiny study."""
    place = tmp_path_factory.mktemp("study")
    run(TINY, place, 1, lambda _: None)
    return place


@pytest.fixture(scope="module")
def results(folder: Path) -> Results:
    return scored(TINY, folder, lambda: None)


def numbers(study: Study, place: Path) -> str:
    return json.dumps(study_json(scored(study, place, lambda: None)), allow_nan=False)


def test_pumps_are_spread_over_the_realities_and_healthy_records_are_enough() -> None:
    study = Study(PLAIN_ROWS, n_pumps=302)
    leak = next(r for r in PLAIN_ROWS if r.name.startswith("pump leakage"))
    assert list(pumps_in(leak, study).values()) == [76, 76, 75, 75]
    healthy = pumps_in(PLAIN_ROWS[0], study)
    assert set(healthy) == set(REALITIES)
    # one flight in twenty drops out, the first 8 records set the baseline
    assert all(n * (250 * 0.95 - 8) >= 100_000 for n in healthy.values())
    for row in PLAIN_ROWS:
        assert sum(c.n_pumps for c in chunks_of(row, study)) == sum(pumps_in(row, study).values())


def test_rows_are_chosen_by_name_with_and_without_burst() -> None:
    assert [r.name for r in chosen_rows(["drain +30 %"])] == ["drain +30 %", "drain +30 %; burst"]
    assert [r.name for r in chosen_rows(["drain +30 %; burst"])] == ["drain +30 %; burst"]
    with pytest.raises(StudyFaultsError) as caught:
        chosen_rows(["nothing", "drain +30 %", "else"])
    assert {"no row 'nothing'", "no row 'else'"} <= set(caught.value.faults)
    assert (sized((), None, None, 1).n_pumps, sized((), None, None, 1).n_healthy_records) == (300, 100_000)
    assert sized((), 12, None, 1, quick=True).n_pumps == 12


def test_a_resumed_study_gives_the_same_numbers(folder: Path, tmp_path: Path) -> None:
    whole = numbers(TINY, folder)
    chunks = [c for row in TINY.rows for c in chunks_of(row, TINY)]
    seen: list[int] = []

    def stop(n: int) -> None:
        seen.append(n)
        if len(seen) == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(TINY, tmp_path, 1, stop)
    kept = {p.name for p in tmp_path.iterdir()}
    assert len(kept) == 3
    # a damaged result is worked out again, like one that is missing
    next(tmp_path.iterdir()).write_bytes(b"half a file")
    counted: list[int] = []
    run(TINY, tmp_path, 1, counted.append)
    assert sum(counted) == sum(c.n_pumps for c in chunks)
    assert not [p for p in tmp_path.iterdir() if p.suffix != ".npz"]
    assert numbers(TINY, tmp_path) == whole


def test_a_pool_gives_the_same_numbers(folder: Path, tmp_path: Path) -> None:
    run(TINY, tmp_path, 2, lambda _: None)
    assert numbers(TINY, tmp_path) == numbers(TINY, folder)


def test_results_are_named_after_all_they_depend_on(monkeypatch: pytest.MonkeyPatch) -> None:
    chunk = chunks_of(TINY.rows[1], TINY)[0]
    assert store.key(chunk) == store.key(replace(chunk))
    others = [
        replace(chunk, seed=2),
        replace(chunk, number=1),
        replace(chunk, n_pumps=2),
        replace(chunk, reality=REALITIES[1]),
        replace(chunk, row=replace(chunk.row, n_flights=41)),
        replace(chunk, row=replace(chunk.row, course=Growing(("slippers",), 0.8, flights=15, onset=15))),
        replace(chunk, row=replace(chunk.row, sensing=replace(chunk.row.sensing, outlier=0.01))),
    ]
    keys = {store.key(c) for c in (chunk, *others)}
    assert len(keys) == 1 + len(others)
    monkeypatch.setattr(store, "twin_version", lambda _: "another twin")
    assert store.key(chunk) not in keys
    monkeypatch.undo()
    monkeypatch.setattr(store, "_sources", lambda: "another judge")
    assert store.key(chunk) not in keys


def test_large_leakage_is_found_and_called_by_no_wrong_side(results: Results) -> None:
    TypeAdapter(StudyReport).validate_python(study_json(results))
    assert study_json(results)["study"]["software"] == software().to_json()
    row = study_json(results)["rows"][1]
    found = row["scopes"]["all realities"]["scores"]
    assert found["alarm after the onset"]["value"] == 1.0
    assert found["at the end: side system"]["value"] == 0.0
    # the truth's own course ends at 0.9 L/min
    assert 0.0 < found["size at the alarm, median"]["value"] < 0.9
    assert found["size at the alarm, median"]["low"] <= found["size at the alarm, median"]["value"]


def test_page_needs_nothing_from_elsewhere_and_says_what_was_done(results: Results) -> None:
    text = report_html(results)
    assert sentence() in text
    assert not re.search(r"https?:|//[a-z]|<script|<link|<img|@import|src=", text)
    page = Page()
    page.feed(text)
    assert page.open == []
    assert len(page.ids) == len(set(page.ids))
    assert set(page.references) <= set(page.ids)
    words = re.sub(r"\s+", " ", page.words)
    for difference in DIFFERENCES:
        assert re.sub(r"\s+", " ", difference) in words
    for expected in (
        "seed 1",
        "4 pumps in each row",
        "twin h225-",
        "Size at the alarm",
        "ROC",
        "Reliability",
        "Delay",
        "Found over",
    ):
        assert expected in words
    # false alarms in each of four realities, the worn among the healthy, two calibrations read in two ways, two coverages
    assert re.search(r"\d of 11 targets are met", words)
    assert not {"nan", "inf"} & set(re.findall(r"[a-z]+", words))


def test_command_writes_both_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    page, found = tmp_path / "a" / "study.html", tmp_path / "b" / "study.json"
    options = ["--quick", "--rows", "worn on arrival", "--workers", "1", "--pumps", "4", "--seed", "5"]
    answer = runner.invoke(app, ["evaluate", *options, "--html", str(page), "--json", str(found)])
    assert answer.exit_code == 0, answer.output
    assert "targets met" in answer.output
    assert page.read_text(encoding="utf-8").startswith("<!doctype html>")
    content = json.loads(found.read_text(encoding="utf-8"))
    assert content["study"]["seed"] == 5
    assert [r["row"] for r in content["rows"]] == ["worn on arrival", "worn on arrival; burst"]
    assert [t["at_least"] for t in content["targets"] if t["row"] == "worn on arrival"] == [0.85, 0.9]
    assert all({"value", "low", "high", "met", "scope"} <= set(t) for t in content["targets"])


def test_command_names_every_fault_before_it_computes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    wrong = runner.invoke(app, ["evaluate", "--rows", "nothing", "--rows", "else"])
    assert wrong.exit_code == 2
    for words in ("no row 'nothing'", "no row 'else'", "pump leakage 0.6 L/min"):
        assert words in wrong.output
    (tmp_path / "file").write_text("")
    where = str(tmp_path / "file" / "study.html")
    refused = runner.invoke(app, ["evaluate", "--quick", "--html", where, "--resume", str(tmp_path / "file" / "keep")])
    assert refused.exit_code == 2
    assert refused.output.count("cannot be written") == 2


def test_command_says_how_to_go_on_after_ctrl_c(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setattr("service.studies.evaluation.command.run", interrupted)
    kept = runner.invoke(app, ["evaluate", "--quick", "--resume", str(tmp_path)])
    assert kept.exit_code == 130
    assert f"goes on from {tmp_path}" in kept.output
    lost = runner.invoke(app, ["evaluate", "--quick"])
    assert lost.exit_code == 130
    assert "nothing is kept" in lost.output
