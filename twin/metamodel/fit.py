"""Fit the metamodel of a pump's slipper gap to runs of its transient, and say how far it errs on runs held out.

A Gaussian process with one length per feature (scikit-learn; installed with the extra ``fit``) is fitted once, to all
answers together; what it has learnt is a table of nodes and weights, which kernels read (``twin.parts.slipper_map``).
"""

import os
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.metamodel.held import held_run
from twin.metamodel.places import bounds, places
from twin.parameters import Pump, PumpType
from twin.parts.slipper_map import (
    ANSWERS,
    FROM_DISCHARGE,
    FROM_SUCTION,
    N_AXES,
    N_FEATURES,
    OVER_SUCTION,
    SlipperMap,
    mapped,
    throttle_capacity,
    write_features,
)
from twin.pumps import circuit_parameters
from twin.slipper_maps import StoredMap, gap_numbers_hash
from twin.sources import sources_hash
from twin.units import M3_PER_S_PER_LPM, PA_PER_BAR, STANDARD_ATMOSPHERE_BAR

Matrix = NDArray[np.float64]

LEAKAGE = "case_leakage_lpm"
"""Both flows of the slippers together: what they leak into the case."""
_P_AMB = STANDARD_ATMOSPHERE_BAR * PA_PER_BAR
_SEED, _SEED_HELD_OUT = 1, 2


@dataclass(frozen=True, slots=True)
class Fit:
    """A fitted metamodel with the runs that were held out of it.

    Attributes
    ----------
    stored
        What kernels and files take.
    axes, truth, predicted
        Runs held out: points (m, N_AXES), answers of the transient and of the metamodel, (m, len(ANSWERS)).
    """

    stored: StoredMap
    axes: Matrix
    truth: Matrix
    predicted: Matrix


def fit_map(
    kind: PumpType,
    nodes: int = 640,
    held_out: int = 200,
    *,
    n_workers: int | None = None,
    progress: Callable[[float], None] = lambda _share: None,
) -> Fit:
    """Fit the metamodel of a pump type whose slipper gap is variable.

    Parameters
    ----------
    kind
        A set with ``slipper.variable`` 1.
    nodes, held_out
        Runs that are fitted, and runs that say the error. A run is three revolutions of the transient pump.
    progress
        Told the share of the runs that is done.

    Raises
    ------
    ValueError
        for a set with a constant gap, or where hardly a run goes through.
    ImportError
        without scikit-learn: the extra ``fit``.
    """
    if kind.pump.slipper.variable < 0.5:
        raise ValueError(f"{kind.name}: slipper.variable is 0, its gap is slipper.h and needs no metamodel")
    points = [places(kind, nodes, _SEED), places(kind, held_out, _SEED_HELD_OUT)]
    both = np.concatenate(points)
    circuit = circuit_parameters("separate_drain")
    done = 0
    found = np.empty((len(both), len(ANSWERS)))
    with ThreadPoolExecutor(n_workers or os.cpu_count() or 1) as pool:
        for i, answers in enumerate(pool.map(lambda axes: held_run(kind.pump, circuit, axes), both)):
            found[i] = answers
            done += 1
            progress(done / len(both))
    good = np.isfinite(found).all(axis=1)
    fitted = good & (np.arange(len(both)) < len(points[0]))
    others = good & ~fitted
    if fitted.sum() < 50 or others.sum() < 10:
        raise ValueError(f"{kind.name}: only {int(good.sum())} of {len(both)} runs of the transient pump went through")
    model = _fitted(kind.pump, both[fitted], found[fitted])
    low, high = bounds(kind, both[fitted])
    model = model._replace(low=low, high=high)
    predicted = predict(kind.pump, model, both[others])
    stored = StoredMap(
        model,
        gap_numbers_hash(kind.pump),
        f"slipper gap of {kind.name}, {int(fitted.sum())} runs",
        sources_hash("twin.metamodel.held"),
        _errors(predicted, found[others]),
        _reach(kind.pump, model, both[others]),
    )
    return Fit(stored, both[others], found[others], predicted)


