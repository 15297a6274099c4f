"""Most probable numbers of a pump from operating points and priors, from several starts; what the prior decides is said."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import chi2

from twin.identification.problem import DEFAULT_PARAMETERS, Parameter, Point, Problem, parameter_of
from twin.identification.result import Estimate, Identification, PointResidual, Undetermined
from twin.numbers import Z_90
from twin.parameters import PumpType
from twin.pumps.circuits import CIRCUIT_QUANTITIES, CIRCUITS

STARTS = 3
"""The set itself, and draws from the prior."""
_SEED = 20
_DRAWN_WITHIN = 1.5
"""Spreads: farther draws may be no pump that holds a pressure."""
_SAME = 0.1
"""Difference in chi-square below which two starts have found the same."""
_RIVAL = 4.0
"""Chi-square by which a second minimum may be worse and still be no less believable than two sigma."""
_BESIDE = 0.5
_FAR = 3.0


def identify(
    kind: PumpType,
    points: Sequence[Point],
    circuit: str = "acceptance_stand",
    parameters: Sequence[str] = DEFAULT_PARAMETERS,
) -> Identification:
    """Find a pump type's most probable numbers from measured steady points (maximum a posteriori).

    Parameters
    ----------
    kind
        Where the numbers start from, and with their spreads the prior (``twin.identification.priors``).
    points
        Conditions with what was measured there; standard deviations are those of independent errors.
    circuit
        Name of the circuit that the pump ran in; its drain may be fitted along (``circuit.k_c``, ``w_nu``, ``w_Q``).
    parameters
        Paths of the numbers to find.

    Returns
    -------
    Identification
        Every number has an interval; numbers that the prior decides are named in ``undetermined`` as well.

    Raises
    ------
    ValueError
        with every fault: an unknown path, too few measurements, a point that the starting parameters cannot reach.

    Notes
    -----
    The sum of squared residuals, each per standard deviation, and of squared offsets from the start, each per spread of
    the prior, is minimised from several starts. Its curvature at the minimum gives the intervals (Laplace), in the
    logarithm of a number where the prior is a ratio. If the numbers stem from the prior, the minimum is distributed as
    chi-square with as many degrees of freedom as there are measurements.
    """
    problem = _problem(kind, points, circuit, parameters)
    offsets, chi_square, remarks = _best(problem)
    return _result(problem, circuit, offsets, chi_square, remarks)


def _problem(kind: PumpType, points: Sequence[Point], circuit: str, parameters: Sequence[str]) -> Problem:
    faults = [] if circuit in CIRCUITS else [f"no circuit {circuit!r}; known: {', '.join(CIRCUITS)}"]
    quantities = CIRCUIT_QUANTITIES.get(circuit, CIRCUIT_QUANTITIES["acceptance_stand"])
    found: list[Parameter] = []
    for path in dict.fromkeys(parameters):
        try:
            found.append(parameter_of(kind, quantities, path))
        except KeyError:
            faults.append(f"no number {path!r} in {kind.name} or in its circuit")
    faults += [f"{p.path} is 0 in {kind.name}: it has no ratio to move by" for p in found if _is_stuck(p)]
    if not any(point.measured for point in points):
        faults.append("nothing was measured")
    for i, point in enumerate(points):
        wrong = [n for n, m in point.measured.items() if not m.standard_deviation > 0.0 or not np.isfinite(m.value)]
        faults += [f"point {i + 1}: {name} needs a number and a standard deviation above 0" for name in wrong]
    problem = Problem(kind, CIRCUITS.get(circuit, CIRCUITS["acceptance_stand"]), tuple(points), tuple(found))
    faults += problem.unsolved()
    if faults:
        raise ValueError("; ".join(faults))
    return problem


def _is_stuck(parameter: Parameter) -> bool:
    return parameter.prior.is_ratio and parameter.start == 0.0


def _best(problem: Problem) -> tuple[NDArray[np.float64], float, list[str]]:
    """Lowest minimum of several starts, its chi-square, and remarks about rivals."""
    n = len(problem.parameters)
    rng = np.random.default_rng(_SEED)
    draws = np.clip(rng.normal(size=(STARTS - 1, n)), -_DRAWN_WITHIN, _DRAWN_WITHIN)
    found = sorted((_fitted(problem, start) for start in (np.zeros(n), *draws)), key=lambda minimum: minimum[1])
    offsets, chi_square = found[0]
    rivals = [other for other, value in found[1:] if _SAME < value - chi_square < _RIVAL]
    apart = [other for other in rivals if np.abs(other - offsets).max() > 1.0]
    remarks = [f"{len(apart)} of {STARTS} starts end in another minimum that is hardly worse: see more points"]
    return offsets, chi_square, remarks if apart else []


def _fitted(problem: Problem, start: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    identity = np.eye(len(start))
    bounds = (np.array([p.low for p in problem.parameters]), np.array([p.high for p in problem.parameters]))

    def residuals(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.concatenate([problem.residuals(x), x])

    def jacobian(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.vstack([problem.jacobian(x), identity])

    found = least_squares(
        residuals,
        np.clip(start, bounds[0] + 1.0e-6, bounds[1] - 1.0e-6),
        jacobian,
        bounds=bounds,
        xtol=1e-6,
        ftol=1e-8,
        max_nfev=200,
    )
    return found.x, 2.0 * float(found.cost)


def _result(
    problem: Problem, circuit: str, offsets: NDArray[np.float64], chi_square: float, remarks: list[str]
) -> Identification:
    twin, normalised = problem.predicted(offsets), problem.residuals(offsets)
    freedom = len(normalised)
    p_value = float(chi2.sf(chi_square, freedom))
    jacobian = problem.jacobian(offsets)
    left = np.asarray(np.linalg.inv(jacobian.T @ jacobian + np.eye(len(offsets))), dtype=np.float64)
    deviations = np.sqrt(np.diag(left))
    correlation = left / np.outer(deviations, deviations)
    to_unit = np.array([p.slope(float(x)) / p.per_unit for p, x in zip(problem.parameters, offsets, strict=True)])
    estimates = tuple(
        _estimate(p, float(offset), float(sd))
        for p, offset, sd in zip(problem.parameters, offsets, deviations, strict=True)
    )
    undetermined = tuple(
        Undetermined(
            e.path,
            tuple(f.path for i, f in enumerate(estimates) if i != k and abs(correlation[i, k]) > _BESIDE),
        )
        for k, e in enumerate(estimates)
        if e.decided_by == "prior"
    )
    warnings = _far(problem.parameters, offsets) + _at_bounds(estimates) + remarks
    if len({p.condition.fluid_temperature_degc for p in problem.points}) == 1:
        warnings.append("all points have one temperature: what depends on viscosity is not tested elsewhere")
    residuals = tuple(
        PointResidual(i + 1, name, value, float(t), value - float(t), float(z))
        for (i, name), value, t, z in zip(
            problem.places,
            (problem.points[i].measured[n].value for i, n in problem.places),
            twin,
            normalised,
            strict=True,
        )
    )
    return Identification(
        problem.kind, circuit, estimates, undetermined, left * np.outer(to_unit, to_unit), correlation, residuals,
        chi_square, freedom, p_value, tuple(warnings),
    )  # fmt: skip


def _estimate(parameter: Parameter, offset: float, deviation: float) -> Estimate:
    value, low, high = (parameter.value(offset + side * Z_90 * deviation) / parameter.per_unit for side in (0, -1, 1))
    margin = 1.0e-3
    at_bound = not parameter.low + margin < offset < parameter.high - margin
    in_unit = parameter.slope(offset) / parameter.per_unit * deviation
    start = parameter.start / parameter.per_unit
    low, high = sorted((low, high))
    return Estimate(
        parameter.path, parameter.unit, start, value, in_unit, low, high, at_bound,
        parameter.prior.spread, parameter.prior.is_ratio, parameter.prior.source, deviation**2,
    )  # fmt: skip


def _far(parameters: Sequence[Parameter], offsets: NDArray[np.float64]) -> list[str]:
    return [
        f"{p.path} lies {abs(offset):.1f} times its prior's spread from the start: another effect may stand behind it"
        for p, offset in zip(parameters, offsets, strict=True)
        if abs(offset) > _FAR
    ]


def _at_bounds(estimates: Sequence[Estimate]) -> list[str]:
    return [f"{e.path} ended at its bound: its interval means nothing" for e in estimates if e.at_bound]
