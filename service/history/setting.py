"""What surrounds a pump on its aircraft: circuit, fluid, sensors; and the pump type as the judge sees it there."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

from twin.parameters import Circuit, PumpType, Sensor
from twin.pumps import circuit_parameters
from twin.pumps.circuit_sets import circuit_set_from
from twin.pumps.fluids import FLUIDS, with_fluid

DEFAULT_CIRCUIT = "shared_return"
"""Circuit of an aircraft of which the registry says nothing."""
CIRCUIT_DOCUMENT = "circuit_document"
"""Registry value that holds a stored circuit beside its name."""


@dataclass(frozen=True, slots=True)
class FittedSensor:
    """One sensor of an aircraft: full scale [bar] and accuracy [% of full scale], None where not stated."""

    channel: str
    full_scale_bar: float
    accuracy_percent: float | None


@dataclass(frozen=True, slots=True)
class Setting:
    """Surroundings of a pump at one event time; equal settings are analysed alike.

    ``stored_circuit`` is None for one of the twin's own. Consumers of a stored circuit are no part of it: what leaks at rest
    is learnt from the pump's own baseline.
    """

    circuit: str = DEFAULT_CIRCUIT
    fluid: str | None = None
    sensors: tuple[FittedSensor, ...] = ()
    stored_circuit: Circuit | None = None

    @property
    def circuit_parameters(self) -> Circuit:
        """The circuit as the twin takes it."""
        return circuit_parameters(self.circuit) if self.stored_circuit is None else self.stored_circuit

    @property
    def unknown_fluid(self) -> str | None:
        """Name of a fluid that the twin has no properties of."""
        return self.fluid if self.fluid is not None and self.fluid not in FLUIDS else None

    def pump_type(self, base: PumpType) -> PumpType:
        """The pump type with this aircraft's sensors and fluid.

        A sensor's repeatability keeps the pump type's ratio to its accuracy: data sheets of operators state the
        accuracy alone.
        """
        sensors: dict[str, Sensor] = dict(base.sensors)
        for fitted in self.sensors:
            usual = base.sensors.get(fitted.channel)
            if usual is None:
                continue
            accuracy = usual.accuracy_fs if fitted.accuracy_percent is None else fitted.accuracy_percent / 100.0
            ratio = usual.repeatability_fs / usual.accuracy_fs if usual.accuracy_fs > 0.0 else 1.0
            sensors[fitted.channel] = Sensor(fitted.full_scale_bar, accuracy, ratio * accuracy)
        filled = base if self.unknown_fluid is not None else with_fluid(base, self.fluid)
        return replace(filled, sensors=sensors)

    def has_own_fluid(self, base: PumpType) -> bool:
        """Whether the aircraft's fluid is the pump type's own, as far as anybody knows."""
        return self.fluid is None or FLUIDS.get(self.fluid, base.pump.fluid) == base.pump.fluid


def setting_at(aircraft: Mapping[str, Any], at: datetime) -> Setting:
    """Setting that an aircraft's registry values give at an event time; of each channel the newest sensor by then."""
    newest: dict[str, tuple[datetime, FittedSensor]] = {}
    for entry in aircraft.get("sensors", ()):
        since = datetime.fromisoformat(entry["since"])
        held = newest.get(entry["channel"])
        if since <= at and (held is None or held[0] <= since):
            sensor = FittedSensor(entry["channel"], entry["full_scale_bar"], entry.get("accuracy_percent_full_scale"))
            newest[entry["channel"]] = (since, sensor)
    sensors = tuple(newest[channel][1] for channel in sorted(newest))
    document = aircraft.get(CIRCUIT_DOCUMENT)
    stored = None if document is None else circuit_set_from(document).circuit
    return Setting(aircraft.get("circuit") or DEFAULT_CIRCUIT, aircraft.get("fluid"), sensors, stored)
