"""In which proportion faults are pooled: what the judge itself takes for likely before it has seen a record.

A stated probability can only be held against outcomes that come as often as the judge was told. In each spacing of
onset candidates every kind of fault sets in with the bank's prior hazard, as a step or as a ramp; of ``WATCHED_RECORDS``
a pump is then healthy to the end with ``exp(-hazard)``, else it has one of the faults, shared out by kinds. Pumps come
worn with the bank's prior of that. Rows of the same truth share its weight alike.
"""

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

from detectors.evaluation.rows import Row
from detectors.filter_bank import ARRIVAL_KINDS, SPAWN_EVERY
from detectors.state_model import FAULT_KINDS, log_hazards
from detectors.verdict import FAULTS, State

WATCHED_RECORDS = 200
"""Records that a pump of the study is watched for, to a few."""
ARRIVAL_PRIOR = 0.04
"""Prior odds of having come worn by each of its laws against health, as the bank starts with."""


def _hazards() -> dict[State, float]:
    """Prior probability that a fault of a state sets in, at once or growing, within one spacing of onset candidates."""
    found: dict[State, float] = {}
    for kind, probability in zip(FAULT_KINDS, np.exp(log_hazards()).sum(axis=0).tolist(), strict=True):
        if kind.state in FAULTS:
            found[kind.state] = found.get(kind.state, 0.0) + probability
    return found


def hazard_per_record() -> float:
    """Prior probability that any fault of pump, system or sensor sets in within one record."""
    return sum(_hazards().values()) / SPAWN_EVERY


def prior_weights(rows: Sequence[Row]) -> list[float]:
    """Weight of each row; those of a truth that no row stands for are left out."""
    odds = len(ARRIVAL_KINDS) * ARRIVAL_PRIOR
    worn = odds / (1.0 + odds)
    healthy = math.exp(-hazard_per_record() * WATCHED_RECORDS)
    share = {State.HEALTHY: (1.0 - worn) * healthy}
    hazards = _hazards()
    whole = sum(hazards.values())
    share |= {s: (1.0 - worn) * (1.0 - healthy) * h / whole for s, h in hazards.items()}
    groups = Counter((row.truth, row.worn) for row in rows)
    return [(worn if row.worn else share[row.truth]) / groups[row.truth, row.worn] for row in rows]
