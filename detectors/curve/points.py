"""The damage identification curve: where this pump lives while it is sound, where it was, where each fault would take it.

Plane: discharge pressure against case-minus-reservoir pressure. As the demand of the circuit grows the sound pump moves
along its reference curve; a degraded pump is lifted off it. Everything is the judge's: the reference is what its
likeliest filters say of this pump without a fault, the points what they say with it.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from detectors.bank.hypotheses import FAULT_KINDS
from detectors.bank.measurement import Measured, measured_windows
from detectors.bank.prediction import CASE, DISCHARGE, ZERO
from detectors.bank.window import Measurement
from detectors.curve.laws import NEWEST, Excess, Law, laws_through
from detectors.curve.sights import Sight, amplitude_of, moved, place_of, reference_of, sight_of, sights
from detectors.expectation.anchor import COLUMN, anchors
from detectors.expectation.reduced_twin import nominal_pressures
from detectors.expectation.residuals import matching_condition, reservoir_noise_sd
from detectors.expectation.type_correction import HealthyCurve, corrections
from detectors.judgement.assessment import Fold
from detectors.judgement.handover import FromOthers
from detectors.words.numbers import Z_90
from detectors.words.observation import History, Observation
from detectors.words.states import State
from twin.condition import Condition
from twin.parameters import Circuit, PumpType

Array = NDArray[np.float64]
Covariance = tuple[tuple[float, float], tuple[float, float]]

AXES: Mapping[str, str] = {"x": "discharge_pressure_bar", "y": "case_minus_reservoir_bar"}
DEMANDS_LPM: tuple[float, ...] = (0.0, 0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
"""Demands at which the curve is drawn (our choice: dense where the droop begins) [L/min]."""
FIRST_RECORDS = 8
"""Records since the pump sits where it is whose zero is the sensor's first (our choice: those of a baseline)."""
NEAR_K, NEAR_RPM = 25.0, 300.0
"""How far from the chosen condition measured points of a bench are still brought to it (our choice)."""
_RESERVOIR, _WARMTH_K = COLUMN["reservoir"], "fluid_temperature_degc"
_SIZES: Mapping[State, tuple[float, str]] = {
    State.PUMP_DEGRADATION: (0.5, "L/min"),
    State.COMPENSATOR_FAULT: (2.0, "bar"),
    State.SYSTEM_LEAKAGE: (3.0, "L/min"),
    State.DRAIN_RESTRICTION: (50.0, "%"),
}
"""Size of the fault that an arrow stands for, and its unit."""


@dataclass(frozen=True, slots=True)
class CurvePoint:
    """This pump without a fault at one demand: place and covariance [bar, bar^2]; ``low`` to ``high`` is 90 % of y."""

    x: float
    y: float
    low: float
    high: float
    system_leakage_lpm: float
    covariance: Covariance


@dataclass(frozen=True, slots=True)
class PumpPoint:
    """Where the judge saw the pump after one record, brought to the curve's conditions [bar, bar^2]."""

    at: datetime
    x: float
    y: float
    covariance: Covariance


@dataclass(frozen=True, slots=True)
class Reading:
    """One record as measured, brought to the curve's conditions [bar].

    ``y_first_zero`` is what it would be with the zero that the case sensor had in the first records here: a shift of the
    sensor stands between the two.
    """

    at: datetime
    x: float
    y: float
    y_first_zero: float


@dataclass(frozen=True, slots=True)
class Direction:
    """Displacement by a fault of ``size`` in ``unit`` [bar]; ``both_ways`` where it can go the other way."""

    dx: float
    dy: float
    size: float
    unit: str
    both_ways: bool = False

    @property
    def per(self) -> str:
        """The size as it is written: ``0.5 L/min``."""
        return f"{self.size:g} {self.unit}"


@dataclass(frozen=True, slots=True)
class Baseline:
    """Where this pump's reference lies relative to the nominal twin [bar], and the records since the pump sits here."""

    dx: float
    dy: float
    records: int


@dataclass(frozen=True, slots=True)
class Curve:
    """Everything that the pictures show; ``conditions`` are in edge units.

    ``measured`` is the pump type's curve as measured on a bench, brought to the conditions and laid to the reference's foot
    along x, for the bench's pump had a setting of its own; pairs of x and y, empty without one. ``excess`` and ``laws`` are
    the second picture.
    """

    conditions: Mapping[str, float]
    baseline: Baseline
    curve: tuple[CurvePoint, ...]
    points: tuple[PumpPoint, ...]
    directions: Mapping[str, Direction]
    readings: tuple[Reading, ...] = ()
    measured: tuple[tuple[float, float], ...] = ()
    excess: tuple[Excess, ...] = ()
    laws: Mapping[str, Law] | None = None


