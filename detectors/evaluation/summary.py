"""Results of a study: each row over all realities together, by law of the system leakage, and in each reality."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from detectors.evaluation.calibration import Calibration, calibration, calibration_error
from detectors.evaluation.delays import delay_scores
from detectors.evaluation.lives import life_scores
from detectors.evaluation.operating import OperatingCurve, operating_curve
from detectors.evaluation.prevalence import prior_weights
from detectors.evaluation.reality import Reality
from detectors.evaluation.rows import Row
from detectors.evaluation.scores import N_DRAWS, Roc, Score, roc
from detectors.evaluation.scoring import (
    COVERED,
    FalseAlarm,
    Seen,
    alarm_delays,
    alarm_sizes,
    confusion,
    false_alarm_episodes,
    has_size,
    scores,
    seen,
    suspicion,
)
from detectors.evaluation.study import Outcome, joined
from detectors.words.thresholds import effective
from detectors.words.verdict import SIDE_OF, Side, State

Array = NDArray[np.float64]

ALL_REALITIES = "all realities"
POOLED = "rows with one right answer, pooled"
CONFIDENCE_ERROR, EACH_ERROR = "calibration error, confidence", "calibration error, six probabilities"
CONFIDENCE_ERROR_FROM_ONSET = "calibration error, confidence, faulty from the onset on"
EACH_ERROR_FROM_ONSET = "calibration error, six probabilities, faulty from the onset on"
ALARMED_ERROR = "calibration error, confidence while in alarm"
ROC_AREA = "area below the ROC"


def scope_of_leak(law: str) -> str:
    """Name of the realities with this law of the system leakage."""
    return f"{law} leak"


@dataclass(frozen=True)
class ScopeScores:
    """Scores over some of the realities."""

    pumps: int
    records: int
    scores: Mapping[str, Score]


@dataclass(frozen=True)
class RowResult:
    """What the study found of one row.

    Attributes
    ----------
    realities
        Names of the realities that were run.
    scopes
        Scores over ``ALL_REALITIES``, over each law of the system leakage, and in each reality.
    confusion
        Pumps by the side that the last verdict names.
    sizes, delays
        Size and flights at each pump's alarm, infinite where missed; empty in a healthy row, sizes also where the
        fault has none.
    calibration
        None where more than one answer is right.
    false_alarms
        Episodes on healthy records by reality; pumps are numbered in the order of the reality's chunks.
    curve
        ROC against the healthy pumps of the study over the same flights; None without them.
    operating
        What other alarm thresholds would have done; None where ``curve`` is.
    """

    row: Row
    realities: tuple[str, ...]
    scopes: Mapping[str, ScopeScores]
    confusion: Mapping[Side, int]
    sizes: Array
    delays: Array
    calibration: Calibration | None
    false_alarms: Mapping[str, tuple[FalseAlarm, ...]]
    curve: Roc | None
    operating: OperatingCurve | None


def row_result(row: Row, outcomes: Mapping[Reality, Outcome], healthy: Seen | None, seed: int) -> RowResult:
    """Score a row.

    Parameters
    ----------
    outcomes
        Judged pumps by reality, at least one.
    healthy
        Healthy pumps under the same sensing, for the ROC.
    seed
        Of the resampling.
    """
    groups = {ALL_REALITIES: list(outcomes)}
    for reality in outcomes:
        groups.setdefault(scope_of_leak(reality.system_leak), []).append(reality)
    groups |= {reality.name: [reality] for reality in outcomes}
    found = {name: seen(row, joined([outcomes[r] for r in group])) for name, group in groups.items()}
    whole = found[ALL_REALITIES]
    scopes = {name: ScopeScores(len(s.last), int(s.judged.sum()), scores(s, seed)) for name, s in found.items()}
    everything = dict(scopes[ALL_REALITIES].scores)
    if row.limit is not None:
        everything |= life_scores(whole, row.limit, seed)
    if row.in_class:
        everything |= delay_scores(whole, seed)
    table = calibration(whole) if row.is_pooled else None
    if table is not None:
        everything |= _errors([table], seed, None)
    curve, operating = None, None
    if healthy is not None and row.onset is not None and not row.in_class:
        sound, faulty = (suspicion(s, row.onset, row.n_flights) for s in (healthy, whole))
        if len(sound) and len(faulty):
            curve = roc(sound, faulty)
            everything[ROC_AREA] = _area(sound, faulty, curve.area, seed)
            operating, at_one = operating_curve(healthy, whole, effective({}), seed)
            everything |= at_one
    scopes[ALL_REALITIES] = replace(scopes[ALL_REALITIES], scores=everything)
    is_faulty = row.truth is not State.HEALTHY
    return RowResult(
        row,
        tuple(r.name for r in outcomes),
        scopes,
        confusion(whole),
        alarm_sizes(whole) if is_faulty and has_size(whole) else np.zeros(0),
        alarm_delays(whole) if is_faulty else np.zeros(0),
        table,
        {r.name: tuple(false_alarm_episodes(found[r.name])) for r in outcomes},
        curve,
        operating,
    )


@dataclass(frozen=True)
class Pooled:
    """Calibration and coverage over all rows with one right answer.

    ``weights`` are those of the rows in the judge's prior proportion of faults (``detectors.evaluation.prevalence``);
    what counts a fault from its onset on, and the coverage, weigh all rows alike.
    """

    burst: bool
    rows: tuple[str, ...]
    weights: tuple[float, ...]
    scores: Mapping[str, Score]
    calibrations: tuple[Calibration, ...]


def pooled(results: Sequence[RowResult], seed: int, *, burst: bool) -> Pooled | None:
    """Pool the rows without, or with a burst in each window; None if there are none.

    Intervals of the coverage add the rows' own in quadrature: rows are independent of each other.
    """
    rows = [r for r in results if r.calibration is not None and r.row.sensing.burst is burst]
    tables = tuple(r.calibration for r in rows if r.calibration is not None)
    if not tables:
        return None
    weights = prior_weights([r.row for r in rows])
    found = _errors(tables, seed, weights)
    for name in COVERED.values():
        given = [r.scopes[ALL_REALITIES].scores[name] for r in rows if name in r.scopes[ALL_REALITIES].scores]
        if given:
            found[name] = _mean(given)
    return Pooled(burst, tuple(r.row.name for r in rows), tuple(weights), found, tables)


def side_confusion(results: Sequence[RowResult], *, burst: bool) -> dict[Side, dict[Side, int]]:
    """Pumps by the side of the truth and the side of their last verdict, over the rows with one right answer."""
    table: dict[Side, dict[Side, int]] = {}
    for result in results:
        if result.row.is_pooled and result.row.sensing.burst is burst:
            line = table.setdefault(SIDE_OF[result.row.truth], dict.fromkeys(Side, 0))
            for side, n in result.confusion.items():
                line[side] += n
    return table


def _errors(tables: Sequence[Calibration], seed: int, weights: Sequence[float] | None) -> dict[str, Score]:
    return {
        CONFIDENCE_ERROR: calibration_error([t.confidence for t in tables], seed, weights=weights, by_mass=True),
        EACH_ERROR: calibration_error([t.each for t in tables], seed, weights=weights, by_mass=True),
        CONFIDENCE_ERROR_FROM_ONSET: calibration_error([t.confidence_from_onset for t in tables], seed),
        EACH_ERROR_FROM_ONSET: calibration_error([t.each_from_onset for t in tables], seed),
        ALARMED_ERROR: calibration_error([t.alarmed for t in tables], seed),
    }


def _area(sound: Array, faulty: Array, area: float, seed: int) -> Score:
    """Area below the ROC; healthy and faulty pumps are resampled apart."""
    rng = np.random.default_rng(seed)
    draws = [
        roc(sound[rng.integers(0, len(sound), len(sound))], faulty[rng.integers(0, len(faulty), len(faulty))]).area
        for _ in range(N_DRAWS)
    ]
    low, high = np.quantile(draws, (0.025, 0.975))
    return Score(area, float(low), float(high))


def _mean(given: Sequence[Score]) -> Score:
    n = len(given)
    value = sum(s.value for s in given) / n
    below = math.sqrt(sum((s.value - s.low) ** 2 for s in given)) / n
    above = math.sqrt(sum((s.high - s.value) ** 2 for s in given)) / n
    return Score(value, value - below, value + above)
