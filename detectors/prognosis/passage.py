"""Flight hours until a level crosses its limit: first passage of a drifting level, mixed over what is not known.

The level's track is followed by Kalman filters side by side: without drift, with steady drift, with a drift that
wanders, with one that grows exponentially; each with several diffusions and noise scales. Their evidence weighs
them. From each posterior of (level, drift) the time to the limit follows the inverse Gaussian law (Schroedinger
1915; Whitmore 1975); a forecast is given only where drift is evident and the interval says something.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, ndtr, ndtri

from detectors.words.numbers import STUDENT_DEGREES

Array = NDArray[np.float64]

FEWEST_ESTIMATES = 8
DRIFT_PROBABILITY = 0.9
"""Posterior probability of growth below which there is nothing to extrapolate."""
WIDEST_RATIO = 20.0
_CONFIDENCE = 0.90
_PRIOR_STEADY = 0.5
_DIFFUSIONS = ((0.0, 0.4), (3e-4, 0.4), (3e-3, 0.2))
"""Variance of the level gained over a life, in squares of the way to the limit, and its prior share."""
_NOISES = ((1.0, 0.7), (1.6, 0.3))
"""Factor on the stated standard deviations, and its prior share."""
_LAWS = (
    (0.0, 0.0, 0.3),
    (0.0, 3.0, 0.1),
    (0.5, 0.0, 0.15),
    (1.0, 0.0, 0.15),
    (1.5, 0.0, 0.12),
    (2.0, 0.0, 0.1),
    (3.0, 0.0, 0.08),
)
"""Growth of the drift over the track (exponent), its wander over a life in squares of a typical drift, share.

A track holds some half of a life, so pace that rises e-fold over the life is 0.5 here: without laws between the whole
numbers such wear was followed by none of them and 80 % intervals held 64 % of the truths.
"""
_DRIFTS = (0.3, 1.0, 3.0, 10.0)
"""Drift at the track's end in units of the way to the limit over a life."""
_SHORTEST_TRACK = 0.25
"""Part of a life that a track spans at least where a chance is asked of it: growth counts by the span, and e-fold growth
within a few flights is no wear (estimate: half of what ``_LAWS`` reckons with)."""
_HORIZON_LIVES = 10.0
"""How far is looked ahead, in lives of a typical pump (estimate: beyond ten nobody plans)."""
_N_TIMES = 240
"""Instants on the way to the horizon (estimate: finer than the forecast is sharp)."""
_N_DRAWS = 2000
"""Paths that a forecast is drawn from (estimate: its 5 % quantile is then known to half a per cent of probability)."""


@dataclass(frozen=True, slots=True)
class LevelEstimate:
    """One record's estimate of the level, with an error of its own [level's unit], at the pump's flight hours."""

    flight_hours: float | None
    mean: float
    standard_deviation: float


@dataclass(frozen=True, slots=True)
class Forecast:
    """Distribution of the remaining flight hours [h]: ``probability[i]`` that the limit is reached by ``hours[i]``."""

    mean: float
    low: float
    high: float
    hours: Array
    probability: Array

    def quantile(self, share: float) -> float:
        """Flight hours by which the limit is reached with probability ``share``; infinite beyond the horizon."""
        if not 0.0 < share < 1.0:
            raise ValueError(f"share is {share:g}; it must lie between 0 and 1")
        if share > self.probability[-1]:
            return math.inf
        return float(np.interp(share, self.probability, self.hours))

    def probability_within(self, hours: float) -> float:
        """Probability that the limit is reached within some flight hours [h]; beyond the horizon at least this."""
        if not 0.0 <= hours < math.inf:
            raise ValueError(f"hours is {hours:g}; it must be finite and not below 0")
        return float(np.interp(hours, self.hours, self.probability))


@dataclass(frozen=True, slots=True)
class NoForecast:
    """Why no forecast is honest."""

    reason: str


