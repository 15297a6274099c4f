"""Curves of a study: how large and how late the alarms were, ROC, reliability."""

from collections.abc import Mapping, Sequence
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from detectors.evaluation.calibration import mean_shares
from detectors.evaluation.summary import Pooled, RowResult
from service.evaluation.numbers import thinned
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
    return plots


class Reading(Enum):
    """Which statements a reliability diagram shows: (attribute of ``Calibration``, title, records)."""

    CONFIDENCE = ("confidence", "Reliability of the largest probability", "Records after the onset")
    EACH = ("each", "Reliability of all six probabilities", "Records after the onset")
    ALARMED = ("alarmed", "Reliability of the largest probability in alarm", "Records in alarm")


def reliability_plot(pools: Sequence[Pooled], of: Reading) -> Plot:
    """Observed share over stated probability."""
    name, title, records = of.value
    ends = np.array([0.0, 1.0])
    curves = [Curve("as stated", ends, ends)]
    for pool in pools:
        counted, stated, happened = mean_shares([getattr(c, name) for c in pool.calibrations])
        used = counted > 0.0
        label = "with bursts" if pool.burst else "windows"
        curves.append(Curve(label, stated[used] / counted[used], happened[used] / counted[used]))
    caption = f"Below the line the judge was too sure. {records}; every row with the same weight."
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
