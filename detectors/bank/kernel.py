"""One step of every filter of a bank: predict, weigh, update. Compiled; plain arrays, nothing allocated per filter."""

import math

import numpy as np

from detectors.bank.prediction import N_MEASURED, ZERO, Scratch, predicted, scratch
from detectors.bank.shapes import ON_OFF, OPEN, REMEMBERED, Array, Filters, Freed, Reading, Walks
from detectors.expectation.components import (
    AMPLITUDE,
    N_STATE,
    RATE,
    RESERVOIR,
    SETTING,
)
from detectors.words.numbers import STUDENT_DEGREES
from twin.compiled import compiled, inlined

_EXPLAINED = (16.0, 19.3, 22.1, 24.5, 26.9, 29.1)
"""Squared distance up to which k numbers count as explained: what one good record in 16,000 exceeds (chi-squared)."""
_OPEN_SD = (5.0, 0.5, 0.3, 0.5, 0.5, 0.1)
"""How far apart two records of one pump may lie when nothing is known of the reason, by what is measured (estimates: a
tenth of what the sensors span, and no less than the largest faults that have a name move)."""
GROWS_ON = 0.95
"""Share of its rate with which a fault still grows a record later: growth that nothing sustains ends within some twenty records
(estimate; wear of ten flights that then stood was neither a step nor a ramp, and whoever misfitted it least was named)."""
_REMEMBERED = 2**REMEMBERED - 1
_IMPOSSIBLE = -50.0
"""Log density of a measurement that a filter cannot weigh (estimate: far below any outlier's, and no infinity) [nat]."""


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
def _less(P: Array, W: Array, k: int, n: int) -> None:
    """``P -= W' W``, up to three rows of W at a time."""
    for a in range(0, k, 3):
        left = k - a
        for i in range(n):
            u = W[a, i]
            if left >= 3:
                v, w = W[a + 1, i], W[a + 2, i]
                for j in range(n):
                    P[i, j] -= u * W[a, j] + v * W[a + 1, j] + w * W[a + 2, j]
            elif left == 2:
                v = W[a + 1, i]
                for j in range(n):
                    P[i, j] -= u * W[a, j] + v * W[a + 1, j]
            else:
                for j in range(n):
                    P[i, j] -= u * W[a, j]


@inlined
def take(
    m: Array,
    P: Array,
    direction: Array,
    reading: Reading,
    n: int,
    iterations: int,
    point: Array,
    wander: Array,
    room: Scratch,
) -> tuple[float, float]:
    """Take one measurement into one filter, in place.

    Gives the logarithm of its predictive density (without constants), and its squared distance over the largest that
    counts as explained.

    Parameters
    ----------
    m, P
        Mean and covariance, shapes (N,) and (N, N).
    direction, reading
        What the filter's amplitude moves, and what was measured.
    n
        How much of the state is alive (``Bank.alive``).
    iterations
        How often the twin is linearised anew about the updated state.
    point
        Where to linearise first, shape (N,); overwritten.
    wander
        Variance by which the state may have moved between here and ``point``, shape (N,), where that was fitted to a
        whole history and may say by itself that this measurement is an outlier; empty where it was not.
    room
        From ``scratch``.
    """
    anchor, ripple, values, noise, seen = reading
    wide, small = room
    k = len(seen)
    # n is no constant: loops of known length would be unrolled and done one number at a time
    H, PH, W = wide[:N_MEASURED], wide[N_MEASURED : 2 * N_MEASURED], wide[2 * N_MEASURED : 3 * N_MEASURED]
    full = wide[3 * N_MEASURED]
    S, L = small[:N_MEASURED], small[N_MEASURED : 2 * N_MEASURED]
    y, innovation, white = small[2 * N_MEASURED], small[2 * N_MEASURED + 1], small[2 * N_MEASURED + 2]
    log_density, misfit = 0.0, 0.0
    for iteration in range(iterations):
        predicted(point, direction, anchor, ripple, full, y, H, max(seen[k - 1], ZERO) + 1)
        for a in range(k):
            ia = seen[a]
            innovation[a] = _projected(values[ia] - y[ia], H[ia], m, P, point, n, PH[a])
            for b in range(a + 1):
                total = 0.0
                for j in range(n):
                    total += H[ia, j] * PH[b, j]
                S[a, b] = total
                L[a, b] = total + noise[ia, seen[b]]
        good = _cholesky(L, k)
        distance, log_det = 0.0, 0.0
        if good:
            distance, log_det = _whitened(L, innovation, white, k)
        if not (good and distance < 1.0e300):
            return log_density + _IMPOSSIBLE, np.inf
        if iteration == 0:
            misfit = distance / _EXPLAINED[k - 1]
            log_density = -0.5 * log_det - 0.5 * (STUDENT_DEGREES + k) * math.log1p(distance / STUDENT_DEGREES)
        if len(wander) > 0:
            distance = max(distance, _residual_distance(H, y, reading, n, wander, small))
        inflation = max(1.0, (STUDENT_DEGREES + distance) / (STUDENT_DEGREES + k))
        if inflation > 1.0:
            for a in range(k):
                for b in range(a + 1):
                    L[a, b] = S[a, b] + inflation * noise[seen[a], seen[b]]
            _cholesky(L, k)
            _whitened(L, innovation, white, k)
        # W = L^-1 P H': then the mean moves by W' white and the covariance falls by W' W
        for i in range(n):
            point[i] = m[i]
        for a in range(k):
            own, move = W[a], white[a]
            for i in range(n):
                own[i] = PH[a, i]
            for b in range(a % 2, a, 2):
                u, v = L[a, b], L[a, b + 1]
                for i in range(n):
                    own[i] -= u * W[b, i] + v * W[b + 1, i]
            factor = 1.0 / L[a, a]
            if a % 2 == 1:
                u = L[a, 0]
                for i in range(n):
                    own[i] = factor * (own[i] - u * W[0, i])
                    point[i] += own[i] * move
            else:
                for i in range(n):
                    own[i] *= factor
                    point[i] += own[i] * move
    _less(P, W, k, n)
    for i in range(n):
        m[i] = point[i]
    return log_density, misfit


