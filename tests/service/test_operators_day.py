"""docs/api.md is true: every command in it is run in a real shell and says what is written there."""

import shutil
from pathlib import Path

import pytest

from tests.operators_day import DOCUMENT, normalised, outputs, rewritten, steps


@pytest.mark.study
def test_every_command_of_the_document_says_what_is_written(tmp_path: Path) -> None:
    missing = [program for program in ("bash", "curl", "jq") if shutil.which(program) is None]
    if missing:
        pytest.fail(f"docs/api.md needs {', '.join(missing)}: install the packages of these names")
    text = DOCUMENT.read_text(encoding="utf-8")
    folder = tmp_path / "day"
    folder.mkdir()
    blocks = steps(text)
    flat = [step for block in blocks for step in block]
    assert len(flat) > 30
    for step, said in zip(flat, outputs(blocks, folder), strict=True):
        assert said == step.output, f"$ {step.command}\nrefresh with: python tests/operators_day.py --write"


def test_placeholders_hide_what_differs_between_runs_and_nothing_else() -> None:
    said = (
        'key cd_abcdefghijklmnopqrstuvwxyz at http://127.0.0.1:4711 {"id": "0123456789abcdef0123456789abcdef", '
        '"recorded_at": "2026-05-02T07:11:00.123456Z", "at": "2026-05-02T07:11:00Z", "value": 0.912345, "n": 42}\n'
    )
    assert normalised(said, Path("/nowhere"), 4711) == (
        'key cd_… at http://127.0.0.1:8000 {"id": "<id>", '
        '"recorded_at": "<now>", "at": "2026-05-02T07:11:00Z", "value": 0.912, "n": 42}\n'
    )


def test_rewriting_with_the_outputs_that_are_there_changes_nothing() -> None:
    text = "Words.\n\n```console\n$ one \\\n>   two\nsaid\n$ three\n```\n\n```json\n{}\n```\n"
    (block,) = steps(text)
    assert [s.command for s in block] == ["one \\\n  two", "three"]
    assert rewritten(text, [s.output for s in block]) == text
