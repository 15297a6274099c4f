"""Fault magnitudes in an operator's units, averaged over the hypotheses by their evidence."""

import math

import numpy as np
from numpy.typing import NDArray

from detectors.filter_bank import STEP, Bank, directions_of
from detectors.filter_kernel import case_flow
from detectors.state_model import AMPLITUDE, FAULT_KINDS
from detectors.verdict import Estimate

Array = NDArray[np.float64]

Z_90 = 1.645
WIDENING = 1.12
"""Intervals are widened by an eighth: what a study against foreign realities asked for honest coverage."""
_ODDS_TO_FIND = 11.0
"""Log evidence that a fault must gather: the alarm level plus the prior against it [nat]."""

_QUANTITIES: dict[str, tuple[str, ...]] = {
    "pump_leakage_change_lpm": (
        "leakage, slippers",
        "leakage, port plate",
        "leakage, mixed",
        "leakage, throttled",
        "uneven wear",
    ),
    "system_leakage_change_lpm": ("system leakage, orifice", "system leakage, laminar"),
    "pressure_setting_change_bar": ("setting",),
    "drain_resistance_change_percent": ("drain restriction",),
}
_NUMBER = {k.name: i for i, k in enumerate(FAULT_KINDS)}
_KINDS = {quantity: np.array([_NUMBER[n] for n in names]) for quantity, names in _QUANTITIES.items()}
_N_LIKELY = 3


def estimates(bank: Bank, weights: Array, reference: Array) -> tuple[dict[str, Estimate], dict[str, float]]:
    """Changes since the baseline with 90 % intervals, and the smallest change that would be found.

    Before the baseline is set a change is as unknown as its prior, and nothing has a smallest size yet.

    Parameters
    ----------
    bank
        Filters after the last record.
    weights
        Their posterior shares, shape (n,).
    reference
        Anchor of the pump type's reference condition.
    """
    found, smallest = {}, {}
    kinds = bank.kind[: bank.n]
    amplitude = bank.mean[: bank.n, AMPLITUDE]
    sd = np.sqrt(np.maximum(bank.covariance[: bank.n, AMPLITUDE, AMPLITUDE], 0.0))
    for quantity, numbers in _KINDS.items():
        places = np.flatnonzero(np.isin(kinds, numbers))
        resolution = _resolution(bank, int(numbers[0]), sd)
        if resolution is None:
            resolution = FAULT_KINDS[int(numbers[0])].scale
        else:
            smallest[quantity] = math.sqrt(2.0 * _ODDS_TO_FIND) * resolution
        share = weights[places]
        rest = 1.0 - float(share.sum())
        mean = float(share @ amplitude[places])
        second = float(share @ (sd[places] ** 2 + amplitude[places] ** 2)) + rest * resolution**2
        found[quantity] = _interval(mean, math.sqrt(max(second - mean**2, 0.0)))
    drain = "drain_resistance_change_percent"
    found[drain] = _in_percent(found[drain])
    if drain in smallest:
        smallest[drain] = 100.0 * math.expm1(smallest[drain])
    found["case_flow_at_reference_lpm"] = _case_flow(bank, weights, reference)
    return found, smallest


def _in_percent(logarithm: Estimate) -> Estimate:
    return Estimate(*(100.0 * math.expm1(min(v, 5.0)) for v in (logarithm.mean, logarithm.low, logarithm.high)))


def _resolution(bank: Bank, kind: int, sd: Array) -> float | None:
    """How well a sudden fault of this kind is known since its oldest onset; None before one saw two records."""
    onset = bank.onset[: bank.n]
    is_old = (bank.kind[: bank.n] == kind) & (bank.shape[: bank.n] == STEP) & (onset <= bank.records - 2)
    places = np.flatnonzero(is_old)
    return float(sd[places[np.argmin(onset[places])]]) if len(places) else None


def _case_flow(bank: Bank, weights: Array, reference: Array) -> Estimate:
    """Case flow at the reference condition, from the likeliest filters; each filter's spread through its slopes."""
    likely = np.argsort(weights)[::-1][:_N_LIKELY]
    share = weights[likely] / weights[likely].sum()
    mean, second = 0.0, 0.0
    for w, f in zip(share, likely, strict=True):
        flow, variance = case_flow(bank.mean[f], bank.covariance[f], directions_of(int(bank.kind[f])), reference)
        mean += w * flow
        second += w * (variance + flow**2)
    return _interval(mean, math.sqrt(max(second - mean**2, 0.0)))


def _interval(mean: float, sd: float) -> Estimate:
    half = Z_90 * WIDENING * sd
    return Estimate(mean, mean - half, mean + half)


def probability_above(estimate: Estimate, limit: float) -> float:
    """Probability that an estimated quantity lies above ``limit`` (normal)."""
    sd = max((estimate.high - estimate.low) / (2.0 * Z_90), 1e-9)
    return 0.5 * math.erfc((limit - estimate.mean) / (sd * math.sqrt(2.0)))
