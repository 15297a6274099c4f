"""What a state says the sensors show, with every slope; and what it says of the case flow. Compiled."""

import math
from typing import NamedTuple

import numpy as np

from detectors.bank.shapes import Array, Filters, Reading
from detectors.expectation.anchor import COLUMN
from detectors.expectation.components import (
    AMPLITUDE,
    ANSWER,
    CASE_OFFSET,
    CASE_RIPPLE_WARMTH,
    CASE_SPAN,
    LAW,
    LN_LAMINAR,
    LN_RIPPLE,
    LN_SLIPPER,
    LN_VISCOSITY,
    N_COMPONENTS,
    N_LIVING,
    N_PLACES,
    N_STATE,
    ONCE,
    RESERVOIR,
)
from detectors.expectation.reduced_twin import SLIPPER_VISCOSITY, pressures
from twin.compiled import compiled

N_MEASURED = 6
"""Discharge pressure, case pressure, zero of the case sensor, order n of both pressures, line at once per turn."""
DISCHARGE, CASE, ZERO, RIPPLE, CASE_RIPPLE, LINE = range(N_MEASURED)

N_SLOPES = N_PLACES
"""A slope for every place of the state, and after them one for every component that only a fault moves."""
_P_R, _WARMTH = COLUMN["reservoir"], COLUMN["warmth"]
_LEAST_RATIO = 0.05
"""Of order n to the twin's below which no leakage brings it (our choice: it has no less than nothing)."""


Expected = tuple[float, float, float]
"""Discharge and case pressure as they would be measured, and case over reservoir pressure [bar]."""


@compiled
def place(j: int) -> int:
    """Place of component j in a state, or among the slopes."""
    return j if j < LN_RIPPLE else j + LAW + 1 - LN_RIPPLE


@compiled
def predicted(
    state: Array,
    direction: Array,
    anchor: Array,
    ripple: Array,
    full: Array,
    y: Array,
    H: Array,
    n_rows: int = N_MEASURED,
) -> None:
    """What a state says the sensors show, ``y`` (6,), and its slopes ``H`` (6, N_SLOPES).

    ``direction`` (2, N_COMPONENTS) is what the amplitude moves, and what its product with the law moves on top;
    ``ripple`` holds the relative slopes of order n of both pressures by the components, shape (2, N_COMPONENTS);
    ``full`` (N_COMPONENTS,) is work space. Only the first ``n_rows`` of ``H`` are needed, at least three; where no more
    are, those of the lines stay as they are.
    """
    amplitude, law = state[AMPLITUDE], state[LAW]
    _whole(state, direction, full)
    pressures(anchor, full, y, H)
    H[ZERO:n_rows, :] = 0.0
    span = 1.0 + full[CASE_SPAN]
    if span != 1.0:
        H[CASE, :] *= span
    H[CASE, place(CASE_SPAN)] = y[CASE]
    y[CASE] = span * y[CASE] + full[CASE_OFFSET]
    H[CASE, CASE_OFFSET] = 1.0
    reservoir = anchor[_P_R] + full[RESERVOIR]
    y[ZERO] = full[CASE_OFFSET] + full[RESERVOIR] + full[CASE_SPAN] * reservoir
    H[ZERO, CASE_OFFSET], H[ZERO, RESERVOIR], H[ZERO, place(CASE_SPAN)] = 1.0, span, reservoir
    if n_rows > RIPPLE:
        for r in range(2):
            ratio = 1.0
            for j in range(N_COMPONENTS):
                ratio += ripple[r, j] * full[j]
            # lines follow what leaks, not its logarithm
            by_slippers, by_laminar = ripple[r, LN_SLIPPER], ripple[r, LN_LAMINAR]
            slippers, laminar = (
                full[LN_SLIPPER] - SLIPPER_VISCOSITY * full[LN_VISCOSITY],
                full[LN_LAMINAR] - full[LN_VISCOSITY],
            )
            more_s, more_l = math.exp(slippers), math.exp(laminar)
            ratio += by_slippers * (more_s - 1.0 - slippers) + by_laminar * (more_l - 1.0 - laminar)
            ratio = max(ratio, _LEAST_RATIO)
            answer = 1.0 + full[ANSWER]
            gain = full[LN_RIPPLE + r] + r * anchor[_WARMTH] * full[CASE_RIPPLE_WARMTH]
            line = math.exp(gain) * ratio**answer
            share = line * answer / ratio
            for j in range(N_COMPONENTS):
                H[RIPPLE + r, place(j)] = share * ripple[r, j]
            H[RIPPLE + r, place(LN_SLIPPER)] *= more_s
            H[RIPPLE + r, place(LN_LAMINAR)] *= more_l
            thinner = SLIPPER_VISCOSITY * by_slippers * (1.0 - more_s) + by_laminar * (1.0 - more_l)
            H[RIPPLE + r, place(LN_VISCOSITY)] += share * thinner
            y[RIPPLE + r] = line
            H[RIPPLE + r, place(LN_RIPPLE + r)] += line
            H[RIPPLE + r, place(CASE_RIPPLE_WARMTH)] += r * anchor[_WARMTH] * line
            H[RIPPLE + r, place(ANSWER)] += line * math.log(ratio)
        y[LINE] = abs(full[ONCE])
        H[LINE, place(ONCE)] = 1.0 if full[ONCE] >= 0.0 else -1.0
    for j in range(N_COMPONENTS):
        by, by_law = direction[0, j], direction[1, j]
        if by != 0.0 or by_law != 0.0:
            at = place(j)
            for i in range(n_rows):
                H[i, AMPLITUDE] += H[i, at] * (by + law * by_law)
                H[i, LAW] += H[i, at] * amplitude * by_law


