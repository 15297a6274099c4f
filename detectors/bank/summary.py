"""What a bank says in sums: weights by state and by quantity. Compiled, one pass over the filters."""

import math

import numpy as np
from numpy.typing import NDArray

from detectors.bank.shapes import (
    ALIKE,
    ARRIVAL,
    AS_ALIKE,
    AS_STATED,
    FIRST,
    N_WAYS,
    ON_OFF,
    OPEN,
    RAMP,
    RESOLUTION,
    SECOND,
    SHARE,
    STATED,
    STEP,
    WHOLE,
    Array,
    Filters,
    Integers,
    Kinds,
    Meaning,
    Sums,
)
from detectors.expectation.components import AMPLITUDE, LAW, RATE, SETTING
from twin.compiled import compiled

_LEAST_SHOWN, _NOT_YET = 3, 1.0e3
"""Flights on which a fault must have shown before it counts as one that comes and goes (our choice), and what stands against
it until then [nat]."""
_IMPOSSIBLE = 1.5
"""Times its largest size from which a fault is no explanation (our choice): a filter that needs a bleed of twice what the control
valve lets through has bent its nuisances to follow a drain, and its own spread says nothing of that."""
TEMPER = 0.7
"""Exponent of the likelihood where causes compete: their laws are not the world's."""
_REFERENCE = 5
"""Records that a pump's own reference needs (as many as let a record surprise, ``Bank.learn``): behind fewer the likelihood
counts in proportion, for what the change is measured from is the population's spread."""


@compiled
def log_normal_above(z: float) -> float:
    """Logarithm of the standard normal distribution function at z."""
    if z > -8.0:
        return math.log(0.5 * math.erfc(-z / math.sqrt(2.0)))
    return -0.5 * z * z - math.log(-z * math.sqrt(2.0 * math.pi))


@compiled
def summed(filters: Filters, n: int, records: int, meaning: Meaning, sums: Sums) -> float:
    """Sum the first n filters after ``records`` records into ``sums``; returns the share of pumps that came worn."""
    mean, covariance, kind, shape, onset = filters.mean, filters.covariance, filters.kind, filters.shape, filters.onset
    weights, of_all, changed, together, moments = sums
    _weigh(filters, n, meaning, weights)
    of_all[:, :], changed[:, :], moments[:, :], together[:, :] = 0.0, 0.0, 0.0, 0.0
    healthy = of_all.shape[1] - 1
    arrived = 0.0
    n_quantities = len(moments)
    oldest = np.full(n_quantities, records)
    first_kind = np.full(n_quantities, -1)
    for k in range(len(meaning.quantities) - 1, -1, -1):
        if meaning.quantities[k] >= 0:
            first_kind[meaning.quantities[k]] = k
    for f in range(n):
        w, k, amplitude = weights[WHOLE, f], kind[f], mean[f, AMPLITUDE]
        floor = meaning.floors[k] if shape[f] != ARRIVAL else meaning.floors[len(meaning.floors) - 1]
        place = meaning.states[k] if abs(amplitude) >= floor and k >= 0 else healthy
        change = mean[f, SETTING] - filters.setting_at_onset[f]
        if k >= 0 and meaning.beside[k] >= 0 and abs(change) >= meaning.setting_floor:
            # two faults: the larger, each by its scale, is the first
            first, second = place, meaning.beside[k]
            if abs(change) / meaning.setting_scale > abs(amplitude) / meaning.scales[k]:
                first, second = second, place
            if place == healthy:
                first = meaning.beside[k]
            else:
                together[first, second] += w
            place = first
            _add(moments[meaning.setting_quantity], w, change, covariance[f, SETTING, SETTING])
        since_first = healthy if shape[f] == ARRIVAL else place
        for way in range(N_WAYS):
            of_all[way, place] += weights[way, f]
            changed[way, since_first] += weights[way, f]
        if since_first != place:
            arrived += w
        if k < 0 or meaning.quantities[k] < 0:
            continue
        q = meaning.quantities[k]
        variance = max(covariance[f, AMPLITUDE, AMPLITUDE], 0.0)
        _add(moments[q], w, amplitude, variance)
        if k == first_kind[q] and shape[f] == STEP and onset[f] <= records - 2 and onset[f] < oldest[q]:
            oldest[q] = onset[f]
            moments[q, RESOLUTION] = math.sqrt(variance)
    return arrived


