"""What happens to pump, position and sensors between two records, and what it makes unknown.

Leakages, bleed, setting, droop and ripple belong to the pump and travel with it. Drain, return line, leak of the circuit and
fluid belong to the position and stay there; zeros and spans belong to the sensors. An entry frees what it names.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from detectors.words.observation import History, Maintenance, Observation
from twin.parameters import PumpType
from twin.pumps.fluids import FLUIDS, PRODUCTS, ln_viscosity_ratio

Freed = Mapping[str, float | None]
"""Components made unknown: None for as unknown as in any pump of the population, or by how much they may differ."""

_POPULATION = None
_FLUID: Freed = {"ln_viscosity": _POPULATION, "setting": 0.5}
"""The spool's jet forces follow the fluid: a product half as viscous regulates half a bar lower (operating point)."""
_CLOGS: Freed = {"drain_extra": _POPULATION, "drain_viscous": _POPULATION, "drain_orifice": _POPULATION}
"""What clogs the drain ends with the work on it, whatever its law."""
_CASE_SENSOR: Freed = {"case_offset": _POPULATION, "case_span": _POPULATION}
_RESERVOIR_SENSOR: Freed = {"reservoir": _POPULATION}
_DISCHARGE_SENSOR: Freed = {"setting": 1.0}
"""The setting is known as the old sensor showed it (estimate: a third of the accuracy of a sensor of 350 bar, 1 %)."""
_POSITION: Freed = {
    **_CLOGS,
    "ln_drain": _POPULATION,
    "drain_viscosity": _POPULATION,
    "drain_flow": _POPULATION,
    "system_orifice": _POPULATION,
    "system_laminar": _POPULATION,
    "case_warmth": _POPULATION,
    **{f"load_{what}": _POPULATION for what in ("case", "case_square", "warmth", "discharge", "discharge_square")},
    # volumes and lines of the aircraft give the pump's ripple another gain (study: 20 % between aircraft)
    "ln_ripple": 0.2,
    "ln_case_ripple": 0.2,
    "once": 0.01,
}
_WEARING = ("ln_slipper", "ln_laminar", "throttled", "bleed", "slipper_extra", "laminar_extra")
_REGULATING = ("setting", "softening", "ln_droop")
_RIPPLE = ("ln_ripple", "ln_case_ripple", "once", "case_ripple_warmth", "answer")
_PUMP: Freed = dict.fromkeys((*_WEARING, *_REGULATING, *_RIPPLE), _POPULATION)
_WINDOW_DEGC = 60.0
"""Temperature at which products are compared: where windows lie."""
_BATCH_SD, _FAMILY_SD = 0.04, 0.25
"""Spread of the logarithm of viscosity between batches of one product (study), and where nobody said which product it is
(estimate: half of what lies between the thinnest and the usual one)."""
MOVED: Freed = {**_POSITION, **_FLUID, **_CASE_SENSOR, **_RESERVOIR_SENSOR, **_DISCHARGE_SENSOR}
"""Another aircraft or position, with its own drain, fluid and sensors."""
_ACTIONS: Mapping[str, Freed] = {
    # a filter element is one part of the drain, the line stays as it is (estimate: give or take 12 %, a third of what a fully
    # loaded element costs); what is cleaned has no more resistance than before
    "filter_changed": {**_CLOGS, "ln_drain": 0.12, "drain_flow": 0.12},
    "drain_cleaned": {**_CLOGS, "ln_drain": 0.12, "drain_viscosity": 0.1, "drain_flow": 0.12},
    "fluid_changed": _FLUID,
    "setting_adjusted": {"setting": _POPULATION},
    "pump_overhauled": _PUMP,
}
_SENSORS: Mapping[str | None, Freed] = {
    None: {**_CASE_SENSOR, **_RESERVOIR_SENSOR},
    "case_pressure_bar": _CASE_SENSOR,
    "reservoir_pressure_bar": _RESERVOIR_SENSOR,
    "discharge_pressure_bar": _DISCHARGE_SENSOR,
}
"""By channel; None where nobody said which: then either zero may be another."""


def freed_by(entry: Maintenance) -> Freed:
    """What an entry makes unknown; nothing where the judge carries nothing of what was touched."""
    if entry.action == "sensor_replaced":
        return _SENSORS.get(entry.channel, {})
    return _ACTIONS.get(entry.action, {})


def viscosity_of(entry: Maintenance, pump: PumpType) -> tuple[float, float] | None:
    """Logarithm of the viscosity after an entry over that of the twin's fluid, and how far it may be off.

    None where the entry names no product, or one that the twin has no properties of: then a fresh batch of an unknown
    product is as wide as the family of fluids.
    """
    assumed = next((name for name, fluid in FLUIDS.items() if fluid == pump.pump.fluid), None)
    if entry.action != "fluid_changed":
        return None
    if entry.fluid is None or entry.fluid not in PRODUCTS or assumed is None:
        return 0.0, _FAMILY_SD
    ratio = ln_viscosity_ratio(entry.fluid, assumed, _WINDOW_DEGC)
    return ratio, max(PRODUCTS[entry.fluid].viscosity_sd(_WINDOW_DEGC), _BATCH_SD)


def due(maintenance: tuple[Maintenance, ...], after: datetime, until: datetime) -> list[Maintenance]:
    """Entries between two records, in their order."""
    found = [m for m in maintenance if after < m.at <= until]
    return sorted(found, key=lambda m: (m.at, m.action, m.channel or "", m.fluid or ""))


@dataclass(frozen=True, slots=True)
class Latest:
    """Where the observation that was taken last stands."""

    at: datetime
    aircraft: str
    position: str


def has_moved(previous: Latest, observation: Observation, history: History) -> bool:
    """Whether a pump was put somewhere, or put in again, between its last record and another one."""
    moved = (previous.aircraft, previous.position) != (observation.aircraft, observation.position)
    return moved or any(previous.at < t <= observation.at for t in history.installed_at)
