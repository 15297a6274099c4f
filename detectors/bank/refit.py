"""Fit filters anew to everything learnt, each linearised about where its own fit ends.

Resistance, weights of its law and flows multiply each other. A filter that met them one record at a time is surer than
it should be, and its evidence with it; passes over the whole history, each about the state that the last one came to,
mend both (Gauss-Newton, outliers found anew in every pass). A fault's amplitude is followed back along its shape: a
step stands since its onset, a ramp grew since then. The healthy pump is tried from the state of the likeliest fault as
well: a poor start there would be read as a fault.
"""

import math

import numpy as np
from numpy.typing import NDArray

from detectors.bank.kernel import advance, take, workspace
from detectors.bank.summary import ARRIVAL, RAMP, STEP
from detectors.expectation.components import AMPLITUDE, N_STATE, RATE, SETTING
from twin.compiled import compiled

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

_PASSES_OF_FAULTS = 2
_YOUNG = 16
"""Records of a history in which every fit is tried from several starts."""
_SETTLED = 0.3
"""A fit ends when no component moves by more than this share of its own spread."""


@compiled
def fit_anew(
    mean: Array,
    covariance: Array,
    kind: Integers,
    shape: Integers,
    onset: Integers,
    log_evidence: Array,
    setting_at_onset: Array,
    rows: Integers,
    base_mean: Array,
    base_variance: Array,
    base_records: int,
    scales: Array,
    ramp_records: float,
    arrival: Array,
    log_prior: Array,
    walk: Array,
    amplitude_walk: Array,
    rate_walk: Array,
    setting_walk: Array,
    directions: Array,
    anchors: Array,
    ripples: Array,
    values: Array,
    noises: Array,
    seen: NDArray[np.bool_],
    record: Integers,
    alive: int,
    most_passes: int,
) -> None:
    """Fit the filters ``rows`` anew, in place.

    Parameters
    ----------
    mean, covariance, kind, shape, onset, log_evidence, setting_at_onset
        The bank; evidence is counted anew from ``log_prior``,
        shape (3, n_kinds): steps, ramps, arrivals; the healthy pump's is 0.
    base_mean, base_variance, base_records
        Where the history begins: state (N,), covariance (N, N), number of records before it.
    scales, ramp_records, arrival
        Spread of steps by kind, records of a ramp, mean and spread of an arrival's amplitude.
    walk, amplitude_walk, rate_walk, setting_walk
        As in ``filter_kernel.advance``; all but the first by filter.
    anchors, ripples, values, noises, seen, record
        Measurements in order, first axis M, and the record that each belongs to.
    alive
        How much of the state is alive (``n`` of ``filter_kernel.take``).
    most_passes
        Over the history, for the healthy pump from each start.
    """
    start, best_mean, best_covariance = np.empty(N_STATE), np.empty(N_STATE), np.empty((N_STATE, N_STATE))
    likeliest = rows[0]
    for f in rows:
        if log_evidence[f] > log_evidence[likeliest]:
            likeliest = f
    other = mean[likeliest].copy()
    young = record[len(record) - 1] - base_records < _YOUNG
    for f in rows:
        k, form = kind[f], shape[f]
        prior = 0.0 if k < 0 else log_prior[form, k]
        spread = scales[k] if form == STEP else scales[k] / ramp_records
        own = mean[f].copy()
        best = -np.inf
        for attempt in range(3 if k < 0 else 1):
            start[:] = own
            # the healthy pump also from where the likeliest fault stands and, young, from its history backwards
            if (attempt == 1 and likeliest == f) or (attempt == 2 and not young):
                continue
            # and what set in since, young, from where the healthy pump came to; who came worn never was that pump
            if attempt == 1 or (k >= 0 and young and form != ARRIVAL):
                start[:] = other
                start[AMPLITUDE], start[RATE] = own[AMPLITUDE], own[RATE]
            for passed in range(most_passes if k < 0 or form == ARRIVAL else _PASSES_OF_FAULTS):
                found = prior + _through(
                    mean[f : f + 1],
                    covariance[f : f + 1],
                    k,
                    form,
                    onset[f],
                    start,
                    attempt == 2 and passed == 0,
                    base_mean,
                    base_variance,
                    base_records,
                    spread,
                    arrival,
                    walk,
                    amplitude_walk[f : f + 1],
                    rate_walk[f : f + 1],
                    setting_walk[f : f + 1],
                    setting_at_onset[f : f + 1],
                    directions[k],
                    anchors,
                    ripples,
                    values,
                    noises,
                    seen,
                    record,
                    alive,
                )
                moved = 0.0
                for j in range(alive):
                    if covariance[f, j, j] > 0.0:
                        moved = max(moved, abs(mean[f, j] - start[j]) / math.sqrt(covariance[f, j, j]))
                if moved < _SETTLED:
                    break
                start[:] = mean[f]
            if found > best:
                best, best_mean[:], best_covariance[:, :] = found, mean[f], covariance[f]
        log_evidence[f], mean[f], covariance[f] = best, best_mean, best_covariance
        if k < 0:
            other[:] = mean[f]


