"""Test programme of annex A-1 by name: steady tests A2 and A3 on five points of figure 3-1, dynamic tests B2 and B3.

Pressures of the annex are absolute. A steady point is found by the load, as on the bench: a given discharge pressure, most
power, or the valve wide open. A dynamic test changes the opening of the load by a step, or by a ramp of 27 L/min per second.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from twin.condition import Condition, Health, OperatingPoints
from twin.operating_point import operating_point, problem
from twin.parameters import Circuit, PumpType
from twin.simulation.scenario import Scenario, Schedule
from twin.units import M3_PER_S_PER_LPM, PA_PER_BAR, STANDARD_ATMOSPHERE_BAR

STEADY: Mapping[str, float] = {"A2": 50.0, "A3": 100.0}
DYNAMIC: Mapping[str, float] = {"B2": 50.0, "B3": 100.0}
"""Tests of the annex with their temperature [degC]."""
TESTS: tuple[str, ...] = (*STEADY, *DYNAMIC)
BLOCKS: tuple[tuple[float, float], ...] = ((4600.0, 1.0), (4600.0, 3.5), (3450.0, 1.0), (5500.0, 1.0), (920.0, 1.0))
"""Speed [rpm] and inlet pressure [bar absolute] of five tests each; speeds hold for a pump of 4600 rpm."""
POINTS: tuple[str, ...] = ("zero flow", "167 bar", "most power", "50 bar", "full flow")
OPEN_VALVE = 0.0214
"""k_d of the bench's load wide open [bar/(L/min)^2]: inferred from point 5 of tables 3-8 and 3-10."""
CHANGES: tuple[tuple[str, float, float, bool], ...] = (
    ("zero to full, step", 0.0, 1.0, False),
    ("full to zero, step", 1.0, 0.0, False),
    ("zero to full, ramp", 0.0, 1.0, True),
    ("full to zero, ramp", 1.0, 0.0, True),
    ("20 to 80 %, step", 0.2, 0.8, False),
    ("80 to 20 %, step", 0.8, 0.2, False),
    ("20 to 80 %, ramp", 0.2, 0.8, True),
    ("80 to 20 %, ramp", 0.8, 0.2, True),
)
"""Shares of 27 L/min. The annex prints "20% to 80%" four times; 80 to 20 % is our reading, after its first four."""
FULL_FLOW_LPM = 27.0
RAMP_LPM_PER_S = 27.0
_BEFORE_S, _AFTER_S, _SETTLING_S = 2.0, 2.0, 1.0
_MARGIN = 0.98
"""Of what the pump delivers into its open valve: more than that asks for no steady state."""
_STIFF, _SOFT = 30.0, 1.0e-4
_NOMINAL_RPM = 4600.0


class SteadyTest(NamedTuple):
    """Test ``number`` of A2 or A3: point of figure 3-1, condition, load [bar/(L/min)^2], its steady state or why there is none."""

    number: int
    point: str
    condition: Condition
    load: float
    state: OperatingPoints
    problem: str | None


class DynamicTest(NamedTuple):
    """Test ``number`` of B2 or B3 with the scenario to run."""

    number: int
    change: str
    scenario: Scenario


class _Stand(NamedTuple):
    """What is tested in what."""

    kind: PumpType
    circuit: Circuit
    health: Health


def steady_tests(
    name: str,
    kind: PumpType,
    circuit: Circuit,
    health: Health = Health(),  # noqa: B008 - immutable
) -> list[SteadyTest]:
    """The 25 tests of A2 or A3; speeds in the annex' ratio to the pump's own nominal speed.

    Raises
    ------
    ValueError
        for another name.
    """
    if name not in STEADY:
        raise ValueError(f"no steady test {name!r}; known: {', '.join(STEADY)}")
    tests, stand = [], _Stand(kind, circuit, health)
    for block, (speed, inlet) in enumerate(BLOCKS):
        condition = Condition(
            speed * kind.nominal_speed_rpm / _NOMINAL_RPM, STEADY[name], inlet - STANDARD_ATMOSPHERE_BAR
        )
        tests += [_steady(5 * block + i + 1, point, condition, stand) for i, point in enumerate(POINTS)]
    return tests


