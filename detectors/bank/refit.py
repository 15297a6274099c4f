"""Fit filters anew to everything learnt, each linearised about where its own fit ends.

Resistance, weights of its law and flows multiply each other. A filter that met them one record at a time is surer than
it should be, and its evidence with it; passes over the whole history, each about the state that the last one came to,
mend both (Gauss-Newton, outliers found anew in every pass). A fault's amplitude is followed back along its shape: a
step stands since its onset, a ramp grew since then. The healthy pump is tried from the state of the likeliest fault as
well: a poor start there would be read as a fault.
"""

import math

import numpy as np

from detectors.bank.kernel import free, take, wandered
from detectors.bank.prediction import Scratch, scratch
from detectors.bank.shapes import (
    ARRIVAL,
    RAMP,
    STATED,
    STEP,
    Array,
    Base,
    Filters,
    History,
    Integers,
    Kinds,
    Reading,
    Walks,
)
from detectors.expectation.components import AMPLITUDE, LAW, N_STATE, RATE, RESERVOIR, SETTING
from twin.compiled import compiled

_PASSES_OF_FAULTS = 2
"""Over the history, for each fault (estimate: the healthy pump's fit has found the nuisances before)."""
_YOUNG = 16
"""Records of a history in which every fit is tried from several starts (estimate: later the starts meet)."""
_SETTLED = 0.3
"""A fit ends when no component moves by more than this share of its own spread (estimate: below that no word changes)."""


@compiled
def fit_anew(
    filters: Filters,
    rows: Integers,
    base: Base,
    kinds: Kinds,
    walks: Walks,
    history: History,
    alive: int,
    most_passes: int,
) -> None:
    """Fit the filters ``rows`` anew, in place; evidence is counted anew from ``kinds.log_priors``, the healthy pump's from 0.

    Parameters
    ----------
    base, kinds, walks, history
        Where the history begins, what faults are, how the state wanders, and all that was measured since.
    alive
        How much of the state is alive (``n`` of ``kernel.step``).
    most_passes
        Over the history, for the healthy pump from each start.
    """
    start, best_mean, best_covariance = np.empty(N_STATE), np.empty(N_STATE), np.empty((N_STATE, N_STATE))
    mean, covariance, log_evidence, room = filters.mean, filters.covariance, filters.log_evidence, scratch()
    likeliest = rows[0]
    for f in rows:
        if log_evidence[f] > log_evidence[likeliest]:
            likeliest = f
    other = mean[likeliest].copy()
    young = history.record[len(history.record) - 1] - base.records < _YOUNG
    for f in rows:
        k, form = filters.kind[f], filters.shape[f]
        prior = 0.0 if k < 0 else kinds.log_priors[STATED, form, k]
        passes = most_passes if k < 0 or form == ARRIVAL else _PASSES_OF_FAULTS
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
                start[AMPLITUDE], start[RATE], start[LAW] = own[AMPLITUDE], own[RATE], own[LAW]
            found = 0.0
            for passage in range(passes):
                backwards = attempt == 2 and passage == 0
                found = prior + _through(filters, f, start, backwards, base, kinds, walks, history, alive, room)
                if _step_in_spreads(mean[f], covariance[f], start, alive) < _SETTLED:
                    break
                start[:] = mean[f]
            if found > best:
                best, best_mean[:], best_covariance[:, :] = found, mean[f], covariance[f]
        log_evidence[f], mean[f], covariance[f] = best, best_mean, best_covariance
        if k < 0:
            other[:] = mean[f]


@compiled
def _step_in_spreads(m: Array, P: Array, start: Array, alive: int) -> float:
    """How far a pass moved the component that it moved most, in the component's own spread."""
    most = 0.0
    for j in range(alive):
        if P[j, j] > 0.0:
            most = max(most, abs(m[j] - start[j]) / math.sqrt(P[j, j]))
    return most


