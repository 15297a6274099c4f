"""Evaluation: a detection study on simulated fleets, worked off chunk by chunk in a process of its own."""

import json
import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from pydantic import Field
from sqlalchemy.orm import Session

from service.answers.jobs import JobResult
from service.errors import Fault, Invalid, Unavailable
from service.jobs.kinds import Item, Kind, Parameters, Work, register
from service.jobs.products import folder_of, keep
from service.studies.evaluation import store
from service.studies.evaluation.numbers import study_json
from service.studies.evaluation.plan import Chunk, Study, StudyFaultsError, chunks_of, sized
from service.studies.evaluation.report import report_html
from service.studies.evaluation.run import judge_chunk, run, scored

T = TypeVar("T")
MOST_PUMPS, MOST_HEALTHY_RECORDS = 300, 100_000
"""The size of the study that the targets ask for: about an hour of one core."""


class EvaluationParameters(Parameters):
    """Which rows, all without a name; how many pumps in each, and healthy records in each simulated reality."""

    rows: tuple[str, ...] = ()
    pumps: int = Field(default=40, ge=4, le=MOST_PUMPS)
    healthy_records: int = Field(default=10_000, ge=100, le=MOST_HEALTHY_RECORDS)
    seed: int = Field(default=1, ge=0, le=2**32 - 1)


@dataclass(frozen=True, slots=True)
class _Running:
    study: Study
    chunks: list[Chunk]
    folder: Path
    pool: ProcessPoolExecutor


@register
class Evaluation(Kind[EvaluationParameters, _Running]):
    """One item per chunk: ``judged``, or ``kept`` where its result was there; at the end the study as JSON and HTML."""

    name = "evaluation"
    role = "engineer"
    parameters = EvaluationParameters

    def prepared(
        self, _session: Session, parameters: EvaluationParameters, _operator: str | None
    ) -> EvaluationParameters:
        try:
            _study(parameters)
        except StudyFaultsError as error:
            faults = [Fault("parameters.rows", fault) for fault in error.faults]
            raise Invalid(f"the study has {len(faults)} fault(s)", faults) from None
        return parameters

    @contextmanager
    def opened(self, work: Work[EvaluationParameters]) -> Iterator[_Running]:
        study = _study(work.parameters)
        chunks = [chunk for row in study.rows for chunk in chunks_of(row, study)]
        # requests go on being answered: all computing is done by another process, which is not forked from this one
        pool = ProcessPoolExecutor(1, multiprocessing.get_context("forkserver"))
        try:
            yield _Running(study, chunks, folder_of(work), pool)
        finally:
            pool.shutdown(wait=True, cancel_futures=True)

    def total(self, _work: Work[EvaluationParameters], state: _Running) -> int:
        return len(state.chunks)

    def item(self, _work: Work[EvaluationParameters], state: _Running, position: int) -> Item:
        chunk = state.chunks[position]
        name = f"{chunk.row.name} / {chunk.reality.name} / {chunk.number + 1}"
        there = store.is_kept(state.folder, chunk)
        if not there:
            _made(state.pool, judge_chunk, chunk, state.folder)
        return Item(name, "kept" if there else "judged", {"pumps": chunk.n_pumps})

    def result(self, work: Work[EvaluationParameters], state: _Running, counts: dict[str, int]) -> JobResult:
        documents = _made(state.pool, _documents, state.study, state.folder)
        return {"counts": counts, "files": keep(work, documents)}


def _made(pool: ProcessPoolExecutor, call: Callable[..., T], *given: Any) -> T:
    """What the other process makes.

    Raises
    ------
    Unavailable
        when it was ended: a stop of all processes of a service, or memory that was short, is no end of the job.
    """
    try:
        return pool.submit(call, *given).result()
    except BrokenProcessPool:
        raise Unavailable("the process that judges was ended from outside several times within a minute") from None


def _study(parameters: EvaluationParameters) -> Study:
    return sized(parameters.rows, parameters.pumps, parameters.healthy_records, parameters.seed)


def _documents(study: Study, folder: Path) -> dict[str, str]:
    """The study by format; chunks that another worker judged, and kept on its own machine, are judged again."""
    run(study, folder, 1, lambda _n: None)
    results = scored(study, folder, lambda: None)
    return {
        "json": json.dumps(study_json(results), indent=1, allow_nan=False) + "\n",
        "html": report_html(results),
    }
