"""Forecasts within a study: those that the service would have given, asked at shares of each pump's life."""

from dataclasses import replace

import numpy as np

from detectors.evaluation.lives import asked_records
from detectors.evaluation.sensing import HOURS_PER_FLIGHT
from detectors.evaluation.study import STATES, Outcome
from detectors.prognosis.passage import NoForecast
from detectors.words.numbers import Z_90
from detectors.words.verdict import ESTIMATES, State
from service.reading.forecast import METRIC, TrendPoint, forecast_of_trend


def with_forecasts(outcome: Outcome, limit: float) -> Outcome:
    """The outcome with median and 80 % interval [h] at the records that are asked, from what was known then."""
    forecast = np.full_like(outcome.forecast, np.nan)
    for pump, records in enumerate(asked_records(outcome, limit)):
        for record in {int(r) for r in records if r >= 0}:
            found = forecast_of_trend(points_to(outcome, pump, record), limit)
            if not isinstance(found, NoForecast):
                forecast[pump, record] = found.quantile(0.5), found.quantile(0.1), found.quantile(0.9)
    return replace(outcome, forecast=forecast)


def points_to(outcome: Outcome, pump: int, last: int) -> list[TrendPoint]:
    """The pump's trend up to a record, as the service stores it: nothing while the baseline is still learnt."""
    k = list(ESTIMATES).index(METRIC)
    learning = STATES.index(State.INSUFFICIENT_DATA)
    points = []
    for flight, state, (mean, low, high) in zip(
        outcome.flight[pump, : last + 1],
        outcome.state[pump, : last + 1],
        outcome.estimates[pump, : last + 1, k],
        strict=True,
    ):
        sd = (high - low) / (2.0 * Z_90)
        if state != learning and sd > 0.0:
            points.append(TrendPoint(HOURS_PER_FLIGHT * float(flight), float(mean), float(sd)))
    return points