@compiled
def _through(
    filters: Filters,
    f: int,
    about: Array,
    backwards: bool,
    base: Base,
    kinds: Kinds,
    walks: Walks,
    history: History,
    alive: int,
    room: Scratch,
) -> float:
    """One pass of filter ``f`` over the history, linearised about a state; the logarithm of its predictive densities.

    ``backwards`` takes a healthy pump's history from its end and weighs records by what came after them: an outlier at
    the beginning, where nothing is known that it could contradict, is found so.
    """
    m, P = filters.mean[f], filters.covariance[f]
    kind, shape, onset, direction = (
        filters.kind[f],
        filters.shape[f],
        filters.onset[f],
        kinds.directions[filters.kind[f]],
    )
    walk, amplitude_walk, rate_walk, setting_walk = (
        walks.state,
        walks.amplitude[shape, kind],
        walks.rate[shape, kind],
        walks.setting[kind],
    )
    record, seen = history.record, history.seen
    places, point = np.empty(seen.shape[1], dtype=np.int64), about.copy()
    amplitude = about[AMPLITUDE]
    last = record[len(record) - 1]
    m[:], P[:, :] = base.mean, base.covariance
    begun = kind < 0
    if shape == ARRIVAL and kind >= 0:
        m[AMPLITUDE] = kinds.arrival_mean
        P[AMPLITUDE, AMPLITUDE] = kinds.arrival_spread**2
        m[LAW], P[LAW, LAW] = kinds.laws[kind, 0], kinds.laws[kind, 1] ** 2
        begun = True
    total, at = 0.0, base.records - 1
    along, grows = 0.0, 0.0
    nowhere, wander = np.empty(0), np.empty(N_STATE)
    freed = history.freed
    freed_last, event = np.full(N_STATE, -1), 0
    for e in range(len(freed.record)):
        freed_last[freed.place[e]] = freed.record[e]
    if backwards:
        event = len(freed.record) - 1
    for place in range(len(record)):
        i = len(record) - 1 - place if backwards else place
        if record[i] != at:
            at = record[i]
            # what was made unknown between this record and the last one, on the way there or on the way back
            while not backwards and event < len(freed.record) and freed.record[event] <= at:
                free(m, P, freed, event)
                event += 1
            while backwards and event >= 0 and freed.record[event] > at:
                free(m, P, freed, event)
                event -= 1
            if not begun and at >= onset:
                begun = True
                filters.setting_at_onset[f] = m[SETTING]
                spread = filters.scale[f] if shape == STEP else filters.scale[f] / kinds.ramp_records
                begins = AMPLITUDE if shape == STEP else RATE
                P[begins, begins] = spread**2
                m[LAW], P[LAW, LAW] = kinds.laws[kind, 0], kinds.laws[kind, 1] ** 2
            if begun:
                wandered(m, P, walk, amplitude_walk, rate_walk, setting_walk)
            else:
                wandered(m, P, walk, 0.0, 0.0, 0.0)
            P[RESERVOIR, RESERVOIR] += history.wander[i]
            if begun and kind >= 0:
                # growth may have ended long ago: where it stood then is what the records up to then say
                along, grows = (m[AMPLITUDE], m[RATE]) if shape == RAMP else (amplitude, 0.0)
        n_seen = 0
        for j in range(seen.shape[1]):
            if seen[i, j]:
                places[n_seen] = j
                n_seen += 1
        for j in range(N_STATE):
            point[j] = about[j]
            wander[j] = (last - at) * walk[j]
            if at < freed_last[j]:
                # where it came to says nothing of what it was before
                point[j], wander[j] = m[j], P[j, j]
        if shape == RAMP and begun:
            wander[AMPLITUDE] = P[AMPLITUDE, AMPLITUDE]
        wander[SETTING] += (last - max(at, onset)) * setting_walk
        point[AMPLITUDE], point[RATE] = along, grows
        reading = Reading(history.anchors[i], history.ripples[i], history.values[i], history.noises[i], places[:n_seen])
        density, _ = take(m, P, direction, reading, alive, 1, point, nowhere if backwards else wander, room)
        total += density
    return total
