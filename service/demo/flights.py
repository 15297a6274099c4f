"""One flight as a monitored helicopter records it, simulated through the twin at every second.

What is simulated is not what the judge assumes: the drain follows ``a nu Q + b Q^2`` instead of the twin's linear
default, and leakage, setting, droop, drain and sensors are each pump's and aircraft's own.
"""

import io
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

import numpy as np

from twin.condition import INPUTS, Condition, Health, input_rows
from twin.operating_point import operating_points
from twin.pumps import circuit_parameters, pump_type
from twin.pumps.fluids import with_fluid
from twin.recording import Recording
from twin.simulation.instrumentation import SensorModel, measured

PUMP_OFF_S, RUN_UP_S, SETTLE_S, ZERO_FLOW_S, FLIGHT_S, COAST_S = 40, 20, 30, 90, 240, 60
DRAIN_WEIGHTS = {"drain_viscosity_weight_change": 0.4, "drain_flow_weight_change": 0.6}
"""Drain law of the simulated aircraft: hoses explain 40 % of the resistance at 50 degC, fittings the rest."""


@dataclass(frozen=True, slots=True)
class FlightPlan:
    """What makes one flight differ from the next; ``fluid`` is a product, None for the pump type's own."""

    started_at: datetime
    fluid_temperature_degc: float
    reservoir_pressure_bar: float
    health: Health
    fluid: str | None = None


def flight(plan: FlightPlan, sensors: Mapping[str, SensorModel], rng: np.random.Generator) -> Recording:
    """Simulate one flight at 1 Hz: pump off, run-up, zero-flow stretch, flight, shutdown."""
    n = PUMP_OFF_S + RUN_UP_S + SETTLE_S + ZERO_FLOW_S + FLIGHT_S + COAST_S
    time = np.arange(n, dtype=np.float64)
    start_zero = PUMP_OFF_S + RUN_UP_S + SETTLE_S
    start_flight = start_zero + ZERO_FLOW_S
    end_flight = start_flight + FLIGHT_S
    nominal = 4600.0 * (1.0 + rng.normal(0.0, 0.004))
    ramp = np.clip((time - PUMP_OFF_S) / RUN_UP_S, 0.0, 1.0) - np.clip((time - end_flight) / 20.0, 0.0, 1.0)
    speed = nominal * np.clip(ramp, 0.0, 1.0)
    temperature = plan.fluid_temperature_degc + 0.8 * np.clip((time - start_zero) / ZERO_FLOW_S, -1.0, 4.0)
    activity = np.zeros(n)
    flying = (time >= start_flight) & (time < end_flight)
    activity[flying] = np.clip(np.abs(np.convolve(rng.normal(0.35, 0.35, n), np.ones(5) / 5, "same")), 0.06, 1)[flying]
    activity[(time >= PUMP_OFF_S) & (time < start_zero)] = 0.3  # control check
    demand = 12.0 * activity
    reservoir = np.full(n, plan.reservoir_pressure_bar)
    discharge, case = _pressures(plan, speed, temperature, demand, rng)
    truth = Recording(
        {
            "time_s": time,
            "discharge_pressure_bar": discharge,
            "case_pressure_bar": case,
            "shaft_speed_rpm": speed,
            "fluid_temperature_degc": temperature,
            "reservoir_pressure_bar": reservoir,
            "flight_control_activity": activity,
        }
    )
    return measured(truth, sensors, rng)


def _pressures(
    plan: FlightPlan,
    speed: np.ndarray,
    temperature: np.ndarray,
    demand: np.ndarray,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Discharge and case pressure at every second: the twin while the pump turns, the reservoir while it rests."""
    turning = speed > 900.0
    rows = np.repeat(input_rows([Condition(4600.0, 50.0)], [plan.health._replace(**DRAIN_WEIGHTS)]), turning.sum(), 0)
    # a slow pump cannot meet the full demand; the flight has none while it runs up
    possible = np.minimum(demand[turning], np.maximum(20.0 * speed[turning] / 4600.0 - 6.0, 0.0))
    for name, values in (
        ("speed_rpm", speed[turning]),
        ("fluid_temperature_degc", temperature[turning]),
        ("reservoir_pressure_bar", plan.reservoir_pressure_bar),
        ("discharge_flow_lpm", possible),
    ):
        rows[:, INPUTS.index(name)] = values
    pump = with_fluid(pump_type("h225"), plan.fluid).pump
    points = operating_points(pump, rows, circuit_parameters("shared_return"))
    discharge = np.full(len(speed), plan.reservoir_pressure_bar + rng.uniform(0.0, 15.0))  # trapped, as on a real line
    case = np.full(len(speed), plan.reservoir_pressure_bar)
    discharge[turning] = np.nan_to_num(points.value("discharge_pressure_bar"), nan=100.0)
    case[turning] = np.nan_to_num(points.value("case_pressure_bar"), nan=plan.reservoir_pressure_bar + 0.3)
    return discharge, case


def csv_bytes(recording: Recording, metadata: Mapping[str, str]) -> bytes:
    """A recording as a CSV flight record with its metadata in leading lines."""
    out = io.StringIO()
    for key, value in metadata.items():
        out.write(f"# {key}: {value}\n")
    names = list(recording.channels)
    out.write(",".join(names) + "\n")
    table = np.column_stack([recording[name] for name in names])
    for row in table:
        out.write(",".join("" if np.isnan(v) else f"{v:.6g}" for v in row) + "\n")
    return out.getvalue().encode()
