"""Work a study off: every chunk a task of its own, in this process or in a pool of them; then score it."""

import multiprocessing
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from detectors.evaluation.reality import Reality
from detectors.evaluation.rows import Row
from detectors.evaluation.scoring import Seen, seen
from detectors.evaluation.small_steps import judged_in_class
from detectors.evaluation.study import Outcome, joined, judged
from detectors.evaluation.summary import Pooled, RowResult, pooled, row_result
from detectors.evaluation.targets import Finding, findings
from detectors.words.thresholds import effective
from detectors.words.verdict import State
from service.studies.evaluation import store
from service.studies.evaluation.forecasts import with_forecasts
from service.studies.evaluation.plan import Chunk, Study, chunks_of
from twin.pumps import circuit_parameters, pump_type


@dataclass(frozen=True)
class Results:
    """A study with all that it found."""

    study: Study
    rows: tuple[RowResult, ...]
    pools: tuple[Pooled, ...]
    findings: tuple[Finding, ...]


def run(study: Study, folder: Path, workers: int, done: Callable[[int], None]) -> None:
    """Judge every chunk that ``folder`` does not hold yet.

    Parameters
    ----------
    done
        Told the pumps of each chunk that is there.

    Raises
    ------
    KeyboardInterrupt
        After the chunks that were running are kept: the same study goes on from there.
    """
    waiting = []
    for chunk in (c for row in study.rows for c in chunks_of(row, study)):
        if store.is_kept(folder, chunk):
            done(chunk.n_pumps)
        else:
            waiting.append(chunk)
    if workers == 1:
        for chunk in waiting:
            judge_chunk(chunk, folder)
            done(chunk.n_pumps)
        return
    # not forked from this process: it has threads and a database driver
    context = multiprocessing.get_context("forkserver")
    with ProcessPoolExecutor(min(workers, max(len(waiting), 1)), context, initializer=_quiet) as pool:
        tasks = {pool.submit(judge_chunk, chunk, folder): chunk for chunk in waiting}
        try:
            for task in as_completed(tasks):
                task.result()
                done(tasks[task].n_pumps)
        except BaseException:
            pool.shutdown(wait=True, cancel_futures=True)
            raise


def scored(study: Study, folder: Path, done: Callable[[], None]) -> Results:
    """Score a study whose chunks are all there; ``done`` is told of each row."""
    healthy: dict[tuple[bool, bool], Seen] = {}
    rows = []
    # healthy pumps first: the ROC of every other row needs them
    for row in sorted(study.rows, key=lambda r: not r.by_records):
        outcomes = _outcomes(row, study, folder)
        sensing = (row.sensing.burst, row.sensing.ground_runs is not None)
        if row.by_records and row.truth is State.HEALTHY:
            healthy[sensing] = seen(row, joined(list(outcomes.values())))
        rows.append(row_result(row, outcomes, healthy.get(sensing), study.seed))
        done()
    pools = tuple(p for p in (pooled(rows, study.seed, burst=burst) for burst in (False, True)) if p is not None)
    return Results(study, tuple(rows), pools, tuple(findings(rows, pools)))


def _outcomes(row: Row, study: Study, folder: Path) -> dict[Reality, Outcome]:
    parts: dict[Reality, list[Outcome]] = {}
    for chunk, outcome in _read(row, study, folder):
        parts.setdefault(chunk.reality, []).append(outcome)
    return {reality: joined(found) for reality, found in parts.items()}


def _read(row: Row, study: Study, folder: Path) -> Iterator[tuple[Chunk, Outcome]]:
    for chunk in chunks_of(row, study):
        outcome = store.kept(folder, chunk)
        if outcome is None:
            raise RuntimeError(f"a result of row {row.name!r} has gone from {folder}; run the study again")
        yield chunk, outcome


def judge_chunk(chunk: Chunk, folder: Path) -> None:
    """Judge one chunk and keep what was found in ``folder``."""
    kind, circuit = pump_type(chunk.pump_type), circuit_parameters(chunk.circuit)
    judge = judged_in_class if chunk.row.in_class else judged
    outcome = judge(
        chunk.row, chunk.reality, kind, circuit, effective({}, kind), chunk.seed, chunk.number, chunk.n_pumps
    )
    if chunk.row.limit is not None:
        outcome = with_forecasts(outcome, chunk.row.limit)
    store.keep(folder, chunk, outcome)


def _quiet() -> None:
    """Ctrl-C reaches the whole group; only the process that started the pool answers it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
