"""Sides that used to be named wrongly: what weighs alike, what a reference must hold, what cannot be that large; and histories."""

import math
from collections.abc import Iterator

import numpy as np
import pytest

from detectors.bank.hypotheses import FAULT_KINDS
from detectors.bank.kernel import GROWS_ON, wandered
from detectors.bank.prediction import CASE, N_MEASURED, N_SLOPES, predicted
from detectors.bank.shapes import (
    ARRIVAL,
    AS_STATED,
    STEP,
    WHOLE,
    Filters,
)
from detectors.bank.summary import TEMPER, _size_evidence, _weigh
from detectors.bank.tables import DIRECTIONS, KINDS, WALKS, empty_filters
from detectors.evaluation.reality import REALITIES
from detectors.evaluation.rows import ROWS, Row
from detectors.evaluation.strange import STRANGE_ROWS
from detectors.evaluation.study import Outcome, judged
from detectors.expectation.anchor import anchors
from detectors.expectation.components import AMPLITUDE, LAW, N_COMPONENTS, N_STATE, RATE
from detectors.judgement.isolation import _MEANING
from detectors.words.states import FAULTS, SIDE_OF, VERDICTS, Side, State
from detectors.words.thresholds import effective
from twin.condition import Condition
from twin.pumps import circuit_parameters, pump_type

PUMP, CIRCUIT = pump_type("h225"), circuit_parameters("shared_return")
NAMES = [k.name for k in FAULT_KINDS]
LEAK, DRAIN, BLEED = (NAMES.index(n) for n in ("leakage, slippers", "drain restriction", "bleed"))
BY_NAME = {row.name: row for row in (*ROWS, *STRANGE_ROWS)}


def case_by_size(kind: int) -> float:
    """What one sigma of a kind does to the case pressure of the nominal pump at 60 degC [bar]."""
    anchor = anchors([Condition(PUMP.nominal_speed_rpm, 60.0, 0.5)], PUMP, CIRCUIT)[0][0]
    full = np.empty(N_COMPONENTS)
    state = np.zeros(N_STATE)
    state[LAW] = KINDS.laws[kind, 0]
    y, H = np.zeros(N_MEASURED), np.empty((N_MEASURED, N_SLOPES))
    ripple, direction = np.zeros((2, N_COMPONENTS)), DIRECTIONS[kind]
    predicted(state, direction, anchor, ripple, full, y, H)
    return float(H[CASE, AMPLITUDE]) * float(KINDS.scales[kind])


@pytest.mark.parametrize("name", ["leakage, port plate", "system leakage", "drain restriction"])
def test_rivals_move_the_case_alike(name: str) -> None:
    """Within a third: who may wander less in what the sensor sees follows a slow change with less noise, record for record."""
    rival = NAMES.index(name)
    assert case_by_size(rival) == pytest.approx(case_by_size(LEAK), rel=0.3)
    wander = np.sqrt(WALKS.amplitude[STEP])
    assert wander[rival] / KINDS.scales[rival] == pytest.approx(wander[LEAK] / KINDS.scales[LEAK])


def filters_of(*rows: tuple[int, int, int, float, float]) -> Filters:
    """A healthy pump, and filters by kind, shape, onset, size and what the data say for each [nat]."""
    filters = empty_filters()
    for f, (kind, shape, onset, size, nats) in enumerate(rows, 1):
        filters.kind[f], filters.shape[f], filters.onset[f] = kind, shape, onset
        filters.mean[f, AMPLITUDE], filters.covariance[f, AMPLITUDE, AMPLITUDE] = size, 0.01**2
        filters.prior[f] = -6.0
        filters.log_evidence[f] = nats - 6.0
    return filters


def lead(onset: int, shape: int = STEP) -> float:
    """How far the tempered evidence parts a drain from a leak that the data put ten nats behind it [nat]."""
    filters = filters_of((DRAIN, shape, onset, 0.5, 40.0), (LEAK, STEP, 9, 0.5, 30.0))
    weights = np.empty((3, 3))
    _weigh(filters, 3, _MEANING, weights)
    assert weights[WHOLE, 1] / weights[WHOLE, 2] == pytest.approx(math.exp(10.0))
    return math.log(weights[AS_STATED, 1] / weights[AS_STATED, 2])


