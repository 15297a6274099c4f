"""What the judge holds of a pump after each record, and where that lies in the plane of the curve.

Only the likeliest filters count, as in the estimates. A filter's fault is what its amplitude moves: without it the same
filter says where this pump would be if nothing had happened to it, its reference.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from detectors.bank.bank import HEALTHY
from detectors.bank.hypotheses import FAULT_KINDS, FaultKind
from detectors.bank.measurement import NO_RIPPLE
from detectors.bank.prediction import CASE, DISCHARGE, N_MEASURED, N_SLOPES, predicted
from detectors.bank.tables import DIRECTIONS
from detectors.expectation.anchor import COLUMN
from detectors.expectation.components import AMPLITUDE, N_COMPONENTS, N_STATE, PLACE
from detectors.judgement.assessment import Fold
from detectors.judgement.handover import FromOthers
from detectors.judgement.isolation import evidence
from detectors.words.flights import outline_of, roles_of
from detectors.words.observation import History
from detectors.words.states import State

Array = NDArray[np.float64]

_N_LIKELY = 3
"""Filters that count (estimate: those of the case flow's estimate)."""
_OF_SENSORS = (PLACE["case_offset"], PLACE["reservoir"])
"""Components that are no part of where the pump really is."""
_LOGARITHM = "ln_"
"""How the names of components begin that are logarithms."""
_SYSTEM = PLACE["system_orifice"]
_RESERVOIR = COLUMN["reservoir"]


@dataclass(frozen=True, slots=True)
class Sight:
    """The likeliest filters after a record: shares (k,), states (k, N), covariances (k, N, N), kinds (k,).

    ``setting_at_onset`` is where the setting stood when a fault set in that lets it go, shape (k,) [bar].
    """

    record_id: str
    at: datetime
    shares: Array
    mean: Array
    covariance: Array
    kind: NDArray[np.int64]
    setting_at_onset: Array


@dataclass(frozen=True, slots=True)
class Place:
    """A point of the plane with its covariance: discharge pressure and case minus reservoir pressure [bar, bar^2]."""

    xy: Array
    covariance: Array


def sights(fold: Fold, history: History, others: Mapping[str, FromOthers]) -> list[Sight]:
    """Fold a history from its first record on, with a sight after every record that taught something.

    ``fold`` is a new one; it is left behind the last record. ``others`` is what records take over from other pumps.
    """
    observations = sorted(history.observations, key=lambda o: (o.at, o.record_id))
    roles = roles_of([outline_of(o) for o in observations])
    found, used = [], fold.used
    for assessment in fold.continued(observations, roles, history, others=others):
        if fold.used > used:
            used = fold.used
            found.append(sight_of(fold, assessment.record_id, assessment.at))
    return found


def sight_of(fold: Fold, record_id: str, at: datetime) -> Sight:
    """The likeliest filters of a fold now."""
    filters, weights = fold.bank.filters, evidence(fold.bank, fold.thresholds).weights
    likely = np.argsort(-weights, kind="stable")[:_N_LIKELY]
    return Sight(
        record_id,
        at,
        weights[likely] / weights[likely].sum(),
        filters.mean[likely].copy(),
        filters.covariance[likely].copy(),
        filters.kind[likely].copy(),
        filters.setting_at_onset[likely].copy(),
    )


def place_of(sight: Sight, anchor: Array) -> Place:
    """Where the pump is at an anchor's condition, with its fault."""
    kinds = [HEALTHY if k >= 0 and FAULT_KINDS[k].sensor is not None else int(k) for k in sight.kind]
    return _mixed(sight, anchor, sight.mean, kinds)


def reference_of(sight: Sight, anchor: Array, demand_lpm: float = 0.0) -> Place:
    """Where the same pump would be without its fault, under a demand of the circuit [L/min at 175 bar]."""
    return _mixed(sight, anchor, _healthy_states(sight, demand_lpm), _healthy_kinds(sight))


def amplitude_of(kind: FaultKind, size: float) -> float:
    """Amplitude of a fault of one kind by its size: a share is counted as a logarithm where the component is one."""
    return math.log1p(size) if kind.component.startswith(_LOGARITHM) else size


def size_of(kind: FaultKind, amplitude: float) -> float:
    """The other way round."""
    return math.expm1(amplitude) if kind.component.startswith(_LOGARITHM) else amplitude


def moved(sight: Sight, anchor: Array, kind: int, amplitude: float) -> Array:
    """Displacement of the reference by a fault of one kind, shape (2,) [bar]."""
    state = (sight.shares @ _healthy_states(sight, 0.0)).copy()
    state[AMPLITUDE] = 0.0
    start = _predicted(state, HEALTHY, anchor)[0]
    state[AMPLITUDE] = amplitude
    return _predicted(state, kind, anchor)[0] - start


def _healthy_kinds(sight: Sight) -> list[int]:
    """Kinds of the filters without their faults: what changes in a healthy pump, a new batch of fluid, stays."""
    return [int(k) if k >= 0 and FAULT_KINDS[k].state is State.HEALTHY else HEALTHY for k in sight.kind]


def _healthy_states(sight: Sight, demand_lpm: float) -> Array:
    states = sight.mean.copy()
    for row, k in enumerate(sight.kind):
        if k >= 0 and FAULT_KINDS[k].beside is not None:
            states[row, PLACE["setting"]] = sight.setting_at_onset[row]
    states[:, _SYSTEM] += demand_lpm
    return states


def _mixed(sight: Sight, anchor: Array, states: Array, kinds: list[int]) -> Place:
    found, within = np.empty((len(kinds), 2)), np.zeros((2, 2))
    for row, kind in enumerate(kinds):
        found[row], slopes = _predicted(states[row], kind, anchor)
        within += sight.shares[row] * slopes @ sight.covariance[row] @ slopes.T
    mean = sight.shares @ found
    apart = found - mean
    return Place(mean, within + (apart.T * sight.shares) @ apart)


def _predicted(state: Array, kind: int, anchor: Array) -> tuple[Array, Array]:
    """Place in the plane that a state says, shape (2,), and its slopes by the state, shape (2, N)."""
    own = state.copy()
    own[list(_OF_SENSORS)] = 0.0
    full, y = np.empty(N_COMPONENTS), np.empty(N_MEASURED)
    slopes = np.empty((N_MEASURED, N_SLOPES))
    predicted(own, DIRECTIONS[kind], anchor, NO_RIPPLE, full, y, slopes)
    both = slopes[[DISCHARGE, CASE], :N_STATE].copy()
    both[:, list(_OF_SENSORS)] = 0.0
    return np.array((y[DISCHARGE], y[CASE] - anchor[_RESERVOIR])), both
