"""What ``casedrain evaluate`` does: check what was asked, run with progress, write page and numbers."""

import json
import os
import tempfile
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from service.studies.evaluation.numbers import study_json
from service.studies.evaluation.plan import Study, StudyFaultsError, chunks_of
from service.studies.evaluation.report import report_html
from service.studies.evaluation.run import Results, run, scored


@dataclass(frozen=True, slots=True)
class Outputs:
    """Where results go; without a ``resume`` folder the judged chunks are thrown away."""

    json: Path | None = None
    html: Path | None = None
    resume: Path | None = None


def available_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def evaluate(study: Study, outputs: Outputs, workers: int, console: Console) -> Results:
    """Run a study and write what was asked for.

    Raises
    ------
    StudyFaultsError
        naming every place that cannot be written, before anything is computed.
    KeyboardInterrupt
        After the running chunks are kept in the resume folder.
    """
    _check(outputs)
    with ExitStack() as stack:
        folder = outputs.resume or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="casedrain-study-")))
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
        bar = stack.enter_context(
            Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console, transient=True)
        )
        n_pumps = sum(c.n_pumps for row in study.rows for c in chunks_of(row, study))
        judging = bar.add_task("pumps judged", total=n_pumps)
        run(study, folder, workers, lambda n: bar.advance(judging, n))
        scoring = bar.add_task("rows scored", total=len(study.rows))
        results = scored(study, folder, lambda: bar.advance(scoring))
    if outputs.json is not None:
        outputs.json.write_text(json.dumps(study_json(results), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    if outputs.html is not None:
        outputs.html.write_text(report_html(results), encoding="utf-8")
    return results


def _check(outputs: Outputs) -> None:
    folders = {p.parent for p in (outputs.json, outputs.html) if p is not None}
    if outputs.resume is not None:
        folders.add(outputs.resume)
    faults = []
    for folder in sorted(folders):
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as error:
            faults.append(f"{folder} cannot be written: {error.strerror}")
    if faults:
        raise StudyFaultsError(faults)
