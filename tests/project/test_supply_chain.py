"""The audit of dependencies says what it found, and that it found nobody to ask; the bill of materials is whole."""

import json

import pytest

from tests.supply_chain import GOOD, SKIPPED, WRONG, declared, judged, missing_of

KNOWN = {"name": "a", "version": "1", "vulns": []}
BAD = {"name": "b", "version": "2", "vulns": [{"id": "X-1", "fix_versions": ["3"]}]}
UNKNOWN = {"name": "c", "skip_reason": "not found"}


@pytest.mark.parametrize(
    ("packages", "status", "words"),
    [
        ([KNOWN, KNOWN, UNKNOWN], GOOD, "2 of 3"),
        ([KNOWN, BAD], WRONG, "b 2: X-1"),
        ([UNKNOWN, UNKNOWN, BAD], WRONG, "mended in 3"),
        ([UNKNOWN, UNKNOWN, KNOWN], SKIPPED, "2 of 3"),
    ],
)
def test_audits_are_judged(packages: list[object], status: int, words: str) -> None:
    found, sentence = judged(json.dumps({"dependencies": packages}))
    assert found == status
    assert words in sentence


def test_an_answer_that_is_none_is_no_audit() -> None:
    assert judged("")[0] == judged("[]")[0] == judged("<html>")[0] == SKIPPED


def test_a_bill_that_lacks_something_is_not_whole() -> None:
    names = declared()
    assert {"authlib", "fastapi", "psycopg", "salib"} <= set(names)
    whole = {"components": [{"name": name.replace("-", "_"), "version": "1"} for name in names]}
    assert missing_of(whole, names) == []
    whole["components"][0].pop("version")
    assert missing_of(whole, names) == [names[0]]