def dynamic_tests(
    name: str,
    kind: PumpType,
    circuit: Circuit,
    health: Health = Health(),  # noqa: B008 - immutable
) -> list[DynamicTest]:
    """The eight tests of B2 or B3: two seconds before the change, two after a second of settling.

    Full flow is 27 L/min, or 98 % of what a smaller pump delivers into the open valve.

    Raises
    ------
    ValueError
        for another name, or where the pump has no steady state to start from.
    """
    if name not in DYNAMIC:
        raise ValueError(f"no dynamic test {name!r}; known: {', '.join(DYNAMIC)}")
    condition = Condition(kind.nominal_speed_rpm, DYNAMIC[name], 1.0 - STANDARD_ATMOSPHERE_BAR)
    stand = _Stand(kind, circuit, health)
    most = _delivery(_loaded(stand, condition, OPEN_VALVE))
    if math.isnan(most):
        raise ValueError(f"{kind.name} has no steady state into the open valve")
    full = min(FULL_FLOW_LPM, _MARGIN * most)
    openings = {0.0: 0.0}
    for share in (0.2, 0.8, 1.0):
        openings[share] = _opening(stand, condition, share * full)
    tests = []
    for number, (change, before, after, ramp) in enumerate(CHANGES, 1):
        takes = abs(after - before) * full / RAMP_LPM_PER_S if ramp else 0.0
        ends = (openings[before], openings[after])
        schedule = Schedule((_BEFORE_S, _BEFORE_S + takes), ends) if ramp else Schedule.step(_BEFORE_S, *ends)
        duration = _BEFORE_S + takes + _SETTLING_S + _AFTER_S
        changes = {"load_conductance_lpm_per_sqrt_bar": schedule}
        tests.append(
            DynamicTest(number, change, Scenario(duration, condition, health, changes, title=f"{name}-{number}"))
        )
    return tests


def _loaded(stand: _Stand, condition: Condition, load: float) -> OperatingPoints:
    k_d = load * PA_PER_BAR / M3_PER_S_PER_LPM**2
    return operating_point(stand.kind.pump, condition, stand.circuit, stand.health, load_coefficient=k_d)


def _pressure(state: OperatingPoints) -> float:
    return float(state.value("discharge_pressure_bar")[0])


def _delivery(state: OperatingPoints) -> float:
    return float(state.value("discharge_flow_lpm")[0])


def _steady(number: int, point: str, condition: Condition, stand: _Stand) -> SteadyTest:
    load = _load_at(point, condition, stand)
    if math.isnan(load):
        state = _loaded(stand, condition, OPEN_VALVE)
        low = _pressure(state)
        words = f"no load of the bench holds {point} here: the open valve gives {low:.1f} bar"
        return SteadyTest(number, point, condition, load, state, words)
    state = _loaded(stand, condition, load)
    return SteadyTest(number, point, condition, load, state, problem(state, 0))


def _load_at(point: str, condition: Condition, stand: _Stand) -> float:
    """k_d [bar/(L/min)^2] of a point; 0 at zero flow, NaN where no load holds it."""
    if point == "zero flow":
        return 0.0
    if point == "full flow":
        return OPEN_VALVE
    if point == "most power":
        found = minimize_scalar(
            lambda x: _lost_power(_loaded(stand, condition, math.exp(x))),
            bounds=(math.log(OPEN_VALVE), math.log(_STIFF)),
            method="bounded",
            options={"xatol": 1e-5},
        )
        return math.exp(float(found.x))
    asked = float(point.split(maxsplit=1)[0]) - STANDARD_ATMOSPHERE_BAR

    def excess(x: float) -> float:
        reached = _pressure(_loaded(stand, condition, math.exp(x)))
        return -asked if math.isnan(reached) else reached - asked

    low, high = math.log(_SOFT), math.log(_STIFF)
    if excess(low) > 0.0 or excess(high) < 0.0:
        return math.nan
    return math.exp(float(brentq(excess, low, high)))


def _lost_power(state: OperatingPoints) -> float:
    power = _pressure(state) * _delivery(state)
    return 0.0 if math.isnan(power) else -power


def _opening(stand: _Stand, condition: Condition, flow: float) -> float:
    """Opening of the load [L/min/sqrt(bar)] that lets a flow through."""

    def excess(x: float) -> float:
        delivered = _delivery(_loaded(stand, condition, math.exp(x)))
        return np.inf if math.isnan(delivered) else delivered - flow

    load = math.exp(float(brentq(excess, math.log(OPEN_VALVE), math.log(_STIFF))))
    return 1.0 / math.sqrt(load)
