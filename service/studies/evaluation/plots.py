"""Curves of a study: how large and how late the alarms were, ROC, reliability."""

from collections.abc import Mapping, Sequence
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from detectors.evaluation.calibration import equal_mass, mean_shares
from detectors.evaluation.lives import LAMBDAS, covered_at, near_at
from detectors.evaluation.operating import OperatingCurve
from detectors.evaluation.summary import ALL_REALITIES, Pooled, RowResult
from service.studies.evaluation.numbers import thinned
from twin.validation.evidence import Curve, Plot

Array = NDArray[np.float64]


def row_plots(results: Mapping[str, RowResult]) -> list[Plot]:
    """Plots of one fault; ``results`` by the word for its sensing."""
    unit = next(iter(results.values())).row.unit
    sizes = {label: r.sizes for label, r in results.items() if len(r.sizes)}
    delays = {label: r.delays for label, r in results.items() if len(r.delays)}
    plots = []
    if sizes:
        plots.append(_reached("Size at the alarm", f"true size of the fault [{unit}]", sizes))
    if delays:
        plots.append(_reached("Delay", "flights from the onset to the alarm", delays))
    curves = {label: thinned(r.curve) for label, r in results.items() if r.curve is not None}
    if curves:
        lines = [Curve(label, np.array(x), np.array(y)) for label, (x, y) in curves.items()]
        caption = (
            "Pumps by the largest probability of a fault on the same flights: healthy ones to the right, faulty up."
        )
        plots.append(Plot("ROC", "healthy pumps suspected", "faulty pumps suspected", tuple(lines), caption))
    swept = {label: r.operating for label, r in results.items() if r.operating is not None}
    lived = {label: r for label, r in results.items() if r.row.limit is not None}
    return plots + (_swept(swept) if swept else []) + (_lived(lived) if lived else [])


def _lived(results: Mapping[str, RowResult]) -> list[Plot]:
    """Coverage of the forecast's intervals and nearness of its mean along the life."""
    plots = []
    for title, y_label, of in (
        ("Forecast: intervals", "share of 80 % intervals that hold the truth", covered_at),
        ("Forecast: alpha-lambda", "share of pumps with a mean within 20 % of the truth", near_at),
    ):
        curves = []
        for label, result in results.items():
            scores = result.scopes[ALL_REALITIES].scores
            at = [share for share in LAMBDAS if of(share) in scores]
            if at:
                curves.append(Curve(label, np.array(at), np.array([scores[of(share)].value for share in at])))
        if curves:
            caption = "Lives run from the installation to the first flight at the limit; no forecast is no interval."
            plots.append(Plot(title, "share of the life", y_label, tuple(curves), caption))
    return plots


def _swept(curves: Mapping[str, OperatingCurve]) -> list[Plot]:
    """Share found and median delay over false alarms, the alarm threshold swept."""
    x_label = "false alarms per 10,000 healthy records"
    found, late = [], []
    for label, curve in curves.items():
        x = np.array([s.value for s in curve.false_alarms])
        found.append(Curve(label, x, np.array([s.value for s in curve.detected])))
        reached = np.array([s.value for s in curve.delay])
        kept = np.isfinite(reached)
        if kept.any():
            late.append(Curve(label, x[kept], reached[kept]))
    ends = next(iter(curves.values())).thresholds
    caption = f"The threshold of the alarm runs from {ends[0]:g} to {ends[-1]:g} nat; intervals are in the numbers."
    plots = [Plot("Found over false alarms", x_label, "share of faulty pumps", tuple(found), caption)]
    if late:
        plots.append(Plot("Delay over false alarms", x_label, "median flights from the onset", tuple(late), caption))
    return plots


_TRUE_NOW = "Every judged record, a fault true where it exceeds its floor, rows in the judge's prior proportion"
_TRUE_LATER = "Records after the onset, every row with the same weight"


class Reading(Enum):
    """Which statements a reliability diagram shows: (attribute of ``Calibration``, title, records)."""

    CONFIDENCE = ("confidence", "Reliability of the largest probability", _TRUE_NOW)
    EACH = ("each", "Reliability of all six probabilities", _TRUE_NOW)
    CONFIDENCE_FROM_ONSET = ("confidence_from_onset", "The largest, faulty from the onset on", _TRUE_LATER)
    EACH_FROM_ONSET = ("each_from_onset", "All six, faulty from the onset on", _TRUE_LATER)
    ALARMED = (
        "alarmed",
        "Reliability of the largest probability in alarm",
        "Records in alarm, every row with the same weight",
    )


def reliability_plot(pools: Sequence[Pooled], of: Reading) -> Plot:
    """Observed share over stated probability."""
    name, title, records = of.value
    ends = np.array([0.0, 1.0])
    curves = [Curve("as stated", ends, ends)]
    for pool in pools:
        tables = [getattr(c, name) for c in pool.calibrations]
        is_fine = of in (Reading.CONFIDENCE, Reading.EACH)
        shares = equal_mass(mean_shares(tables, pool.weights)) if is_fine else mean_shares(tables)
        counted, stated, happened = shares
        used = counted > 0.0
        label = "with bursts" if pool.burst else "windows"
        curves.append(Curve(label, stated[used] / counted[used], happened[used] / counted[used]))
    caption = f"Below the line the judge was too sure. {records}."
    return Plot(title, "stated probability", "share that happened", tuple(curves), caption)


def _reached(title: str, x_label: str, values: Mapping[str, Array]) -> Plot:
    """Share of pumps whose alarm came at this value or before; missed ones keep the curve below 1."""
    curves, missed = [], []
    for label, found in values.items():
        reached = np.sort(found[np.isfinite(found)])
        share = np.arange(1, len(reached) + 1) / len(found)
        start = reached[:1]
        curves.append(Curve(label, np.concatenate([start, reached]), np.concatenate([0.0 * start, share])))
        missed.append(f"{len(found) - len(reached)} of {len(found)} pumps without an alarm ({label})")
    return Plot(title, x_label, "share of pumps", tuple(curves), "; ".join(missed) + ".")
