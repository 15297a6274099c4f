"""Tables that the bank reads: kinds of fault as arrays, their priors by shape, how many onsets are kept, and how states walk."""

from collections.abc import Mapping
from functools import cache

import numpy as np
from numpy.typing import NDArray

from detectors.bank.hypotheses import (
    FAULT_KINDS,
    FREE_SETTING_WALK_BAR,
    N_KINDS,
    directions,
    hazards_of,
    kind_scales,
    laws,
    log_priors,
    walk_variance,
)
from detectors.bank.shapes import N_SHAPES, ON_OFF, OPEN, RAMP, STATED, STEP, Filters, Kinds, Walks
from detectors.expectation.components import N_COMPONENTS, N_STATE
from detectors.words.verdict import State
from twin.parameters import PumpType

_MOST: Mapping[int, int] = {STEP: 5, RAMP: 4, ON_OFF: 2, OPEN: 2}
"""Onsets of one kind that are kept by shape: where a ramp began matters less than where a step stood."""
DISCREPANCY = 0.02
"""Share of a deviation of the case pressure that no law and no sensor is good for (estimate: a sensor of 1 % of its full scale,
and laws that were learnt where the healthy pump runs). Without it a drain ten times as resistant, 3.5 bar, would be weighed
with the 5 mbar of a sensor's noise, and the least wrong law would win by a hundred nats."""
BREADTH = 4.0
"""How many times its usual size a fault may have that sets in with a surprise, of every kind alike (estimate: a drain blocked
tenfold is 18 times its kind's scale, a leak of 2 L/min five times)."""
ARRIVAL_KINDS = ("leakage, slippers",)
ARRIVAL_LEAKAGE_LPM = (1.2, 0.6)
"""Mean and spread of what a pump leaks on top that arrives worn: the limit lies 0.2 above the nominal pump's case flow."""
ARRIVAL_FLOOR_LPM = 0.5
"""Below this a pump that leaks more than its type is one of the population, not one that arrived worn."""
LOG_ARRIVAL = float(np.log(0.1))
"""Prior of such an arrival (estimate: one pump in ten is used when it comes)."""
RAMP_RECORDS = 12.0
"""Records in which a ramp of one sigma grows by a fault's scale: fits 0.04 L/min a flight, and does not punish 0.004 (estimate)."""
LOG_PRIORS = log_priors(LOG_ARRIVAL)
_AMPLITUDE_WALK = np.array([0.03, 0.03, 0.0, 0.03, 0.0])
"""Walk of a fault's amplitude from record to record by shape, as a share of its scale. Growth stops: a ramp that could leave
its rate by 1 % only went on for ten flights, and the drain's law was bent to hold it."""
_RATE_WALK = 0.1
"""Walk of a ramp's rate, as a share of the rate's own spread: growth slows down, stops and starts again."""
MOST_ONSETS = np.zeros((N_SHAPES, N_KINDS), dtype=np.int64)
for _shape, _most in _MOST.items():
    MOST_ONSETS[_shape] = _most * np.isfinite(LOG_PRIORS[STATED, _shape])
