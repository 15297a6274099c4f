"""Onsets that are tried: from the first record on, and at once where a record is a surprise; what far-off records weigh."""

from dataclasses import replace

import numpy as np
import pytest

from detectors.bank.bank import FIRST_ONSETS, Bank
from detectors.bank.hypotheses import FAULT_KINDS, GONE, OTHER
from detectors.bank.measurement import measured_windows
from detectors.bank.prediction import CASE, DISCHARGE, ZERO
from detectors.bank.shapes import STEP
from detectors.bank.tables import DISCREPANCY
from detectors.bank.window import Measurement
from detectors.judgement.assessment import Fold
from detectors.words.flights import outline_of, roles_of
from detectors.words.observation import History
from detectors.words.thresholds import effective
from tests.detectors.fleet import CIRCUIT, PUMP, history

FOUND = history(5, 20).observations
DRAIN = [k.name for k in FAULT_KINDS].index("drain restriction")


def measurements() -> list[tuple[Measurement, ...]]:
    found = measured_windows(list(FOUND), {}, PUMP, CIRCUIT)
    return [found[o.record_id].measurements for o in FOUND]


def onsets(bank: Bank, kind: int) -> set[int]:
    filters, n = bank.filters, bank.n
    return set(filters.onset[:n][(filters.kind[:n] == kind) & (filters.shape[:n] == STEP)].tolist())


def test_what_sets_in_at_the_beginning_is_tried() -> None:
    """After the first and the second record, and after every fourth."""
    fold = Fold(PUMP, CIRCUIT, effective({}))
    observations = list(FOUND[:9])
    list(fold.continued(observations, roles_of([outline_of(o) for o in observations]), History(())))
    assert set(FIRST_ONSETS) == {1, 2}
    assert onsets(fold.bank, DRAIN) == {1, 2, 4, 8}


def off(measurement: tuple[Measurement, ...], case_bar: float) -> tuple[Measurement, ...]:
    *rest, last = measurement
    values = last.values.copy()
    values[CASE] += case_bar
    return (*rest, replace(last, values=values))


@pytest.mark.parametrize(("case_bar", "surprises"), [(0.0, False), (0.02, False), (1.0, True), (3.0, True)])
def test_a_surprise_is_met_from_its_first_record_on(case_bar: float, surprises: bool) -> None:
    """The kinds of fault begin with the record itself, not with the next fourth one; what fits begins nothing."""
    bank, taken = Bank(PUMP), measurements()
    for one in taken[:14]:
        bank.learn(one)
    before = onsets(bank, DRAIN)
    bank.learn(off(taken[14], case_bar))
    assert (14 in onsets(bank, DRAIN)) is surprises
    assert onsets(bank, DRAIN) - {14} == before
    if surprises:
        begun = {
            int(k) for k, o in zip(bank.filters.kind[: bank.n], bank.filters.onset[: bank.n], strict=True) if o == 14
        }
        blind = {k for k, kind in enumerate(FAULT_KINDS) if any(name == "once" for name, _ in kind.moves)}
        assert begun >= set(range(len(FAULT_KINDS))) - blind - {GONE}
        assert OTHER in begun


def test_the_first_records_surprise_nobody() -> None:
    """As long as the pump is hardly known everything is new."""
    bank, taken = Bank(PUMP), measurements()
    for one in taken[:3]:
        bank.learn(one)
    bank.learn(off(taken[3], 2.0))
    assert onsets(bank, DRAIN) == set()


@pytest.mark.parametrize("case_bar", [0.0, 0.5, 3.0])
def test_far_from_where_it_was_learnt_a_case_pressure_weighs_less(case_bar: float) -> None:
    """Two per cent of the deviation from what the healthy pump was to show; nothing else is touched."""
    bank, taken = Bank(PUMP), measurements()
    for one in taken[:14]:
        bank.learn(one)
    coming = off(taken[14], case_bar)
    (_, expected, _), _ = bank.expected(coming[-1])
    deviation = coming[-1].values[CASE] - expected
    bank.learn(coming)
    weighed, plain = bank.learnt[-1][-1], coming[-1]
    added = weighed.noise - plain.noise
    assert added[CASE, CASE] == pytest.approx((0.02 * deviation) ** 2, rel=1e-3, abs=1e-12)
    assert DISCREPANCY == 0.02
    added[CASE, CASE] = 0.0
    assert not added.any()
    assert np.array_equal(weighed.values, plain.values)
    assert set(weighed.seen) == {DISCHARGE, CASE, ZERO}
