"""Fault magnitudes in an operator's units, averaged over the hypotheses by their evidence."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from detectors.bank.bank import Bank
from detectors.bank.hypotheses import FAULT_KINDS
from detectors.bank.position import shares_of
from detectors.bank.prediction import mean_case_flow
from detectors.bank.tables import DIRECTIONS
from detectors.judgement.isolation import QUANTITIES, Evidence
from detectors.words.numbers import Z_90
from detectors.words.verdict import Estimate

Array = NDArray[np.float64]

WIDENING = 1.12
"""Intervals are widened by an eighth: what a study against foreign realities asked for honest coverage."""
_ODDS_TO_FIND = 12.0
"""Log evidence that a fault must gather: the alarm level plus the prior against it [nat]."""

_SCALES = {
    quantity: next(k.scale for k in FAULT_KINDS if k.component in names) for quantity, names in QUANTITIES.items()
}
_DRAIN = "drain_resistance_change_percent"
_LEAST_SHARE = 0.01
"""Share from which a filter counts for the case flow (estimate: the rest hardly moves it, and each costs the twin once)."""


class Found(NamedTuple):
    """Changes since the baseline with 90 % intervals, the smallest that would be found, and how likely the case flow at the
    reference condition lies beyond its limit; None where nothing shows the case flow.
    """

    values: dict[str, Estimate]
    smallest: dict[str, float]
    beyond: float | None


NOTHING_FOUND = Found({}, {}, None)
"""Of a pump whose channels, or whose type without a twin, part no cause from another: no size is anybody's."""


def estimates(bank: Bank, found: Evidence, reference: Array, limit_lpm: float) -> Found:
    """What the bank says of sizes.

    Before the baseline is set a change is as unknown as its prior, and nothing has a smallest size yet.

    Parameters
    ----------
    bank, found
        Filters after the last record, and their evidence.
    reference, limit_lpm
        Anchor of the pump type's reference condition, and the limit of the case flow there.
    """
    values, smallest = {}, {}
    for quantity, (share, first, second, resolution) in zip(QUANTITIES, found.moments.tolist(), strict=True):
        spread = resolution if resolution > 0.0 else _SCALES[quantity]
        if resolution > 0.0:
            smallest[quantity] = math.sqrt(2.0 * _ODDS_TO_FIND) * resolution
        whole = second + (1.0 - share) * spread**2
        values[quantity] = _interval(first, math.sqrt(max(whole - first**2, 0.0)))
    values[_DRAIN] = _in_percent(values[_DRAIN])
    if _DRAIN in smallest:
        smallest[_DRAIN] = 100.0 * smallest[_DRAIN]
    # a level is said by the shares that causes are said by
    stated, alike = shares_of(bank, found.weights, found.by_prior)
    shares = 0.5 * (stated + alike)
    *level, beyond = mean_case_flow(bank.filters, shares, DIRECTIONS, reference, _LEAST_SHARE, limit_lpm, WIDENING)
    values["case_flow_at_reference_lpm"] = Estimate(*level)
    return Found(values, smallest, beyond)


def _in_percent(share: Estimate) -> Estimate:
    return Estimate(*(100.0 * value for value in (share.mean, share.low, share.high)))


def _interval(mean: float, sd: float) -> Estimate:
    half = Z_90 * WIDENING * sd
    return Estimate(mean, mean - half, mean + half)