@inlined
def _projected(off: float, h: Array, m: Array, P: Array, point: Array, n: int, row: Array) -> float:
    """``row = h P`` over the living n; what is left of ``off``, measured at ``point``, at the mean."""
    for j in range(n):
        row[j] = 0.0
    for i in range(n):
        slope = h[i]
        if slope != 0.0:
            off -= slope * (m[i] - point[i])
            for j in range(n):
                row[j] += slope * P[i, j]
    return off


@compiled
def _residual_distance(H: Array, y: Array, reading: Reading, n: int, wander: Array, small: Array) -> float:
    """Squared distance of what was measured from what the linearisation point says, in noise and wander."""
    values, noise, seen = reading.values, reading.noise, reading.seen
    k = len(seen)
    L, residual, white = (
        small[2 * N_MEASURED + 3 : 3 * N_MEASURED + 3],
        small[3 * N_MEASURED + 3],
        small[3 * N_MEASURED + 4],
    )
    for a in range(k):
        residual[a] = values[seen[a]] - y[seen[a]]
        for b in range(a + 1):
            total = noise[seen[a], seen[b]]
            for j in range(n):
                total += H[seen[a], j] * H[seen[b], j] * wander[j]
            L[a, b] = total
    if not _cholesky(L, k):
        return 0.0
    distance, _ = _whitened(L, residual, white, k)
    return distance


@compiled
def step(filters: Filters, n_filters: int, directions: Array, reading: Reading, n: int, iterations: int) -> None:
    """Take one measurement into the first ``n_filters`` filters, in place.

    What comes and goes is asked twice, with its fault and without it, and goes on from the likelier answer.

    Parameters
    ----------
    directions
        What each kind moves (``Kinds.directions``).
    reading, n, iterations
        As in ``take``.
    """
    mean, covariance, kind, log_evidence = filters.mean, filters.covariance, filters.kind, filters.log_evidence
    room = scratch()
    point, nowhere, nothing = np.empty(N_STATE), np.empty(0), directions[len(directions) - 1]
    before, spread_before = np.empty(N_STATE), np.empty((N_STATE, N_STATE))
    shown, spread_shown = np.empty(N_STATE), np.empty((N_STATE, N_STATE))
    for f in range(n_filters):
        m, P = mean[f], covariance[f]
        if filters.shape[f] == OPEN:
            log_evidence[f] += _open_density(m, reading, nothing, room)
            filters.misfit[f] = np.inf
            continue
        comes_and_goes = filters.shape[f] == ON_OFF
        if comes_and_goes:
            before[:], spread_before[:, :] = m, P
        with_fault, misfit_shown = 0.0, 0.0
        for attempt in range(2 if comes_and_goes else 1):
            for i in range(N_STATE):
                point[i] = m[i]
            direction = directions[kind[f]] if attempt == 0 else nothing
            found, misfit = take(m, P, direction, reading, n, iterations, point, nowhere, room)
            if not comes_and_goes:
                log_evidence[f] += found
                filters.misfit[f] = max(filters.misfit[f], misfit)
            elif attempt == 0:
                with_fault, misfit_shown = found, misfit
                shown[:], spread_shown[:, :] = m, P
                m[:], P[:, :] = before, spread_before
            else:
                log_evidence[f] += _log_half_of(with_fault, found)
                if with_fault > found:
                    m[:], P[:, :] = shown, spread_shown
                    misfit = misfit_shown
                    filters.shown[f] |= 1
                filters.misfit[f] = max(filters.misfit[f], misfit)


@compiled
def surprise(filters: Filters, n_filters: int, directions: Array, reading: Reading, n: int) -> float:
    """Squared distance of a measurement from what the likeliest filter expects, over the largest that counts as explained."""
    f = filters.log_evidence[:n_filters].argmax()
    m, P = filters.mean[f], filters.covariance[f]
    room, point = scratch(), m.copy()
    return take(m.copy(), P.copy(), directions[filters.kind[f]], reading, n, 1, point, np.empty(0), room)[1]


