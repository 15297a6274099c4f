"""What a verdict says besides its headline: the same sentences on the page, in the report and on the command line."""

from datetime import timedelta
from typing import Any, get_args

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select

from detectors.words.verdict import CAUSES
from service.client.testing import verdict_of
from service.command_line.analysed import show_pump
from service.demo.fleet import DemoRecord
from service.registry.maintenance import Action
from service.reports.remarks import remarks
from service.storage.tables import StoredAssessment
from tests.service.finished_job import finished

SAYS: dict[str, Any] = {
    "fit": {"records": 20, "explained": 19, "since": None},
    "blind_spots": [
        {"quantity": "pump_leakage_change_lpm", "below": 0.6, "because": "reservoir pressure is <b>not</b> measured"},
        {"quantity": "drain_resistance_change_percent", "below": None, "because": "the temperature never changes"},
    ],
    "probability_beyond_limit": 0.12,
    "crossing": {"within_flight_hours": 50.0, "probability": 0.004},
    "intermittent": {"state": "system_leakage", "records": 9, "of": 20, "since": "2026-05-02T07:11:00Z"},
    "resolved_by": {
        "state": "drain_restriction",
        "action": "drain_cleaned+filter_changed",
        "at": "2026-06-01T08:00:00Z",
    },
    "missing_evidence": [
        {
            "what": "ground run at 10 and 20 L/min",
            "records": 2,
            "would_decide": ["pump_degradation", "system_leakage"],
        },
        {"what": "burst of two seconds", "records": 1, "would_decide": []},
    ],
    "case_pressure": {"over_reservoir_bar": 1.23, "reference_bar": 0.5, "limit_bar": 3.5, "beyond": True},
}
SENTENCES = {
    "The leading cause": ["explains 19 of the last 20 records"],
    "Cannot be seen": [
        "pump leakage: changes below 0.6 L/min stay unseen, because reservoir pressure is <b>not</b> measured",
        "drain resistance: changes of any size stay unseen, because the temperature never changes",
    ],
    "Comes and goes": ["leakage in the circuit on 9 of 20 records, first on 02 May 2026"],
    "Resolved": ["restricted drain line ended on 01 Jun 2026: drain cleaned and filter of the case drain changed"],
    "Still missing": [
        "ground run at 10 and 20 L/min, 2 records: would decide between worn pump and leakage in the circuit",
        "burst of two seconds, 1 record",
    ],
    "Limit": [
        "case flow at the reference condition is beyond its limit with a probability of 12 %",
        "it crosses the limit within 50 flight hours with a probability of less than 1 %",
    ],
    "Case pressure": [
        "1.23 bar over the reservoir on the last flight: beyond the rule, whatever the cause (twice this pump's own reference of "
        "0.50 bar, or 3.5 bar)"
    ],
}


def said(**says: Any) -> dict[str, list[str]]:
    verdict: Any = {**verdict_of(), **says}
    return {remark.heading: list(remark.sentences) for remark in remarks(verdict)}


def test_every_word_of_a_verdict_becomes_a_sentence() -> None:
    assert said(**SAYS) == SENTENCES


def test_nothing_is_said_of_nothing() -> None:
    nothing = dict.fromkeys(SAYS) | {"blind_spots": [], "missing_evidence": []}
    assert said(**nothing) == said() == {}
    assert said(fit={"records": 0, "explained": 0, "since": None}) == {}


def test_what_does_not_fit_is_dated_and_shares_are_never_rounded_to_certainty() -> None:
    fit = {"records": 20, "explained": 12, "since": "2026-05-02T07:11:00Z"}
    assert said(fit=fit)["The leading cause"] == ["explains 12 of the last 20 records; none since 02 May 2026"]
    for share, words in ((0.0, "0 %"), (0.997, "more than 99 %"), (1.0, "100 %"), (0.004, "less than 1 %")):
        assert said(probability_beyond_limit=share)["Limit"][0].endswith(f"probability of {words}")


@pytest.mark.parametrize("action", [*get_args(Action), "pump_exchanged"])
def test_every_action_and_cause_has_words(action: str) -> None:
    for cause in CAUSES:
        (sentence,) = said(resolved_by={"state": cause.value, "action": action, "at": "2026-06-01T08:00:00Z"})[
            "Resolved"
        ]
        assert "_" not in sentence


def test_page_and_report_say_them_as_text(client: TestClient, worn_records: list[DemoRecord]) -> None:
    for record in worn_records[:10]:
        client.post("/api/v1/records", content=record.content, headers={"content-type": "text/csv"})
    serial = worn_records[0].pump.serial
    with client.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
        newest = session.scalars(select(StoredAssessment).order_by(StoredAssessment.at.desc())).first()
        assert newest is not None
        newest.verdict = {**newest.verdict, **SAYS}
    end = (worn_records[9].started_at + timedelta(days=1)).isoformat()
    wanted = {"kind": "report", "parameters": {"pump": serial, "since": "2020-01-01T00:00:00Z", "until": end}}
    job = finished(client, client.post("/api/v1/jobs", json=wanted).json()["id"])
    # the chance of crossing is worked out from the trend, not read
    expected = SENTENCES | {"Limit": SENTENCES["Limit"][:1]}
    for page in (client.get(f"/pumps/{serial}").text, client.get(f"/api/v1/jobs/{job['id']}/result").text):
        assert "<b>not</b>" not in page
        plain = page.replace("&lt;", "<").replace("&gt;", ">").replace("&#39;", "'")
        for heading, sentences in expected.items():
            assert f"<dt>{heading}</dt>" in plain
            assert all(f"<dd>{sentence}</dd>" in plain for sentence in sentences)


def test_the_command_line_says_them(capsys: pytest.CaptureFixture[str]) -> None:
    from rich.console import Console

    answer = {"serial": "P-1", "verdict": {**verdict_of(), **SAYS}, "files": []}
    show_pump(answer, Console(width=400))
    printed = capsys.readouterr().out
    for heading, sentences in SENTENCES.items():
        assert all(f"{heading}: {sentence}." in printed for sentence in sentences)
