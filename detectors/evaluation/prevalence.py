"""In which proportion faults are pooled: what the judge itself takes for likely before it has seen a record.

A stated probability can only be held against outcomes that come as often as the judge was told. In each spacing of
onset candidates every kind of fault sets in with the bank's prior hazard, as a step or as a ramp, and the compensator's
regulation with that of its charts; of ``WATCHED_RECORDS`` a pump is then healthy to the end with ``exp(-hazard)``, else
it has one of the faults, shared out by groups: the state, uneven wear and regulation apart. Pumps come worn with the
bank's prior of that. Rows of the same group share its weight alike; groups without a row have none.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from detectors.bank.bank import SPAWN_EVERY
from detectors.bank.hypotheses import FAULT_KINDS, log_priors
from detectors.bank.regulation import LOG_HAZARD as REGULATION_LOG_HAZARD
from detectors.bank.shapes import STATED
from detectors.bank.tables import ARRIVAL_KINDS, LOG_ARRIVAL
from detectors.evaluation.rows import Row
from detectors.evaluation.truth import judges_kinds
from detectors.words.verdict import FAULTS, State

WATCHED_RECORDS = 200
"""Records that a pump of the study is watched for, to a few."""
ARRIVAL_PRIOR = math.exp(LOG_ARRIVAL)
"""Prior odds of having come worn against health, as the bank starts with."""


@dataclass(frozen=True)
class _Group:
    """Faults that come as often as the judge says: a state, and what is watched for apart within it."""

    state: State
    apart: str = ""


_REGULATION = _Group(State.COMPENSATOR_FAULT, "regulation")
_APART = ("uneven wear",)


def _group(kind: str) -> _Group:
    """Group of one of the judge's kinds; what the bank has none of shows in the regulation, if anywhere."""
    state = next((k.state for k in FAULT_KINDS if k.name == kind), None)
    return _REGULATION if state is None else _Group(state, kind if kind in _APART else "")


def _hazards() -> dict[_Group, float]:
    """Prior probability that a fault of a group sets in, at once or growing, within one spacing of onset candidates."""
    found = {_REGULATION: math.exp(REGULATION_LOG_HAZARD)}
    for kind, probability in zip(FAULT_KINDS, np.exp(log_priors(-np.inf)[STATED]).sum(axis=0).tolist(), strict=True):
        if kind.state in FAULTS:
            found[_group(kind.name)] = found.get(_group(kind.name), 0.0) + probability
    return found


def hazard_per_record() -> float:
    """Prior probability that any fault of pump, system or sensor sets in within one record."""
    return sum(_hazards().values()) / SPAWN_EVERY


def prior_weights(rows: Sequence[Row]) -> list[float]:
    """Weight of each row; those of a group that no row stands for are left out."""
    odds = len(ARRIVAL_KINDS) * ARRIVAL_PRIOR
    worn = odds / (1.0 + odds)
    healthy = math.exp(-hazard_per_record() * WATCHED_RECORDS)
    hazards = _hazards()
    whole = sum(hazards.values())
    faulty = {g: (1.0 - worn) * (1.0 - healthy) * h / whole for g, h in hazards.items()}
    parts = [_parts(row) for row in rows]
    held = {g: sum(p.get(g, 0.0) for p in parts) for g in faulty}
    n_worn = sum(row.worn for row in rows)
    n_healthy = sum(row.truth is State.HEALTHY for row in rows)
    weights = []
    for row, part in zip(rows, parts, strict=True):
        if row.worn:
            weights.append(worn / n_worn)
        elif row.truth is State.HEALTHY:
            weights.append((1.0 - worn) * healthy / n_healthy)
        else:
            weights.append(sum(faulty[g] * p / held[g] for g, p in part.items()))
    return weights


def _parts(row: Row) -> dict[_Group, float]:
    """Shares of the groups in a row's faults; empty for a row that is healthy or came worn."""
    if row.worn or row.truth is State.HEALTHY:
        return {}
    kinds = judges_kinds(row)
    if not kinds:  # a sensor that is moved
        return {_Group(row.truth): 1.0}
    found: dict[_Group, float] = {}
    for kind, n in kinds.items():
        found[_group(kind)] = found.get(_group(kind), 0.0) + n / kinds.total()
    return found
