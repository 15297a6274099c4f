"""All numbers of a study as plain values; what is not a number is None."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from detectors.evaluation.calibration import N_BINS, Calibration, Reliability, equal_mass, mean_shares
from detectors.evaluation.operating import OperatingCurve
from detectors.evaluation.reality import DIFFERENCES, REALITIES
from detectors.evaluation.scores import Roc, Score
from detectors.evaluation.summary import RowResult, side_confusion
from detectors.evaluation.targets import NOT_SIMULATED, Finding
from detectors.judgement.version import twin_version
from detectors.words.verdict import Side
from service.answers.job_documents import (
    OperatingPointOfAlarm,
    Reliabilities,
    ReliabilityBin,
    Scored,
    StudyReport,
    StudyRow,
    StudyTarget,
)
from service.identity import software
from service.studies.evaluation.run import Results
from twin.pumps import pump_type

_MOST_POINTS = 200


def study_json(results: Results) -> StudyReport:
    """The study, its targets, every score of every row with its interval, and the curves."""
    study = results.study
    return {
        "study": {
            "version": software().release,
            "software": software().to_json(),
            "twin": twin_version(pump_type(study.pump_type)),
            "seed": study.seed,
            "pumps_per_row": study.n_pumps,
            "healthy_records_per_reality": study.n_healthy_records,
            "realities": [r.name for r in REALITIES],
            "differences": list(DIFFERENCES),
            "intervals": 0.95,
            "not_simulated": list(NOT_SIMULATED),
        },
        "targets": [_finding(f) for f in results.findings],
        "pooled": [
            {
                "burst": p.burst,
                "rows": list(p.rows),
                "weights": list(p.weights),
                "scores": _scores(p.scores),
                "reliability": _reliabilities(p.calibrations, p.weights),
                "confusion": _confusion(results, burst=p.burst),
            }
            for p in results.pools
        ],
        "rows": [_row(r) for r in results.rows],
    }


def thinned(curve: Roc) -> tuple[list[float], list[float]]:
    """False alarm and detection rates of a ROC from corner to corner, at most some 200 points of it."""
    n = len(curve.thresholds)
    at = np.unique(np.linspace(0, n - 1, min(n, _MOST_POINTS)).astype(np.int64))
    return [0.0, *curve.false_alarm_rate[at].tolist()], [0.0, *curve.detection_rate[at].tolist()]


def _row(result: RowResult) -> StudyRow:
    row = result.row
    entry: StudyRow = {
        "row": row.name,
        "truth": row.truth.value,
        "burst": row.sensing.burst,
        "flights": row.n_flights,
        "onset_flight": row.onset,
        "unit": row.unit,
        "scopes": {
            name: {"pumps": s.pumps, "records": s.records, "scores": _scores(s.scores)}
            for name, s in result.scopes.items()
        },
        "sides_at_the_end": {side.value: n for side, n in result.confusion.items()},
        "sizes_at_the_alarm": [_number(v) for v in np.sort(result.sizes)],
        "false_alarms": [
            {"reality": name, "pump": e.pump, "flight": e.flight, "records": e.records, "state": e.state.value}
            for name, found in result.false_alarms.items()
            for e in found
        ],
        "delays": [_number(v) for v in np.sort(result.delays)],
    }
    if result.calibration is not None:
        entry["reliability"] = _reliabilities([result.calibration], (1.0,))
    if result.curve is not None:
        false_alarms, detections = thinned(result.curve)
        entry["roc"] = {"false_alarm_rate": false_alarms, "detection_rate": detections}
    if result.operating is not None:
        entry["operating_curve"] = _operating(result.operating)
    return entry


def _operating(curve: OperatingCurve) -> list[OperatingPointOfAlarm]:
    """By alarm threshold: false alarms, share found and delay, each with its interval."""
    return [
        {
            "alarm_on_log_odds": threshold,
            "false_alarms_per_10000_records": _score(false_alarms),
            "detected": _score(detected),
            "median_delay_flights": _score(delay),
        }
        for threshold, false_alarms, detected, delay in zip(
            curve.thresholds, curve.false_alarms, curve.detected, curve.delay, strict=True
        )
    ]


def _finding(finding: Finding) -> StudyTarget:
    target = finding.target
    return {
        "row": target.row,
        "burst": target.burst,
        "quantity": target.quantity,
        "scope": finding.scope,
        "at_least": _number(target.low),
        "at_most": _number(target.high),
        **_score(finding.score),
        "met": finding.met,
        "note": target.note,
    }


def _confusion(results: Results, *, burst: bool) -> dict[str, dict[str, int]]:
    table: Mapping[Side, Mapping[Side, int]] = side_confusion(results.rows, burst=burst)
    return {truth.value: {side.value: n for side, n in line.items()} for truth, line in table.items()}


def _reliabilities(rows: Sequence[Calibration], weights: Sequence[float]) -> Reliabilities:
    return {
        "confidence": _by_mass([c.confidence for c in rows], weights),
        "each": _by_mass([c.each for c in rows], weights),
        "confidence_from_onset": _reliability([c.confidence_from_onset for c in rows]),
        "each_from_onset": _reliability([c.each_from_onset for c in rows]),
        "alarmed": _reliability([c.alarmed for c in rows]),
    }


def _by_mass(tables: list[Reliability], weights: Sequence[float]) -> list[ReliabilityBin]:
    shares = equal_mass(mean_shares(tables, weights))
    return [
        {"share": float(n), "stated": float(p / n) if n else None, "happened": float(y / n) if n else None}
        for n, p, y in shares.T
    ]


def _reliability(tables: list[Reliability]) -> list[ReliabilityBin]:
    counted, stated, happened = mean_shares(tables)
    return [
        {
            "from": k / N_BINS,
            "to": (k + 1) / N_BINS,
            "share": float(counted[k]),
            "stated": float(stated[k] / counted[k]) if counted[k] else None,
            "happened": float(happened[k] / counted[k]) if counted[k] else None,
        }
        for k in range(N_BINS)
    ]


def _scores(scores: Mapping[str, Score]) -> dict[str, Scored]:
    return {name: _score(score) for name, score in scores.items()}


def _score(score: Score) -> Scored:
    return {"value": _number(score.value), "low": _number(score.low), "high": _number(score.high)}


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