def damage_identification_curve(
    history: History,
    pump: PumpType,
    circuit: Circuit,
    thresholds: Mapping[str, float],
    condition: Condition,
    healthy: HealthyCurve | None = None,
    others: Mapping[str, FromOthers] | None = None,
) -> Curve:
    """Curve, points and fault directions at one condition (speed, fluid temperature, reservoir pressure).

    Parameters
    ----------
    history, pump, circuit, thresholds, healthy
        As the judge takes them (``detectors.judgement.assessment.assess``): the history is folded here.
    condition
        Where everything is brought to; its flow is that of zero demand.
    others
        What records take over from other pumps, by record.
    """
    conditions = {
        "speed_rpm": condition.speed_rpm,
        "fluid_temperature_degc": condition.fluid_temperature_degc,
        "reservoir_pressure_bar": condition.reservoir_pressure_bar,
    }
    if not (pump.own_twin and pump.has_both_pressures):
        # one pressure is no plane, and without a twin nothing says where a fault would go
        return Curve(conditions, Baseline(0.0, 0.0, 0), (), (), {})
    fold = Fold(pump, circuit, thresholds, healthy)
    seen = sights(fold, history, others or {})
    rows, solved = anchors([condition._replace(discharge_flow_lpm=0.0)], pump, circuit)
    if not solved[0]:
        return Curve(conditions, Baseline(0.0, 0.0, 0), (), (), {})
    anchor, shift = rows[0], corrections(healthy, [condition], pump, circuit)[0]
    # without a record: a pump of the type, as unknown as the type leaves it
    last = seen[-1] if seen else sight_of(fold, "", datetime.min.replace(tzinfo=UTC))
    curve = []
    for demand in DEMANDS_LPM:
        place = reference_of(last, anchor, demand)
        x, y = float(place.xy[0]), float(place.xy[1]) + shift.case_bar
        place.covariance[1, 1] += shift.standard_deviation_bar**2
        half = Z_90 * float(np.sqrt(place.covariance[1, 1]))
        curve.append(CurvePoint(x, y, y - half, y + half, demand, _pairs(place.covariance)))
    points = []
    for sight in seen:
        place = place_of(sight, anchor)
        y = float(place.xy[1]) + shift.case_bar
        points.append(PumpPoint(sight.at, float(place.xy[0]), y, _pairs(place.covariance)))
    discharge, case = nominal_pressures(anchor)
    by_id = {o.record_id: o for o in history.observations}
    judged = [by_id[s.record_id] for s in seen]
    here = _here(judged, history.installed_at)
    baseline = Baseline(curve[0].x - discharge, curve[0].y - (case - float(anchor[_RESERVOIR])), len(here))
    shown = measured_windows(judged, {}, pump, circuit, healthy)
    readings, excess = _readings(judged, shown, last, here, (curve[0].x, curve[0].y), pump)
    return Curve(
        conditions,
        baseline,
        tuple(curve),
        tuple(points),
        _directions(last, anchor),
        readings,
        _bench(healthy, condition, (curve[0].x, discharge), pump, circuit),
        excess,
        laws_through(excess, last, pump, circuit, condition),
    )


def latest_condition(observations: Sequence[Observation], pump: PumpType) -> Condition:
    """Condition of the newest accepted zero-flow window; the type's reference condition without one."""
    windows = [o.reduction.zero_flow for o in sorted(observations, key=lambda o: (o.at, o.record_id))]
    accepted = [w for w in windows if w is not None]
    if accepted:
        return matching_condition(accepted[-1], pump)._replace(discharge_flow_lpm=0.0)
    return Condition(pump.nominal_speed_rpm, 60.0, pump.nominal_reservoir_pressure_bar)