@pytest.mark.parametrize(("onset", "share"), [(0, 0.0), (1, 0.2), (4, 0.8), (5, 1.0), (60, 1.0)])
def test_what_has_no_reference_of_its_own_parts_no_causes(onset: int, share: float) -> None:
    """Behind fewer than five records a change is measured from the population's spread, and its law decides as much less."""
    assert lead(onset) == pytest.approx(10.0 * TEMPER * share)


def test_who_came_worn_needs_no_reference() -> None:
    assert lead(0, ARRIVAL) == pytest.approx(10.0 * TEMPER)


@pytest.mark.parametrize(("size", "counts"), [(0.3, True), (0.58, True), (0.7, False), (1.2, False)])
def test_nothing_bleeds_more_than_the_control_valve_lets_through(size: float, counts: bool) -> None:
    """0.6 L/min; a drain blocked tenfold behind a full sensor was once a bleed of 1.2."""
    filters = filters_of((BLEED, STEP, 9, size, 0.0), (LEAK, STEP, 9, size, 0.0))
    found = [_size_evidence(filters, f, KINDS.signs, KINDS.most) for f in (1, 2)]
    assert (found[0] > found[1] - 0.1) is counts
    assert found[1] == pytest.approx(math.log(2.0))
    if not counts:
        assert found[0] < -40.0


def test_growth_that_nothing_sustains_ends() -> None:
    """A rate of 0.06 L/min a record adds twenty times as much where nothing is measured any more, and not without end."""
    m, P = np.zeros(N_STATE), np.zeros((N_STATE, N_STATE))
    m[RATE], P[RATE, RATE] = 0.06, 0.01**2
    for _ in range(400):
        wandered(m, P, np.zeros(N_STATE), 0.0, 0.0, 0.0)
    assert m[AMPLITUDE] == pytest.approx(0.06 / (1.0 - GROWS_ON))
    assert m[RATE] == pytest.approx(0.0, abs=1.0e-9)
    # a sum of rates: its spread grows as the sum does
    assert math.sqrt(P[AMPLITUDE, AMPLITUDE]) == pytest.approx(0.01 / (1.0 - GROWS_ON))


def final(outcome: Outcome) -> Iterator[tuple[State, Side | None]]:
    """State and side of each pump's last verdict; the side is that of all its candidates, None where they differ."""
    for states, candidates in zip(outcome.state, outcome.candidates, strict=True):
        last = int(np.flatnonzero(states >= 0)[-1])
        state = VERDICTS[states[last]]
        left = [f for i, f in enumerate(FAULTS) if candidates[last] >> i & 1]
        sides = {SIDE_OF[f] for f in (left or [state]) if f in FAULTS}
        yield state, sides.pop() if len(sides) == 1 else None


def sides(row: Row, seed: int, chunks: tuple[tuple[str, int], ...]) -> list[Side | None]:
    """Sides that are said at the end, one pump for each reality and chunk."""
    realities = {r.name: r for r in REALITIES}
    return [
        side
        for name, chunk in chunks
        for _, side in final(judged(row, realities[name], PUMP, CIRCUIT, effective({}), seed, chunk, 1))
    ]


FITTINGS, GAP = "fittings drain, orifice leak", "viscous drain, laminar leak"


@pytest.mark.parametrize(
    ("row", "chunks", "wrong"),
    [
        ("drain x10 at once", ((FITTINGS, 5), (FITTINGS, 7)), Side.PUMP),
        (
            "wear of 0.6 L/min in 10 flights",
            ((GAP, 2), (FITTINGS, 0), ("fittings drain, laminar leak", 2)),
            Side.SYSTEM,
        ),
        (
            "wear of 1 L/min in flights 1 to 9",
            (("viscous drain, orifice leak", 2), ("viscous drain, orifice leak", 3)),
            Side.SYSTEM,
        ),
        ("uneven wear", ((FITTINGS, 0), (FITTINGS, 1)), Side.SYSTEM),
    ],
)
def test_histories_that_had_a_wrong_side(row: str, chunks: tuple[tuple[str, int], ...], wrong: Side) -> None:
    """Each ended on the wrong side before rivals weighed alike; none is told a wrong side now."""
    assert wrong not in sides(BY_NAME[row], 101, chunks)