CAPACITY = 1 + len(ARRIVAL_KINDS) + int(MOST_ONSETS.sum())
"""The healthy pump, those that came worn, and every onset that is kept."""
DIRECTIONS = np.concatenate((directions(), np.zeros((1, 2, N_COMPONENTS))))
"""What each kind of fault moves per unit of amplitude, and of its product with the law, zeros for the healthy pump last,
shape (N_KINDS + 1, 2, N_COMPONENTS)."""
_MOVES_SETTING = np.array([k.beside is not None for k in FAULT_KINDS] + [False])
IS_HEALTHY = np.array([k.state is State.HEALTHY for k in FAULT_KINDS] + [False])
_IS_BOUNDED = np.array([k.state is State.HEALTHY or np.isfinite(k.most) for k in FAULT_KINDS] + [True])
"""Kinds that cannot be many times their usual size: fluids differ no more than they do, and what has a largest size."""
_BY_LINES = np.array([any(name == "once" for name, _ in k.moves) for k in FAULT_KINDS])
_OF_RESERVOIR = np.array([k.component == "reservoir" for k in FAULT_KINDS])
_SCALES = np.append(kind_scales(), 0.0)
_HEALS = np.array([-4.0 if k.state is State.PUMP_DEGRADATION else 0.0 for k in FAULT_KINDS] + [0.0])
"""Gaps that have worn do not close by themselves (estimate: one in fifty of those that seemed to be worn)."""
_SIGNS = np.array([k.sign for k in FAULT_KINDS] + [0])
_LARGEST = np.array([k.most for k in FAULT_KINDS] + [np.inf])
KINDS = Kinds(DIRECTIONS, _SCALES, laws(), _SIGNS, _LARGEST, _HEALS, LOG_PRIORS, RAMP_RECORDS, *ARRIVAL_LEAKAGE_LPM)


def kinds_of(pump: PumpType) -> Kinds:
    """What faults are, setting in as often as a pump type's population has them."""
    return KINDS._replace(log_priors=log_priors(LOG_ARRIVAL, hazards_of(pump)))


_AMPLITUDE_VARIANCE = np.outer(_AMPLITUDE_WALK, _SCALES) ** 2
_RATE_VARIANCE = np.zeros_like(_AMPLITUDE_VARIANCE)
_RATE_VARIANCE[RAMP] = (_RATE_WALK * _SCALES / RAMP_RECORDS) ** 2
_SETTING_VARIANCE = np.where(_MOVES_SETTING, FREE_SETTING_WALK_BAR**2, 0.0)
"""Walks from record to record by shape and kind, the healthy pump last."""
WALKS = Walks(walk_variance(), _AMPLITUDE_VARIANCE, _RATE_VARIANCE, _SETTING_VARIANCE)


def empty_filters() -> Filters:
    """Room for every filter that is kept."""
    return Filters(
        mean=np.zeros((CAPACITY, N_STATE)),
        covariance=np.zeros((CAPACITY, N_STATE, N_STATE)),
        kind=np.full(CAPACITY, -1),
        shape=np.zeros(CAPACITY, dtype=np.int64),
        onset=np.zeros(CAPACITY, dtype=np.int64),
        log_evidence=np.zeros(CAPACITY),
        setting_at_onset=np.zeros(CAPACITY),
        scale=np.zeros(CAPACITY),
        prior=np.zeros((CAPACITY, 2)),
        misfit=np.zeros(CAPACITY),
        unexplained=np.zeros(CAPACITY, dtype=np.int64),
        shown=np.zeros(CAPACITY, dtype=np.int64),
    )


@cache
def most_onsets(*, lines: bool, reservoir: bool) -> NDArray[np.int64]:
    """How many onsets are kept by shape and kind, (N_SHAPES, N_KINDS): none of what cannot be told without lines or reservoir."""
    most = MOST_ONSETS.copy()
    if not lines:
        most[:, _BY_LINES] = 0
    if not reservoir:
        most[:, _OF_RESERVOIR] = 0
    most.flags.writeable = False
    return most


@cache
def scales_of(breadth: float) -> NDArray[np.float64]:
    """One-sigma sizes that new faults are expected to have, (N_KINDS + 1,): ``breadth`` times the usual where nothing bounds them."""
    return np.where(_IS_BOUNDED, 1.0, breadth) * KINDS.scales


def touched_by(freed: Mapping[str, float | None]) -> NDArray[np.bool_]:
    """Kinds of fault that move a component of which nothing is known any more, shape (N_KINDS,).

    ``freed`` holds by component None for that, or by how much it may differ from what it was, which ends nothing.
    """
    unknown = {name for name, like_before in freed.items() if like_before is None}
    return np.array([any(name in unknown for name, _ in (*k.moves, *k.law.moves)) for k in FAULT_KINDS])
