"""The demo's fleet: eight pumps, three of them healthy, and what is wrong with the others."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta

import numpy as np

from service.answers.verdicts import Verdict
from service.demo.flights import FlightPlan, csv_bytes, flight
from twin.condition import Health
from twin.simulation.instrumentation import HELICOPTER, SensorModel, specimen

START = datetime(2026, 3, 2, 6, 30, tzinfo=UTC)
ONSET_SHARE = 0.3
"""Faults set in after this share of the flights: the baseline is learnt before."""


@dataclass(frozen=True, slots=True)
class Truth:
    """What is wrong with one pump of the demo.

    Attributes
    ----------
    fault
        Health of a flight, from the pump's own health and how far the fault has grown (0..1).
    right
        States that are right as a final verdict.
    candidate
        State that must be among the candidates of ``indeterminate``; None where that would be wrong.
    """

    words: str
    fault: Callable[[Health, float], Health]
    right: tuple[str, ...]
    candidate: str | None = None
    zero_step_bar: float = 0.0


@dataclass(frozen=True, slots=True)
class DemoPump:
    """One pump with its place, its truth and the product that its aircraft is filled with (None: the type's own)."""

    serial: str
    aircraft: str
    position: str
    truth: Truth
    fluid: str | None = None


@dataclass(frozen=True, slots=True)
class DemoRecord:
    """One flight record, ready for upload."""

    pump: DemoPump
    flight_id: str
    started_at: datetime
    content: bytes


def _unchanged(own: Health, _share: float) -> Health:
    return own


HEALTHY = Truth("healthy", _unchanged, ("healthy",))
WORN = Truth(
    "worn: leakage +0.7 L/min",
    lambda own, share: own._replace(pump_leakage_scale=own.pump_leakage_scale + 1.05 * share),
    ("pump_degradation",),
    "pump_degradation",
)
LEAKING = Truth(
    "circuit leaks +3 L/min",
    lambda own, share: own._replace(system_leakage_lpm=own.system_leakage_lpm + 3.0 * share),
    ("system_leakage",),
    "system_leakage",
)
SETTING = Truth(
    "setting drifts by -3 bar",
    lambda own, share: own._replace(pressure_setting_change_bar=own.pressure_setting_change_bar - 3.0 * share),
    ("compensator_fault",),
    "compensator_fault",
)
CLOGGED = Truth(
    "drain resistance +50 %",
    lambda own, share: own._replace(drain_resistance_scale=own.drain_resistance_scale * (1.0 + 0.5 * share)),
    ("drain_restriction",),
    "drain_restriction",
)
MOVED = Truth("case sensor moves by +0.2 bar", _unchanged, ("sensor_fault",), "sensor_fault", zero_step_bar=0.2)

PUMPS: tuple[DemoPump, ...] = (
    DemoPump("DT-101", "F-HCAA", "LH", HEALTHY),
    DemoPump("DT-102", "F-HCAA", "RH", WORN),
    DemoPump("DT-103", "F-HCAB", "LH", HEALTHY),
    DemoPump("DT-104", "F-HCAB", "RH", LEAKING),
    DemoPump("DT-105", "F-HCAC", "LH", SETTING),
    DemoPump("DT-106", "F-HCAC", "RH", HEALTHY),
    DemoPump("DT-107", "F-HCAD", "LH", CLOGGED),
    DemoPump("DT-108", "F-HCAD", "RH", MOVED),
)


def pump_records(pump: DemoPump, n_flights: int, seed: int) -> Iterator[DemoRecord]:
    """Flight records of one pump in event order; the same seed gives the same bytes."""
    rng = np.random.default_rng([seed, *pump.serial.encode()])
    own = Health(
        pump_leakage_scale=float(np.exp(np.clip(rng.normal(0.0, 0.15), -0.4, 0.15))),
        system_leakage_lpm=float(rng.uniform(0.3, 0.7)),
        pressure_setting_change_bar=float(rng.normal(0.0, 0.7)),
        drain_resistance_scale=float(np.exp(rng.normal(0.0, 0.12))),
        droop_scale=float(np.exp(rng.normal(0.0, 0.4))),
    )
    sensors = {name: specimen(model, rng) for name, model in HELICOPTER.items()}
    onset = max(round(ONSET_SHARE * n_flights), 1)
    at = START + timedelta(hours=float(rng.uniform(0.0, 3.0)))
    hours = float(rng.uniform(200.0, 1800.0))
    for i in range(n_flights):
        share = float(np.clip((i - onset) / max(n_flights - 6 - onset, 1), 0.0, 1.0))
        moved = pump.truth.zero_step_bar if i >= 2 * onset else 0.0
        flight_sensors = sensors | {"case_pressure_bar": _shifted(sensors["case_pressure_bar"], moved)}
        plan = FlightPlan(
            started_at=at,
            fluid_temperature_degc=float(rng.uniform(25.0, 72.0)),
            reservoir_pressure_bar=float(np.clip(rng.normal(0.5, 0.15), 0.05, None)),
            health=pump.truth.fault(own, share),
            fluid=pump.fluid,
        )
        recording = flight(plan, flight_sensors, rng)
        flight_id = f"{pump.aircraft}-{at:%Y%m%d}"
        metadata = {
            "pump_serial": pump.serial,
            "aircraft": pump.aircraft,
            "position": pump.position,
            "flight_id": flight_id,
            "started_at": f"{at:%Y-%m-%dT%H:%M:%SZ}",
            "flight_hours": f"{hours:.1f}",
        }
        yield DemoRecord(pump, flight_id, at, csv_bytes(recording, metadata))
        at += timedelta(days=float(rng.uniform(1.0, 3.0)))
        hours += float(rng.uniform(0.8, 3.5))


def fleet_records(n_flights: int, seed: int) -> Iterator[DemoRecord]:
    """Flight records of the whole fleet, pump by pump."""
    for pump in PUMPS:
        yield from pump_records(pump, n_flights, seed)


def is_right(truth: Truth, verdict: Verdict) -> bool:
    """Whether a final verdict agrees with the truth: the right state, or undecided with it among the candidates."""
    if verdict["state"] in truth.right:
        return True
    return verdict["state"] == "indeterminate" and truth.candidate in verdict["candidates"]


def _shifted(model: SensorModel, by: float) -> SensorModel:
    return replace(model, offset=model.offset + by)
