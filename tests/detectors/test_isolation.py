"""From shares of the evidence to words: side first, then the fault, both kept until they clearly fall."""

import numpy as np
import pytest

from detectors.judgement.isolation import Alarm, Decision, Evidence, decided
from detectors.words.thresholds import effective
from detectors.words.verdict import FAULTS, State

P, C, L, D, S = FAULTS
THRESHOLDS = effective({"side_records": 3.0, "alarm_records": 2.0})


def evidence(log_odds: float = 10.0, arrival: float = 0.0, **shares: float) -> Evidence:
    """Shares by the initial of the state; what is missing to 1 goes to the moved sensor."""
    found = dict(zip(FAULTS, (shares.get(k, 0.0) for k in "pcld"), strict=False))
    found[S] = 1.0 - sum(found.values())
    return Evidence(log_odds, {}, np.empty(0), found, arrival, np.zeros((5, 5)), np.zeros((4, 4)))


def run(*found: Evidence) -> list[Decision]:
    alarm, decisions = Alarm(), []
    for one in found:
        alarm, decision = decided(alarm, one, THRESHOLDS)
        decisions.append(decision)
    return decisions


def test_a_side_is_named_by_its_faults_together() -> None:
    undecided = run(*[evidence(p=0.08, l=0.5, d=0.42)] * 3)
    assert [d.state for d in undecided] == [State.HEALTHY, State.INDETERMINATE, State.INDETERMINATE]
    assert undecided[1].candidates == (P, L, D)
    assert undecided[2].candidates == (L, D)  # the circuit's, whichever it is
    assert run(*[evidence(p=0.5, c=0.45, l=0.05)] * 3)[-1].candidates == (P, C)


def test_a_fault_is_named_once_it_leads_alone() -> None:
    assert [d.state for d in run(*[evidence(l=0.97, d=0.03)] * 3)][-1] is L
    # 0.93 is enough for the side, not for the fault: the other fault of the side stays possible
    assert run(*[evidence(p=0.93, l=0.07)] * 5)[-1].candidates == (P, C)


def test_the_pump_s_side_asks_for_more_than_the_circuit_s() -> None:
    assert run(*[evidence(l=0.84, p=0.16)] * 3)[-1].candidates == (L, D)
    assert run(*[evidence(p=0.84, l=0.16)] * 3)[-1].candidates == (P, L)


def test_a_moved_sensor_waits_for_its_name() -> None:
    assert run(*[evidence(p=0.1)] * 5)[-1].candidates == (P, S)
    assert run(*[evidence(p=0.01)] * 5)[-1].state is S


@pytest.mark.parametrize(("weaker", "kept"), [(0.8, True), (0.75, False)])
def test_what_is_named_keeps_its_name_until_it_clearly_falls(weaker: float, kept: bool) -> None:
    named = [evidence(l=0.97, p=0.03)] * 3
    assert run(*named, evidence(l=weaker, p=1.0 - weaker))[-1].state is (L if kept else State.INDETERMINATE)
    # what was never named gets no such credit
    assert run(*named[:2], evidence(l=weaker, p=1.0 - weaker))[-1].state is State.INDETERMINATE


def test_one_rival_is_always_left() -> None:
    assert len(run(*[evidence(l=1.0)] * 2)[-1].candidates) == 2


def test_an_alarm_ends_below_the_off_level_only() -> None:
    between = 0.5 * (THRESHOLDS["alarm_on_log_odds"] + THRESHOLDS["alarm_off_log_odds"])
    high, low = evidence(l=1.0), evidence(between, l=1.0)
    assert [d.state is State.HEALTHY for d in run(high, low, high, high, low, evidence(0.0, l=1.0))] == [
        True,
        True,
        True,
        False,
        False,
        True,
    ]


def test_who_came_worn_is_called_so_unless_something_else_has_changed() -> None:
    came = [evidence(-5.0, 0.9, p=0.9)] * 4
    assert [d.state for d in run(*came)] == [State.HEALTHY] * 3 + [P]
    assert run(*came, *[evidence(9.0, 0.9, l=0.99)] * 2)[-1].state is State.INDETERMINATE