def forecast(
    estimates: Sequence[LevelEstimate], limit: float, *, typical_life_hours: float = 2000.0, unit: str = ""
) -> Forecast | NoForecast:
    """Flight hours from the last estimate until the level crosses ``limit`` from below.

    Parameters
    ----------
    estimates : Sequence[LevelEstimate]
        In any order; errors taken as independent. Those that have no number are left out.
    limit : float
        The level that ends the pump's life [level's unit].
    typical_life_hours : float
        Flight hours that growth to the limit may take: sets the priors' scale, right to a factor of ten or so.
    unit : str
        The level's unit, as a reason says it; empty says none.

    Returns
    -------
    Forecast or NoForecast
        Mean and 90 % interval, the whole distribution with them; or the reason why there is none.

    Raises
    ------
    ValueError
        If the limit or the typical life is not a usable number, or a standard deviation is not positive.
    """
    _check(estimates, limit, typical_life_hours)
    numbers = [e for e in estimates if math.isfinite(e.mean)]
    dated = [e for e in numbers if e.flight_hours is not None and math.isfinite(e.flight_hours)]
    if 2 * len(dated) < len(numbers):
        return NoForecast(f"flight hours are missing for {len(numbers) - len(dated)} of {len(numbers)} records")
    if len(dated) < FEWEST_ESTIMATES:
        return NoForecast(f"{len(dated)} records have an estimate; at least {FEWEST_ESTIMATES} are needed")
    if len({e.flight_hours for e in dated}) == 1:
        return NoForecast("all records have the same flight hours")
    filters, weight, growing = _followed(dated, limit, typical_life_hours, 0.0)
    level = float(weight @ filters.level)
    above = float(weight @ ndtr((filters.level - limit) / np.sqrt(filters.p_ll)))
    if above > 0.5:
        said = f" {unit}" if unit else ""
        return NoForecast(f"the level, {level:.3g}{said}, is already above the limit, {limit:.3g}{said}")
    if growing < DRIFT_PROBABILITY:
        return NoForecast(f"no growth is evident: its probability is {growing:.2f}, {DRIFT_PROBABILITY:g} is needed")
    return _passage(filters, weight, limit, typical_life_hours)


def chance_within(
    estimates: Sequence[LevelEstimate], limit: float, hours: float, *, typical_life_hours: float = 2000.0
) -> float:
    """Probability that the level has crossed ``limit`` from below by ``hours`` flight hours after the last estimate.

    Every filter counts by its share, the ones without drift too, and whatever lies beyond the limit has crossed it: so
    there is a chance wherever there is an estimate, and none is left out for being small.

    Parameters
    ----------
    estimates : Sequence[LevelEstimate]
        In any order; errors taken as independent. At least one has a number and flight hours; the others are left out.
    limit : float
        The level that ends the pump's life [level's unit].
    hours : float
        How far is looked ahead [h].
    typical_life_hours : float
        As in ``forecast``.

    Raises
    ------
    ValueError
        As ``forecast``; without an estimate at flight hours, or if ``hours`` is negative or not finite.
    """
    _check(estimates, limit, typical_life_hours)
    if not 0.0 <= hours < math.inf:
        raise ValueError(f"hours is {hours:g}; it must be finite and not below 0")
    dated = [e for e in estimates if math.isfinite(e.mean) and e.flight_hours is not None]
    if not dated:
        raise ValueError("no estimate has a number and flight hours; at least one is needed")
    filters, weight, _ = _followed(dated, limit, typical_life_hours, _SHORTEST_TRACK * typical_life_hours)
    pick, drift, level = _drawn(filters, weight)
    return float(_crossed_by(filters, pick, drift, limit - level, max(hours, 1e-6 * typical_life_hours)).mean())


