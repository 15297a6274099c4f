"""A healthy reference fitted to measured points: response over regressors, its band, its range, departures from it.

Case-minus-reservoir pressure over discharge pressure, temperature and speed is the use that it was made for; any
response will do. Few points fall back on the twin's shape, many speak for themselves.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import t as student_t

from detectors.words.numbers import STUDENT_DEGREES

Array = NDArray[np.float64]
Shape = Callable[[Array], Array]
"""Expected response of points, shape (n, number of regressors) in the regressors' order: the twin's curve."""

MOST_LEVERAGE = 2.0
"""Leverage beyond the fitted points' largest, by this factor, is outside the range."""
_NOISE_POINTS = 3.0
"""Points that the stated repeatability is worth against the residuals' own scatter (estimate)."""
_LEVEL_PRIOR = 100.0
"""Spread of a level without an expected shape, in all that the points show: as good as unknown (estimate)."""


@dataclass(frozen=True, slots=True)
class Regressor:
    """One variable that the healthy response follows.

    ``scale`` is a natural step of it, over which the response's departure from the expected shape is judged;
    ``margin`` is how far outside the fitted points the reference may still be asked, ``gap`` how far from the nearest
    of them, also between them; all in ``unit``.
    """

    name: str
    unit: str
    scale: float
    margin: float
    degree: int = 1
    gap: float = math.inf


@dataclass(frozen=True, slots=True)
class Reference:
    """Healthy response at one condition [response's unit].

    ``standard_deviation`` is that of the curve alone, ``predictive_sd`` that of one more healthy point; ``low`` and
    ``high`` bound one more healthy point with 90 % probability. ``slope`` is the change per unit of each regressor.
    """

    mean: float
    standard_deviation: float
    predictive_sd: float
    low: float
    high: float
    slope: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class OutsideRange:
    """Why no reference is given, every regressor that is to blame named."""

    reasons: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Departure:
    """One point against the curve: lifted ``across`` it, moved ``along`` it from ``home``, with their covariance.

    Across is in the response's unit, measured at the point's own regressors; along is in the first regressor's. The
    covariance holds the measurement, the curve and the healthy scatter.
    """

    across: float
    along: float
    covariance: tuple[tuple[float, float], tuple[float, float]]


