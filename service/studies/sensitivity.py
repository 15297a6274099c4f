"""Sensitivity of the steady twin: Sobol or Morris of any outputs over any numbers, conditions and health, with bands."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from service.pump_types.parameter_files import circuit_named_or_written, named_or_written
from twin.condition import CONDITION_INPUTS, INPUTS, OUTPUTS, RANGES, Condition, Health, input_rows
from twin.identification.problem import DEFAULT_PARAMETERS, Parameter, parameter_of
from twin.operating_point import operating_points
from twin.parameters import Circuit, PumpType
from twin.pumps.circuit_sets import CircuitSet

METHODS = ("sobol", "morris")
_TAIL = 0.001
"""Quantiles that are drawn lie this far from 0 and 1: three of the prior's spreads."""
_TEMPERATURE_DEGC = 50.0
_LEVELS = 6
_DRAWN = 400
"""Draws for the bands beside Morris."""
_BAND = (5.0, 50.0, 95.0)
MOST_POINTS = 400_000


class Range(NamedTuple):
    """A condition or health input between two values, each as likely."""

    name: str
    low: float
    high: float


Factor = Parameter | Range


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """Indices of every output by factor.

    Attributes
    ----------
    indices
        By output and index (Sobol: ``S1``, ``S1_conf``, ``ST``, ``ST_conf``; Morris: ``mu``, ``mu_star``, ``mu_star_conf``,
        ``sigma`` in the output's unit over a factor's whole range), shape (number of factors,).
    bands
        By output: 5, 50 and 95 % where every factor is drawn by its spread, shape (3,).
    points, unsolved
        How many were asked, and how many of them have no steady state; these count as the median.
    """

    method: str
    factors: tuple[str, ...]
    indices: dict[str, dict[str, NDArray[np.float64]]]
    bands: dict[str, NDArray[np.float64]]
    points: int
    unsolved: int

    def json(self) -> str:
        """All numbers as JSON."""
        document = {
            "method": self.method,
            "factors": list(self.factors),
            "points": self.points,
            "unsolved": self.unsolved,
            "outputs": {
                output: {
                    "band": dict(zip(("low", "median", "high"), self.bands[output].tolist(), strict=True)),
                    "indices": {name: values.tolist() for name, values in found.items()},
                }
                for output, found in self.indices.items()
            },
        }
        return json.dumps(document, indent=1) + "\n"


def factors_of(kind: PumpType, circuit: CircuitSet, paths: Sequence[str], ranges: Sequence[Range]) -> list[Factor]:
    """Factors: numbers with the spread of their prior, inputs between two values.

    Raises
    ------
    ValueError
        naming every one that does not exist or has no range.
    """
    faults, found = [], []
    for path in paths:
        try:
            found.append(parameter_of(kind, circuit.quantities, path))
        except KeyError:
            faults.append(f"no number {path!r} in {kind.name} or in its circuit")
    for given in ranges:
        if given.name not in INPUTS:
            faults.append(f"no input {given.name!r}; known: {', '.join(INPUTS)}")
            continue
        low, high = RANGES.get(given.name, (-np.inf, np.inf))
        if not low <= given.low < given.high <= high:
            faults.append(f"{given.name}: {given.low:g} to {given.high:g} does not rise within {low:g} to {high:g}")
    if not found and not ranges:
        faults.append("nothing varies")
    if faults:
        raise ValueError("; ".join(faults))
    return [*found, *ranges]


