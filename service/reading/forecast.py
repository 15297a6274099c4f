"""Forecast of one pump: flight hours until the case flow at the reference condition reaches its limit, and the chance
that it does before the next inspection.

The trend's points are posteriors of one running estimate: neighbours share almost all of their error. Every fifth
record stands for its neighbours. What even distant ones share, the error of the baseline, is no noise that averages out:
it is laid on the limit (as a mixture over its quantiles), and most of it is taken off the records' own errors.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import pairwise

import numpy as np
from sqlalchemy.orm import Session

from detectors.prognosis.passage import FEWEST_ESTIMATES, Forecast, LevelEstimate, NoForecast, chance_within, forecast
from detectors.words.numbers import Z_90
from detectors.words.verdict import State
from service.answers.pumps import FlightHours
from service.answers.pumps import Forecast as Forecasted
from service.answers.verdicts import Crossing, Verdict
from service.history.knowledge import installation_intervals
from service.history.placement import changes
from service.reading import queries
from service.reading.by_link import ByLink
from service.reading.pump_history import history_of
from service.reading.queries import TrendOfRecord
from service.storage.tables import Pump
from service.thresholds.layers import thresholds_of

METRIC = "case_flow_at_reference_lpm"
SPACING = 5
"""Records that one estimate stands for."""
SHARED_PART = 0.6
"""Part of the variance shared by all records that is taken off each one's own. Held against simulated lives: with none of
it no growth was evident where 0.6 L/min had grown, with all of it the 80 % intervals held 57 to 70 % of the truths."""
_NODES = ((-1.7320508, 1.0 / 6.0), (0.0, 2.0 / 3.0), (1.7320508, 1.0 / 6.0))
"""Gauss-Hermite nodes of a standard normal error, and their shares."""
_TAIL = 0.05
"""Probability on either side of the interval that is shown: 90 % as everywhere."""


_kept: ByLink[tuple[Forecasted, Crossing | None]] = ByLink(2000)


@dataclass(frozen=True, slots=True)
class TrendPoint:
    """One record's case flow at the reference condition [L/min] with its one-sigma error."""

    flight_hours: float | None
    mean: float
    standard_deviation: float


def with_crossing(session: Session, pump: Pump, verdict: Verdict, at: datetime | None = None) -> Verdict:
    """A stored verdict with the chance of crossing the limit before the next inspection, as of an event time."""
    thresholds = thresholds_of(session, pump.operator, pump.serial, pump.pump_type).values
    rows = [r for r in queries.trends_of_records(session, pump.id, METRIC) if at is None or r.at <= at]
    return crossed(verdict, rows, changes(installation_intervals(session, pump.id)), thresholds)


def crossed(
    verdict: Verdict, rows: Sequence[TrendOfRecord], entered: Sequence[datetime], thresholds: Mapping[str, float]
) -> Verdict:
    """A verdict with its ``crossing``, from the pump's records up to it in event order; null where none can be given.

    Whatever lies beyond the limit already has crossed it: the chance is never below ``probability_beyond_limit``.
    """
    limit, interval = thresholds["case_flow_limit_lpm"], thresholds["inspection_interval_h"]
    points = [p for p in map(_point, _since_installation(rows, entered)) if p is not None]
    chance = crossing_of_trend(points, limit, interval)
    beyond = verdict.get("probability_beyond_limit")
    if beyond is not None and (chance is not None or beyond > 0.5):
        chance = max(beyond, chance or 0.0)
    found: Crossing | None = None
    if chance is not None:
        found = {"within_flight_hours": interval, "probability": chance}
    return {**verdict, "crossing": found}


def crossing_of_trend(points: Sequence[TrendPoint], limit: float, within_h: float) -> float | None:
    """Probability that the level crosses the limit within some flight hours [h]; None without an estimate at flight hours.

    There is one whether or not growth is evident: what does not grow may lie beyond the limit, or come to.
    """
    dated = [p for p in points if p.flight_hours is not None]
    if not dated or 2 * len(dated) < len(points) or _falling(dated) is not None:
        return None
    estimates, shared = _estimates(dated)
    return float(sum(share * chance_within(estimates, limit - node * shared, within_h) for node, share in _NODES))


def forecast_of(session: Session, pump: Pump) -> Forecasted:
    """Forecast in the shape of the API: flight hours with their 90 % interval, or the reason why there are none."""
    limit = thresholds_of(session, pump.operator, pump.serial, pump.pump_type).values["case_flow_limit_lpm"]
    entered = changes(installation_intervals(session, pump.id))
    return _forecasted(queries.trends_of_records(session, pump.id, METRIC), entered, limit)


def forecast_and_crossing(
    session: Session, pump: Pump, verdict: Verdict, thresholds: Mapping[str, float], entered: Sequence[datetime]
) -> tuple[Forecasted, Verdict]:
    """What ``forecast_of`` and ``with_crossing`` give now, from one reading of the pump's records for each state of them.

    ``thresholds`` are those of the pump now, ``entered`` the instants at which entries say that it changed its place.
    """
    limit, interval = thresholds["case_flow_limit_lpm"], thresholds["inspection_interval_h"]

    def read(pump_ids: list[int]) -> dict[int, tuple[Forecasted, Crossing | None]]:
        rows = history_of(session, pump).trend(METRIC)
        return {
            i: (_forecasted(rows, entered, limit), crossed(verdict, rows, entered, thresholds)["crossing"])
            for i in pump_ids
        }

    given = repr((limit, interval, entered, verdict.get("probability_beyond_limit")))
    found = _kept.of(session, [pump], read, given)
    if pump.id not in found:
        return _forecasted([], entered, limit), crossed(verdict, [], entered, thresholds)
    forecast, crossing = found[pump.id]
    return forecast, {**verdict, "crossing": crossing}