def features(pump: Pump, axes: Matrix) -> Matrix:
    """Features at points of the axes (m, N_AXES) at standard ambient pressure, shape (m, N_FEATURES)."""
    found = np.empty((len(axes), N_FEATURES))
    for i in range(len(axes)):
        write_features(pump, np.ascontiguousarray(axes[i]), _P_AMB, found[i])
    return found


def predict(pump: Pump, model: SlipperMap, axes: Matrix) -> Matrix:
    """Answers of a metamodel at points (m, N_AXES), in the units of ``ANSWERS``, shape (m, len(ANSWERS))."""
    per = np.array([M3_PER_S_PER_LPM, M3_PER_S_PER_LPM, 1.0, 1.0, 1.0e-6])
    found = [mapped(pump, model, axes[i].copy(), _P_AMB)[: len(ANSWERS)] for i in range(len(axes))]
    answers: Matrix = np.array(found, dtype=np.float64).reshape(-1, len(ANSWERS)) / per
    return answers


def _fitted(pump: Pump, axes: Matrix, answers: Matrix) -> SlipperMap:
    from sklearn.exceptions import ConvergenceWarning  # noqa: PLC0415 - an extra
    from sklearn.gaussian_process import GaussianProcessRegressor  # noqa: PLC0415
    from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel  # noqa: PLC0415

    x, y = features(pump, axes), answers.copy()
    y[:, FROM_SUCTION] /= [throttle_capacity(pump, float(over)) for over in axes[:, OVER_SUCTION]]
    centre, spread = x.mean(axis=0), np.maximum(x.std(axis=0), 1.0e-12)
    mean, size = y.mean(axis=0), np.maximum(y.std(axis=0), 1.0e-12)
    lengths = Matern(np.full(N_FEATURES, 2.0), (0.05, 1.0e3), nu=2.5)
    process: Any = GaussianProcessRegressor(
        ConstantKernel(4.0) * lengths + WhiteKernel(1.0e-3, (1.0e-7, 1.0)), random_state=0
    )
    with warnings.catch_warnings():
        # a feature that decides nothing runs to its longest length, which is an answer
        warnings.simplefilter("ignore", ConvergenceWarning)
        process.fit((x - centre) / spread, (y - mean) / size)
    kernel = process.kernel_.k1
    per_length = 1.0 / (spread * kernel.k2.length_scale)
    return SlipperMap(
        nodes=_short((x - centre) * per_length),
        weights=_short(kernel.k1.constant_value * process.alpha_ * size, 9),
        centre=_short(centre, 12),
        per_length=_short(per_length, 12),
        mean=_short(mean, 12),
        low=axes.min(axis=0),
        high=axes.max(axis=0),
    )


def _reach(pump: Pump, model: SlipperMap, axes: Matrix) -> float:
    """Largest scaled distance from points to their nearest node [-]."""
    scaled = (features(pump, axes) - model.centre) * model.per_length
    apart = scaled[:, None, :] - model.nodes[None, :, :]
    return float(np.sqrt((apart**2).sum(axis=2).min(axis=1)).max())


def _short(values: Matrix, digits: int = 7) -> Matrix:
    """The same to so many decimals of its largest number: a file of half the size."""
    largest = float(np.abs(values).max())
    found: Matrix = np.ascontiguousarray(np.round(values / largest, digits) * largest)
    return found


def _errors(predicted: Matrix, truth: Matrix) -> dict[str, dict[str, float]]:
    off = {name: predicted[:, j] - truth[:, j] for j, name in enumerate(ANSWERS)}
    off[LEAKAGE] = off[ANSWERS[FROM_DISCHARGE]] + off[ANSWERS[FROM_SUCTION]]
    return {
        name: {
            "rms": float(np.sqrt(np.mean(e**2))),
            "p95": float(np.quantile(np.abs(e), 0.95)),
            "largest": float(np.abs(e).max()),
        }
        for name, e in off.items()
    }


__all__ = ["LEAKAGE", "N_AXES", "Fit", "features", "fit_map", "predict"]
