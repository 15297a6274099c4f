"""What a bank says in sums: weights by state and by quantity. Compiled, one pass over the filters."""

import math

import numpy as np
from numpy.typing import NDArray

from detectors.expectation.components import AMPLITUDE, RATE, SETTING
from twin.compiled import compiled

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

STEP, RAMP, ARRIVAL = 0, 1, 2
"""Shapes of a fault: there at once, growing, there from the first record on."""


@compiled
def log_normal_above(z: float) -> float:
    """Logarithm of the standard normal distribution function at z."""
    if z > -8.0:
        return math.log(0.5 * math.erfc(-z / math.sqrt(2.0)))
    return -0.5 * z * z - math.log(-z * math.sqrt(2.0 * math.pi))


@compiled
def summed(
    mean: Array,
    covariance: Array,
    kind: Integers,
    shape: Integers,
    onset: Integers,
    log_evidence: Array,
    setting_at_onset: Array,
    records: int,
    signs: Integers,
    floors: Array,
    states: Integers,
    beside: Integers,
    setting: Array,
    scales: Array,
    groups: Integers,
    weights: Array,
    all_sums: Array,
    changed: Array,
    together: Array,
    moments: Array,
) -> float:
    """Sum the filters, in place; returns the share of pumps that came worn.

    Parameters
    ----------
    mean, covariance, kind, shape, onset, log_evidence, setting_at_onset
        The bank's filters, first axis m.
    records
        Number of records seen.
    beside, setting, scales
        By kind, the healthy pump last: number of the state of the second fault (-1: none); scale, floor and quantity
        of a moved setting; scales of the kinds. The larger fault, each by its scale, is the first.
    signs, floors, states, groups
        By kind of fault, the healthy pump (-1) last: sign, smallest size worth a word (arrivals: the entry after the
        healthy pump's), number of the state, number of the quantity (-1: none).
    weights
        Receives posterior shares, shape (m,); one-sided faults are weighed by the sign they came out with.
    all_sums, changed
        Receive the shares by state, the healthy pump last, shape (n_states + 1,): of all, and of what changed since the
        first record (an arrival counts as healthy there).
    together
        Receives the shares of two faults by state of the first and of the second, shape (n_states, n_states).
    moments
        Receives by quantity: share, first and second moment of the amplitude, and how well a sudden fault of the first
        such kind is known since its oldest onset (0: no onset has seen two records), shape (n_quantities, 4).
    """
    m = len(kind)
    most = -1.0e300
    for f in range(m):
        weights[f] = log_evidence[f]
        if kind[f] >= 0 and signs[kind[f]] == 1:
            spread = math.sqrt(max(covariance[f, AMPLITUDE, AMPLITUDE], 1.0e-300))
            weights[f] += log_normal_above(mean[f, AMPLITUDE] / spread) + math.log(2.0)
        most = max(most, weights[f])
    total = 0.0
    for f in range(m):
        weights[f] = math.exp(weights[f] - most)
        total += weights[f]
    all_sums[:], changed[:], moments[:, :], together[:, :] = 0.0, 0.0, 0.0, 0.0
    healthy = len(all_sums) - 1
    arrived = 0.0
    n_groups = len(moments)
    oldest = np.full(n_groups, records)
    first_kind = np.full(n_groups, -1)
    for k in range(len(groups) - 1, -1, -1):
        if groups[k] >= 0:
            first_kind[groups[k]] = k
    for f in range(m):
        weights[f] /= total
        w, k, amplitude = weights[f], kind[f], mean[f, AMPLITUDE]
        floor = floors[k] if shape[f] != ARRIVAL else floors[len(floors) - 1]
        place = states[k] if abs(amplitude) >= floor and k >= 0 else healthy
        if k >= 0 and beside[k] >= 0:
            change = mean[f, SETTING] - setting_at_onset[f]
            if abs(change) >= setting[1]:
                first, second = place, beside[k]
                if abs(change) / setting[0] > abs(amplitude) / scales[k]:
                    first, second = second, place
                if place == healthy:
                    first = beside[k]
                else:
                    together[first, second] += w
                place = first
                g = int(setting[2])
                moments[g, 0] += w
                moments[g, 1] += w * change
                moments[g, 2] += w * (covariance[f, SETTING, SETTING] + change * change)
        all_sums[place] += w
        if shape[f] == ARRIVAL:
            changed[healthy] += w
            if place != healthy:
                arrived += w
        else:
            changed[place] += w
        if k < 0 or groups[k] < 0:
            continue
        g = groups[k]
        variance = max(covariance[f, AMPLITUDE, AMPLITUDE], 0.0)
        moments[g, 0] += w
        moments[g, 1] += w * amplitude
        moments[g, 2] += w * (variance + amplitude * amplitude)
        if k == first_kind[g] and shape[f] == STEP and onset[f] <= records - 2 and onset[f] < oldest[g]:
            oldest[g] = onset[f]
            moments[g, 3] = math.sqrt(variance)
    return arrived


@compiled
def spawned(
    mean: Array,
    covariance: Array,
    kind: Integers,
    shape: Integers,
    onset: Integers,
    log_evidence: Array,
    setting_at_onset: Array,
    n: int,
    records: int,
    scales: Array,
    ramp_records: float,
    log_priors: Array,
    most_onsets: Integers,
) -> int:
    """A step and a ramp of each kind setting in now, in place; the least likely old onset gives way. New count.

    The last kind begins where the likeliest fault stands, without it: the fault is gone.

    ``most_onsets`` holds how many of a shape and kind are kept, shape (2, n_kinds), ``log_priors`` how likely each sets in,
    shape (at least 2, n_kinds).
    """
    likeliest, gone = 0, len(scales) - 1
    for f in range(n):
        if kind[f] != gone and log_evidence[f] > log_evidence[likeliest]:
            likeliest = f
    undone, undone_spread, undone_evidence = (
        mean[likeliest].copy(),
        covariance[likeliest].copy(),
        log_evidence[likeliest],
    )
    for k in range(len(scales)):
        if k == gone and likeliest == 0:
            continue
        for form in (STEP, RAMP):
            if most_onsets[form, k] == 0:
                continue
            held, place = 0, -1
            for f in range(n):
                if kind[f] == k and shape[f] == form:
                    held += 1
                    if place < 0 or log_evidence[f] < log_evidence[place]:
                        place = f
            if held < most_onsets[form, k]:
                place = n
                n += 1
            mean[place], covariance[place] = mean[0], covariance[0]
            if form == STEP:
                covariance[place, AMPLITUDE, AMPLITUDE] = scales[k] ** 2
            else:
                covariance[place, RATE, RATE] = (scales[k] / ramp_records) ** 2
            kind[place], shape[place], onset[place] = k, form, records
            setting_at_onset[place] = mean[0, SETTING]
            if k == gone:
                mean[place], covariance[place] = undone, undone_spread
                for i in (AMPLITUDE, RATE):
                    mean[place, i], covariance[place, i, :], covariance[place, :, i] = 0.0, 0.0, 0.0
            log_evidence[place] = (undone_evidence if k == gone else log_evidence[0]) + log_priors[form, k]
    return n
