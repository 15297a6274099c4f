"""Bounded nonlinear least squares on operating points; what the points cannot tell is found first and not moved."""

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

WEAKEST = 1.0
"""Smallest singular value of the sensitivities per spread: the points must know a combination of parameters better than
the numbers' sources do."""
_BESIDE = 0.3
_POOR_FIT = 0.01
_FAR = 3.0


def identify(
    kind: PumpType,
    points: Sequence[Point],
    circuit: str = "acceptance_stand",
    parameters: Sequence[str] = DEFAULT_PARAMETERS,
) -> Identification:
    """Find parameters of a pump type from measured steady points.

    Parameters
    ----------
    kind
        Where the numbers start from; their stated uncertainties tell how far each may lie off, and the bounds are a
        fifth and three times the start.
    points
        Conditions with what was measured there; standard deviations are those of independent errors.
    circuit
        Name of the circuit that the pump ran in; its drain may be fitted along (``circuit.k_c``, ``w_nu``, ``w_Q``).
    parameters
        Paths of the numbers to find.

    Returns
    -------
    Identification
        Parameters that the points do not determine are named and keep their start.

    Raises
    ------
    ValueError
        with every fault: an unknown path, too few measurements, a point that the starting parameters cannot reach.

    Notes
    -----
    Sensitivities are scaled by each parameter's spread and each measurement's standard deviation. While the smallest
    singular value lies below ``WEAKEST``, the parameter with the largest share in that direction is taken out. This is
    done at the start and again at the solution, because sensitivities change with the parameters. What is held may be
    wrong by its spread: that widens the intervals of the others (consider covariance, Schmidt 1966).
    """
    problem = _problem(kind, points, circuit, parameters)
    offsets = np.zeros(len(problem.parameters))
    undetermined: list[Undetermined] = []
    every = problem
    while True:
        problem, offsets, taken = _determined(problem, offsets)
        undetermined += taken
        if not problem.parameters:
            break
        offsets = _fitted(problem, offsets)
        if not _weakest(problem.jacobian(offsets))[0] < WEAKEST:
            break
        # what was fitted on the way moved along an open direction: begin again from the start
        problem, _, taken = _determined(problem, offsets)
        undetermined += taken
        offsets = np.zeros(len(problem.parameters))
    return _result(problem, every, circuit, offsets, tuple(undetermined))


def _problem(kind: PumpType, points: Sequence[Point], circuit: str, parameters: Sequence[str]) -> Problem:
    faults = [] if circuit in CIRCUITS else [f"no circuit {circuit!r}; known: {', '.join(CIRCUITS)}"]
    quantities = CIRCUIT_QUANTITIES.get(circuit, CIRCUIT_QUANTITIES["acceptance_stand"])
    found: list[Parameter] = []
    for path in dict.fromkeys(parameters):
        try:
            found.append(parameter_of(kind, quantities, path))
        except KeyError:
            faults.append(f"no number {path!r} in {kind.name} or in its circuit")
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


