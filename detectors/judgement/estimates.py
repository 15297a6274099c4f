"""Fault magnitudes in an operator's units, averaged over the hypotheses by their evidence."""

import math

import numpy as np
from numpy.typing import NDArray

from detectors.bank.bank import DIRECTIONS, Bank
from detectors.bank.hypotheses import FAULT_KINDS
from detectors.bank.kernel import mean_case_flow
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
_N_LIKELY = 3
"""Filters that the case flow is averaged over (estimate: the rest hardly moves the mean, and each costs an evaluation of the twin)."""


def estimates(bank: Bank, found: Evidence, reference: Array) -> tuple[dict[str, Estimate], dict[str, float]]:
    """Changes since the baseline with 90 % intervals, and the smallest change that would be found.

    Before the baseline is set a change is as unknown as its prior, and nothing has a smallest size yet.

    Parameters
    ----------
    bank, found
        Filters after the last record, and their evidence.
    reference
        Anchor of the pump type's reference condition.
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
        smallest[_DRAIN] = 100.0 * math.expm1(smallest[_DRAIN])
    values["case_flow_at_reference_lpm"] = _case_flow(bank, found.weights, reference)
    return values, smallest


def _in_percent(logarithm: Estimate) -> Estimate:
    return Estimate(*(100.0 * math.expm1(min(v, 5.0)) for v in (logarithm.mean, logarithm.low, logarithm.high)))


def _case_flow(bank: Bank, weights: Array, reference: Array) -> Estimate:
    """Case flow at the reference condition, from the likeliest filters; each filter's spread through its slopes."""
    return _interval(*mean_case_flow(bank.filters, weights, DIRECTIONS, reference, _N_LIKELY))


def _interval(mean: float, sd: float) -> Estimate:
    half = Z_90 * WIDENING * sd
    return Estimate(mean, mean - half, mean + half)
