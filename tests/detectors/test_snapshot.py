"""A fold that was put aside and taken up again goes on to the last bit as if it had never stopped."""

from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from detectors.evaluation.reality import REALITIES, fleet
from detectors.evaluation.rows import LEAKS, Growing
from detectors.evaluation.sensing import Sensing, histories
from detectors.judgement.assessment import Fold, assess
from detectors.judgement.snapshot import fold_from, snapshot
from detectors.words.flights import outline_of, roles_of
from detectors.words.observation import ACTIONS, History, Maintenance, Observation
from detectors.words.thresholds import effective
from tests.detectors.fleet import CIRCUIT, FAULTS, PUMP, history

THRESHOLDS = effective({})
N = 90
"""More than the longest stretch that filters are fitted to anew (64 records)."""


def in_order(seen: History) -> list[Observation]:
    return sorted(seen.observations, key=lambda o: (o.at, o.record_id))


def with_bursts(seen: History) -> History:
    """Every third flight's spectrum in a segment of its own, an hour after the main record."""
    found: list[Observation] = []
    for i, o in enumerate(seen.observations):
        if i % 3 or o.reduction.spectrum is None:
            found.append(o)
            continue
        found.append(replace(o, reduction=replace(o.reduction, spectrum=None)))
        burst = replace(o.reduction, windows=())
        later = o.at + timedelta(hours=1)
        found.append(replace(o, record_id=f"{o.record_id}-b", at=later, segment="burst-1", reduction=burst))
    return replace(seen, observations=tuple(found))


def fast(seed: int) -> History:
    rng = np.random.default_rng(seed)
    flights = fleet(REALITIES[0], PUMP, CIRCUIT, rng, 1, N, Growing(LEAKS, 0.6).courses(1, N, 0))
    return with_bursts(histories(flights, PUMP, Sensing(burst=True), rng)[0])


slow = st.builds(
    lambda seed, fault, zero, reservoir: history(seed, N, FAULTS[fault], with_zero=zero, with_reservoir=reservoir),
    st.integers(0, 99),
    st.sampled_from(sorted(FAULTS)),
    st.booleans(),
    st.booleans(),
)
events = st.lists(st.tuples(st.integers(1, N - 1), st.sampled_from(ACTIONS)), max_size=2)
moves = st.none() | st.integers(1, N - 1)


@settings(max_examples=6, deadline=None, derandomize=True, database=None)
@given(
    seen=slow | st.builds(fast, st.integers(0, 9)),
    events=events,
    moved=moves,
    cuts=st.sets(st.integers(1, N - 1), min_size=3, max_size=3),
)
def test_a_fold_goes_on_as_if_it_had_never_stopped(
    seen: History, events: list[tuple[int, str]], moved: int | None, cuts: set[int]
) -> None:
    observations = in_order(seen)
    # half an hour before a flight: also between a main record and its burst
    done = tuple(
        Maintenance(observations[i].at - timedelta(minutes=30), action) for i, action in events if i < len(observations)
    )
    installed = () if moved is None or moved >= len(observations) else (observations[moved].at,)
    seen = History(tuple(observations), done, installed)
    expected = assess(seen, PUMP, CIRCUIT, THRESHOLDS)
    roles = roles_of([outline_of(o) for o in observations])
    fold = Fold(PUMP, CIRCUIT, THRESHOLDS)
    wanted = {cut for cut in cuts if cut < len(observations)} | {len(observations)}
    steps = enumerate(fold.continued(observations, roles, seen), 1)
    kept = {n: snapshot(fold) for n, _ in steps if n in wanted}
    for cut in wanted - {len(observations)}:
        later = observations[cut:]
        named = {o.record_id for o in later}
        mains = {roles.adds_to[i] for i in named if i in roles.adds_to} - named
        earlier = [o for o in observations if o.record_id in mains]
        resumed = fold_from(kept[cut], PUMP, CIRCUIT, THRESHOLDS)
        assert snapshot(resumed) == kept[cut]
        assert tuple(resumed.continued(later, roles, seen, earlier)) == expected[cut:]
        assert snapshot(resumed) == kept[len(observations)]


def test_bursts_do_take_part() -> None:
    observations = in_order(fast(1))
    roles = roles_of([outline_of(o) for o in observations])
    assert len(roles.adds_to) > 10
    plain = tuple(o for o in observations if o.record_id not in roles.adds_to)
    both = assess(History(tuple(observations)), PUMP, CIRCUIT, THRESHOLDS)
    assert both[-1].verdict.probabilities != assess(History(plain), PUMP, CIRCUIT, THRESHOLDS)[-1].verdict.probabilities


def test_a_burst_behind_a_reset_adds_nothing() -> None:
    """The setting is adjusted between a flight's main record and its burst: what the lines belong to is forgotten."""
    observations = in_order(fast(1))[:40]
    burst = next(i for i, o in enumerate(observations) if o.segment is not None and i > 20)
    adjusted = Maintenance(observations[burst].at - timedelta(minutes=1), "setting_adjusted")
    without = tuple(o for i, o in enumerate(observations) if i != burst)
    found = assess(History(tuple(observations), (adjusted,)), PUMP, CIRCUIT, THRESHOLDS)
    expected = assess(History(without, (adjusted,)), PUMP, CIRCUIT, THRESHOLDS)
    assert found[-1].verdict == expected[-1].verdict


def test_damaged_bytes_are_refused() -> None:
    observations = in_order(history(1, 12))
    fold = Fold(PUMP, CIRCUIT, THRESHOLDS)
    for _ in fold.continued(observations, roles_of([outline_of(o) for o in observations]), History(())):
        pass
    good = snapshot(fold)
    assert len(good) < 300_000
    flipped = [good[:i] + bytes([good[i] ^ 1]) + good[i + 1 :] for i in range(0, len(good), len(good) // 40)]
    for damaged in (b"", good[:10], good[:-1], good + b"x", *flipped):
        with pytest.raises(ValueError, match="snapshot"):
            fold_from(damaged, PUMP, CIRCUIT, THRESHOLDS)
