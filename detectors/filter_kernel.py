"""One step of every filter of a bank: predict, weigh, update. Compiled; plain arrays, nothing allocated per filter."""

import math

import numpy as np
from numpy.typing import NDArray

from detectors.components import CASE_OFFSET, LN_RIPPLE, N_COMPONENTS, ONCE, RESERVOIR
from detectors.reduced_twin import pressures
from twin.compiled import compiled

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

STUDENT_DEGREES = 5.0
N_MEASURED = 6
"""Discharge pressure, case pressure, zero of the case sensor, order n of both pressures, line at once per turn."""
DISCHARGE, CASE, ZERO, RIPPLE, CASE_RIPPLE, LINE = range(N_MEASURED)

_AMPLITUDE, _RATE, _N = N_COMPONENTS, N_COMPONENTS + 1, N_COMPONENTS + 2


@compiled
def predicted(
    state: Array, direction: Array, anchor: Array, ripple: Array, full: Array, slopes: Array, y: Array, H: Array
) -> None:
    """What a state says the sensors show, ``y`` (6,), and its slopes ``H`` (6, N_STATE).

    ``direction`` (N_COMPONENTS,) is what the amplitude moves; ``ripple`` holds the relative slopes of order n of both
    pressures by the components, shape (2, N_COMPONENTS); ``full`` and ``slopes`` are work space.
    """
    for j in range(N_COMPONENTS):
        full[j] = state[j] + direction[j] * state[_AMPLITUDE]
    pressures(anchor, full, y, slopes)
    H[:, :] = 0.0
    for j in range(N_COMPONENTS):
        H[0, j], H[1, j] = slopes[0, j], slopes[1, j]
    y[1] += full[CASE_OFFSET]
    H[1, CASE_OFFSET] = 1.0
    y[2] = full[CASE_OFFSET] + full[RESERVOIR]
    H[2, CASE_OFFSET], H[2, RESERVOIR] = 1.0, 1.0
    for r in range(2):
        gain = math.exp(full[LN_RIPPLE + r])
        ratio = 1.0
        for j in range(N_COMPONENTS):
            ratio += ripple[r, j] * full[j]
            H[3 + r, j] = gain * ripple[r, j]
        y[3 + r] = gain * ratio
        H[3 + r, LN_RIPPLE + r] += gain * ratio
    y[LINE] = abs(full[ONCE])
    H[LINE, ONCE] = 1.0 if full[ONCE] >= 0.0 else -1.0
    for i in range(N_MEASURED):
        total = 0.0
        for j in range(N_COMPONENTS):
            total += H[i, j] * direction[j]
        H[i, _AMPLITUDE] = total


@compiled
def _cholesky(A: Array, n: int) -> bool:
    """Lower factor of the first n rows of A in place; False when A is not positive definite."""
    for j in range(n):
        d = A[j, j]
        for k in range(j):
            d -= A[j, k] * A[j, k]
        if not d > 0.0:
            return False
        A[j, j] = math.sqrt(d)
        for i in range(j + 1, n):
            s = A[i, j]
            for k in range(j):
                s -= A[i, k] * A[j, k]
            A[i, j] = s / A[j, j]
    return True


