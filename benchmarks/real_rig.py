"""Zero-flow features, measured reference and charts on a real hydraulic rig with graded pump leakage.

``python -m benchmarks.real_rig PATH`` writes ``benchmarks/results/real_rig.json`` and ``.svg`` (derived statistics
only). PATH is a NumPy archive of the public set "Condition monitoring of hydraulic systems" (Helwig, Pignanelli and
Schuetze, I2MTC 2015, doi 10.1109/I2MTC.2015.7151267; UCI Machine Learning Repository no. 447): cycles of 60 s as
arrays (n, 60) of 1 s means named like the set's files, ``profile`` (n, 5) with cooler %, valve %, pump leakage
0/1/2, accumulator bar and stable flag (0 = stable), ``cycle`` (n,) with the row in the full set.

In every cycle the circuit closes for seconds 2 to 8 and the pump holds its pressure against no flow. The judge sees
pressure and temperature alone. Labels choose the healthy training blocks and count the results, nothing else; one
block is all neighbouring cycles of one condition, and is never divided between training and judging.
"""

import functools
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import RESULTS, keep
from benchmarks.charts import Chart, Cusum, Glr, Side, cusum_threshold, glr_threshold, run
from detectors.evaluation.scores import proportion
from detectors.expectation.reference_curve import OutsideRange, ReferenceCurve, Regressor, fit_reference

Array = NDArray[np.float64]

PLATEAU = slice(2, 8)
MOST_SPREAD_BAR = 0.2
"""Spread within a plateau above which it is not steady: 0.1 % of the regulated pressure."""
REPEATABILITY_BAR = 0.03
SMALLEST_FALL_BAR = 0.15
"""Fall of the regulated pressure that the charts are set for: five times the repeatability."""
ARL0_CYCLES = 100_000.0
TEMPERATURE = Regressor("oil temperature TS1", "degC", scale=5.0, margin=2.0, degree=2, gap=2.0)
DEPARTURE_BAR = 0.5
N_FOLDS = 5
COOLER, VALVE, PUMP, ACCUMULATOR, UNSTABLE = range(5)
FAULTLESS = {COOLER: 100, VALVE: 100, ACCUMULATOR: 130}
NAMES = {COOLER: "cooler", VALVE: "valve", ACCUMULATOR: "accumulator"}
GRADES = ("none", "weak", "severe")


@dataclass(frozen=True, slots=True)
class Block:
    """Neighbouring cycles of one condition: labels, and the features that the judge sees, each (n,)."""

    profile: tuple[int, ...]
    temperature: Array
    pressure: Array


@dataclass(frozen=True, slots=True)
class Judgement:
    """What was found on one block: cycles outside the range, first alarm of each chart (cycle, from 1; None)."""

    cycles: int
    outside: int
    reason: str | None
    residual_bar: float
    predictive_sd_bar: float
    first_alarm: Mapping[str, int | None]


def blocks(archive: Mapping[str, NDArray[Any]]) -> list[Block]:
    """Blocks of stable cycles in time order with the plateau's features, unsteady plateaus as NaN.

    Raises
    ------
    ValueError
        Names every array that is missing or has a wrong shape.
    """
    _check(archive)
    profile, cycle = archive["profile"], archive["cycle"]
    plateau = archive["PS1"][:, PLATEAU].astype(np.float64)
    pressure = np.where(plateau.std(axis=1) <= MOST_SPREAD_BAR, plateau.mean(axis=1), np.nan)
    temperature = archive["TS1"][:, PLATEAU].astype(np.float64).mean(axis=1)
    edges = np.flatnonzero((np.diff(profile, axis=0) != 0).any(axis=1) | (np.diff(cycle) != 1)) + 1
    spans = [s for s in np.split(np.arange(len(profile)), edges) if len(s) and profile[s[0], UNSTABLE] == 0]
    return [Block(tuple(profile[s[0]].tolist()), temperature[s], pressure[s]) for s in spans]


def reference(training: Sequence[Block]) -> ReferenceCurve:
    """Healthy regulated pressure over oil temperature from the training blocks whose pump is healthy."""
    healthy = [b for b in training if b.profile[PUMP] == 0]
    if not healthy:
        raise ValueError("no training block has a healthy pump; the reference needs at least one")
    return fit_reference(
        [TEMPERATURE],
        np.concatenate([b.temperature for b in healthy])[:, None],
        np.concatenate([b.pressure for b in healthy]),
        repeatability=REPEATABILITY_BAR,
        departure=DEPARTURE_BAR,
        groups=np.repeat(np.arange(len(healthy)), [len(b.pressure) for b in healthy]),
    )


