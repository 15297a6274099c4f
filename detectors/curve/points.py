"""The damage identification curve: where the healthy pump lives, where this one was, where each fault would take it.

Plane: discharge pressure against case-minus-reservoir pressure. As the demand of the circuit grows the healthy
pump moves along its reference curve; a degraded pump is lifted off it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from detectors.expectation.residuals import case_noise_sd, discharge_noise_sd, matching_condition, reservoir_noise_sd
from detectors.words.numbers import Z_90
from detectors.words.observation import Observation, Window
from twin.condition import INPUTS, Condition, Health, OperatingPoints, input_rows
from twin.operating_point import operating_points
from twin.parameters import Circuit, PumpType

Array = NDArray[np.float64]

AXES: Mapping[str, str] = {"x": "discharge_pressure_bar", "y": "case_minus_reservoir_bar"}
DEMANDS_LPM: tuple[float, ...] = (0.0, 0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
"""Demands at which the curve is drawn (our choice: dense where the droop begins) [L/min]."""
BASELINE_RECORDS = 8
"""Records from the first one on that a pump's own curve is laid through (the baseline's, ``baseline_records``)."""


@dataclass(frozen=True, slots=True)
class CurvePoint:
    """Healthy pump at one demand, with the 90 % band between pumps and aircraft of the type [bar]."""

    x: float
    y: float
    low: float
    high: float
    system_leakage_lpm: float


@dataclass(frozen=True, slots=True)
class PumpPoint:
    """One record brought to the curve's conditions, with the covariance of (x, y) [bar, bar^2]."""

    at: datetime
    x: float
    y: float
    covariance: tuple[tuple[float, float], tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Direction:
    """Displacement by a fault of the size that ``per`` names [bar]."""

    dx: float
    dy: float
    per: str


@dataclass(frozen=True, slots=True)
class Baseline:
    """Where the installation's first records lie relative to the nominal twin: the curve is moved by it [bar]."""

    dx: float
    dy: float
    records: int


@dataclass(frozen=True, slots=True)
class Curve:
    """Everything that the picture shows; ``conditions`` are in edge units."""

    conditions: Mapping[str, float]
    baseline: Baseline
    curve: tuple[CurvePoint, ...]
    points: tuple[PumpPoint, ...]
    directions: Mapping[str, Direction]


def damage_identification_curve(
    observations: Sequence[Observation], pump: PumpType, circuit: Circuit, condition: Condition
) -> Curve:
    """Curve, points and fault directions at one condition (speed, fluid temperature, reservoir pressure).

    Points are moved by what the healthy twin changes between their own condition and this one.
    """
    conditions = {
        "speed_rpm": condition.speed_rpm,
        "fluid_temperature_degc": condition.fluid_temperature_degc,
        "reservoir_pressure_bar": condition.reservoir_pressure_bar,
    }
    reference = _reference(pump, circuit, condition)
    points = _points(observations, pump, circuit, condition)
    baseline = _baseline(observations, points, reference)
    dx, dy = baseline.dx, baseline.dy
    moved = tuple(CurvePoint(p.x + dx, p.y + dy, p.low + dy, p.high + dy, p.system_leakage_lpm) for p in reference)
    return Curve(conditions, baseline, moved, points, _directions(pump, circuit, condition))


def _baseline(
    observations: Sequence[Observation], points: Sequence[PumpPoint], reference: Sequence[CurvePoint]
) -> Baseline:
    """Median displacement of the first points since the pump sits where its newest record saw it."""
    ordered = sorted(observations, key=lambda o: (o.at, o.record_id))
    if not points or not reference:
        return Baseline(0.0, 0.0, 0)
    place = (ordered[-1].aircraft, ordered[-1].position)
    before = [o.at for o in ordered if (o.aircraft, o.position) != place]
    first = [p for p in points if not before or p.at > max(before)][:BASELINE_RECORDS]
    if not first:
        return Baseline(0.0, 0.0, 0)
    dx = float(np.median([p.x for p in first])) - reference[0].x
    dy = float(np.median([p.y for p in first])) - reference[0].y
    return Baseline(dx, dy, len(first))


def latest_condition(observations: Sequence[Observation], pump: PumpType) -> Condition:
    """Condition of the newest accepted zero-flow window; the type's reference condition without one."""
    windows = [o.reduction.zero_flow for o in sorted(observations, key=lambda o: (o.at, o.record_id))]
    accepted = [w for w in windows if w is not None]
    if accepted:
        return matching_condition(accepted[-1], pump)._replace(discharge_flow_lpm=0.0)
    return Condition(pump.nominal_speed_rpm, 60.0, pump.nominal_reservoir_pressure_bar)


def _plane(points: OperatingPoints, reservoir: Array) -> Array:
    """Coordinates in the plane, shape (n, 2)."""
    x, y = points.value("discharge_pressure_bar"), points.value("case_pressure_bar") - reservoir
    return np.column_stack((x, y))


def _reference(pump: PumpType, circuit: Circuit, condition: Condition) -> tuple[CurvePoint, ...]:
    healths = [Health(system_leakage_lpm=q) for q in DEMANDS_LPM]
    rows = input_rows([condition] * len(healths), healths)
    points = operating_points(pump.pump, rows, circuit, derivatives=True)
    plane = _plane(points, np.full(len(healths), condition.reservoir_pressure_bar))
    population = pump.population
    variance = np.zeros(len(healths))
    for name, scale in (
        ("pump_leakage_scale", population["pump_leakage_scale"].value),
        ("drain_resistance_scale", population["drain_resistance_scale"].value),
        ("fluid_temperature_degc", 1.0),
    ):
        variance += (points.derivative("case_pressure_bar", name) * scale) ** 2
    half = Z_90 * np.sqrt(variance)
    return tuple(
        CurvePoint(float(x), float(y), float(y - h), float(y + h), q)
        for (x, y), h, q, s in zip(plane, half, DEMANDS_LPM, points.status, strict=True)
        if s == 0
    )


def _points(
    observations: Sequence[Observation], pump: PumpType, circuit: Circuit, condition: Condition
) -> tuple[PumpPoint, ...]:
    seen: list[tuple[Observation, Window]] = []
    for observation in sorted(observations, key=lambda o: (o.at, o.record_id)):
        window = observation.reduction.zero_flow
        if window is not None:
            seen.append((observation, window))
    if not seen:
        return ()
    own = [matching_condition(w, pump) for _, w in seen]
    rows = input_rows([*own, condition], [Health()] * (len(own) + 1))
    twin = operating_points(pump.pump, rows, circuit)
    plane = _plane(twin, rows[:, INPUTS.index("reservoir_pressure_bar")])
    points = []
    for (observation, window), condition_there, healthy in zip(seen, own, plane[:-1], strict=True):
        zero = observation.reduction.zero
        reservoir = condition_there.reservoir_pressure_bar
        measured = np.array(
            (
                window.means["discharge_pressure_bar"].mean,
                window.means["case_pressure_bar"].mean - zero.offset_bar - reservoir,
            )
        )
        x, y = measured - healthy + plane[-1]
        # a wrong reservoir pressure moves the measured difference and the twin's discharge pressure alike
        shared = reservoir_noise_sd(window, pump) ** 2
        xx = discharge_noise_sd(window, pump) ** 2 + shared
        yy = case_noise_sd(window, pump) ** 2 + zero.standard_deviation_bar**2 + shared
        if np.isfinite((x, y)).all():
            points.append(PumpPoint(observation.at, float(x), float(y), ((xx, shared), (shared, yy))))
    return tuple(points)


def _directions(pump: PumpType, circuit: Circuit, condition: Condition) -> dict[str, Direction]:
    faults = {
        "pump_degradation": (Health(throttled_leakage_lpm=0.5), "0.5 L/min"),
        "compensator_fault": (Health(pressure_setting_change_bar=2.0), "2 bar"),
        "system_leakage": (Health(system_leakage_lpm=3.0), "3 L/min"),
        "drain_restriction": (Health(drain_resistance_scale=1.5), "50 %"),
    }
    healths = [Health(), *(h for h, _ in faults.values())]
    points = operating_points(pump.pump, input_rows([condition] * len(healths), healths), circuit)
    plane = _plane(points, np.full(len(healths), condition.reservoir_pressure_bar))
    moved = plane[1:] - plane[0]
    return {
        name: Direction(float(dx), float(dy), per)
        for (name, (_, per)), (dx, dy) in zip(faults.items(), moved, strict=True)
        if np.isfinite((dx, dy)).all()
    }
