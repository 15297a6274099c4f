"""Histories of pumps whose reality differs from the judge's model, at the level of window means.

Differences: the drain follows ``a nu Q + b Q^2`` (the judge's default is linear), droop, leakage, setting and drain
resistance are drawn per pump, temperatures and reservoir pressure vary, sensors repeat imperfectly and the case
sensor's zero wanders. Nothing is noise-free.
"""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta

import numpy as np

from detectors.words.observation import History, Mean, Observation, Reduction, Window, WindowKind, Zero
from twin.condition import Condition, Health, input_rows
from twin.operating_point import operating_points
from twin.pumps import circuit_parameters, pump_type

PUMP = pump_type("h225")
CIRCUIT = circuit_parameters("shared_return")
START = datetime(2026, 1, 5, 8, 0, tzinfo=UTC)
Fault = Callable[[int, Health], Health]


def history(
    seed: int,
    n: int = 40,
    fault: Fault | None = None,
    *,
    zero_step_bar: float = 0.0,
    zero_step_at: int = 20,
    with_zero: bool = True,
    with_reservoir: bool = True,
    spikes: bool = False,
) -> History:
    """One pump's flights; ``fault(i, health)`` changes the health of flight i."""
    rng = np.random.default_rng(seed)
    own = Health(
        pump_leakage_scale=float(np.exp(np.clip(rng.normal(0, 0.2), -0.6, 0.2))),  # within the acceptance limits
        system_leakage_lpm=float(rng.uniform(0.3, 0.7)),
        pressure_setting_change_bar=float(rng.normal(0, 0.8)),
        drain_resistance_scale=float(np.exp(rng.normal(0, 0.15))),
        drain_viscosity_weight_change=0.4,
        drain_flow_weight_change=0.6,
        droop_scale=float(np.exp(rng.normal(0, 0.5))),
    )
    healths = [fault(i, own) if fault else own for i in range(n)]
    temperature = rng.uniform(25, 75, n)
    reservoir = np.clip(rng.normal(0.5, 0.2, n), 0, None)
    speed = rng.normal(4600, 20, n)
    conditions = [Condition(s, t, r) for s, t, r in zip(speed, temperature, reservoir, strict=True)]
    points = operating_points(PUMP.pump, input_rows(conditions, healths), CIRCUIT)
    assert (points.status == 0).all()
    offset = rng.normal(0, 0.03) + np.cumsum(rng.normal(0, 0.004, n)) + zero_step_bar * (np.arange(n) >= zero_step_at)
    case = points.value("case_pressure_bar") + offset + rng.normal(0, 0.005, n)
    discharge = points.value("discharge_pressure_bar") + rng.normal(0, 0.35, n)
    if spikes:
        case[n // 2] += 1.0
        discharge[n // 3] -= 40.0
    zero = offset + rng.normal(0, 0.006, n)
    if not with_reservoir:
        zero += reservoir - PUMP.nominal_reservoir_pressure_bar  # the zero is taken against the nominal value then
    observations = []
    for i in range(n):
        means = {
            "discharge_pressure_bar": Mean(float(discharge[i]), 0.05),
            "case_pressure_bar": Mean(float(case[i]), 0.001),
            "shaft_speed_rpm": Mean(float(speed[i]), 1.0),
            "fluid_temperature_degc": Mean(float(temperature[i] + rng.normal(0, 0.3)), 0.02),
        }
        if with_reservoir:
            means["reservoir_pressure_bar"] = Mean(float(reservoir[i] + rng.normal(0, 0.004)), 0.001)
        window = Window(WindowKind.ZERO_FLOW, 60.0, 120.0, True, None, means)
        found = Zero(float(zero[i]), 0.008 if with_reservoir else 0.1, True) if with_zero else Zero(0.0, 0.06, False)
        observations.append(
            Observation(
                record_id=f"r{i:04d}",
                at=START + timedelta(days=i, hours=int(rng.integers(0, 8))),
                aircraft="F-1",
                position="LH",
                flight_id=f"F{i}",
                reduction=Reduction(found, (window,), None),
            )
        )
    return History(tuple(observations))


def growing(field: str, amount: float, n: int = 40, start: int = 12, *, factor: bool = False) -> Fault:
    """A fault that grows linearly from flight ``start`` to ``amount`` at flight n."""

    def fault(i: int, own: Health) -> Health:
        share = max(0.0, (i - start) / (n - 1 - start))
        held = getattr(own, field)
        change = held * (1.0 + amount * share) if factor else held + amount * share
        return own._replace(**{field: change})

    return fault


FAULTS: dict[str, Fault] = {
    # 0.7 L/min on some 0.67 L/min of laminar leakage
    "worn": growing("pump_leakage_scale", 1.05, factor=True),
    "leaking": growing("system_leakage_lpm", 3.0),
    "setting": growing("pressure_setting_change_bar", -3.0),
    "drain": growing("drain_resistance_scale", 0.4, factor=True),
}
