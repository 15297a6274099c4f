"""Numbers of a pump from static points on a load, all points jointly, by the objective of equation 3-15.

The thesis fitted every point by itself, because its tool could not do otherwise, and took the mean. Here one set of numbers
is sought for all points, by sequential quadratic programming (the thesis' NLPQL) and by an evolutionary search over the
whole box (it names a genetic algorithm), which needs neither start nor slope: SQP stops at the first minimum, as the thesis says.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, differential_evolution, minimize
from scipy.stats import spearmanr

from twin.condition import Condition, Health, input_rows
from twin.operating_point import operating_points
from twin.parameters import Circuit, Pump
from twin.units import M3_PER_S_PER_LPM, PA_PER_BAR

Vector = NDArray[np.float64]
Method = Literal["sqp", "evolution"]

UNSOLVED = 10.0
"""Normalised error of a point without a steady state: worse than any that has one."""
_SEED = 20
_STARTS = 4
_CHAINS, _DRAWS = 14, 150
_BOUND = 1.0e-3
"""Of the box: nearer to its edge a number has ended there."""
_TOGETHER = 0.7
_OPEN = 0.45
"""Of the box: an interval as wide as half of what holds without any point."""


class StaticPoint(NamedTuple):
    """A point of figure 3-1: condition, load k_d of equation 3-2 [bar/(L/min)^2], 0 at zero flow, and measured outputs."""

    condition: Condition
    load: float
    measured: Mapping[str, float]


class Box(NamedTuple):
    """A number to find, in ``unit``: between ``low`` and ``high``; ``si`` is the unit in SI."""

    path: str
    unit: str
    low: float
    high: float
    si: float


@dataclass(frozen=True, slots=True)
class Found:
    """A number found [unit of its box].

    Attributes
    ----------
    low, high
        90 % interval of all sets of numbers in the box that explain the points, their misfit taken as their error.
    at_bound
        True where the best number lies at the edge of its box.
    open
        True where the interval spans nearly half of the box or more: the points do not tell this number.
    beside
        Numbers that it cannot be told from (rank correlation of those sets above 0.7).
    """

    path: str
    unit: str
    value: float
    low: float
    high: float
    at_bound: bool
    open: bool
    beside: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class JointFit:
    """Numbers found for all points together; ``objective`` is the sum of equation 3-15 over the measured outputs.

    ``predicted`` is by output, shape (points,); ``evaluations`` counts how often all points were solved.
    """

    method: Method
    found: tuple[Found, ...]
    objective: float
    objectives: Mapping[str, float]
    predicted: Mapping[str, Vector]
    evaluations: int
    pump: Pump


def changed(pump: Pump, boxes: Sequence[Box], values: Sequence[float]) -> Pump:
    """The pump with these numbers [unit of each box] in place of its own."""
    for box, value in zip(boxes, values, strict=True):
        part, _, name = box.path.partition(".")
        block: Any = getattr(pump, part)
        pump = pump._replace(**{part: block._replace(**{name: float(value) * box.si})})
    return pump


def predicted(
    pump: Pump, points: Sequence[StaticPoint], circuit: Circuit, outputs: Sequence[str], health: Health
) -> dict[str, Vector]:
    """What the operating point gives at each point, by output, shape (points,); NaN where there is no steady state."""
    rows = input_rows([p.condition for p in points], [health] * len(points))
    loads = np.array([p.load for p in points]) * PA_PER_BAR / M3_PER_S_PER_LPM**2
    solved = operating_points(pump, rows, circuit, load_coefficient=loads)
    return {name: solved.value(name) for name in outputs}


def joint_fit(
    pump: Pump,
    points: Sequence[StaticPoint],
    circuit: Circuit,
    boxes: Sequence[Box],
    normalisation: Mapping[str, float],
    method: Method = "sqp",
    generations: int = 120,
) -> JointFit:
    """Find one set of numbers for all points (3-15).

    Parameters
    ----------
    points
        Each measures every output that ``normalisation`` names.
    boxes
        What is free, and how far.
    normalisation
        Factor X_v of each output [its unit].
    method
        ``sqp``: SLSQP from the pump itself and from three draws; ``evolution``: differential evolution, whose bounds are
        its only knowledge, and SLSQP from where it ends.
    generations
        Most generations of the evolution.

    Raises
    ------
    ValueError
        where an output was not measured at a point, or a number starts outside of its box.
    """
    faults = [
        f"point {i}: {name} was not measured"
        for i, point in enumerate(points, 1)
        for name in normalisation
        if name not in point.measured
    ]
    own = np.array([_own(pump, box) for box in boxes])
    faults += [f"{b.path} = {v:g} {b.unit} starts outside of {b.low:g} to {b.high:g}" for b, v in
               zip(boxes, own, strict=True) if not b.low <= v <= b.high]  # fmt: skip
    if faults:
        raise ValueError("; ".join(faults))
    lows, widths = np.array([b.low for b in boxes]), np.array([b.high - b.low for b in boxes])
    count = [0]

    def errors(x: Vector) -> Vector:
        count[0] += 1
        return _errors(changed(pump, boxes, lows + x * widths), points, circuit, normalisation)

    def objective(x: Vector) -> float:
        return float((errors(np.clip(x, 0.0, 1.0)) ** 2).sum() / len(points))

    search = _sqp if method == "sqp" else _evolution
    x = search(objective, (own - lows) / widths, generations)
    best = changed(pump, boxes, lows + x * widths)
    found = _found(boxes, x, errors)
    squared = errors(x).reshape(len(normalisation), len(points)) ** 2
    values = predicted(best, points, circuit, tuple(normalisation), Health())
    each = dict(zip(normalisation, squared.mean(axis=1).tolist(), strict=True))
    return JointFit(method, found, sum(each.values()), each, values, count[0], best)


def _own(pump: Pump, box: Box) -> float:
    part, _, name = box.path.partition(".")
    return float(getattr(getattr(pump, part), name)) / box.si


def _errors(pump: Pump, points: Sequence[StaticPoint], circuit: Circuit, normalisation: Mapping[str, float]) -> Vector:
    """Errors over their factors, shape (outputs * points,)."""
    values = predicted(pump, points, circuit, tuple(normalisation), Health())
    rows = [(np.array([p.measured[n] for p in points]) - values[n]) / X for n, X in normalisation.items()]
    return np.nan_to_num(np.concatenate(rows), nan=UNSOLVED)


def _sqp(objective: Callable[[Vector], float], start: Vector, _: int) -> Vector:
    rng = np.random.default_rng(_SEED)
    starts = [start, *rng.uniform(0.1, 0.9, size=(_STARTS - 1, len(start)))]
    return min((_downhill(objective, s) for s in starts), key=objective)


def _downhill(objective: Callable[[Vector], float], start: Vector) -> Vector:
    bounds = Bounds(np.zeros(len(start)), np.ones(len(start)))
    run = minimize(
        objective, start, method="SLSQP", bounds=bounds, options={"maxiter": 200, "ftol": 1e-10, "eps": 1e-6}
    )
    return np.clip(np.asarray(run.x, dtype=np.float64), 0.0, 1.0)


def _evolution(objective: Callable[[Vector], float], start: Vector, generations: int) -> Vector:
    bounds = Bounds(np.zeros(len(start)), np.ones(len(start)))
    run = differential_evolution(objective, bounds, maxiter=generations, popsize=8, tol=1e-6, polish=False, rng=_SEED)
    best = np.asarray(run.x, dtype=np.float64)
    return min((best, _downhill(objective, best)), key=objective)


def _draws(x: Vector, errors: Callable[[Vector], Vector]) -> Vector:
    """Sets of numbers that explain the points, shape (m, n): a differential-evolution Markov chain within the box.

    The misfit at ``x`` counts as the points' error, every place in the box as equally likely before. A curvature would not do:
    the leakage of a gap goes with its cube, so that a narrow gap has none, and two gaps make one ridge.
    """
    rng, n = np.random.default_rng(_SEED), len(x)
    best = errors(x)
    scale = float(best @ best) / max(len(best) - n, 1)

    def height(place: Vector) -> float:
        if ((place < 0.0) | (place > 1.0)).any():
            return -np.inf
        found = errors(place)
        return -0.5 * float(found @ found) / scale

    chains = np.clip(x + rng.normal(0.0, 0.05, (_CHAINS, n)), 0.0, 1.0)
    heights = np.array([height(place) for place in chains])
    kept = []
    for step in range(_DRAWS):
        for k in range(_CHAINS):
            one, two = rng.choice(_CHAINS, 2, replace=False)
            # every tenth step may jump from ridge to ridge
            reach = 1.0 if step % 10 == 0 else 2.38 / np.sqrt(2.0 * n)
            place = chains[k] + reach * (chains[one] - chains[two]) + rng.normal(0.0, 0.005, n)
            there = height(place)
            if np.log(rng.uniform()) < there - heights[k]:
                chains[k], heights[k] = place, there
        if step >= _DRAWS // 3:
            kept.append(chains.copy())
    return np.concatenate(kept)


def _found(boxes: Sequence[Box], x: Vector, errors: Callable[[Vector], Vector]) -> tuple[Found, ...]:
    draws = _draws(x, errors)
    lows, highs = np.quantile(draws, [0.05, 0.95], axis=0)
    together = np.atleast_2d(spearmanr(draws).statistic) if len(boxes) > 2 else np.eye(len(boxes))
    found = []
    for k, box in enumerate(boxes):
        width = box.high - box.low
        beside = tuple(b.path for j, b in enumerate(boxes) if j != k and abs(together[k, j]) > _TOGETHER)
        at_bound = not _BOUND < x[k] < 1.0 - _BOUND
        low, high = float(min(lows[k], x[k])), float(max(highs[k], x[k]))
        found.append(
            Found(box.path, box.unit, box.low + float(x[k]) * width, box.low + low * width, box.low + high * width,
                  at_bound, high - low >= _OPEN, beside)
        )  # fmt: skip
    return tuple(found)
