"""The registry: aircraft, pump types, measured healthy curves, CSV files taken in."""

from typing import NotRequired

from typing_extensions import TypedDict

from service.answers.words import Instant, shape


@shape
class FittedSensor(TypedDict):
    """A sensor of an aircraft and since when it is there."""

    channel: str
    """Channel that it measures."""
    identity: str
    """Serial number or other mark."""
    full_scale_bar: float
    """Full scale [bar]."""
    accuracy_percent_full_scale: float | None
    """Accuracy [% of full scale]; null: the pump type's."""
    since: Instant
    """Since when it is fitted."""


@shape
class Aircraft(TypedDict):
    """An aircraft with its fluid, circuit and sensors."""

    aircraft: str
    """Tail or serial number."""
    operator: str
    """Operator that it belongs to."""
    aircraft_type: str | None
    """Type, for example `H225`."""
    fluid: str | None
    """Product name of the hydraulic fluid, which its pumps are judged with; null: the pump type's own."""
    circuit: str
    """`shared_return`, `separate_drain` or the id of a stored circuit."""
    sensors: list[FittedSensor]
    """Sensors that differ from the pump type's, or whose change starts a reference anew."""
    confirmed: bool
    """False where only records speak of it."""
    created_at: Instant
    """When it was first heard of."""


@shape
class LookAlike(TypedDict):
    """Something known by a name that is easily taken for another: by case, hyphens, blanks, zeros, letters alike."""

    name: str
    """Its serial number, or its name."""
    since: Instant
    """When it was first heard of."""


@shape
class AircraftMade(Aircraft):
    """An aircraft as it was registered."""

    looks_like: NotRequired[list[LookAlike]]
    """Other aircraft of the operator whose names are easily taken for this one's; left out where there are none."""


@shape
class SensorOfType(TypedDict):
    """A sensor that pumps of a type have."""

    full_scale_bar: float
    """Full scale [bar]."""
    accuracy_percent_full_scale: float
    """Accuracy [% of full scale]."""
    repeatability_percent_full_scale: float
    """Repeatability [% of full scale]."""


@shape
class Quantity(TypedDict):
    """A number of a parameter set."""

    value: float
    """Value, in the `unit` beside it."""
    unit: str
    """Unit; `-` for a number without one."""
    source: str
    """Where the number comes from."""
    uncertainty: float | None
    """One sigma as a share of the value; null where it is exact."""


@shape
class PumpTypeSummary(TypedDict):
    """A pump type in a list."""

    id: str
    """Id of the pump type."""
    title: str
    """What it is."""
    nominal_speed_rpm: float
    """Nominal shaft speed [rpm]."""
    nominal_reservoir_pressure_bar: float
    """Nominal reservoir pressure, gauge [bar]."""
    sensors: dict[str, SensorOfType]
    """Sensors by the channel that they measure."""
    twin_version: str
    """Version of the twin with this parameter set."""


@shape
class PumpType(PumpTypeSummary):
    """A whole parameter set, in the shape that `POST /pump-types` takes."""

    quantities: dict[str, Quantity]
    """Parameters of the pump by part and symbol, for example `slipper.h`."""
    limits: dict[str, Quantity]
    """Limits that hold for the type."""
    population: dict[str, Quantity]
    """How pumps of the type differ from each other."""
    lacks: NotRequired[list[str]]
    """Required channels that records of the type do not have, by name; left out where they have all."""
    own_twin: NotRequired[bool]
    """False for a type that is watched for change against its measured curve alone; left out for all others."""


@shape
class Consumer(TypedDict):
    """Something at the discharge line that leaks at rest."""

    name: str
    """What it is."""
    flow_lpm: float
    """What it lets through at 175 bar [L/min]."""


@shape
class Accumulator(TypedDict):
    """Gas in the discharge line."""

    gas_volume_l: float
    """Gas before it is filled [L]."""
    precharge_bar: float
    """Pressure before it is filled, gauge [bar]."""


@shape
class Circuit(TypedDict):
    """A circuit round a pump, in the shape that `POST /circuits` takes."""

    id: str
    """Its name, as `circuit` of the twin's calls and of aircraft takes it."""
    title: str
    """What it is."""
    drain: str
    """`shared`: the drain joins the return line; `separate`: it has its own."""
    quantities: dict[str, Quantity]
    """Resistances of drain and return line by symbol."""
    consumers: list[Consumer]
    """What leaks at rest."""
    accumulator: Accumulator | None
    """Null: there is none."""


@shape
class ReferencePoint(TypedDict):
    """A measured point of a healthy pump; null where the pump type's records lack the channel."""

    discharge_pressure_bar: float | None
    """Discharge pressure, gauge [bar]."""
    case_minus_reservoir_bar: float | None
    """Case pressure minus reservoir pressure [bar]."""
    fluid_temperature_degc: float | None
    """Fluid temperature [degC]."""
    speed_rpm: float | None
    """Shaft speed [rpm]."""
    warming_k_per_min: NotRequired[float]
    """How fast the fluid warmed meanwhile [K/min]; 0 where nobody said."""


class ReferencePoints(TypedDict):
    """A measured curve as it is stored."""

    items: list[ReferencePoint]


@shape
class ReferenceCurve(TypedDict):
    """The healthy curve that holds for a pump type: measured, or the twin's own."""

    pump_type: str
    """Id of the pump type."""
    source: str
    """`measured` or `twin`."""
    operator: str | None
    """Operator whose measurement it is; null for everybody's and for the twin's."""
    points: list[ReferencePoint]
    """Measured points; empty where the twin's curve holds."""
    recorded_at: Instant | None
    """When the measurement was stored."""
    author: NotRequired[str]
    """Who stored it; left out for the twin's."""


@shape
class RegistryFileTaken(TypedDict):
    """What the lines of a registry file did."""

    created: int
    """Number of lines that registered something (a count)."""
    changed: int
    """Number of lines that changed something (a count)."""
    unchanged: int
    """Number of lines that said what was known (a count)."""