def _forecasted(records: Sequence[TrendOfRecord], entered: Sequence[datetime], limit: float) -> Forecasted:
    points = [p for p in map(_point, _since_installation(records, entered)) if p is not None]
    found = forecast_of_trend(points, limit)
    document: Forecasted = {
        "flight_hours": None,
        "limit": limit,
        "limit_unit": "L/min",
        "metric": METRIC,
        "records": len(points),
        "median_flight_hours": None,
        "reason": None,
    }
    if isinstance(found, NoForecast):
        return document | {"reason": found.reason}
    hours: FlightHours = {"mean": found.mean, "low": found.low, "high": found.high}
    return document | {"flight_hours": hours, "median_flight_hours": found.quantile(0.5)}


@dataclass(frozen=True, slots=True)
class _Parts:
    """A forecast for each node of the error that all records share [L/min]."""

    given: Sequence[Forecast | NoForecast]
    shared: float


def forecast_of_trend(points: Sequence[TrendPoint], limit: float) -> Forecast | NoForecast:
    """Forecast from points in event order, all of one installation."""
    parts = _parts(points, limit)
    if isinstance(parts, NoForecast):
        return parts
    given = [part for part in parts.given if isinstance(part, Forecast)]
    if len(given) == len(parts.given):
        return _mixed(given)
    _, middle, nearest = parts.given
    if isinstance(middle, NoForecast):
        return middle
    if isinstance(nearest, NoForecast):
        return NoForecast(
            f"the limit of {limit:g} L/min lies within the error of the estimate, {Z_90 * parts.shared:.2g} L/min"
        )
    return NoForecast("the interval is too wide to help: the estimate's own error could put the limit out of reach")


def _parts(points: Sequence[TrendPoint], limit: float) -> _Parts | NoForecast:
    """Forecasts with the limit at each node of the shared error, or why there is not even one."""
    fewest = SPACING * (FEWEST_ESTIMATES - 1) + 1
    if len(points) < fewest:
        return NoForecast(
            f"{len(points)} records of this installation have an estimate; at least {fewest} are needed, because "
            "neighbouring estimates share their errors"
        )
    dated = [p for p in points if p.flight_hours is not None]
    if len(dated) < 0.5 * len(points) or len(dated) < fewest:
        return NoForecast(f"flight hours are missing for {len(points) - len(dated)} of {len(points)} records")
    falls = _falling(dated)
    if falls is not None:
        return NoForecast(f"flight hours fall from {falls[0]:g} to {falls[1]:g} within one installation: correct them")
    estimates, shared = _estimates(dated)
    return _Parts([forecast(estimates, limit - node * shared, unit="L/min") for node, _ in _NODES], shared)


def _falling(dated: Sequence[TrendPoint]) -> tuple[float, float] | None:
    """The first neighbours whose flight hours fall."""
    hours = [p.flight_hours for p in dated if p.flight_hours is not None]
    return next((pair for pair in pairwise(hours) if pair[1] < pair[0]), None)


def _estimates(dated: Sequence[TrendPoint]) -> tuple[list[LevelEstimate], float]:
    """Estimates that count, each with the error that is its own, and the error that all share [L/min]."""
    # from the newest backwards, so that the last record always counts
    kept = dated[::-1][::SPACING][::-1]
    shared = min(p.standard_deviation for p in kept)
    common = SHARED_PART * shared**2
    return [LevelEstimate(p.flight_hours, p.mean, math.sqrt(p.standard_deviation**2 - common)) for p in kept], shared


def _mixed(parts: Sequence[Forecast]) -> Forecast | NoForecast:
    """One distribution from those of all nodes, on the same hours."""
    hours = parts[0].hours
    probability = np.sum([share * part.probability for (_, share), part in zip(_NODES, parts, strict=True)], axis=0)
    mean = float(sum(share * part.mean for (_, share), part in zip(_NODES, parts, strict=True)))
    whole = Forecast(mean, 0.0, 0.0, hours, probability)
    if probability[-1] <= 1.0 - _TAIL:
        return NoForecast(f"the interval reaches beyond {hours[-1]:.0f} flight hours")
    low = whole.quantile(_TAIL) if probability[0] < _TAIL else 0.0
    return Forecast(mean, low, whole.quantile(1.0 - _TAIL), hours, probability)


def _since_installation(rows: Sequence[TrendOfRecord], entered: Sequence[datetime]) -> list[TrendOfRecord]:
    """The newest records in a row from one aircraft and position, without an entered change of place among them."""
    found: list[TrendOfRecord] = []
    for row in reversed(rows):
        if found:
            after = found[-1]
            if (row.aircraft, row.position) != (after.aircraft, after.position):
                break
            if any(row.at < instant <= after.at for instant in entered):
                break
        found.append(row)
    return found[::-1]


def _point(row: TrendOfRecord) -> TrendPoint | None:
    """A record's estimate; none where the baseline is still being learnt."""
    value = row.trend.get(METRIC)
    if value is None or row.state == State.INSUFFICIENT_DATA:
        return None
    mean, low, high = value["mean"], value["low"], value["high"]
    if mean is None or low is None or high is None:
        return None
    sd = (high - low) / (2.0 * Z_90)
    return TrendPoint(row.flight_hours, mean, sd) if sd > 0.0 else None
