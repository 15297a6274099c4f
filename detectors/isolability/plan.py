"""What an isolability study is asked: sensors, windows, temperatures, flights; checked, every fault at once."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from twin.parameters import PumpType, Sensor

PLAN_RANGES: Mapping[str, tuple[float, float]] = {
    "full_scale_bar": (0.1, 1000.0),
    "accuracy_fs": (1.0e-5, 0.1),
    "repeatability_fs": (1.0e-6, 0.1),
    "temperature_degc": (-20.0, 140.0),
    "baseline_flights": (1, 500),
    "flights": (1, 500),
    "windows_per_flight": (1, 3),
    "ground_run_every": (1, 500),
    "ground_run_flow_lpm": (1.0, 60.0),
    "false_alarm_probability": (1.0e-9, 0.1),
    "detection_probability": (0.5, 0.9999),
}
"""Lowest and highest value of each number, both included."""
MOST_GROUND_RUN_FLOWS = 3
"""Windows under load of one record that the judge learns from (``detectors.bank.measurement.MOST_WINDOWS``)."""


class PlanFaultsError(ValueError):
    """What is wrong with a plan, all of it: pairs of place and problem."""

    def __init__(self, faults: list[tuple[str, str]]) -> None:
        super().__init__("; ".join(f"{where}: {problem}" for where, problem in faults))
        self.faults = faults


@dataclass(frozen=True, slots=True)
class Sensors:
    """The pressure sensors; ``reservoir`` None where none is fitted.

    ``zero_measured`` says whether each flight has a pump-off stretch that gives the case sensor's zero.
    """

    case: Sensor
    discharge: Sensor
    reservoir: Sensor | None
    zero_measured: bool = True


@dataclass(frozen=True, slots=True)
class Plan:
    """One study.

    Attributes
    ----------
    sensors
        What is measured, and how well.
    temperature_range_degc
        Fluid temperatures that the flights' windows spread over, evenly.
    baseline_flights, flights
        Flights before the fault sets in, and flights with it.
    windows_per_flight
        Zero-flow windows of each flight.
    ground_run_flows_lpm, ground_run_every
        Flows of the windows under load that follow the last zero-flow window of the first flight and of every so many
        after it; none without a flow.
    burst
        Whether every flight has two seconds at 10 kHz in its last zero-flow window.
    false_alarm_probability, detection_probability
        Per record, and with the fault present: what "detectable" and "isolable" mean.
    """

    sensors: Sensors
    temperature_range_degc: tuple[float, float] = (30.0, 80.0)
    baseline_flights: int = 30
    flights: int = 30
    windows_per_flight: int = 1
    ground_run_flows_lpm: tuple[float, ...] = ()
    ground_run_every: int = 10
    burst: bool = False
    false_alarm_probability: float = 1.0e-4
    detection_probability: float = 0.9


def sensors_of(pump: PumpType, *, reservoir: bool = True, zero_measured: bool = True) -> Sensors:
    """The pump type's own sensors."""
    own = pump.sensors
    fitted = own["reservoir_pressure_bar"] if reservoir else None
    return Sensors(own["case_pressure_bar"], own["discharge_pressure_bar"], fitted, zero_measured)


def plan_faults(plan: Plan) -> list[tuple[str, str]]:
    """Every fault of a plan as (place, problem); empty when it is good."""
    faults: list[tuple[str, str]] = []

    def check(where: str, value: float, key: str) -> None:
        low, high = PLAN_RANGES[key]
        if not (math.isfinite(value) and low <= value <= high):
            faults.append((where, f"{value:g} is outside {low:g} to {high:g}"))

    for name, sensor in (
        ("case", plan.sensors.case),
        ("discharge", plan.sensors.discharge),
        ("reservoir", plan.sensors.reservoir),
    ):
        if sensor is not None:
            for key in ("full_scale_bar", "accuracy_fs", "repeatability_fs"):
                check(f"sensors.{name}.{key}", getattr(sensor, key), key)
    for end, temperature in zip(("low", "high"), plan.temperature_range_degc, strict=True):
        check(f"temperature_range_degc.{end}", temperature, "temperature_degc")
    low, high = plan.temperature_range_degc
    if low > high:
        faults.append(("temperature_range_degc", f"{low:g} lies above {high:g}"))
    for i, flow in enumerate(plan.ground_run_flows_lpm):
        check(f"ground_run_flows_lpm.{i}", flow, "ground_run_flow_lpm")
    if len(plan.ground_run_flows_lpm) > MOST_GROUND_RUN_FLOWS:
        problem = f"{len(plan.ground_run_flows_lpm)} flows are more than {MOST_GROUND_RUN_FLOWS}"
        faults.append(("ground_run_flows_lpm", problem))
    for key in (
        "ground_run_every",
        "baseline_flights",
        "flights",
        "windows_per_flight",
        "false_alarm_probability",
        "detection_probability",
    ):
        check(key, getattr(plan, key), key)
    return faults