def _weakest(jacobian: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
    """Smallest singular value, 0 with fewer rows than columns, and its direction among the parameters."""
    _, values, directions = np.linalg.svd(jacobian, full_matrices=True)
    n = jacobian.shape[1]
    return (float(values[-1]) if len(values) == n else 0.0), directions[-1]


def _determined(
    problem: Problem, offsets: NDArray[np.float64]
) -> tuple[Problem, NDArray[np.float64], list[Undetermined]]:
    """Take parameters out until the points determine all that are left."""
    taken: list[Undetermined] = []
    while problem.parameters:
        smallest, direction = _weakest(problem.jacobian(offsets))
        if smallest >= WEAKEST:
            break
        k = int(np.argmax(np.abs(direction)))
        beside = tuple(
            p.path
            for i, p in enumerate(problem.parameters)
            if i != k and abs(direction[i]) > _BESIDE * abs(direction[k])
        )
        taken.append(Undetermined(problem.parameters[k].path, beside))
        problem, offsets = problem.without(k), np.delete(offsets, k)
    return problem, offsets, taken


def _fitted(problem: Problem, offsets: NDArray[np.float64]) -> NDArray[np.float64]:
    low = np.array([(p.low - p.start) / p.spread for p in problem.parameters])
    high = np.array([(p.high - p.start) / p.spread for p in problem.parameters])
    found = least_squares(
        problem.residuals, np.clip(offsets, low, high), problem.jacobian, bounds=(low, high), xtol=1e-10, ftol=1e-12
    )
    solution: NDArray[np.float64] = found.x
    return solution


def _covariance(problem: Problem, every: Problem, offsets: NDArray[np.float64], factor: float) -> NDArray[np.float64]:
    """Covariance of the estimates in units of their spreads, shape (n, n).

    ``factor`` widens what the measurements' noise leaves; what the held parameters add is widened by nothing.
    """
    if not problem.parameters:
        return np.zeros((0, 0))
    at = dict(zip((p.path for p in problem.parameters), offsets, strict=True))
    here = np.array([at.get(p.path, 0.0) for p in every.parameters])
    free = problem.jacobian(offsets)
    noise = np.linalg.inv(free.T @ free)
    held = [k for k, p in enumerate(every.parameters) if p.path not in at]
    shift = np.zeros((len(offsets), len(held)))
    for column, k in enumerate(held):
        # a whole spread, not a slope: leakage grows with the cube of a gap
        shift[:, column] = noise @ free.T @ _worst_change(every, here, k)
    found: NDArray[np.float64] = factor**2 * noise + shift @ shift.T
    return found


def _worst_change(every: Problem, here: NDArray[np.float64], k: int) -> NDArray[np.float64]:
    """Change of the residuals when parameter ``k`` moves by its spread to the side that changes them more."""
    parameter, before = every.parameters[k], every.residuals(here)
    changes = []
    for side in (1.0, -1.0):
        there = here.copy()
        low, high = ((b - parameter.start) / parameter.spread for b in (parameter.low, parameter.high))
        there[k] = np.clip(here[k] + side, low, high)
        changes.append(every.residuals(there) - before)
    return max(changes, key=lambda change: float(change @ change))


def _result(
    problem: Problem,
    every: Problem,
    circuit: str,
    offsets: NDArray[np.float64],
    undetermined: tuple[Undetermined, ...],
) -> Identification:
    twin, normalised = problem.predicted(offsets), problem.residuals(offsets)
    chi_square, freedom = float(normalised @ normalised), len(normalised) - len(offsets)
    p_value = float(chi2.sf(chi_square, freedom)) if freedom > 0 else 1.0
    is_poor = p_value < _POOR_FIT
    factor = float(np.sqrt(chi_square / freedom)) if is_poor else 1.0
    scaled = _covariance(problem, every, offsets, factor)
    to_unit = np.array([p.spread / p.per_unit for p in problem.parameters])
    covariance = scaled * np.outer(to_unit, to_unit)
    deviations = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(deviations, deviations)
    values = problem.values(offsets)
    estimates = tuple(
        _estimate(p, float(value), float(sd))
        for p, value, sd in zip(problem.parameters, values, deviations, strict=True)
    )
    warnings = _far(problem.parameters, offsets) + _at_bounds(estimates)
    if is_poor:
        warnings.append(
            f"chi-square is {chi_square:.1f} for {freedom} degrees of freedom: the twin does not meet the points within "
            f"their standard deviations; intervals are widened for it"
        )
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
        problem.kind, circuit, estimates, undetermined, covariance, correlation, residuals, chi_square, freedom,
        p_value, tuple(warnings),
    )  # fmt: skip


def _estimate(parameter: Parameter, value: float, deviation: float) -> Estimate:
    in_unit = value / parameter.per_unit
    margin = 1.0e-6 * parameter.spread
    at_bound = not parameter.low + margin < value < parameter.high - margin
    half = Z_90 * deviation
    start = parameter.start / parameter.per_unit
    return Estimate(parameter.path, parameter.unit, start, in_unit, deviation, in_unit - half, in_unit + half, at_bound)


def _far(parameters: Sequence[Parameter], offsets: NDArray[np.float64]) -> list[str]:
    return [
        f"{p.path} lies {abs(offset):.1f} times its stated spread from the start: another effect may stand behind it"
        for p, offset in zip(parameters, offsets, strict=True)
        if abs(offset) > _FAR
    ]


def _at_bounds(estimates: Sequence[Estimate]) -> list[str]:
    return [f"{e.path} ended at its bound: its interval means nothing" for e in estimates if e.at_bound]