@dataclass(frozen=True, slots=True)
class ReferenceCurve:
    """Posterior of a healthy reference; made by `fit_reference`."""

    regressors: tuple[Regressor, ...]
    centre: Array
    measured: Array
    """Fitted points' regressors, each column sorted by itself, shape (n, number of regressors)."""
    coefficients: Array
    covariance: Array
    """Of the coefficients in units of the scatter's variance, shape (p, p)."""
    scatter: float
    """Scatter of one healthy point about the curve [response's unit]."""
    dof: float
    largest_leverage: float
    shape: Shape | None

    def at(self, condition: Mapping[str, float]) -> Reference | OutsideRange:
        """Healthy response at a condition, or why it lies outside the range.

        Raises
        ------
        ValueError
            If the condition lacks a regressor or holds no number for it.
        """
        x = self._values(condition)
        reasons = self._outside(x)
        if reasons:
            return OutsideRange(reasons)
        mean, leverage = self._mean(x), self._leverage(x)
        widening = math.sqrt(self.dof / (self.dof - 2.0))
        reach = float(student_t.ppf(0.95, self.dof)) * self.scatter * math.sqrt(1.0 + leverage)
        slopes = self._slopes(x)
        return Reference(
            mean,
            self.scatter * math.sqrt(leverage) * widening,
            self.scatter * math.sqrt(1.0 + leverage) * widening,
            mean - reach,
            mean + reach,
            {r.name: float(s) for r, s in zip(self.regressors, slopes, strict=True)},
        )

    def departure(
        self, condition: Mapping[str, float], response: float, home: float, covariance: ArrayLike
    ) -> Departure | OutsideRange:
        """Where a measured point lies relative to the curve.

        Parameters
        ----------
        condition : Mapping[str, float]
            The point's regressors, each in its unit.
        response : float
            Its measured response.
        home : float
            Value of the first regressor from which displacement counts, as the healthy point at zero demand.
        covariance : ArrayLike
            Of the measured (first regressor, response), shape (2, 2).

        Raises
        ------
        ValueError
            If the condition lacks a regressor, or the covariance is not one of two numbers.
        """
        measured = np.asarray(covariance, dtype=np.float64)
        if measured.shape != (2, 2) or not np.isfinite(measured).all() or np.linalg.eigvalsh(measured)[0] < -1e-12:
            raise ValueError("covariance must be a finite, symmetric, non-negative matrix of shape (2, 2)")
        reference = self.at(condition)
        if isinstance(reference, OutsideRange):
            return reference
        first = self.regressors[0].name
        jacobian = np.array([[-reference.slope[first], 1.0], [1.0, 0.0]])
        total = jacobian @ measured @ jacobian.T
        total[0, 0] += reference.predictive_sd**2
        (aa, ab), (_, bb) = total.tolist()
        return Departure(response - reference.mean, condition[first] - home, ((aa, ab), (ab, bb)))

    def _values(self, condition: Mapping[str, float]) -> Array:
        faults = [
            f"{r.name} [{r.unit}] is {'missing' if r.name not in condition else 'not a number'}"
            for r in self.regressors
            if not math.isfinite(condition.get(r.name, math.nan))
        ]
        if faults:
            raise ValueError("; ".join(faults))
        return np.array([condition[r.name] for r in self.regressors])

    def _outside(self, x: Array) -> tuple[str, ...]:
        reasons = []
        for r, value, measured in zip(self.regressors, x, self.measured.T, strict=True):
            low, high, nearest = measured[0], measured[-1], float(np.abs(measured - value).min())
            if not low - r.margin <= value <= high + r.margin:
                reasons.append(
                    f"{r.name} is {value:.4g} {r.unit}; the reference was measured from {low:.4g} to {high:.4g} "
                    f"{r.unit} and reaches {r.margin:g} {r.unit} further"
                )
            elif nearest > r.gap:
                reasons.append(
                    f"{r.name} is {value:.4g} {r.unit}; the nearest measured point is {nearest:.3g} {r.unit} away, "
                    f"at most {r.gap:g} {r.unit} are allowed"
                )
        leverage = self._leverage(x)
        if reasons or leverage <= MOST_LEVERAGE * self.largest_leverage or leverage <= self._margin_leverage():
            return tuple(reasons)
        # the regressor whose return to the centre relieves the leverage most
        relieved = []
        for j in range(len(x)):
            back = x.copy()
            back[j] = self.centre[j]
            relieved.append(self._leverage(back))
        r = self.regressors[int(np.argmin(relieved))]
        return (f"{r.name} at {x[int(np.argmin(relieved))]:.4g} {r.unit} was never measured together with the others",)

    def _margin_leverage(self) -> float:
        """Largest leverage that the margins themselves allow, one regressor at a time from the centre."""
        found = [0.0]
        for j, r in enumerate(self.regressors):
            for edge in (self.measured[0, j] - r.margin, self.measured[-1, j] + r.margin):
                x = self.centre.copy()
                x[j] = edge
                found.append(self._leverage(x))
        return max(found)

    def _leverage(self, x: Array) -> float:
        row = _basis(x[None, :], self.regressors, self.centre)[0]
        return float(row @ self.covariance @ row)

    def _mean(self, x: Array) -> float:
        expected = float(self.shape(x[None, :])[0]) if self.shape else 0.0
        return expected + float(_basis(x[None, :], self.regressors, self.centre)[0] @ self.coefficients)

    def _slopes(self, x: Array) -> Array:
        step = np.array([1e-4 * r.scale for r in self.regressors])
        return np.array(
            [(self._mean(x + e) - self._mean(x - e)) / (2.0 * s) for e, s in zip(np.diag(step), step, strict=True)]
        )


