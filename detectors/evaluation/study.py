"""One chunk of a row of a study: pumps with a fault in a reality, judged one by one, kept as plain arrays."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from detectors.evaluation.reality import Reality, fleet
from detectors.evaluation.rows import Row
from detectors.evaluation.sensing import histories
from detectors.evaluation.truth import is_worth_a_word
from detectors.judgement.assessment import assess
from detectors.words.states import CAUSES, VERDICTS
from detectors.words.verdict import ESTIMATES, FAULTS, Assessment, State
from twin.parameters import Circuit, PumpType

Array = NDArray[np.float64]
STATES: tuple[State, ...] = VERDICTS
NAMES: tuple[State, ...] = CAUSES
"""What probabilities are stated of, in their order."""
_STATE_NUMBER = {s: i for i, s in enumerate(STATES)}
_ROUND = 8
"""A whole round of the kinds that take turns over chunks: shares stay right for any number of pumps."""
_LARGEST = 10
"""Rounds of pumps that one process judges at once (estimate: large enough to start for, small enough to share out)."""
_PADDING = {"flight": -1, "state": -1, "candidates": 0, "faulty": False}
"""What stands where a pump has no record."""


@dataclass(frozen=True)
class Outcome:
    """What the judge said of one chunk of pumps, padded with -1 or NaN behind a pump's last record.

    Attributes
    ----------
    flight
        Flight number of each record, shape (n_pumps, n_records).
    state
        Index into ``STATES``.
    candidates
        Bit i set for ``FAULTS[i]``.
    probabilities
        Of ``CAUSES``, shape (n_pumps, n_records, 7).
    estimates
        Mean, low and high of ``ESTIMATES``, shape (n_pumps, n_records, 5, 3).
    size, leakage, case_flow
        The truth: size of the first fault, leakage it added, and case flow at the reference.
    """

    flight: NDArray[np.int64]
    state: NDArray[np.int64]
    candidates: NDArray[np.int64]
    probabilities: Array
    estimates: Array
    size: Array
    leakage: Array
    case_flow: Array
    faulty: NDArray[np.bool_]
    """The true change since the installation exceeds its own floor: it is worth a word."""
    information: Array
    """What the record adds to tell the fault from health, after what is unknown is projected out [nat]; NaN where the
    world is not the judge's own."""
    forecast: Array
    """Remaining flight hours: median and ends of the 80 % interval, shape (n_pumps, n_records, 3); NaN where none was asked
    or given."""


def state_number(state: State) -> int:
    """Index into ``STATES``."""
    return _STATE_NUMBER[state]


def chunks(n_pumps: int) -> list[tuple[int, int]]:
    """(number, pumps) of each chunk that a row of ``n_pumps`` is worked off in: whole rounds of nearly equal ones."""
    n = min(n_pumps, _ROUND * -(-n_pumps // (_ROUND * _LARGEST)))
    return [(k, n_pumps // n + (k < n_pumps % n)) for k in range(n)]


def seed_of(study_seed: int, *names: str | int) -> np.random.Generator:
    """Generator that depends on nothing but the study's seed and the names of what is drawn."""
    text = "/".join(str(n) for n in (study_seed, *names))
    return np.random.default_rng(int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big"))


def judged(
    row: Row,
    reality: Reality,
    pump: PumpType,
    circuit: Circuit,
    thresholds: Mapping[str, float],
    seed: int,
    chunk: int,
    n_pumps: int,
) -> Outcome:
    """Simulate and judge one chunk."""
    rng = seed_of(seed, row.name, reality.name, chunk)
    courses = row.course.courses(n_pumps, row.n_flights, chunk)
    flights = fleet(reality, pump, circuit, rng, n_pumps, row.n_flights, courses, worn=row.worn, moved_at=row.moved_at)
    seen = histories(flights, pump, row.sensing, rng, row.moved_at)
    found = [assess(h, pump, circuit, thresholds) for h in seen]
    outcome = blank(n_pumps, max(len(f) for f in found))
    size, leakage = courses[0].size if courses else np.zeros(flights.discharge.shape), flights.leakage
    faulty = is_worth_a_word(row, courses, n_pumps, thresholds["sensor_shift_bar"])
    for i, assessments in enumerate(found):
        for j, assessment in enumerate(assessments):
            _write(outcome, i, j, assessment)
            f = outcome.flight[i, j]
            outcome.size[i, j], outcome.leakage[i, j] = size[i, f], leakage[i, f]
            outcome.case_flow[i, j] = flights.case_flow_at_reference[i, f]
            outcome.faulty[i, j] = faulty[i, f]
    return outcome


def blank(n_pumps: int, longest: int) -> Outcome:
    """Nothing said and nothing true yet."""
    return Outcome(
        flight=np.full((n_pumps, longest), -1),
        state=np.full((n_pumps, longest), -1),
        candidates=np.zeros((n_pumps, longest), dtype=np.int64),
        probabilities=np.full((n_pumps, longest, len(CAUSES)), np.nan),
        estimates=np.full((n_pumps, longest, len(ESTIMATES), 3), np.nan),
        size=np.full((n_pumps, longest), np.nan),
        leakage=np.full((n_pumps, longest), np.nan),
        case_flow=np.full((n_pumps, longest), np.nan),
        faulty=np.zeros((n_pumps, longest), dtype=np.bool_),
        information=np.full((n_pumps, longest), np.nan),
        forecast=np.full((n_pumps, longest, 3), np.nan),
    )


def _write(outcome: Outcome, i: int, j: int, assessment: Assessment) -> None:
    verdict = assessment.verdict
    outcome.flight[i, j] = int(assessment.record_id)
    outcome.state[i, j] = state_number(verdict.state)
    outcome.candidates[i, j] = sum(1 << FAULTS.index(c) for c in verdict.candidates if c in FAULTS)
    outcome.probabilities[i, j] = [verdict.probabilities[s] for s in NAMES]
    for k, name in enumerate(ESTIMATES):
        e = verdict.estimates.get(name)
        if e is not None:
            outcome.estimates[i, j, k] = (e.mean, e.low, e.high)


def joined(outcomes: Sequence[Outcome]) -> Outcome:
    """Pumps of several chunks below each other, padded to the longest.

    Raises
    ------
    ValueError
        Without an outcome.
    """
    if not outcomes:
        raise ValueError("outcomes are missing; at least one is needed")
    longest = max(o.flight.shape[1] for o in outcomes)
    arrays = {}
    for f in fields(Outcome):
        parts = [getattr(o, f.name) for o in outcomes]
        fill = _PADDING.get(f.name, np.nan)
        arrays[f.name] = np.concatenate(
            [
                np.pad(a, [(0, 0), (0, longest - a.shape[1]), *[(0, 0)] * (a.ndim - 2)], constant_values=fill)
                for a in parts
            ]
        )
    return Outcome(**arrays)
