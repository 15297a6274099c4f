"""``docs/nomenclature.md`` names every quantity and word of the judge as the code has it, and nothing that is not there."""

import re
from dataclasses import fields
from datetime import UTC, datetime
from pathlib import Path

import pytest

from detectors.bank.hypotheses import FAULT_KINDS
from detectors.bank.regulation import Feature
from detectors.expectation.components import COMPONENTS
from detectors.judgement.events import freed_by
from detectors.judgement.isolation import QUANTITIES, Evidence
from detectors.words.observation import ACTIONS, Maintenance, Observation, Reduction, WindowKind
from detectors.words.states import STATES
from detectors.words.verdict import ESTIMATES, TREND_METRICS, Verdict
from service.storage.tables import ANALYSED, REFUSED, STORED, SUPERSEDED, WITHDRAWN

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "nomenclature.md").read_text(encoding="utf-8")
UNITS = {"-", "L/min", "bar", "degC", "nat", "Hz", "h", "%", "instant", "unit of the quantity", "channel's unit"}
WORDS = {
    "Regulation": tuple(f.name.lower() for f in Feature),
    "Evidence": tuple(f.name for f in fields(Evidence)),
    "Verdict": tuple(f.name for f in fields(Verdict)),
    "Windows": tuple(k.value for k in WindowKind),
    "Records": tuple(f.name for kind in (Reduction, Observation) for f in fields(kind)),
    "Status of a record": (STORED, ANALYSED, REFUSED, SUPERSEDED, WITHDRAWN),
}
"""Headings, and the names that stand under them in this order."""


def rows(heading: str) -> dict[str, list[str]]:
    """Rows under a heading: name to the cells beside it."""
    found = re.search(rf"^### {heading}$(.*?)(?=^##|\Z)", PAGE, re.M | re.S)
    assert found is not None, heading
    cells = [line.strip("| ").split(" | ") for line in found[1].splitlines() if line.startswith("| `")]
    table = {name.strip("`"): rest for name, *rest in cells}
    assert len(table) == len(cells), heading
    return table


@pytest.mark.parametrize("heading", WORDS)
def test_every_name_stands_there_and_says_something(heading: str) -> None:
    table = rows(heading)
    assert tuple(table) == WORDS[heading]
    assert all(len(cells[0]) > 3 for cells in table.values())
    assert {cells[1] for cells in table.values() if len(cells) > 1} <= UNITS


def test_every_component_of_the_state_has_a_meaning_and_a_unit() -> None:
    table = rows("State components")
    assert tuple(table) == COMPONENTS
    for name, (meaning, unit) in table.items():
        assert len(meaning) > 3, name
        assert unit in UNITS, name
        assert unit == "-" or not name.startswith("ln_"), f"{name} is a logarithm"


def test_components_of_one_estimate_are_counted_in_its_unit() -> None:
    """A share is shown in percent."""
    table = rows("State components")
    for quantity, names in QUANTITIES.items():
        assert {table[name][1].replace("-", "%") for name in names} == {ESTIMATES[quantity]}, quantity


def test_every_kind_of_fault_stands_there_with_what_it_moves() -> None:
    units = {name: cells[1] for name, cells in rows("State components").items()}
    expected = {
        kind.name: [
            kind.state.value,
            ", ".join(name for name, _ in kind.moves) or "nothing",
            units.get(kind.component, "-"),
        ]
        for kind in FAULT_KINDS
    }
    assert list(rows("Kinds of fault").items()) == list(expected.items())


def test_every_state_stands_there_with_its_side_and_word() -> None:
    expected = {state.value: [row.side.value, row.word] for state, row in STATES.items()}
    assert list(rows("States").items()) == list(expected.items())


def test_every_metric_stands_there_with_its_unit() -> None:
    table = rows("Trend metrics")
    assert [(name, cells[1]) for name, cells in table.items()] == list(TREND_METRICS.items())


def test_every_action_stands_there_with_what_it_resets() -> None:
    at = datetime(2026, 5, 2, tzinfo=UTC)
    expected = {action: [", ".join(freed_by(Maintenance(at, action)))] for action in ACTIONS}
    assert list(rows("Maintenance").items()) == list(expected.items())