def fit_reference(
    regressors: Sequence[Regressor],
    values: ArrayLike,
    response: ArrayLike,
    *,
    repeatability: float,
    departure: float,
    shape: Shape | None = None,
    groups: ArrayLike | None = None,
) -> ReferenceCurve:
    """Fit the healthy response by robust Bayesian linear regression.

    Terms are powers of ``(x - centre) / scale``; each coefficient has a normal prior about the expected shape, each
    further degree a third of the first's. Outliers count by Student-t weights (5 degrees of freedom). The scatter
    has an inverse chi-squared prior worth three points.

    Parameters
    ----------
    regressors : Sequence[Regressor]
        First the one that the response is drawn over.
    values : ArrayLike
        Measured regressors, shape (n, number of regressors).
    response : ArrayLike
        Measured response, shape (n,). Points with a missing number are left out.
    repeatability : float
        Expected scatter of healthy points about a right curve [response's unit].
    departure : float
        Prior standard deviation of the response's departure from the shape over one ``scale`` of a regressor.
    shape : Shape, optional
        Expected response, as from the twin; without it zero, and only slopes shrink.
    groups : ArrayLike, optional
        Which points were taken in one go, shape (n,): they share an error, and count for less than as many apart.

    Raises
    ------
    ValueError
        Names every fault: shapes that do not match, fewer than two known points, numbers out of range.
    """
    x, y = np.atleast_2d(np.asarray(values, dtype=np.float64)), np.asarray(response, dtype=np.float64)
    _check(regressors, x, y, repeatability, departure, groups)
    known = np.isfinite(x).all(axis=1) & np.isfinite(y)
    x, y = x[known], y[known]
    centre = np.median(x, axis=0)
    basis = _basis(x, regressors, centre)
    target = y - (shape(x) if shape else 0.0)
    prior = np.array([departure / 3.0 ** (d - 1) for r in regressors for d in range(1, r.degree + 1)])
    # without an expected shape the level is the data's own business
    start = 0.0 if shape else float(np.median(target))
    level = departure if shape else _LEVEL_PRIOR * (departure + repeatability + float(np.ptp(target)))
    prior_variance = np.concatenate(([level], prior)) ** 2
    weight, scatter = np.ones(len(y)), repeatability
    shares = np.ones(len(y)) if groups is None else np.asarray(groups)[known]
    labels = None if groups is None else np.unique(shares, return_inverse=True)[1]
    share = np.ones(len(y))
    coefficients: Array = np.zeros(basis.shape[1])
    covariance: Array = np.eye(basis.shape[1])
    for _ in range(60):
        precision = (basis.T * (weight * share)) @ basis + np.diag(scatter**2 / prior_variance)
        covariance = np.asarray(np.linalg.inv(precision), dtype=np.float64)
        coefficients = covariance @ (basis.T @ (weight * share * (target - start)))
        residual = target - start - basis @ coefficients
        n_terms = float(np.einsum("ij,jk,ik,i->", basis, covariance, basis, weight * share))
        lost = max(share.sum() - n_terms, 0.0)
        total = float(weight * share @ residual**2) + _NOISE_POINTS * repeatability**2
        # scatter of single points, degrees of freedom of independent ones
        newest = math.sqrt(total / (lost + _NOISE_POINTS))
        weight = (STUDENT_DEGREES + 1.0) / (STUDENT_DEGREES + (residual / newest) ** 2)
        if labels is not None:
            share = _shares(residual * np.sqrt(weight), labels)
        if abs(newest / scatter - 1.0) < 1e-9:
            break
        scatter = newest
    coefficients[0] += start
    leverage = np.einsum("ij,jk,ik->i", basis, covariance, basis)
    return ReferenceCurve(
        tuple(regressors),
        centre,
        np.sort(x, axis=0),
        coefficients,
        covariance,
        scatter,
        lost + _NOISE_POINTS,
        float(leverage.max()),
        shape,
    )


def _basis(x: Array, regressors: Sequence[Regressor], centre: Array) -> Array:
    """One, then the powers of each regressor in its scale; shape (n, p)."""
    columns = [np.ones(len(x))]
    for j, r in enumerate(regressors):
        z = (x[:, j] - centre[j]) / r.scale
        columns.extend(z**d for d in range(1, r.degree + 1))
    return np.stack(columns, axis=1)


def _shares(residual: Array, labels: NDArray[np.intp]) -> Array:
    """Worth of each point next to an independent one: 1 / (1 + (m - 1) rho), rho the correlation within its group."""
    count = np.bincount(labels)
    total, square = np.bincount(labels, residual), np.bincount(labels, residual**2)
    pairs = float((count * (count - 1)).sum())
    if pairs == 0.0:
        return np.ones(len(labels))
    rho = float((total**2 - square).sum()) / pairs / max(float(np.mean(residual**2)), 1e-300)
    return np.asarray(1.0 / (1.0 + (count[labels] - 1.0) * min(max(rho, 0.0), 1.0)))


def _check(
    regressors: Sequence[Regressor],
    x: Array,
    y: Array,
    repeatability: float,
    departure: float,
    groups: ArrayLike | None,
) -> None:
    faults = []
    if not regressors:
        faults.append("regressors are missing; at least one is needed")
    for r in regressors:
        if not (math.isfinite(r.scale) and r.scale > 0.0):
            faults.append(f"scale of {r.name} is {r.scale:g}; it must be finite and above 0")
        if not (math.isfinite(r.margin) and r.margin >= 0.0):
            faults.append(f"margin of {r.name} is {r.margin:g}; it must be finite and at least 0")
        if not r.gap > 0.0:
            faults.append(f"gap of {r.name} is {r.gap:g}; it must be above 0")
        if r.degree not in {1, 2, 3}:
            faults.append(f"degree of {r.name} is {r.degree}; it must be 1, 2 or 3")
    for name, value in (("repeatability", repeatability), ("departure", departure)):
        if not (math.isfinite(value) and value > 0.0):
            faults.append(f"{name} is {value:g}; it must be finite and above 0")
    if x.shape != (len(y), len(regressors)) or y.ndim != 1:
        faults.append(f"values have shape {x.shape} and response {y.shape}; (n, {len(regressors)}) and (n,) are needed")
    elif (n := int((np.isfinite(x).all(axis=1) & np.isfinite(y)).sum())) < 2:
        faults.append(f"{n} points have all their numbers; at least 2 are needed")
    if groups is not None and np.shape(groups) != (len(y),):
        faults.append(f"groups have shape {np.shape(groups)}; ({len(y)},) is needed")
    if faults:
        raise ValueError("; ".join(faults))