def _readings(
    judged: Sequence[Observation],
    shown: Mapping[str, Measured],
    last: Sight,
    here: Sequence[Observation],
    foot: tuple[float, float],
    pump: PumpType,
) -> tuple[tuple[Reading, ...], tuple[Excess, ...]]:
    """Records as measured: brought to the foot of the curve, and beyond the reference at their own condition.

    ``here`` are those since the pump sits where it is: laws go through no others.
    """
    readings, excess, first = [], [], _first_zero(here)
    newest = {o.record_id for o in here[-NEWEST:]}
    for observation in judged:
        measured, window = shown.get(observation.record_id), observation.reduction.zero_flow
        if measured is None or window is None or CASE not in measured.measurements[-1].seen:
            continue
        plain = measured.measurements[-1]
        zero = observation.reduction.zero.offset_bar
        beyond, sd = _beyond(plain, zero, last)
        y = foot[1] + beyond[1]
        readings.append(Reading(observation.at, foot[0] + beyond[0], y, y + zero - first))
        # nobody knows how much of it is the reservoir's where that is not measured
        told = observation.record_id in newest and plain.reservoir_measured
        sd = sd if plain.reservoir_measured else math.hypot(sd, reservoir_noise_sd(window, pump))
        excess.append(Excess(observation.at, window.means[_WARMTH_K].mean, beyond[1], sd, told))
    return tuple(readings), tuple(excess)


def _here(judged: Sequence[Observation], installed_at: Sequence[datetime]) -> Sequence[Observation]:
    """Records since the pump sits where its newest one saw it."""
    start = 0
    for i, (before, after) in enumerate(pairwise(judged), 1):
        moved_on = (before.aircraft, before.position) != (after.aircraft, after.position)
        if moved_on or any(before.at < t <= after.at for t in installed_at):
            start = i
    return judged[start:]


def _first_zero(here: Sequence[Observation]) -> float:
    """Zero of the case sensor in the first records here [bar]; 0 where none was measured."""
    zeros = [o.reduction.zero.offset_bar for o in here if o.reduction.zero.measured][:FIRST_RECORDS]
    return float(np.median(zeros)) if zeros else 0.0


def _beyond(plain: Measurement, zero: float, last: Sight) -> tuple[tuple[float, float], float]:
    """What a window shows beyond the reference, x and y, with the error of y [bar]; ``zero`` is the case sensor's."""
    reference = reference_of(last, plain.anchor).xy
    case = float(plain.values[CASE] - plain.anchor[_RESERVOIR]) - zero
    sd = float(np.sqrt(plain.noise[CASE, CASE] + plain.noise[ZERO, ZERO]))
    return (float(plain.values[DISCHARGE] - reference[0]), case - float(reference[1])), sd


def _directions(sight: Sight, anchor: Array) -> dict[str, Direction]:
    """Where the first kind of each state would take the reference: the judge's own."""
    found: dict[str, Direction] = {}
    for k, kind in enumerate(FAULT_KINDS):
        if kind.state in _SIZES and kind.state.value not in found:
            size, unit = _SIZES[kind.state]
            dx, dy = moved(sight, anchor, k, amplitude_of(kind, size / 100.0 if unit == "%" else size))
            found[kind.state.value] = Direction(float(dx), float(dy), size, unit, kind.sign == 0)
    return found


def _bench(
    healthy: HealthyCurve | None, condition: Condition, foot: tuple[float, float], pump: PumpType, circuit: Circuit
) -> tuple[tuple[float, float], ...]:
    """Measured points near the condition, brought to it by what the nominal twin changes; ``foot`` is the reference's x
    and the nominal twin's.
    """
    near = [
        p
        for p in (healthy.points if healthy is not None else ())
        if abs(p.fluid_temperature_degc - condition.fluid_temperature_degc) <= NEAR_K
        and abs(p.speed_rpm - condition.speed_rpm) <= NEAR_RPM
    ]
    if not near:
        return ()
    reservoir = pump.nominal_reservoir_pressure_bar
    asked = [Condition(p.speed_rpm, p.fluid_temperature_degc, reservoir) for p in near]
    rows, solved = anchors([*asked, condition._replace(discharge_flow_lpm=0.0)], pump, circuit)
    if not solved[-1]:
        return ()
    there = np.array([nominal_pressures(row) for row in rows[:-1]])
    here, own = nominal_pressures(rows[-1]), float(rows[-1][_RESERVOIR])
    brought = [
        (p.discharge_pressure_bar - d + here[0], p.case_minus_reservoir_bar - (c - reservoir) + (here[1] - own))
        for p, (d, c), good in zip(near, there, solved[:-1], strict=True)
        if good
    ]
    if not brought:
        return ()
    along = foot[0] - max(x for x, _ in brought)
    return tuple(sorted((float(x + along), float(y)) for x, y in brought))


def _pairs(covariance: Array) -> Covariance:
    (a, b), (c, d) = covariance.tolist()
    return (a, b), (c, d)