@compiled
def _through(
    m: Array,
    P: Array,
    kind: int,
    shape: int,
    onset: int,
    about: Array,
    backwards: bool,
    base_mean: Array,
    base_variance: Array,
    base_records: int,
    spread: float,
    arrival: Array,
    walk: Array,
    amplitude_walk: Array,
    rate_walk: Array,
    setting_walk: Array,
    setting_at_onset: Array,
    direction: Array,
    anchors: Array,
    ripples: Array,
    values: Array,
    noises: Array,
    seen: NDArray[np.bool_],
    record: Integers,
    alive: int,
) -> float:
    """One pass of one filter over the history, linearised about a state; the logarithm of its predictive densities.

    ``m`` (1, N) and ``P`` (1, N, N) receive the filter; ``spread`` is that of a step or of a ramp's rate.
    ``backwards`` takes a healthy pump's history from its end and weighs records by what came after them: an outlier at
    the beginning, where nothing is known that it could contradict, is found so.
    """
    wide, small = workspace()
    places, point, still = np.empty(seen.shape[1], dtype=np.int64), about.copy(), np.zeros(1)
    amplitude, rate = about[AMPLITUDE], about[RATE]
    last = record[len(record) - 1]
    m[0], P[0] = base_mean, base_variance
    begun = kind < 0
    if shape == ARRIVAL and kind >= 0:
        m[0, AMPLITUDE] = arrival[0]
        P[0, AMPLITUDE, AMPLITUDE] = arrival[1] ** 2
        begun = True
    total, at = 0.0, base_records - 1
    along, grows = 0.0, 0.0
    nowhere, wander = np.empty(0), np.empty(N_STATE)
    for place in range(len(record)):
        i = len(record) - 1 - place if backwards else place
        if record[i] != at:
            at = record[i]
            if not begun and at >= onset:
                begun = True
                setting_at_onset[0] = m[0, SETTING]
                begins = AMPLITUDE if shape == STEP else RATE
                P[0, begins, begins] = spread**2
            if begun:
                advance(m, P, 1, walk, amplitude_walk, rate_walk, setting_walk)
            else:
                advance(m, P, 1, walk, still, still, still)
            if begun and kind >= 0:
                along = amplitude
                if shape == RAMP:
                    # back along the ramp from where it stands, never beyond its foot
                    along, grows = amplitude * (at - onset + 1.0) / max(last - onset + 1.0, 1.0), rate
        n_seen = 0
        for j in range(seen.shape[1]):
            if seen[i, j]:
                places[n_seen] = j
                n_seen += 1
        for j in range(N_STATE):
            point[j] = about[j]
            wander[j] = (last - at) * walk[j]
        wander[SETTING] += (last - max(at, onset)) * setting_walk[0]
        point[AMPLITUDE], point[RATE] = along, grows
        total += take(
            m[0],
            P[0],
            direction,
            anchors[i],
            ripples[i],
            values[i],
            noises[i],
            places,
            n_seen,
            alive,
            1,
            point,
            nowhere if backwards else wander,
            wide,
            small,
        )
    return total
