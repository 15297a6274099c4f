"""One row of a study: a fleet with a fault in a reality, judged pump by pump, kept as plain arrays."""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from detectors.assessment import assess
from detectors.evaluation.reality import Course, Reality, fleet
from detectors.evaluation.sensing import Sensing, histories
from detectors.verdict import ESTIMATES, FAULTS, Assessment, State
from twin.parameters import Circuit, PumpType

Array = NDArray[np.float64]
STATES: tuple[State, ...] = tuple(State)
_STATE_NUMBER = {s: i for i, s in enumerate(STATES)}
_CHUNK = 20
LEAKS = ("slippers", "slippers", "three slippers", "three pistons", "port plate", "port plate", "slippers", "slippers")


@dataclass(frozen=True, slots=True)
class Row:
    """What one row of a study simulates.

    ``course`` gives the faults of one chunk of pumps from its number: (generator, pumps, flights, chunk) -> courses.
    ``truth`` is the state that is right at the end (``healthy`` without a fault).
    """

    name: str
    truth: State
    n_flights: int = 200
    course: Callable[[np.random.Generator, int, int, int], tuple[Course, ...]] = lambda *_: ()
    sensing: Sensing = field(default_factory=Sensing)
    worn: bool = False


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
        Healthy and ``FAULTS``, shape (n_pumps, n_records, 6).
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


def chunks(n_pumps: int) -> list[tuple[int, int]]:
    """(number, pumps) of each chunk that a row of ``n_pumps`` is worked off in."""
    return [(k, min(_CHUNK, n_pumps - k * _CHUNK)) for k in range(-(-n_pumps // _CHUNK))]


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
    courses = row.course(rng, n_pumps, row.n_flights, chunk)
    flights = fleet(reality, pump, circuit, rng, n_pumps, row.n_flights, courses, worn=row.worn)
    found = [assess(h, pump, circuit, thresholds) for h in histories(flights, pump, row.sensing, rng)]
    longest = max(len(f) for f in found)
    outcome = Outcome(
        flight=np.full((n_pumps, longest), -1),
        state=np.full((n_pumps, longest), -1),
        candidates=np.zeros((n_pumps, longest), dtype=np.int64),
        probabilities=np.full((n_pumps, longest, 1 + len(FAULTS)), np.nan),
        estimates=np.full((n_pumps, longest, len(ESTIMATES), 3), np.nan),
        size=np.full((n_pumps, longest), np.nan),
        leakage=np.full((n_pumps, longest), np.nan),
        case_flow=np.full((n_pumps, longest), np.nan),
    )
    size = courses[0].size if courses else np.zeros(flights.discharge.shape)
    for i, assessments in enumerate(found):
        for j, assessment in enumerate(assessments):
            _write(outcome, i, j, assessment)
            f = outcome.flight[i, j]
            outcome.size[i, j], outcome.leakage[i, j] = size[i, f], flights.leakage[i, f]
            outcome.case_flow[i, j] = flights.case_flow_at_reference[i, f]
    return outcome


def _write(outcome: Outcome, i: int, j: int, assessment: Assessment) -> None:
    verdict = assessment.verdict
    outcome.flight[i, j] = int(assessment.record_id)
    outcome.state[i, j] = _STATE_NUMBER[verdict.state]
    outcome.candidates[i, j] = sum(1 << FAULTS.index(c) for c in verdict.candidates)
    outcome.probabilities[i, j] = [verdict.probabilities[s] for s in (State.HEALTHY, *FAULTS)]
    for k, name in enumerate(ESTIMATES):
        e = verdict.estimates.get(name)
        if e is not None:
            outcome.estimates[i, j, k] = (e.mean, e.low, e.high)


# courses


def growing(
    kinds: tuple[str, ...], amount: float, flights: int = 150, start: int = 40
) -> Callable[..., tuple[Course, ...]]:
    """A fault that grows linearly to ``amount`` over ``flights`` from ``start``; kinds take turns over the chunks."""

    def course(_rng: np.random.Generator, n: int, m: int, chunk: int) -> tuple[Course, ...]:
        size = amount * np.clip((np.arange(m) - start) / flights, 0.0, 1.0)
        return (Course(kinds[chunk % len(kinds)], np.tile(size, (n, 1))),)

    return course


def stepping(kinds: tuple[str, ...], amount: float, start: int = 40) -> Callable[..., tuple[Course, ...]]:
    """A fault that is there from flight ``start`` on."""

    def course(_rng: np.random.Generator, n: int, m: int, chunk: int) -> tuple[Course, ...]:
        size = amount * (np.arange(m) >= start)
        return (Course(kinds[chunk % len(kinds)], np.tile(size, (n, 1))),)

    return course


def both(*faults: tuple[str, float], flights: int = 150, start: int = 40) -> Callable[..., tuple[Course, ...]]:
    """Faults that grow side by side."""

    def course(rng: np.random.Generator, n: int, m: int, chunk: int) -> tuple[Course, ...]:
        return tuple(growing((kind,), amount, flights, start)(rng, n, m, chunk)[0] for kind, amount in faults)

    return course


PLAIN_ROWS: tuple[Row, ...] = (
    Row("healthy", State.HEALTHY, 250),
    Row("pump leakage 0.6 L/min", State.PUMP_DEGRADATION, 200, growing(LEAKS, 0.6)),
    Row("uneven wear", State.PUMP_DEGRADATION, 200, growing(("three pistons", "one slipper"), 0.15)),
    Row("system leakage 3 L/min", State.SYSTEM_LEAKAGE, 200, growing(("system",), 3.0)),
    Row("drain +30 %", State.DRAIN_RESTRICTION, 120, stepping(("drain",), 0.3)),
    Row("setting 1.5 bar", State.COMPENSATOR_FAULT, 200, growing(("setting",), -1.5)),
    Row("setting 3 bar", State.COMPENSATOR_FAULT, 200, growing(("setting",), -3.0)),
    Row("edge radius x10", State.COMPENSATOR_FAULT, 200, growing(("erosion",), 45.0)),
    Row("case zero +0.06 bar", State.SENSOR_FAULT, 120, sensing=Sensing(case_zero_step=0.06, step_at=40)),
    Row(
        "case zero +0.06 bar, zero not measured",
        State.SENSOR_FAULT,
        120,
        sensing=Sensing(case_zero_step=0.06, step_at=40, zero_measured=False),
    ),
    Row("reservoir not measured", State.HEALTHY, 120, sensing=Sensing(reservoir_measured=False)),
    Row("worn on arrival", State.PUMP_DEGRADATION, 30, worn=True),
    Row("two faults: pump 0.6, system 1 L/min", State.PUMP_DEGRADATION, 200, both(("slippers", 0.6), ("system", 1.0))),
    Row(
        "two faults: drain +30 %, setting 3 bar", State.COMPENSATOR_FAULT, 200, both(("setting", -3.0), ("drain", 0.3))
    ),
)
ROWS: tuple[Row, ...] = (
    *PLAIN_ROWS,
    *(replace(r, name=f"{r.name}; burst", sensing=replace(r.sensing, burst=True)) for r in PLAIN_ROWS),
)
"""With one 1 Hz zero-flow window a flight, and with a burst in it."""