@compiled
def step(
    mean: Array,
    covariance: Array,
    kind: Integers,
    log_evidence: Array,
    n_filters: int,
    directions: Array,
    anchor: Array,
    ripple: Array,
    values: Array,
    noise: Array,
    seen: Integers,
    iterations: int,
    about: Array,
) -> None:
    """Take one measurement into every filter, in place.

    Parameters
    ----------
    mean, covariance, kind, log_evidence
        The bank, shapes (M, N), (M, N, N), (M,), (M,); the first ``n_filters`` count. Kind -1 is the healthy pump.
    directions
        What each kind moves, shape (n_kinds + 1, N_COMPONENTS); the last row, zeros, serves the healthy pump.
    anchor, ripple
        The nominal twin at the condition, and its order n.
    values, noise
        What was measured, shape (6,), and its covariance, shape (6, 6).
    seen
        Which of the six were measured, in rising order, shape (k,).
    iterations
        How often the twin is linearised anew about the updated state.
    about
        Where to linearise instead of at each filter's own state, shape (N,); empty: at its own.
    """
    k = len(seen)
    y, H = np.empty(N_MEASURED), np.empty((N_MEASURED, _N))
    full, slopes = np.empty(N_COMPONENTS), np.empty((2, N_COMPONENTS))
    PH = np.empty((N_MEASURED, _N))
    S, L = np.empty((N_MEASURED, N_MEASURED)), np.empty((N_MEASURED, N_MEASURED))
    innovation, white = np.empty(N_MEASURED), np.empty(N_MEASURED)
    W = np.empty((N_MEASURED, _N))
    point = np.empty(_N)
    for f in range(n_filters):
        m, P = mean[f], covariance[f]
        direction = directions[kind[f]]
        for i in range(_N):
            point[i] = m[i] if len(about) == 0 else about[i]
        for iteration in range(iterations):
            predicted(point, direction, anchor, ripple, full, slopes, y, H)
            for a in range(k):
                ia = seen[a]
                innovation[a] = values[ia] - y[ia]
                for j in range(_N):
                    innovation[a] -= H[ia, j] * (m[j] - point[j])
                for i in range(_N):
                    total = 0.0
                    for j in range(_N):
                        total += P[i, j] * H[ia, j]
                    PH[a, i] = total
            for a in range(k):
                for b in range(k):
                    total = 0.0
                    for j in range(_N):
                        total += H[seen[a], j] * PH[b, j]
                    S[a, b] = total
                    L[a, b] = total + noise[seen[a], seen[b]]
            good = _cholesky(L, k)
            distance, log_det = 0.0, 0.0
            if good:
                distance, log_det = _whitened(L, innovation, white, k)
            if not (good and distance < 1.0e300):
                log_evidence[f] -= 50.0
                break
            if iteration == 0:
                log_evidence[f] += -0.5 * log_det - 0.5 * (STUDENT_DEGREES + k) * math.log1p(distance / STUDENT_DEGREES)
            inflation = max(1.0, (STUDENT_DEGREES + distance) / (STUDENT_DEGREES + k))
            if inflation > 1.0:
                for a in range(k):
                    for b in range(k):
                        L[a, b] = S[a, b] + inflation * noise[seen[a], seen[b]]
                _cholesky(L, k)
                _whitened(L, innovation, white, k)
            # W = L^-1 P H': then the mean moves by W' white and the covariance falls by W' W
            for a in range(k):
                for i in range(_N):
                    total = PH[a, i]
                    for b in range(a):
                        total -= L[a, b] * W[b, i]
                    W[a, i] = total / L[a, a]
            for i in range(_N):
                total = m[i]
                for a in range(k):
                    total += W[a, i] * white[a]
                point[i] = total
            if iteration == iterations - 1:
                for i in range(_N):
                    for j in range(i + 1):
                        total = P[i, j]
                        for a in range(k):
                            total -= W[a, i] * W[a, j]
                        P[i, j] = total
                        P[j, i] = total
                for i in range(_N):
                    m[i] = point[i]


@compiled
def _whitened(L: Array, innovation: Array, white: Array, k: int) -> tuple[float, float]:
    """``white = L^-1 innovation``; its square sum and the log determinant of L L'."""
    distance, log_det = 0.0, 0.0
    for a in range(k):
        total = innovation[a]
        for b in range(a):
            total -= L[a, b] * white[b]
        white[a] = total / L[a, a]
        distance += white[a] * white[a]
        log_det += 2.0 * math.log(L[a, a])
    return distance, log_det


@compiled
def advance(
    mean: Array, covariance: Array, n_filters: int, walk: Array, amplitude_walk: Array, rate_walk: Array
) -> None:
    """From one record to the next, in place: amplitudes grow by their rate, every component wanders.

    ``walk`` holds variances, shape (N,); ``amplitude_walk`` and ``rate_walk`` those of each filter's amplitude and of its
    rate, shape (M,).
    """
    for f in range(n_filters):
        m, P = mean[f], covariance[f]
        if P[_RATE, _RATE] > 0.0:
            m[_AMPLITUDE] += m[_RATE]
            for i in range(_N):
                P[_AMPLITUDE, i] += P[_RATE, i]
            for i in range(_N):
                P[i, _AMPLITUDE] += P[i, _RATE]
        for i in range(_N):
            P[i, i] += walk[i]
        P[_AMPLITUDE, _AMPLITUDE] += amplitude_walk[f]
        P[_RATE, _RATE] += rate_walk[f]


@compiled
def case_flow(state: Array, covariance: Array, direction: Array, anchor: Array) -> tuple[float, float]:
    """Case flow of one filter's state at an anchor and its variance [L/min, (L/min)^2], by forward differences."""
    full, slopes, y = np.empty(N_COMPONENTS), np.empty((2, N_COMPONENTS)), np.empty(2)
    for j in range(N_COMPONENTS):
        full[j] = state[j] + direction[j] * state[_AMPLITUDE]
    flow = pressures(anchor, full, y, slopes)
    gradient = np.zeros(_N)
    h = 1.0e-4
    for j in range(N_COMPONENTS):
        full[j] += h
        gradient[j] = (pressures(anchor, full, y, slopes) - flow) / h
        full[j] -= h
        gradient[_AMPLITUDE] += gradient[j] * direction[j]
    variance = 0.0
    for i in range(_N):
        for j in range(_N):
            variance += gradient[i] * covariance[i, j] * gradient[j]
    return flow, variance