@compiled
def _whole(state: Array, direction: Array, full: Array) -> None:
    """All components of a state with its fault, into ``full`` (N_COMPONENTS,)."""
    for j in range(N_COMPONENTS):
        full[j] = (direction[0, j] + direction[1, j] * state[LAW]) * state[AMPLITUDE]
        if j < N_LIVING:
            full[j] += state[place(j)]


class Scratch(NamedTuple):
    """Room for ``take``: rows as wide as the slopes, and the small matrices of what was measured."""

    wide: Array
    small: Array


@compiled
def scratch() -> Scratch:
    """Room for ``take``, made once for all filters."""
    return Scratch(np.empty((3 * N_MEASURED + 1, N_SLOPES)), np.empty((3 * N_MEASURED + 5, N_MEASURED)))


@compiled
def expected(m: Array, direction: Array, reading: Reading) -> tuple[float, float, float]:
    """Discharge and case pressure that a filter expects to be measured, and its case over reservoir pressure [bar]."""
    wide, small = scratch()
    H, full, y = wide[:N_MEASURED], wide[3 * N_MEASURED], small[0]
    predicted(m, direction, reading.anchor, reading.ripple, full, y, H, ZERO + 1)
    reservoir = reading.anchor[_P_R] + full[RESERVOIR]
    return float(y[DISCHARGE]), float(y[CASE]), float(y[CASE] - full[CASE_OFFSET] - reservoir)


@compiled
def discrepancy(m: Array, direction: Array, reading: Reading, share: float) -> float:
    """Variance of the case pressure [bar^2] where its deviation from what a filter expects is off by a share of itself."""
    for i in reading.seen:
        if i == CASE:
            _, case, _ = expected(m, direction, reading)
            return float((share * (reading.values[CASE] - case)) ** 2)
    return 0.0


@compiled
def expected_by_both(filters: Filters, n: int, directions: Array, reading: Reading) -> tuple[Expected, Expected]:
    """What the healthy and what the likeliest of the first n filters expect to be measured."""
    f = filters.log_evidence[:n].argmax()
    healthy = expected(filters.mean[0], directions[filters.kind[0]], reading)
    return healthy, expected(filters.mean[f], directions[filters.kind[f]], reading)


@compiled
def case_flow(state: Array, covariance: Array, direction: Array, anchor: Array) -> tuple[float, float]:
    """Case flow of one filter's state at an anchor and its variance [L/min, (L/min)^2]."""
    full, slopes, y = np.empty(N_COMPONENTS), np.empty((3, N_SLOPES)), np.empty(2)
    gradient = np.zeros(N_STATE)
    _whole(state, direction, full)
    flow = pressures(anchor, full, y, slopes)
    for j in range(N_COMPONENTS):
        slope = slopes[2, place(j)]
        gradient[AMPLITUDE] += slope * (direction[0, j] + direction[1, j] * state[LAW])
        gradient[LAW] += slope * direction[1, j] * state[AMPLITUDE]
        if j < N_LIVING:
            gradient[place(j)] = slope
    row, variance = np.zeros(N_STATE), 0.0
    for i in range(N_STATE):
        if gradient[i] != 0.0:
            for j in range(N_STATE):
                row[j] += gradient[i] * covariance[i, j]
    for j in range(N_STATE):
        variance += row[j] * gradient[j]
    return flow, variance


@compiled
def mean_case_flow(
    filters: Filters, weights: Array, directions: Array, anchor: Array, least: float, limit: float, widening: float
) -> tuple[float, float, float, float]:
    """Case flow at an anchor over the filters with at least a ``least`` share: mean, 5 and 95 % quantiles of the mixture,
    and how likely it lies beyond a limit [L/min], each filter's own spread widened.

    Where causes disagree there are several levels: two standard deviations round their mean may hold none of them.
    """
    flows, spreads, shares = np.empty(len(weights)), np.empty(len(weights)), np.empty(len(weights))
    n, whole, mean = 0, 0.0, 0.0
    most = weights.max()
    for f in range(len(weights)):
        if weights[f] < min(least, most):
            continue
        flow, variance = case_flow(filters.mean[f], filters.covariance[f], directions[filters.kind[f]], anchor)
        flows[n], spreads[n], shares[n] = flow, widening * math.sqrt(max(variance, 1.0e-12)), weights[f]
        whole += weights[f]
        mean += weights[f] * flow
        n += 1
    flows, spreads, shares = flows[:n], spreads[:n], shares[:n] / whole
    low, high = _quantile(flows, spreads, shares, 0.05), _quantile(flows, spreads, shares, 0.95)
    return mean / whole, low, high, 1.0 - _below(flows, spreads, shares, limit)


@compiled
def _below(flows: Array, spreads: Array, shares: Array, limit: float) -> float:
    """Share of a mixture of normal laws that lies below a limit."""
    total = 0.0
    for i in range(len(flows)):
        total += shares[i] * 0.5 * math.erfc((flows[i] - limit) / (spreads[i] * math.sqrt(2.0)))
    return total


@compiled
def _quantile(flows: Array, spreads: Array, shares: Array, share: float) -> float:
    """Where that share of a mixture of normal laws lies below, by halving to 1e-4 of what its parts span."""
    low, high = float((flows - 4.0 * spreads).min()), float((flows + 4.0 * spreads).max())
    for _ in range(14):
        middle = 0.5 * (low + high)
        if _below(flows, spreads, shares, middle) < share:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
