"""Sentences of the judge in psi, US gpm and °F: every number that carries a unit is converted, and nothing else."""

import ast
import re
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from fractions import Fraction
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from detectors.judgement.coverage import Coverage
from detectors.judgement.wording import Said, advice, beyond_case_limit
from detectors.words.states import CAUSES, State
from detectors.words.verdict import BlindSpot, CasePressure, Estimate, Intermittent, MissingEvidence
from service.reports.sentences import in_units
from service.units import METRIC, US
from tests.service.test_reader_units import EXACT

ROOT = Path(__file__).parents[2]
SPEAKING = (
    *sorted((ROOT / "detectors/judgement").glob("*.py")),
    *sorted((ROOT / "detectors/reduction").glob("*.py")),
    ROOT / "detectors/words/thresholds.py",
    ROOT / "detectors/isolability/bounds.py",
    ROOT / "service/ingest/doubts.py",
    ROOT / "service/reading/forecast.py",
)
"""Where sentences are written that a verdict, a record or a forecast keeps."""
OURS = r"bar|L/min|degC|K"
MEASURED = re.compile(rf"([+-]?\d[\d.e+-]*) ({OURS})(?![\w/^])")
WORDS = {"bar": "psi", "L/min": "gpm", "degC": "°F", "K": "°F"}


def shown(value: str, unit: str) -> Fraction:
    """A number of ours in the other unit, exactly."""
    slope, intercept = EXACT[unit]
    return (Fraction(value) - intercept) / slope


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [
        (
            "Fly on: case flow at the reference condition is estimated at 0.71 L/min (0.62 to 0.80, limit 1.5).",
            "Fly on: case flow at the reference condition is estimated at 0.188 gpm (0.164 to 0.211, limit 0.3963).",
        ),
        (
            "Plan the replacement of the pump: its internal leakage has grown by 0.41 L/min (0.33 to 0.49); case flow",
            "Plan the replacement of the pump: its internal leakage has grown by 0.108 gpm (0.087 to 0.129); case flow",
        ),
        ("the regulated pressure has moved by -4.0 bar.", "the regulated pressure has moved by -58 psi."),
        ("the regulated pressure has moved by +4.0 bar.", "the regulated pressure has moved by +58 psi."),
        ("valves leak about 2.0 L/min (1.5 to 2.5) more", "valves leak about 0.53 gpm (0.40 to 0.66) more"),
        ("Healthy as far as leakage above 0.6 L/min goes (x)", "Healthy as far as leakage above 0.16 gpm goes (x)"),
        ("The windows span -10 to 60 degC already;", "The windows span 14 to 140 °F already;"),
        ("limit of case flow at zero flow, 60 degC", "limit of case flow at zero flow, 140 °F"),
        ("all windows lie within 20 K: alike", "all windows lie within 36 °F: alike"),
        ("different fluid temperatures (20 K apart)", "different fluid temperatures (36 °F apart)"),
        (
            "the case stands 4.2 bar over the reservoir (this pump's reference 0.9 bar, limit 3.5 bar).",
            "the case stands 61 psi over the reservoir (this pump's reference 13 psi, limit 50.76 psi).",
        ),
        ("mean of case pressure varies by 0.123 bar; limit 0.050 bar", "mean of case pressure varies by 1.78 psi; limit 0.7252 psi"),
        ("temperature drifts 5.0 K over the stretch; limit 2.0 K", "temperature drifts 9.0 °F over the stretch; limit 3.6 °F"),
        ("it stands at its full scale of 5 bar, and", "it stands at its full scale of 72.52 psi, and"),
        ("has not risen with it (-0.3 bar)", "has not risen with it (-4 psi)"),
        (
            "reads +0.02 bar over the reservoir where a running pump makes 0.31 bar",
            "reads +0.3 psi over the reservoir where a running pump makes 4.5 psi",
        ),
        ("ground runs at zero, 10 and 20 L/min with the flow", "ground runs at zero, 2.6 and 5.3 gpm with the flow"),
        ("the level, 1.62 L/min, is already above the limit, 1.5 L/min", "the level, 0.428 gpm, is already above the limit, 0.3963 gpm"),
    ],
)  # fmt: skip
def test_numbers_are_said_in_the_readers_unit(ours: str, theirs: str) -> None:
    assert in_units(ours, US) == theirs
    assert in_units(ours, METRIC) == ours
    assert in_units(theirs, US) == theirs


