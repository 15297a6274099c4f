"""Fit filters anew to everything learnt, each linearised about where it stands now.

Resistance, weights of its law and flows multiply each other. A filter that met them one record at a time is surer than
it should be, and its evidence with it; a second pass about the state that it came to mends both (Gauss-Newton with one
step, over the whole history). A fault's amplitude is followed back along its shape: a step stands since its onset, a
ramp grew since then.
"""

import numpy as np
from numpy.typing import NDArray

from detectors.components import AMPLITUDE, N_STATE, RATE
from detectors.filter_kernel import advance, take, workspace
from detectors.filter_summary import ARRIVAL, RAMP, STEP
from twin.compiled import compiled

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


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
    alive: int,
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
    alive
        How much of the state is alive (``n`` of ``filter_kernel.take``).
    """
    still = np.zeros(1)
    wide, small = workspace()
    places, point = np.empty(seen.shape[1], dtype=np.int64), np.empty(N_STATE)
    last = record[len(record) - 1]
    for f in rows:
        m, P = mean[f : f + 1], covariance[f : f + 1]
        k, direction = kind[f], directions[kind[f]]
        about = m[0].copy()
        amplitude, rate = about[AMPLITUDE], about[RATE]
        m[0], P[0] = base_mean, base_variance
        log_evidence[f] = 0.0 if k < 0 else log_prior[shape[f]]
        begun = k < 0
        if shape[f] == ARRIVAL and k >= 0:
            m[0, AMPLITUDE] = arrival[0]
            P[0, AMPLITUDE, AMPLITUDE] = arrival[1] ** 2
            begun = True
        at = base_records - 1
        for i in range(len(record)):
            if record[i] != at:
                at = record[i]
                if not begun and at >= onset[f]:
                    begun = True
                    if shape[f] == STEP:
                        P[0, AMPLITUDE, AMPLITUDE] = scales[k] ** 2
                    else:
                        P[0, RATE, RATE] = (scales[k] / ramp_records) ** 2
                if begun:
                    advance(m, P, 1, walk, amplitude_walk[f : f + 1], rate_walk[f : f + 1])
                else:
                    advance(m, P, 1, walk, still, still)
                about[AMPLITUDE], about[RATE] = 0.0, 0.0
                if begun and k >= 0:
                    about[AMPLITUDE] = amplitude
                    if shape[f] == RAMP:
                        # back along the ramp from where it stands, never beyond its foot
                        share = (at - onset[f] + 1.0) / max(last - onset[f] + 1.0, 1.0)
                        about[AMPLITUDE], about[RATE] = amplitude * share, rate
            n_seen = 0
            for j in range(seen.shape[1]):
                if seen[i, j]:
                    places[n_seen] = j
                    n_seen += 1
            for j in range(N_STATE):
                point[j] = about[j]
            log_evidence[f] += take(
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
                wide,
                small,
            )