def judge(curve: ReferenceCurve, temperature: Array, pressure: Array) -> Judgement:
    """Charts over one block's cycles in order; sees no label."""
    residual, sd = np.full(len(pressure), np.nan), np.full(len(pressure), np.nan)
    reasons: list[str] = []
    for i, (t, p) in enumerate(zip(temperature, pressure, strict=True)):
        found = curve.at({TEMPERATURE.name: float(t)})
        if isinstance(found, OutsideRange):
            reasons.extend(found.reasons)
        else:
            residual[i], sd[i] = p - found.mean, found.predictive_sd
    known = np.isfinite(residual)
    alarms: dict[str, int | None] = {}
    for name, (chart, guard_bar) in _charts(round(curve.scatter, 3)).items():
        hit = run(chart, (residual + guard_bar) / sd) >= chart.threshold
        alarms[name] = int(np.argmax(hit)) + 1 if hit.any() else None
    return Judgement(
        len(pressure),
        len(reasons),
        reasons[0] if reasons else None,
        float(residual[known].mean()) if known.any() else math.nan,
        float(sd[known].mean()) if known.any() else math.nan,
        alarms,
    )


@functools.cache
def _charts(scatter_bar: float) -> dict[str, tuple[Chart[Any], float]]:
    """Each chart with the fall [bar] that it is to overlook.

    Blocks share an error that repetition does not average away. The CUSUM overlooks half of the fall by its
    reference; the GLR, which looks for a fall of any size, is told of none before half of it.
    """
    half = 0.5 * SMALLEST_FALL_BAR
    k = half / scatter_bar
    arl = max(ARL0_CYCLES, 1.01 * _least_arl(k))
    return {
        "CUSUM": (Cusum(k, cusum_threshold(k, arl, Side.LOWER), Side.LOWER), 0.0),
        "GLR": (Glr(10, _glr_threshold(), side=Side.LOWER), half),
    }


@functools.cache
def _glr_threshold() -> float:
    return glr_threshold(10, ARL0_CYCLES, side=Side.LOWER).threshold


def _least_arl(reference_sigma: float) -> float:
    """Records between values beyond the reference alone: no CUSUM alarms more often [records]."""
    return 2.0 / math.erfc(reference_sigma / math.sqrt(2.0))


def held_out_blocks(all_blocks: Sequence[Block]) -> list[tuple[Block, Judgement]]:
    """Every block judged by a reference from the other folds' blocks; fold of a block: its number modulo 5."""
    found = []
    for fold in range(N_FOLDS):
        curve = reference([b for i, b in enumerate(all_blocks) if i % N_FOLDS != fold])
        found += [(b, judge(curve, b.temperature, b.pressure)) for b in all_blocks[fold::N_FOLDS]]
    return found


def held_out_level(all_blocks: Sequence[Block], column: int, level: int) -> list[tuple[Block, Judgement]]:
    """Blocks of one level of a circuit part, judged by a reference that never saw this level."""
    curve = reference([b for b in all_blocks if b.profile[column] != level])
    return [(b, judge(curve, b.temperature, b.pressure)) for b in all_blocks if b.profile[column] == level]