@pytest.mark.parametrize(
    "text",
    [
        "it showed on 9 of 20 flights since 02 May 2026.",
        "Keep recording: 3 more flights with a zero-flow window are needed for a baseline.",
        "its resistance has grown by 40 % (30 to 51 %).",
        "bursts of two seconds at 10 kHz in the zero-flow window",
        "speed moves by 3.1 %; limit 2 %",
        "no steady zero-flow window: the longest candidate, 52 to 131 s, was rejected because it lasts 79 s",
        "the pump never reaches 4140 rpm (fastest 3900 rpm)",
        "50 flight hours, 12 records, within 50 flight hours",
        # names are not ours
        "pump 12 bar looks like this one: the same pump twice?",
        "records say F-1 bar LH, the registered installation says 7 K RH",
        "on 5 K and 6 bar at the same time",
        "the samples of flight 20 L/min again: one flight counts once",
        "limit 0.5 bar/h, by 3 bar^2/Hz, about 2 L/min/bar",
        "noise of 0.5 bar/h and 3 bar^2/Hz, 2 L/min/bar",
        "case_pressure_bar holds no number at all: taken as not recorded",
    ],
)
def test_what_carries_no_unit_of_ours_stays(text: str) -> None:
    assert in_units(text, US) == text


def sentences() -> Iterator[str]:
    """Every text of the speaking modules, its placeholders filled with numbers as they are formatted, or with a word."""
    for path in SPEAKING:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        silent = {id(n.value) for n in ast.walk(tree) if isinstance(n, ast.Expr)}  # docstrings
        for node in ast.walk(tree):
            if id(node) in silent:
                continue
            if isinstance(node, ast.JoinedStr):
                yield "".join(_filled(part) for part in node.values)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                yield re.sub(r"\{[^{}]*:(\+?)\.(\d)f\}", lambda m: f"{7.4321:{m[1]}.{m[2]}f}", node.value)


def _filled(part: ast.expr) -> str:
    if isinstance(part, ast.Constant):
        return str(part.value)
    assert isinstance(part, ast.FormattedValue)
    spec = ast.unparse(part.format_spec)[2:-1] if part.format_spec is not None else ""
    return format(7.4321, spec) if re.fullmatch(r"\+?(\.\d)?[fg]", spec) else "it"


def test_every_sentence_that_the_judge_can_write_is_converted_whole() -> None:
    measured = {text for text in sentences() if MEASURED.search(text)}
    assert len(measured) > 15
    for text in measured:
        theirs = in_units(text, US)
        assert MEASURED.search(theirs) is None, text
        for (number, unit), word in zip(
            MEASURED.findall(text), re.findall(r"([+-]?[\d.]+) (psi|gpm|°F)", theirs), strict=True
        ):
            assert word[1] == WORDS[unit], text
            tolerance = 0.51 * 10.0 ** -len(word[0].partition(".")[2])
            assert float(word[0]) == pytest.approx(float(shown(number, unit)), abs=tolerance), text


FLOWS = st.floats(-9.0, 9.0).map(lambda v: round(v, 2))


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from([*(cause for cause in CAUSES if cause is not State.OTHER), State.INDETERMINATE]),
    st.tuples(FLOWS, FLOWS, FLOWS).map(sorted),
    st.booleans(),
    st.booleans(),
)
def test_no_advice_leaves_a_number_of_ours(state: State, level: list[float], blind: bool, beyond: bool) -> None:
    estimate = Estimate(level[1], level[0], level[2])
    shares: Mapping[State, float] = {s: 1.0 / len(CAUSES) for s in CAUSES} | {state: 0.9}
    said = Said(
        state=state,
        candidates=(State.PUMP_DEGRADATION, State.SYSTEM_LEAKAGE) if state is State.INDETERMINATE else (),
        probabilities=shares,
        values=dict.fromkeys(
            ("case_flow_at_reference_lpm", "pump_leakage_change_lpm", "system_leakage_change_lpm",
             "pressure_setting_change_bar", "drain_resistance_change_percent"), estimate),
        beyond=0.9 if beyond else 0.1,
        limit_lpm=1.5,
        missing=3,
        sensor="case_pressure_bar" if state is State.SENSOR_FAULT else None,
        blind=(BlindSpot("pump_leakage_change_lpm", 0.6, "reservoir pressure is not measured"),) if blind else (),
        intermittent=Intermittent(State.SYSTEM_LEAKAGE, 9, 20, datetime(2026, 5, 2, tzinfo=UTC)) if blind else None,
        coverage=Coverage(records=30, coldest=20.0, warmest=62.0),
        evidence=(MissingEvidence("ground runs at zero, 10 and 20 L/min", 2, (state,)),),
    )  # fmt: skip
    text = advice(said)
    if beyond:
        text = beyond_case_limit(text, CasePressure(4.2, 0.9, 3.5, True))
    theirs = in_units(text, US)
    assert MEASURED.search(theirs) is None
    # an interval goes with its number: both, or neither
    assert len(re.findall(r"gpm \([-\d.]+ to [-\d.]+", theirs)) == len(re.findall(r"L/min \([-\d.]+ to [-\d.]+", text))
    # what is counted, dated or a share stays
    for kept in (r"\d+ of \d+ flights since [^.]+", r"\d+ %", r"\d+ more would decide"):
        assert re.findall(kept, theirs) == re.findall(kept, text)