@compiled
def beyond_doubt(filters: Filters, n: int, latest: int, is_healthy: NDArray[np.bool_], gone: int, lead: float) -> int:
    """The likeliest healthy change that set in by record ``latest``, where it leads its rivals by ``lead`` [nat]; -1 for none.

    A fault that is gone has every other explanation for a rival, a new fluid the healthy pump alone.
    """
    likeliest, most, others = -1, -np.inf, -np.inf
    for f in range(n):
        found, kind = filters.log_evidence[f], filters.kind[f]
        if is_healthy[kind] and filters.onset[f] <= latest and found > most:
            likeliest, most = f, found
        if kind != gone:
            others = max(others, found)
    if likeliest < 0:
        return -1
    rival = others if filters.kind[likeliest] == gone else filters.log_evidence[0]
    return likeliest if most >= rival + lead else -1


@compiled
def split(
    kind: Integers, shape: Integers, is_healthy: NDArray[np.bool_], whole: Array, by_prior: Array, shares: Array
) -> None:
    """Shares of filters under either prior into ``shares`` (2, m): how much is healthy by all that the data say (``whole``, (m,)),
    the rest by the tempered likelihood (``by_prior``, (2, m)). ``is_healthy`` goes by kind, the healthy pump (-1) last.
    """
    healthy = 0.0
    for f in range(len(whole)):
        if is_healthy[kind[f]] or shape[f] == ARRIVAL:
            healthy += whole[f]
    for way in range(len(by_prior)):
        among = 0.0
        for f in range(len(whole)):
            if not (is_healthy[kind[f]] or shape[f] == ARRIVAL):
                among += by_prior[way, f]
        for f in range(len(whole)):
            if is_healthy[kind[f]] or shape[f] == ARRIVAL:
                shares[way, f] = whole[f]
            else:
                shares[way, f] = (1.0 - healthy) * by_prior[way, f] / among if among > 0.0 else 0.0


@compiled
def _weigh(filters: Filters, n: int, meaning: Meaning, weights: Array) -> None:
    """Posterior shares of the first n filters, each way; faults by the sign and the size that they came out with."""
    log_evidence = filters.log_evidence
    likeliest = 0
    for f in range(n):
        weights[AS_STATED, f] = _size_evidence(filters, f, meaning.signs, meaning.most) - _habit(filters, f)
        weights[WHOLE, f] = log_evidence[f] - log_evidence[0] + weights[AS_STATED, f]
        if weights[WHOLE, f] > weights[WHOLE, likeliest]:
            likeliest = f
    temper = TEMPER * _reference(filters, likeliest)
    for f in range(n):
        by_data = log_evidence[f] - log_evidence[0] - filters.prior[f, STATED]
        size = weights[AS_STATED, f]
        weights[AS_STATED, f] = filters.prior[f, STATED] + temper * by_data + size
        weights[AS_ALIKE, f] = filters.prior[f, ALIKE] + temper * by_data + size
    for way in range(N_WAYS):
        most, total = weights[way, :n].max(), 0.0
        for f in range(n):
            weights[way, f] = math.exp(weights[way, f] - most)
            total += weights[way, f]
        for f in range(n):
            weights[way, f] /= total


@compiled
def _reference(filters: Filters, f: int) -> float:
    """How much of the pump's own reference stood when a filter's fault set in, 1 for all of it and for what came worn."""
    onset = filters.onset[f]
    if filters.kind[f] < 0 or filters.shape[f] == ARRIVAL or onset < 0:
        return 1.0
    return float(min(onset / _REFERENCE, 1.0))


@compiled
def _habit(filters: Filters, f: int) -> float:
    """What is held against a fault that comes and goes as long as it has hardly come: one flight is an outlier [nat]."""
    if filters.shape[f] != ON_OFF:
        return 0.0
    bits, count = filters.shown[f], 0
    while bits:
        bits &= bits - 1
        count += 1
    return 0.0 if count >= _LEAST_SHOWN else _NOT_YET