@compiled
def _log_half_of(a: float, b: float) -> float:
    """Logarithm of the mean of two numbers that are given as logarithms."""
    high, low = max(a, b), min(a, b)
    return high + math.log1p(math.exp(low - high)) - math.log(2.0)


@compiled
def _open_density(m: Array, reading: Reading, direction: Array, room: Scratch) -> float:
    """Logarithm of the predictive density of whoever knows nothing but how far apart two records may lie."""
    anchor, ripple, values, noise, seen = reading
    wide, small = room
    H, full, y = wide[:N_MEASURED], wide[3 * N_MEASURED], small[0]
    k = len(seen)
    predicted(m, direction, anchor, ripple, full, y, H, max(seen[k - 1], ZERO) + 1)
    distance, log_det = 0.0, 0.0
    for a in range(k):
        i = seen[a]
        variance = noise[i, i] + _OPEN_SD[i] * _OPEN_SD[i]
        distance += (values[i] - y[i]) ** 2 / variance
        log_det += math.log(variance)
    return -0.5 * log_det - 0.5 * (STUDENT_DEGREES + k) * math.log1p(distance / STUDENT_DEGREES)


@compiled
def remembered(filters: Filters, n_filters: int) -> None:
    """A record is over: note which of the first filters explained it, and make room for the next, in place."""
    for f in range(n_filters):
        bit = 1 if filters.misfit[f] > 1.0 else 0
        filters.unexplained[f] = (filters.unexplained[f] << 1 | bit) & _REMEMBERED
        filters.misfit[f] = 0.0


@compiled
def begun(filters: Filters, n_filters: int) -> None:
    """A record begins: no fault has shown in it yet, in place."""
    for f in range(n_filters):
        filters.shown[f] = filters.shown[f] << 1 & _REMEMBERED


@compiled
def pass_time(filters: Filters, n_filters: int, walks: Walks, reservoir: float) -> None:
    """From the last record to the next, which begins, in place; ``reservoir`` is what its pressure wanders by beside [bar^2]."""
    advance(filters, n_filters, walks)
    if reservoir > 0.0:
        for f in range(n_filters):
            filters.covariance[f, RESERVOIR, RESERVOIR] += reservoir
    begun(filters, n_filters)


@compiled
def close(filters: Filters, n_filters: int) -> None:
    """A record has been taken, in place: evidence counts from the likeliest filter on, and who explained it is noted."""
    log_evidence = filters.log_evidence[:n_filters]
    log_evidence -= log_evidence.max()
    remembered(filters, n_filters)


@compiled
def _whitened(L: Array, innovation: Array, white: Array, k: int) -> tuple[float, float]:
    """``white = L^-1 innovation``; its square sum and the log determinant of L L'."""
    distance, root = 0.0, 1.0
    for a in range(k):
        total = innovation[a]
        for b in range(a):
            total -= L[a, b] * white[b]
        white[a] = total / L[a, a]
        distance += white[a] * white[a]
        root *= L[a, a]
    return distance, 2.0 * math.log(root)


@compiled
def advance(filters: Filters, n_filters: int, walks: Walks) -> None:
    """From one record to the next, in place: amplitudes grow by their rate, every component wanders."""
    for f in range(n_filters):
        shape, kind = filters.shape[f], filters.kind[f]
        amplitude, rate, setting = walks.amplitude[shape, kind], walks.rate[shape, kind], walks.setting[kind]
        wandered(filters.mean[f], filters.covariance[f], walks.state, amplitude, rate, setting)


@compiled
def wandered(m: Array, P: Array, walk: Array, amplitude: float, rate: float, setting: float) -> None:
    """One filter from one record to the next, in place; ``walk`` (N,) and the rest are variances."""
    if P[RATE, RATE] > 0.0:
        m[AMPLITUDE] += m[RATE]
        m[RATE] *= GROWS_ON
        for i in range(N_STATE):
            P[AMPLITUDE, i] += P[RATE, i]
            P[RATE, i] *= GROWS_ON
        P[AMPLITUDE, AMPLITUDE] += P[AMPLITUDE, RATE]
        P[AMPLITUDE, RATE] *= GROWS_ON
        P[RATE, RATE] *= GROWS_ON
        P[RATE, AMPLITUDE] = P[AMPLITUDE, RATE]
        for i in range(N_STATE):
            P[i, AMPLITUDE], P[i, RATE] = P[AMPLITUDE, i], P[RATE, i]
    for i in range(N_STATE):
        P[i, i] += walk[i]
    P[AMPLITUDE, AMPLITUDE] += amplitude
    P[RATE, RATE] += rate
    P[SETTING, SETTING] += setting


@compiled
def free(m: Array, P: Array, freed: Freed, event: int) -> None:
    """One filter's component is unknown again, in place: nothing that was learnt of it holds any more.

    Where no mean is given, it is as it was, give or take the variance.
    """
    j = freed.place[event]
    if math.isnan(freed.mean[event]):
        P[j, j] += freed.variance[event]
        return
    for i in range(N_STATE):
        P[i, j] = 0.0
        P[j, i] = 0.0
    m[j], P[j, j] = freed.mean[event], freed.variance[event]