def sensitivity(
    kind: PumpType,
    circuit: CircuitSet,
    condition: Condition,
    factors: Sequence[Factor],
    outputs: Sequence[str],
    method: str = "sobol",
    samples: int = 256,
    seed: int = 1,
) -> Sensitivity:
    """Indices of outputs at a condition.

    Parameters
    ----------
    samples
        Base samples of Sobol (a power of two), trajectories of Morris.

    Raises
    ------
    ValueError
        naming every fault: an unknown output or method, more points than are run at once.
    """
    from SALib.analyze import morris as morris_analysis  # noqa: PLC0415 - heavy, and only here
    from SALib.analyze import sobol as sobol_analysis  # noqa: PLC0415
    from SALib.sample import morris as morris_sample  # noqa: PLC0415
    from SALib.sample import sobol as sobol_sample  # noqa: PLC0415

    names = [factor.path if isinstance(factor, Parameter) else factor.name for factor in factors]
    faults = [f"no output {name!r}; known: {', '.join(OUTPUTS)}" for name in outputs if name not in OUTPUTS]
    faults += [] if outputs else ["no output is asked for"]
    faults += [] if method in METHODS else [f"no method {method!r}; known: {', '.join(METHODS)}"]
    faults += [f"{n} varies twice" for n in sorted({n for n in names if names.count(n) > 1})]
    faults += [] if len(names) > 1 or method != "sobol" else ["Sobol needs two factors at least"]
    points = samples * ((len(names) + 2) if method == "sobol" else (len(names) + 1))
    if not (samples > 0 and points <= MOST_POINTS):
        faults.append(f"{points} points; allowed: 1 to {MOST_POINTS}")
    if method == "sobol" and samples & (samples - 1):
        faults.append(f"{samples} samples; Sobol's sequence asks for a power of two")
    if faults:
        raise ValueError("; ".join(faults))
    problem = {"num_vars": len(names), "names": names, "bounds": [[_TAIL, 1.0 - _TAIL]] * len(names)}
    if method == "sobol":
        quantiles = sobol_sample.sample(problem, samples, calc_second_order=False, seed=seed)
    else:
        quantiles = morris_sample.sample(problem, samples, num_levels=_LEVELS, seed=seed)
    values = _solved(kind, circuit, condition, factors, quantiles)
    unsolved = int(np.isnan(values[:, 0]).sum())
    if unsolved == len(values):
        raise ValueError("no point has a steady state: look at the condition and the ranges")
    # Sobol's blocks begin and end with a draw of its own; Morris walks on a grid, which has no spread of anything
    drawn = np.random.default_rng(seed).uniform(_TAIL, 1.0 - _TAIL, (_DRAWN, len(names)))
    block = len(names) + 2
    spread = (
        np.concatenate([values[::block], values[block - 1 :: block]])
        if method == "sobol"
        else _solved(kind, circuit, condition, factors, drawn)
    )
    indices: dict[str, dict[str, NDArray[np.float64]]] = {}
    bands: dict[str, NDArray[np.float64]] = {}
    for output in outputs:
        column = values[:, OUTPUTS.index(output)]
        bands[output] = np.nanpercentile(spread[:, OUTPUTS.index(output)], _BAND)
        column = np.where(np.isnan(column), bands[output][1], column)
        if method == "sobol":
            found = sobol_analysis.analyze(problem, column, calc_second_order=False, seed=seed)
            kept = ("S1", "S1_conf", "ST", "ST_conf")
        else:
            found = morris_analysis.analyze(problem, quantiles, column, num_levels=_LEVELS, seed=seed)
            kept = ("mu", "mu_star", "mu_star_conf", "sigma")
        indices[output] = {name: np.nan_to_num(np.asarray(found[name], dtype=np.float64)) for name in kept}
    return Sensitivity(method, tuple(names), indices, bands, len(values), unsolved)


def _solved(
    kind: PumpType,
    circuit: CircuitSet,
    condition: Condition,
    factors: Sequence[Factor],
    quantiles: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Outputs of every sample, shape (n, len(OUTPUTS)); NaN without a steady state."""
    row = input_rows([condition], [Health(system_leakage_lpm=circuit.leak_lpm)])[0]
    values = np.empty((len(quantiles), len(OUTPUTS)))
    for i, sample in enumerate(quantiles):
        pump, around, here = kind, circuit.circuit, row.copy()
        for factor, quantile in zip(factors, sample, strict=True):
            if isinstance(factor, Range):
                here[INPUTS.index(factor.name)] = factor.low + quantile * (factor.high - factor.low)
            else:
                pump, around = _changed(
                    pump, around, factor, float(np.clip(norm.ppf(quantile), factor.low, factor.high))
                )
        values[i] = operating_points(pump.pump, here[None, :], around).values[0]
    return values


def _changed(kind: PumpType, circuit: Circuit, factor: Parameter, offset: float) -> tuple[PumpType, Circuit]:
    part, _, name = factor.path.partition(".")
    value = factor.value(offset)
    if part == "circuit":
        return kind, circuit._replace(**{name: value})
    block: Any = getattr(kind.pump, part)
    return replace(kind, pump=kind.pump._replace(**{part: block._replace(**{name: value})})), circuit


def asked(
    pump: str, circuit: str, free: Sequence[str] | None, vary: Sequence[str], at: Sequence[str]
) -> tuple[PumpType, CircuitSet, Condition, list[Factor]]:
    """Pump type, circuit, condition and factors of a call; ``vary`` are texts NAME=LOW:HIGH, ``at`` NAME=VALUE.

    Raises
    ------
    ValueError
        with every fault.
    """
    faults, ranges = [], []
    for text in vary:
        name, _, ends = text.partition("=")
        low, _, high = ends.partition(":")
        try:
            ranges.append(Range(name, float(low), float(high)))
        except ValueError:
            faults.append(f"--vary {text}: is not NAME=LOW:HIGH")
    fixed: dict[str, float] = {}
    for text in at:
        name, _, value = text.partition("=")
        try:
            fixed[name] = float(value)
        except ValueError:
            faults.append(f"--at {text}: is not NAME=VALUE")
    faults += [f"--at {n}: is no part of a condition" for n in fixed if n not in CONDITION_INPUTS]
    if faults:
        raise ValueError("; ".join(faults))
    kind, around = named_or_written(pump), circuit_named_or_written(circuit)
    usual = [] if ranges else list(DEFAULT_PARAMETERS)
    here = Condition(kind.nominal_speed_rpm, _TEMPERATURE_DEGC, kind.nominal_reservoir_pressure_bar)._replace(**fixed)
    return kind, around, here, factors_of(kind, around, usual if free is None else free, ranges)
