"""From the evidence of a bank to words: sequential alarm, the fault it names, or what remains possible."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from detectors.filter_bank import Bank
from detectors.state_model import FAULT, FAULT_KINDS
from detectors.verdict import FAULTS, State

Array = NDArray[np.float64]

TEMPER = 0.5
"""Evidence is raised to this power before it becomes a probability: the twin is not the pump, and neighbouring
records share what it misses. At 0.7, five of forty short histories with a leaking circuit lost the true cause from
their candidates, at 0.5 one (our own simulations); a population study has yet to calibrate it."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """Where the evidence stands after one record.

    ``log_odds`` is that of any fault against health [nat]; ``probabilities`` sum to 1 over healthy and faults;
    ``weights`` are the filters' shares, shape (m,).
    """

    log_odds: float
    probabilities: Mapping[State, float]
    weights: Array


@dataclass(frozen=True, slots=True)
class Alarm:
    """Memory of the sequential decision between records.

    An alarm is raised after ``above`` records in a row over the on-level and ends below the off-level; a fault is
    named after its share among the faults stayed high for ``named_for`` records in a row.
    """

    raised: bool = False
    above: int = 0
    leader: State | None = None
    named_for: int = 0


@dataclass(frozen=True, slots=True)
class Decision:
    """State with what remains possible; ``candidates`` is empty unless the state is ``indeterminate``."""

    state: State
    candidates: tuple[State, ...] = field(default=())


def evidence(bank: Bank, thresholds: Mapping[str, float]) -> Evidence:
    """Sum the bank's filters by the state they stand for."""
    states = np.array([_state_number(k.state) for k in FAULT_KINDS] + [-1])[bank.kind]
    floor = np.array([k.floor for k in FAULT_KINDS] + [0.0])[bank.kind]
    floor[states == _state_number(State.SENSOR_FAULT)] = thresholds["sensor_shift_bar"]
    small = np.abs(bank.mean[:, FAULT]) < floor
    states = np.where(small, -1, states)
    log_odds = bank.log_odds
    healthy = float(logsumexp(log_odds[states == -1]))
    by_fault = np.array([_lse(log_odds[states == i]) for i in range(len(FAULTS))])
    tempered = TEMPER * (np.concatenate(([healthy], by_fault)) - healthy)
    probabilities = np.exp(tempered - logsumexp(tempered))
    weights = np.exp(log_odds - logsumexp(log_odds))
    return Evidence(
        log_odds=_lse(by_fault) - healthy,
        probabilities=dict(zip((State.HEALTHY, *FAULTS), (float(p) for p in probabilities), strict=True)),
        weights=weights,
    )


def decided(alarm: Alarm, found: Evidence, thresholds: Mapping[str, float]) -> tuple[Alarm, Decision]:
    """One step of the sequential decision."""
    above = alarm.above + 1 if found.log_odds > thresholds["alarm_on_log_odds"] else 0
    raised = above >= thresholds["alarm_records"] or (
        alarm.raised and found.log_odds >= thresholds["alarm_off_log_odds"]
    )
    total = sum(found.probabilities[f] for f in FAULTS)
    share = {f: found.probabilities[f] / total if total > 0.0 else 0.0 for f in FAULTS}
    leader = max(FAULTS, key=lambda f: share[f])
    sure = share[leader] > thresholds["side_probability"]
    named_for = (alarm.named_for + 1 if alarm.leader is leader else 1) if sure else 0
    following = Alarm(raised, above, leader if sure else None, named_for)
    if not raised:
        return following, Decision(State.HEALTHY)
    if named_for >= thresholds["side_records"]:
        return following, Decision(leader)
    candidates = tuple(f for f in FAULTS if share[f] >= thresholds["candidate_probability"])
    return following, Decision(State.INDETERMINATE, candidates)


def _state_number(state: State) -> int:
    return FAULTS.index(state)


def _lse(values: Array) -> float:
    return float(logsumexp(values)) if len(values) else -np.inf
