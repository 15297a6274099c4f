"""Forecasts of pumps whose life is run to its end: whether intervals hold the truth, and how near the median comes.

A life lasts from the installation to the first flight on which the true case flow at the reference condition reaches
the limit. Forecasts are asked at shares of it (lambda); a pump that is given none there is a miss of alpha-lambda and no
interval (Saxena et al. 2010).
"""

import math

import numpy as np
from numpy.typing import NDArray

from detectors.evaluation.scores import N_DRAWS, Score, alpha_lambda, bootstrap, proportion
from detectors.evaluation.scoring import Seen
from detectors.evaluation.sensing import HOURS_PER_FLIGHT
from detectors.evaluation.study import Outcome

Array = NDArray[np.float64]

LAMBDAS: tuple[float, ...] = (0.5, 0.7, 0.9)
"""Shares of a life at which forecasts are asked; half a life is what the targets ask."""
ALPHA = 0.2
"""Part of the life that is left by which a forecast may miss (alpha of the alpha-lambda metric; Saxena et al. 2010 use 0.2)."""


def given_at(share: float) -> str:
    """Name of the share of pumps that are given a forecast at this share of their lives."""
    return f"forecast given at {share:g} of the life"


def covered_at(share: float) -> str:
    """Name of the share of 80 % intervals that hold the truth."""
    return f"80 % intervals of the forecast at {share:g} of the life hold the truth"


def near_at(share: float) -> str:
    """Name of the share of pumps whose median forecast lies within alpha of the truth."""
    return f"alpha-lambda 20 % at {share:g} of the life"


def near_where_given_at(share: float) -> str:
    """As ``near_at``, among the pumps that are given a forecast."""
    return f"alpha-lambda 20 % at {share:g} of the life, where a forecast is given"


def error_at(share: float) -> str:
    """Name of the median relative error of the forecast."""
    return f"median error of the forecast at {share:g} of the life, share of the truth"


def ends_of_life(outcome: Outcome, limit: float) -> Array:
    """Flight on which the true case flow first reaches the limit, shape (n_pumps,).

    NaN where it never does, or did before the first verdict: such a pump has no life to forecast.
    """
    above = outcome.case_flow >= limit
    first = np.argmax(above, axis=1)
    flight = outcome.flight[np.arange(len(first)), first].astype(np.float64)
    return np.where(above.any(axis=1) & (first > 0), flight, np.nan)


def asked_records(outcome: Outcome, limit: float) -> NDArray[np.int64]:
    """Record at each of ``LAMBDAS`` of the life, -1 where there is none; shape (n_pumps, len(LAMBDAS))."""
    result = np.full((len(outcome.flight), len(LAMBDAS)), -1)
    for i, end in enumerate(ends_of_life(outcome, limit)):
        if math.isfinite(end):
            flown = outcome.flight[i][outcome.flight[i] >= 0]
            result[i] = [int(np.searchsorted(flown, share * end, side="right")) - 1 for share in LAMBDAS]
    return result


def life_scores(found: Seen, limit: float, seed: int) -> dict[str, Score]:
    """Scores at each of ``LAMBDAS``; empty without a pump that reaches the limit."""
    outcome = found.outcome
    ends, asked = ends_of_life(outcome, limit), asked_records(outcome, limit)
    pumps = np.flatnonzero(np.isfinite(ends))
    if not len(pumps):
        return {}
    result: dict[str, Score] = {}
    for k, share in enumerate(LAMBDAS):
        at = asked[pumps, k]
        median, low, high = outcome.forecast[pumps, at].T
        left = (ends[pumps] - outcome.flight[pumps, at]) * HOURS_PER_FLIGHT
        given = np.isfinite(median)
        near = np.array([alpha_lambda(m, t, ALPHA) for m, t in zip(median, left, strict=True)])
        inside = given & (low <= left) & (left <= high)
        result |= {
            given_at(share): proportion(int(given.sum()), len(pumps)),
            near_at(share): proportion(int(near.sum()), len(pumps)),
        }
        if given.any():
            error = (median[given] - left[given]) / left[given]
            result |= {
                covered_at(share): proportion(int(inside.sum()), int(given.sum())),
                near_where_given_at(share): proportion(int(near.sum()), int(given.sum())),
                error_at(share): bootstrap(lambda x: float(np.median(x)), error, seed=seed, n_draws=N_DRAWS),
            }
    return result
