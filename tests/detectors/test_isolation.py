"""From shares of the evidence to words: side first, then the fault, both kept until they clearly fall."""

from dataclasses import replace

import numpy as np
import pytest

from detectors.judgement.isolation import Alarm, Decision, Evidence, decided, fitting
from detectors.words.thresholds import effective
from detectors.words.verdict import FAULTS, Fit, State

P, C, L, D, S = FAULTS
X = State.OTHER
THRESHOLDS = effective(
    {
        "side_records": 3.0,
        "alarm_records": 2.0,
        "side_probability": 0.92,
        "system_side_probability": 0.83,
        "state_probability": 0.96,
    }
)
"""An operator's own levels: the rules hold for any."""


def evidence(log_odds: float = 10.0, arrival: float = 0.0, **shares: float) -> Evidence:
    """Shares by the initial of the state, ``o`` for none of these; what is missing to 1 goes to the moved sensor.

    Both priors agree on them, and the change set in after the baseline stood.
    """
    found = dict(zip(FAULTS, (shares.get(k, 0.0) for k in "pcld"), strict=False))
    found[X] = shares.get("o", 0.0)
    found[S] = 1.0 - sum(found.values())
    return Evidence(
        log_odds=log_odds,
        probabilities={},
        weights=np.empty(0),
        by_prior=np.empty((2, 0)),
        shares=found,
        surely=found,
        arrival=arrival,
        early=False,
        together=np.zeros((5, 5)),
        moments=np.zeros((4, 4)),
    )


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


def test_every_side_has_its_own_level() -> None:
    """An operator may ask for more before a pump is pulled than before somebody looks at a drain line."""
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
    assert len(run(*[evidence(l=0.975, o=0.025)] * 2)[-1].candidates) == 2


def test_where_the_priors_disagree_nobody_is_named() -> None:
    """A leak that is sure only because wear is known to grow: under the other prior it may be the drain."""
    sure = evidence(p=0.99, d=0.01)
    other = replace(sure, surely={**sure.shares, P: 0.9})
    assert run(*[sure] * 3)[-1].state is P
    assert [d.state for d in run(*[other] * 6)][1:] == [State.INDETERMINATE] * 5
    both = replace(sure, shares={**sure.shares, P: 0.95, D: 0.05}, surely={**sure.shares, P: 0.9, D: 0.01})
    assert run(*[both] * 6)[-1].candidates == (P, D)


def test_what_set_in_before_the_reference_stood_must_be_surer() -> None:
    """0.975 names a fault that is measured against the pump's own reference; without one it stays a candidate."""
    found = evidence(l=0.975, d=0.025)
    assert run(*[found] * 3)[-1].state is L
    assert run(*[replace(found, early=True)] * 6)[-1].state is State.INDETERMINATE
    surer = replace(evidence(l=0.999, d=0.001), early=True)
    assert run(*[surer] * 3)[-1].state is L


def test_none_of_these_is_never_a_verdict() -> None:
    """It is said as a candidate beside the likeliest fault, however far it leads."""
    last = run(*[evidence(o=0.999, l=0.001)] * 8)[-1]
    assert last.state is State.INDETERMINATE
    assert X in last.candidates
    assert L in last.candidates


@pytest.mark.parametrize(
    ("records", "explained", "healthy"), [(4, 0, True), (5, 2, False), (5, 3, True), (20, 11, False), (20, 12, True)]
)
def test_who_does_not_fit_is_not_healthy(records: int, explained: int, healthy: bool) -> None:
    """Six in ten of the last records must fit; below five records nothing is said of it. An alarm keeps its own words."""
    found = evidence(-5.0, d=0.9)
    said = fitting(Decision(State.HEALTHY), Fit(records, explained), found)
    assert said == (Decision(State.HEALTHY) if healthy else Decision(State.INDETERMINATE, (D, X)))
    assert fitting(Decision(L), Fit(records, explained), found) == Decision(L)


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
    assert run(*came, *[evidence(9.0, 0.9, l=0.975)] * 2)[-1].state is State.INDETERMINATE
