"""Isolability: what given sensors could detect and isolate, before anybody buys them."""

import math
from dataclasses import replace
from typing import Any

from fastapi import APIRouter
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat

from detectors.isolability import FaultBound, Isolability, isolability
from detectors.isolability_plan import PLAN_RANGES, Plan, PlanFaultsError, Sensors, sensors_of
from detectors.verdict import SIDE_OF
from service.context import Asker
from service.errors import Fault, Invalid
from twin.parameters import PumpType, Sensor
from twin.pumps import PUMP_TYPES, circuit_parameters, pump_type
from twin.pumps.circuits import CIRCUITS

router = APIRouter(prefix="/twin", tags=["twin"])
REPEATABILITY_SHARE = 0.1
"""Repeatability over accuracy where a request gives the accuracy alone (estimate)."""
_CHANNELS = {
    "case": "case_pressure_bar",
    "discharge": "discharge_pressure_bar",
    "reservoir": "reservoir_pressure_bar",
}


def _ranged(key: str) -> Any:
    low, high = PLAN_RANGES[key]
    return Field(default=None, ge=low, le=high)


class SensorInput(BaseModel):
    """One pressure sensor; what is not given is the pump type's own, repeatability a tenth of a given accuracy."""

    model_config = ConfigDict(extra="forbid")
    full_scale_bar: FiniteFloat | None = _ranged("full_scale_bar")
    accuracy_percent: FiniteFloat | None = Field(default=None, ge=0.001, le=10.0)
    repeatability_percent: FiniteFloat | None = Field(default=None, ge=0.0001, le=10.0)


class SensorsInput(BaseModel):
    """The pressure sensors; ``reservoir_pressure_bar: null`` where none is fitted."""

    model_config = ConfigDict(extra="forbid")
    case_pressure_bar: SensorInput = SensorInput()
    discharge_pressure_bar: SensorInput = SensorInput()
    reservoir_pressure_bar: SensorInput | None = SensorInput()
    case_zero_measured: bool = True


class IsolabilityRequest(BaseModel):
    """One study; the defaults are the pump type's own sensors."""

    model_config = ConfigDict(extra="forbid")
    pump_type: str = "h225"
    circuit: str = "shared_return"
    sensors: SensorsInput = SensorsInput()
    temperature_range_degc: tuple[FiniteFloat, FiniteFloat] = (30.0, 80.0)
    baseline_flights: int = Field(default=30, ge=PLAN_RANGES["baseline_flights"][0], le=PLAN_RANGES["flights"][1])
    flights: int = Field(default=30, ge=PLAN_RANGES["flights"][0], le=PLAN_RANGES["flights"][1])
    windows_per_flight: int = Field(default=1, ge=1, le=PLAN_RANGES["windows_per_flight"][1])
    burst: bool = False
    false_alarm_probability: FiniteFloat = Field(default=1.0e-4, ge=1.0e-9, le=0.1)
    detection_probability: FiniteFloat = Field(default=0.9, ge=0.5, le=0.9999)


@router.post("/isolability", summary="Smallest detectable and isolable faults")
def study(body: IsolabilityRequest, _asker: Asker) -> dict[str, Any]:
    """Bounds of every kind of fault for the given sensors, temperatures and flights."""
    faults = [
        Fault(where, f"{value!r} is not one of {', '.join(sorted(known))}")
        for where, value, known in (("pump_type", body.pump_type, PUMP_TYPES), ("circuit", body.circuit, CIRCUITS))
        if value not in known
    ]
    kind = pump_type(body.pump_type if body.pump_type in PUMP_TYPES else "h225")
    circuit = circuit_parameters(body.circuit if body.circuit in CIRCUITS else "shared_return")
    try:
        found = isolability(_plan(body, kind), kind, circuit)
    except PlanFaultsError as error:
        faults += [Fault(_place(where), problem) for where, problem in error.faults]
    if faults:
        raise Invalid(f"the study has {len(faults)} fault(s)", faults)
    return isolability_document(found) | {"pump_type": body.pump_type, "circuit": body.circuit}


def isolability_document(found: Isolability) -> dict[str, Any]:
    """Bounds as JSON; null where no size inside the linear model would do."""
    plan = found.plan
    return {
        "flights": plan.flights,
        "baseline_flights": plan.baseline_flights,
        "temperature_range_degc": list(plan.temperature_range_degc),
        "burst": plan.burst,
        "false_alarm_probability": plan.false_alarm_probability,
        "detection_probability": plan.detection_probability,
        "case_pressure_range_bar": list(found.case_pressure_range_bar),
        "faults": {fault.name: _fault(fault) for fault in found.faults},
    }


def _fault(fault: FaultBound) -> dict[str, Any]:
    return {
        "state": fault.state.value,
        "side": SIDE_OF[fault.state].value,
        "unit": fault.unit,
        "smallest_detectable": _size(fault.smallest_detectable),
        "smallest_isolable": _size(fault.smallest_isolable),
        "largest_considered": fault.largest,
        "ambiguity_group": list(fault.ambiguity_group),
        "rivals": [
            {
                "name": r.name,
                "state": r.state.value,
                "smallest_isolable": _size(r.smallest_isolable),
                "cosine": r.cosine,
            }
            for r in fault.rivals
        ],
        "by_flights": {
            "smallest_detectable": [_size(float(v)) for v in fault.detectable_by_flights],
            "smallest_isolable": [_size(float(v)) for v in fault.isolable_by_flights],
        },
    }


def _size(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _plan(body: IsolabilityRequest, kind: PumpType) -> Plan:
    given = body.sensors
    tank = given.reservoir_pressure_bar
    sensors = Sensors(
        case=_sensor(given.case_pressure_bar, kind.sensors["case_pressure_bar"]),
        discharge=_sensor(given.discharge_pressure_bar, kind.sensors["discharge_pressure_bar"]),
        reservoir=None if tank is None else _sensor(tank, kind.sensors["reservoir_pressure_bar"]),
        zero_measured=given.case_zero_measured,
    )
    return replace(
        Plan(sensors_of(kind)),
        sensors=sensors,
        temperature_range_degc=body.temperature_range_degc,
        baseline_flights=body.baseline_flights,
        flights=body.flights,
        windows_per_flight=body.windows_per_flight,
        burst=body.burst,
        false_alarm_probability=body.false_alarm_probability,
        detection_probability=body.detection_probability,
    )


def _sensor(given: SensorInput, own: Sensor) -> Sensor:
    accuracy, repeatability = own.accuracy_fs, own.repeatability_fs
    if given.accuracy_percent is not None:
        accuracy = given.accuracy_percent / 100.0
        repeatability = REPEATABILITY_SHARE * accuracy
    if given.repeatability_percent is not None:
        repeatability = given.repeatability_percent / 100.0
    return Sensor(given.full_scale_bar or own.full_scale_bar, accuracy, repeatability)


def _place(where: str) -> str:
    """Place of a plan's fault in the request."""
    for name, channel in _CHANNELS.items():
        where = where.replace(f"sensors.{name}.", f"sensors.{channel}.")
    return where.replace("_fs", "_percent")