def summary(judged: Sequence[tuple[Block, Judgement]]) -> dict[str, Any]:
    """Counts with 95 % intervals; a block is outside if most of its cycles are, and is then not counted as judged."""
    inside = [(b, j) for b, j in judged if 2 * j.outside <= j.cycles]
    outside = [j for _, j in judged if 2 * j.outside > j.cycles]
    out: dict[str, Any] = {
        "blocks": len(judged),
        "outside_range": len(outside),
        "outside_range_example": outside[0].reason if outside else None,
        "alarms_in_blocks_outside": sum(any(j.first_alarm.values()) for j in outside),
    }
    for chart in ("CUSUM", "GLR") if inside else ():
        rows: dict[str, Any] = {}
        for grade, words in enumerate(GRADES):
            of_grade = [j.first_alarm[chart] for b, j in inside if b.profile[PUMP] == grade]
            first = [a for a in of_grade if a is not None]
            key = "false_alarms" if grade == 0 else f"found_{words}_leakage"
            rows[key] = _count(len(first), len(of_grade))
            if grade and first:
                rows[key]["median_cycles_to_alarm"] = float(np.median(first))
                rows[key]["most_cycles_to_alarm"] = max(first)
        for column, name in NAMES.items():
            faulty = [
                j.first_alarm[chart]
                for b, j in inside
                if b.profile[PUMP] == 0 and b.profile[column] != FAULTLESS[column]
            ]
            rows[f"false_alarms_with_{name}_fault"] = _count(sum(a is not None for a in faulty), len(faulty))
        out[chart] = rows
    for grade, words in enumerate(GRADES):
        residual = [j.residual_bar for b, j in inside if b.profile[PUMP] == grade]
        if residual:
            quantities = {"mean": float(np.mean(residual)), "low": min(residual), "high": max(residual)}
            out[f"residual_bar_{words}"] = {k: round(v, 4) for k, v in quantities.items()}
    return out


def _count(n: int, of: int) -> dict[str, Any]:
    score = proportion(n, of)
    return {"n": n, "of": of, "interval_95": [round(score.low, 4), round(score.high, 4)]}


def study(archive: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """All splits: blocks held out, and each level of each circuit part held out."""
    all_blocks = blocks(archive)
    found: dict[str, Any] = {
        "command": "python -m benchmarks.real_rig PATH",
        "cycles": int(sum(len(b.pressure) for b in all_blocks)),
        "blocks": len(all_blocks),
        "settings": {
            "arl0_cycles": ARL0_CYCLES,
            "smallest_fall_bar": SMALLEST_FALL_BAR,
            "repeatability_bar": REPEATABILITY_BAR,
            "regressor": asdict(TEMPERATURE),
        },
        "held_out_blocks": summary(held_out_blocks(all_blocks)),
    }
    for column, name in NAMES.items():
        levels = sorted({b.profile[column] for b in all_blocks})
        for level in levels if len(levels) > 1 else []:
            found[f"never_trained_{name}_{level}"] = summary(held_out_level(all_blocks, column, level))
    return found


def draw(archive: Mapping[str, NDArray[Any]], path: Path) -> None:
    """Mean departure of each held-out block over its mean temperature."""
    import matplotlib as mpl  # noqa: PLC0415

    mpl.use("Agg")
    import matplotlib.pyplot as plt  # noqa: PLC0415

    mpl.rcParams["svg.hashsalt"] = "real_rig"
    judged = held_out_blocks(blocks(archive))
    figure, axis = plt.subplots(figsize=(7.2, 4.4), layout="constrained")
    for grade, (words, marker) in enumerate(zip(GRADES, "osv", strict=True)):
        rows = [(b.temperature.mean(), j.residual_bar) for b, j in judged if b.profile[PUMP] == grade]
        x, y = zip(*rows, strict=True) if rows else ((), ())
        axis.plot(x, y, marker, mfc="none", label=f"pump leakage: {words}")
    axis.axhline(-0.5 * SMALLEST_FALL_BAR, linestyle="--", color="0.4", label="half the fall looked for")
    axis.set_xlabel("oil temperature [degC]")
    axis.set_ylabel("regulated pressure, measured - reference [bar]")
    axis.grid(visible=True, alpha=0.3)
    axis.legend(fontsize=8)
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


def _check(archive: Mapping[str, NDArray[Any]]) -> None:
    faults = [f"{name} is missing" for name in ("PS1", "TS1", "profile", "cycle") if name not in archive]
    if not faults:
        n = len(archive["cycle"])
        expected = {"PS1": (n, 60), "TS1": (n, 60), "profile": (n, 5), "cycle": (n,)}
        faults = [
            f"{name} has shape {archive[name].shape}; {shape} is needed"
            for name, shape in expected.items()
            if archive[name].shape != shape
        ]
    if faults:
        raise ValueError("; ".join(faults))


def main() -> None:
    """Judge, draw, keep."""
    if len(sys.argv) != 2:
        raise SystemExit("usage: python -m benchmarks.real_rig PATH (a NumPy archive; see this file's first lines)")
    with np.load(sys.argv[1]) as archive:
        arrays = {name: archive[name] for name in archive.files}
    keep("real_rig", study(arrays))
    draw(arrays, RESULTS / "real_rig.svg")


if __name__ == "__main__":
    main()
