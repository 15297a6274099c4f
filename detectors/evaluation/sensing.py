"""What the aircraft's sensors make of simulated flights: histories as the judge receives them."""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np

from detectors.evaluation.reality import Flights
from detectors.observation import History, Mean, Observation, Reduction, Window, WindowKind, Zero
from twin.parameters import PumpType

START = datetime(2026, 1, 5, 8, 0, tzinfo=UTC)


@dataclass(frozen=True, slots=True)
class Sensing:
    """Which sensors an aircraft has and how well they see; spreads are one sigma, pressures in bar."""

    zero_measured: bool = True
    reservoir_measured: bool = True
    discharge_repeatability: float = 0.35
    case_repeatability: float = 0.005
    case_zero_drift_per_flight: float = 0.0035
    case_zero_step: float = 0.0
    step_at: int = 0
    discharge_drift_per_flight: float = 0.008
    missing_zero: float = 0.05
    dropout: float = 0.05
    outlier: float = 0.003


def histories(flights: Flights, pump: PumpType, sensing: Sensing, rng: np.random.Generator) -> list[History]:
    """One history per pump; flights that dropped out are missing from it."""
    shape = flights.discharge.shape
    n_pumps, n_flights = shape
    normal = rng.normal
    offset = normal(0.0, 0.03, (n_pumps, 1)) + np.cumsum(normal(0.0, sensing.case_zero_drift_per_flight, shape), axis=1)
    offset += sensing.case_zero_step * (np.arange(n_flights) >= sensing.step_at)
    discharge = flights.discharge + normal(0.0, sensing.discharge_repeatability, shape)
    discharge += np.cumsum(normal(0.0, sensing.discharge_drift_per_flight, shape), axis=1)
    case = flights.case + offset + normal(0.0, sensing.case_repeatability, shape)
    jumped = rng.uniform(size=shape) < sensing.outlier
    case += np.where(jumped, rng.uniform(-1.0, 1.0, shape), 0.0)
    jumped = rng.uniform(size=shape) < sensing.outlier
    discharge += np.where(jumped, rng.uniform(-30.0, 30.0, shape), 0.0)
    probe = normal(0.0, 0.7, (n_pumps, 1)) + normal(0.0, 0.4, shape)
    zero = offset + normal(0.0, 0.006, shape)
    reservoir_error = normal(0.0, 0.01, (n_pumps, 1)) + normal(0.0, 0.004, shape)
    has_zero = sensing.zero_measured & (rng.uniform(size=shape) >= sensing.missing_zero)
    flown = rng.uniform(size=shape) >= sensing.dropout
    if sensing.reservoir_measured:
        zero = zero - reservoir_error
    else:
        zero = zero + flights.reservoir - pump.nominal_reservoir_pressure_bar
    result = []
    for i in range(n_pumps):
        observations = []
        for j in np.flatnonzero(flown[i]):
            means = {
                "discharge_pressure_bar": Mean(float(discharge[i, j]), 0.05),
                "case_pressure_bar": Mean(float(case[i, j]), 0.001),
                "shaft_speed_rpm": Mean(float(flights.speed[i, j]), 1.0),
                "fluid_temperature_degc": Mean(float(flights.temperature[i, j] + probe[i, j]), 0.02),
            }
            if sensing.reservoir_measured:
                means["reservoir_pressure_bar"] = Mean(float(flights.reservoir[i, j] + reservoir_error[i, j]), 0.001)
            window = Window(WindowKind.ZERO_FLOW, 60.0, 120.0, True, None, means)
            found = Zero(0.0, pump.population["case_zero_bar"].value, False)
            if has_zero[i, j]:
                found = Zero(float(zero[i, j]), 0.008 if sensing.reservoir_measured else 0.1, True)
            observations.append(
                Observation(
                    record_id=f"{j:05d}",
                    at=START + timedelta(hours=28.0 * int(j)),
                    aircraft="A",
                    position="LH",
                    flight_id=str(j),
                    reduction=Reduction(found, (window,), None),
                    flight_hours=2.0 * int(j),
                )
            )
        result.append(History(tuple(observations)))
    return result
