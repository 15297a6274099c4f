"""Fit filters anew to everything learnt, each linearised about where it stands now.

Resistance, weights of its law and flows multiply each other. A filter that met them one record at a time is surer than
it should be, and its evidence with it; a second pass about the state that it came to mends both (Gauss-Newton with one
step, over the whole history). A fault's amplitude is followed back along its shape: a step stands since its onset, a
ramp grew since then.
"""

import numpy as np
from numpy.typing import NDArray

from detectors.components import N_COMPONENTS
from detectors.filter_kernel import advance, step
from detectors.filter_summary import ARRIVAL, RAMP, STEP
from twin.compiled import compiled

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

_AMPLITUDE, _RATE, _N = N_COMPONENTS, N_COMPONENTS + 1, N_COMPONENTS + 2


@compiled
def fit_anew(
    mean: Array,
    covariance: Array,
    kind: Integers,
    shape: Integers,
    onset: Integers,
    log_evidence: Array,
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
    directions: Array,
    anchors: Array,
    ripples: Array,
    values: Array,
    noises: Array,
    seen: NDArray[np.bool_],
    record: Integers,
) -> None:
    """Fit the filters ``rows`` anew, in place.

    Parameters
    ----------
    mean, covariance, kind, shape, onset, log_evidence
        The bank; evidence is counted anew from ``log_prior`` by shape (steps, ramps, arrivals; the healthy pump's is 0).
    base_mean, base_variance, base_records
        Where the history begins: state (N,), covariance (N, N), number of records before it.
    scales, ramp_records, arrival
        Spread of steps by kind, records of a ramp, mean and spread of an arrival's amplitude.
    walk, amplitude_walk, rate_walk
        As in ``filter_kernel.advance``; the last two by filter.
    anchors, ripples, values, noises, seen, record
        Measurements in order, first axis M, and the record that each belongs to.
    """
    nowhere = np.zeros(1)
    for f in rows:
        m, P = mean[f : f + 1], covariance[f : f + 1]
        k, e = kind[f : f + 1], log_evidence[f : f + 1]
        about = m[0].copy()
        amplitude, rate = about[_AMPLITUDE], about[_RATE]
        last = record[len(record) - 1]
        m[0], P[0] = base_mean, base_variance
        e[0] = 0.0 if k[0] < 0 else log_prior[shape[f]]
        begun = k[0] < 0
        if shape[f] == ARRIVAL and k[0] >= 0:
            m[0, _AMPLITUDE] = arrival[0]
            P[0, _AMPLITUDE, _AMPLITUDE] = arrival[1] ** 2
            begun = True
        at = base_records - 1
        for i in range(len(record)):
            if record[i] != at:
                at = record[i]
                if not begun and at >= onset[f]:
                    begun = True
                    if shape[f] == STEP:
                        P[0, _AMPLITUDE, _AMPLITUDE] = scales[k[0]] ** 2
                    else:
                        P[0, _RATE, _RATE] = (scales[k[0]] / ramp_records) ** 2
                if begun:
                    advance(m, P, 1, walk, amplitude_walk[f : f + 1], rate_walk[f : f + 1])
                else:
                    advance(m, P, 1, walk, nowhere, nowhere)
                about[_AMPLITUDE], about[_RATE] = 0.0, 0.0
                if begun and k[0] >= 0:
                    about[_AMPLITUDE] = amplitude
                    if shape[f] == RAMP:
                        # back along the ramp from where it stands, never beyond its foot
                        share = (at - onset[f] + 1.0) / max(last - onset[f] + 1.0, 1.0)
                        about[_AMPLITUDE], about[_RATE] = amplitude * share, rate
            which = np.flatnonzero(seen[i])
            step(m, P, k, e, 1, directions, anchors[i], ripples[i], values[i], noises[i], which, 1, about)
