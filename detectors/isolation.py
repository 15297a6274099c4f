"""From the evidence of a bank to words: sequential alarm, the fault it names, or what remains possible."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from detectors.filter_bank import ARRIVAL, Bank
from detectors.state_model import AMPLITUDE, FAULT_KINDS
from detectors.verdict import FAULTS, State

Array = NDArray[np.float64]

TEMPER = 0.8
"""Evidence is raised to this power before it becomes a probability: the twin is not the pump, and neighbouring
records share what it misses. At 0.7, five of forty short histories with a leaking circuit lost the true cause from
their candidates, at 0.5 one (our own simulations); a population study has yet to calibrate it."""


WORN_PROBABILITY = 0.5
"""Probability of having arrived worn from which a pump is called so."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """Where the evidence stands after one record.

    ``log_odds`` is that of any fault against health [nat]; ``probabilities`` sum to 1 over healthy and faults;
    ``weights`` are the filters' shares, shape (m,); ``shares`` are those of
    the faults among what changed since the first record; ``arrival`` is the probability that the pump came worn.
    """

    log_odds: float
    probabilities: Mapping[State, float]
    weights: Array
    shares: Mapping[State, float]
    arrival: float


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
    worn_for: int = 0


@dataclass(frozen=True, slots=True)
class Decision:
    """State with what remains possible; ``candidates`` is empty unless the state is ``indeterminate``."""

    state: State
    candidates: tuple[State, ...] = field(default=())


def evidence(bank: Bank, thresholds: Mapping[str, float]) -> Evidence:
    """Sum the bank's filters by the state they stand for."""
    kinds = bank.kind[: bank.n]
    small = np.abs(bank.mean[: bank.n, AMPLITUDE]) < bank.floors(thresholds["sensor_shift_bar"])
    states = np.where(small, -1, _STATES[kinds])
    arrived = bank.shape[: bank.n] == ARRIVAL
    log_weights = bank.log_weights()
    share = np.exp(log_weights - log_weights.max())
    # the healthy pump's place is the last
    places = np.where(states < 0, len(FAULTS), states)
    sums = np.bincount(places, weights=share, minlength=len(FAULTS) + 1)
    # how a pump came is a question of its own: an alarm is raised by what changed since
    changed = np.bincount(np.where(arrived, len(FAULTS), places), weights=share, minlength=len(FAULTS) + 1)
    tempered = _tempered(sums)
    probabilities = {State.HEALTHY: float(tempered[-1])}
    probabilities |= {f: float(p) for f, p in zip(FAULTS, tempered[:-1], strict=True)}
    return Evidence(
        log_odds=float(np.log(max(changed[:-1].sum(), 1.0e-300)) - np.log(max(changed[-1], 1.0e-300))),
        shares={f: float(v) for f, v in zip(FAULTS, _tempered(changed[:-1]), strict=True)},
        probabilities=probabilities,
        weights=share / share.sum(),
        arrival=float(share[arrived & ~small].sum() / share.sum()),
    )


def decided(alarm: Alarm, found: Evidence, thresholds: Mapping[str, float]) -> tuple[Alarm, Decision]:
    """One step of the sequential decision."""
    worn_for = alarm.worn_for + 1 if found.arrival > WORN_PROBABILITY else 0
    above = alarm.above + 1 if found.log_odds > thresholds["alarm_on_log_odds"] else 0
    raised = above >= thresholds["alarm_records"] or (
        alarm.raised and found.log_odds >= thresholds["alarm_off_log_odds"]
    )
    share = found.shares
    leader = max(FAULTS, key=lambda f: share[f])
    sure = share[leader] > thresholds["side_probability"]
    named_for = (alarm.named_for + 1 if alarm.leader is leader else 1) if sure else 0
    following = Alarm(raised, above, leader if sure else None, named_for, worn_for)
    if worn_for >= thresholds["alarm_records"] and (not raised or leader is State.PUMP_DEGRADATION):
        return following, Decision(State.PUMP_DEGRADATION)
    if not raised:
        return following, Decision(State.HEALTHY)
    if named_for >= thresholds["side_records"]:
        return following, Decision(leader)
    candidates = tuple(f for f in FAULTS if share[f] >= thresholds["candidate_probability"])
    return following, Decision(State.INDETERMINATE, candidates)


def _tempered(sums: Array) -> Array:
    """Shares of evidence sums, tempered; they add up to 1."""
    powers = np.maximum(sums / max(sums.max(), 1.0e-300), 1.0e-300) ** TEMPER
    shares: Array = powers / powers.sum()
    return shares


def _state_number(state: State) -> int:
    return FAULTS.index(state)


_STATES = np.array([_state_number(k.state) for k in FAULT_KINDS] + [-1])
"""State of each kind of fault, the healthy pump last."""