@compiled
def _size_evidence(filters: Filters, f: int, signs: Integers, most: Array) -> float:
    """How likely the size is one that the fault can have [nat].

    Twice the probability that a one-sided fault has its sign; the probability that one with a largest size stays below it, and
    nothing where it is half as large again.
    """
    k, found = filters.kind[f], 0.0
    if k < 0:
        return found
    amplitude = filters.mean[f, AMPLITUDE]
    spread = math.sqrt(max(filters.covariance[f, AMPLITUDE, AMPLITUDE], 1.0e-300))
    if signs[k] == 1:
        found += log_normal_above(amplitude / spread) + math.log(2.0)
    if most[k] < np.inf:
        found += log_normal_above((most[k] - amplitude) / spread)
        if amplitude > _IMPOSSIBLE * most[k]:
            found -= _NOT_YET
    return found


@compiled
def _add(moments: Array, weight: float, mean: float, variance: float) -> None:
    """A filter's share and moments on top of a quantity's."""
    moments[SHARE] += weight
    moments[FIRST] += weight * mean
    moments[SECOND] += weight * (variance + mean * mean)


@compiled
def spawned(filters: Filters, n: int, records: int, kinds: Kinds, most_onsets: Integers, scales: Array) -> int:
    """A step and a ramp of each kind setting in now, in place; the least likely old onset gives way. New count.

    The last kind begins where the likeliest fault stands, without it: the fault is gone.

    ``scales`` are the one-sigma sizes that they are expected to have, shape (n_kinds + 1,).
    ``most_onsets`` holds how many of a shape and kind are kept, shape (N_SHAPES, n_kinds).
    """
    mean, covariance, kind, log_evidence = filters.mean, filters.covariance, filters.kind, filters.log_evidence
    n_kinds = len(scales) - 1
    likeliest, gone, most = 0, n_kinds - 1, log_evidence[0]
    for f in range(n):
        own = log_evidence[f] + _size_evidence(filters, f, kinds.signs, kinds.most)
        if kind[f] != gone and own > most:
            likeliest, most = f, own
    undone, undone_spread, undone_prior = (
        mean[likeliest].copy(),
        covariance[likeliest].copy(),
        filters.prior[likeliest].copy(),
    )
    for k in range(n_kinds):
        if k == gone and likeliest == 0:
            continue
        for form in (STEP, RAMP, ON_OFF, OPEN):
            if most_onsets[form, k] == 0:
                continue
            place = _place_of(filters, n, k, form, most_onsets[form, k])
            n = max(n, place + 1)
            mean[place], covariance[place] = mean[0], covariance[0]
            if form != RAMP:
                covariance[place, AMPLITUDE, AMPLITUDE] = scales[k] ** 2
            else:
                covariance[place, RATE, RATE] = (scales[k] / kinds.ramp_records) ** 2
            mean[place, LAW], covariance[place, LAW, LAW] = kinds.laws[k, 0], kinds.laws[k, 1] ** 2
            kind[place], filters.shape[place], filters.onset[place] = k, form, records
            from_where = likeliest if k == gone else 0
            filters.unexplained[place], filters.shown[place] = filters.unexplained[from_where], 0
            filters.misfit[place], filters.scale[place] = 0.0, scales[k]
            filters.setting_at_onset[place] = mean[0, SETTING]
            if k == gone:
                mean[place], covariance[place] = undone, undone_spread
                for i in (AMPLITUDE, RATE, LAW):
                    mean[place, i], covariance[place, i, :], covariance[place, :, i] = 0.0, 0.0, 0.0
            heals = kinds.heals[kind[likeliest]] if k == gone else 0.0
            start = (most if k == gone else log_evidence[0]) + heals
            log_evidence[place] = start + kinds.log_priors[STATED, form, k]
            for which in (STATED, ALIKE):
                filters.prior[place, which] = kinds.log_priors[which, form, k]
                if k == gone:
                    filters.prior[place, which] += undone_prior[which] + heals
    return n


@compiled
def _place_of(filters: Filters, n: int, k: int, form: int, most: int) -> int:
    """Where the next onset of a kind and shape goes: behind all others, or over the least likely once there are ``most``."""
    count, place = 0, -1
    for f in range(n):
        if filters.kind[f] == k and filters.shape[f] == form:
            count += 1
            if place < 0 or filters.log_evidence[f] < filters.log_evidence[place]:
                place = f
    return n if count < most else place