def _followed(
    dated: Sequence[LevelEstimate], limit: float, life: float, shortest: float
) -> "tuple[_Filters, Array, float]":
    """Filters after the whole track, their shares, and the probability of growth; the track counts as ``shortest`` at least."""
    track = np.array(sorted((e.flight_hours, e.mean, e.standard_deviation) for e in dated), dtype=np.float64)
    scale = max(limit - float(np.median(track[: len(track) // 3 + 1, 1])), float(np.median(track[:, 2])))
    filters = _filtered(track, _filters(scale, life, max(float(np.ptp(track[:, 0])), shortest)))
    return filters, *_weights(filters)


@dataclass(slots=True)
class _Filters:
    """Kalman filters side by side, each array (m,): settings, then mean and covariance of (level, drift)."""

    growth: Array
    level_diffusion: Array
    drift_diffusion: Array
    noise: Array
    drifts: NDArray[np.bool_]
    prior: Array
    drift_sd: Array
    level: Array
    drift: Array
    p_ll: Array
    p_ld: Array
    p_dd: Array
    log_evidence: Array


def _filters(scale: float, life: float, span: float) -> _Filters:
    """Grid of settings in units of the way to the limit and the typical life, with their prior weights."""
    speed = scale / life
    rows = []
    for (diffusion, p), (noise, q) in itertools.product(_DIFFUSIONS, _NOISES):
        rows.append((0.0, diffusion, 0.0, noise, 0.0, p * q * _PRIOR_STEADY))
        for (growth, wander, r), size in itertools.product(_LAWS, _DRIFTS):
            # the drift at the end is what has this size
            sd = size * speed * math.exp(-growth)
            share = p * q * r * (1.0 - _PRIOR_STEADY) / len(_DRIFTS)
            rows.append((growth / span, diffusion, wander, noise, sd, share))
    growth, diffusion, wander, noise, sd, prior = np.array(rows).T
    m = len(prior)
    return _Filters(
        growth,
        diffusion * scale**2 / life,
        wander * speed**2 / life,
        noise,
        sd > 0.0,
        prior,
        sd,
        np.zeros(m),
        np.zeros(m),
        np.full(m, (10.0 * scale) ** 2),
        np.zeros(m),
        sd**2,
        np.zeros(m),
    )


def _filtered(track: Array, f: _Filters) -> _Filters:
    """Run all filters over the track (hours, mean, sd), shape (n, 3); Student-t evidence and weights."""
    f.level += track[0, 1]
    before = track[0, 0]
    for hours, mean, sd in track:
        _advance(f, hours - before)
        before = hours
        noise = (f.noise * sd) ** 2
        innovation = mean - f.level
        total = f.p_ll + noise
        square = innovation**2 / total
        f.log_evidence -= 0.5 * np.log(total) + 0.5 * (STUDENT_DEGREES + 1.0) * np.log1p(square / STUDENT_DEGREES)
        # an outlier's own error is taken as larger, so that it moves the level less
        total = f.p_ll + noise * np.maximum(1.0, (STUDENT_DEGREES + square) / (STUDENT_DEGREES + 1.0))
        gain_l, gain_d = f.p_ll / total, f.p_ld / total
        f.level = f.level + gain_l * innovation
        f.drift = f.drift + gain_d * innovation
        f.p_dd = f.p_dd - gain_d * f.p_ld
        f.p_ld = (1.0 - gain_l) * f.p_ld
        f.p_ll = (1.0 - gain_l) * f.p_ll
    return f


def _advance(f: _Filters, hours: float) -> None:
    """Let ``hours`` pass: the drift grows by exp(growth hours) and wanders, the level follows and diffuses."""
    if hours == 0.0:
        return
    reach, grown = _reach(f.growth, hours), np.exp(f.growth * hours)
    q_l = f.level_diffusion * hours + f.drift_diffusion * hours**3 / 3.0
    q_ld, q_d = f.drift_diffusion * hours**2 / 2.0, f.drift_diffusion * hours
    f.level = f.level + reach * f.drift
    f.drift = grown * f.drift
    f.p_ll = f.p_ll + 2.0 * reach * f.p_ld + reach**2 * f.p_dd + q_l
    f.p_ld = grown * (f.p_ld + reach * f.p_dd) + q_ld
    f.p_dd = grown**2 * f.p_dd + q_d


def _reach(growth: Array, hours: Array | float) -> Array:
    """Hours of today's drift that ``hours`` of growing drift are worth: (exp(g t) - 1) / g."""
    product = np.minimum(growth * hours, 50.0)
    return np.asarray(np.where(growth > 0.0, np.expm1(product) / np.where(growth > 0.0, growth, 1.0), hours))


def _weights(f: _Filters) -> tuple[Array, float]:
    """Posterior shares of the filters, and the probability that the level grows.

    Drift is positive a priori: a filter's evidence counts by twice its posterior share of positive drift.
    """
    positive = np.where(f.drifts, log_ndtr(f.drift / np.sqrt(np.maximum(f.p_dd, 1e-300))) + math.log(2.0), 0.0)
    log = np.log(f.prior) + f.log_evidence + positive
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    return weight, float(weight[f.drifts].sum())


def _drawn(f: _Filters, share: Array) -> tuple[NDArray[np.int64], Array, Array]:
    """Filters by their shares, each with a drift that is positive where it has one, and a level; all (draws,)."""
    rng = np.random.default_rng(0)
    place = (np.arange(_N_DRAWS) + 0.5) / _N_DRAWS
    pick = np.minimum(np.searchsorted(np.cumsum(share / share.sum()), place), len(share) - 1)
    drifts = f.drifts[pick]
    variance = np.where(drifts, f.p_dd[pick], 1.0)
    sd = np.sqrt(variance)
    lowest = ndtr(-f.drift[pick] / sd)
    drift = f.drift[pick] + sd * ndtri(lowest + (1.0 - lowest) * rng.uniform(1e-6, 1.0 - 1e-6, _N_DRAWS))
    drift = np.where(drifts, np.maximum(drift, 1e-9 * sd), 0.0)
    slope = np.where(drifts, f.p_ld[pick] / variance, 0.0)
    left = np.maximum(f.p_ll[pick] - slope * f.p_ld[pick], 0.0)
    level = f.level[pick] + slope * (drift - f.drift[pick]) + np.sqrt(left) * rng.standard_normal(_N_DRAWS)
    return pick, drift, level


def _crossed_by(f: _Filters, pick: NDArray[np.int64], drift: Array, way: Array, hours: float) -> Array:
    """Probability that each draw has covered its ``way`` to the limit by ``hours``, (draws,)."""
    # a wandering drift adds to the diffusion what it adds to the level's variance
    variance = f.level_diffusion[pick] + f.drift_diffusion[pick] * hours**2 / 3.0
    return _crossed(way, drift * _reach(f.growth[pick], hours) / hours, variance, hours)


def _passage(f: _Filters, weight: Array, limit: float, life: float) -> Forecast | NoForecast:
    """Mix the first-passage law over draws of (filter, drift, level) with positive drift."""
    pick, drift, level = _drawn(f, np.where(f.drifts, weight, 0.0))
    horizon = _HORIZON_LIVES * life
    hours = np.concatenate([[0.0], np.geomspace(1e-4 * life, horizon, _N_TIMES)])
    probability = np.empty(len(hours))
    probability[0] = float((level >= limit).mean())
    for i, t in enumerate(hours[1:], 1):
        probability[i] = _crossed_by(f, pick, drift, limit - level, float(t)).mean()
    probability = np.maximum.accumulate(probability)
    tail = 0.5 * (1.0 - _CONFIDENCE)
    found = Forecast(math.nan, 0.0, math.inf, hours, probability)
    low = found.quantile(tail) if probability[0] < tail else 0.0
    high = found.quantile(1.0 - tail)
    if not math.isfinite(high):
        return NoForecast(
            f"the interval reaches beyond {horizon:.0f} flight hours: growth is too slow or too uncertain"
        )
    if high > WIDEST_RATIO * max(low, 0.01 * life):
        return NoForecast(f"the interval is too wide to help: {low:.0f} to {high:.0f} flight hours")
    mean = float(np.trapezoid(1.0 - probability, hours))
    return Forecast(mean, low, high, hours, probability)


def _crossed(way: Array, pace: Array, variance: Array, hours: float) -> Array:
    """Inverse Gaussian: probability that the way [level's unit] is covered by ``hours``; all (m,)."""
    spread = np.sqrt(np.maximum(variance * hours, 1e-18 * np.maximum(way**2, 1e-300)))
    ahead = ndtr((pace * hours - way) / spread)
    back = 2.0 * way * pace * hours / spread**2 + log_ndtr(-(pace * hours + way) / spread)
    return np.where(way <= 0.0, 1.0, np.minimum(1.0, ahead + np.exp(np.minimum(back, 0.0))))


def _check(estimates: Sequence[LevelEstimate], limit: float, life: float) -> None:
    faults = []
    if not math.isfinite(limit):
        faults.append("limit is not a number")
    if not (math.isfinite(life) and life > 0.0):
        faults.append(f"typical_life_hours is {life:g}; it must be finite and above 0")
    wrong = sum(math.isfinite(e.mean) and not 0.0 < e.standard_deviation < math.inf for e in estimates)
    if wrong:
        faults.append(f"standard_deviation of {wrong} estimates is not a positive number")
    if faults:
        raise ValueError("; ".join(faults))
