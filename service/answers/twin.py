"""The twin: operating points, short runs, what given sensors can see."""

from typing import NotRequired

from typing_extensions import TypedDict

from service.answers.problems import Problem
from service.answers.words import Side, State, shape


@shape
class Leakages(TypedDict):
    """Leakage into the case by where it comes from."""

    pistons: float
    """Past the pistons [L/min]."""
    slippers: float
    """Under the slippers [L/min]."""
    port_plate: float
    """Over the port plate [L/min]."""
    compensator: float
    """From the compensator [L/min]."""


@shape
class OperatingPoint(TypedDict, total=False):
    """A steady state, or the problem in place of one."""

    error: Problem
    """Why there is no solution; then it is the only member."""
    discharge_pressure_bar: float
    """Discharge pressure, gauge [bar]."""
    case_pressure_bar: float
    """Case pressure, gauge [bar]."""
    return_pressure_bar: float
    """Pressure in the return line, gauge [bar]."""
    control_pressure_bar: float
    """Pressure on the stroking piston, gauge [bar]."""
    swashplate_angle_deg: float
    """Tilt of the swashplate [deg]."""
    discharge_flow_lpm: float
    """Flow into the circuit [L/min]."""
    case_flow_lpm: float
    """Flow through the drain line [L/min]."""
    shaft_torque_nm: float
    """Torque of the shaft [N m]."""
    suction_flow_lpm: float
    """Flow through the inlet [L/min]."""
    case_temperature_degc: float
    """Temperature of the fluid in the case [degC]."""
    leakage_lpm: Leakages
    """Leakage into the case by where it comes from [L/min]."""
    derivatives: dict[str, dict[str, float]]
    """Derivative of each output by each input, in the unit of the output per unit of the input."""
    outside: list[str]
    """Quantities beyond what the pump type was held against; missing where there are none. `suction_pressure_bar`: the
    chambers cannot fill; `slipper.variable`: the set's gap follows from forces, and no metamodel was fitted to
    its numbers; `slipper.metamodel`: the metamodel is asked beyond the runs that it was fitted to."""


@shape
class OperatingPoints(TypedDict):
    """Steady states in the order of the conditions."""

    items: list[OperatingPoint]
    """One per condition."""


@shape
class Simulation(TypedDict):
    """Channels of a run, all equally long; pressures are gauge."""

    pump_type: str
    """Id of the pump type."""
    circuit: str
    """Circuit around the pump."""
    fluid: str | None
    """Product name of the fluid; null: the pump type's own."""
    duration_s: float
    """Length of the run [s]."""
    sample_rate_hz: float
    """Sampling rate [Hz]."""
    pressure_reference: str
    """Always `gauge`."""
    outside: NotRequired[list[str]]
    """`slipper.metamodel` where the metamodel of the slippers was asked beyond its runs; missing where it was not."""
    channels: dict[str, list[float | None]]
    """Samples by channel, in the unit that its name ends in."""


@shape
class Rival(TypedDict):
    """Another fault that a fault could be taken for."""

    name: str
    """The other fault."""
    state: State
    """State of a verdict that it would be."""
    smallest_isolable: float | None
    """Smallest size told apart from it, in the fault's `unit`; null: none inside the linear model."""
    cosine: float
    """Cosine between the directions of both (a number without unit); 1: the same."""


@shape
class BoundsByFlights(TypedDict):
    """How the bounds fall with the number of flights, from the first flight on."""

    smallest_detectable: list[float | None]
    """Smallest detectable size after 1, 2, … flights, in the fault's `unit`."""
    smallest_isolable: list[float | None]
    """Smallest isolable size after 1, 2, … flights, in the fault's `unit`."""


@shape
class FaultBounds(TypedDict):
    """What the sensors can see of one fault."""

    state: State
    """State of a verdict that it would be."""
    side: Side
    """Where it lies."""
    unit: str
    """Unit of all sizes."""
    smallest_detectable: float | None
    """Smallest size that is noticed, in `unit`; null: none inside the linear model."""
    smallest_isolable: float | None
    """Smallest size that is told apart from every rival, in `unit`; null: none inside the linear model."""
    largest_considered: float
    """Largest size inside the linear model, in `unit`."""
    ambiguity_group: list[str]
    """Faults that it cannot be told apart from."""
    rivals: list[Rival]
    """Other faults, each with what tells it apart."""
    by_flights: BoundsByFlights
    """The bounds by the number of flights."""


@shape
class IsolabilityStudy(TypedDict):
    """Bounds of every kind of fault, for given sensors, temperatures and flights."""

    flights: int
    """Number of flights after the fault began (a count)."""
    baseline_flights: int
    """Number of flights of the baseline (a count)."""
    temperature_range_degc: list[float]
    """Lowest and highest fluid temperature [degC]."""
    windows_per_flight: int
    """Number of zero-flow windows per flight (a count)."""
    ground_run_flows_lpm: list[float]
    """Demands of the ground runs [L/min]."""
    ground_run_every: int
    """Number of flights from one ground run to the next (a count)."""
    burst: bool
    """Whether a fast burst is recorded."""
    false_alarm_probability: float
    """Probability of an alarm without a fault (a share)."""
    detection_probability: float
    """Probability that a fault of the smallest size is seen (a share)."""
    case_pressure_range_bar: list[float]
    """Lowest and highest case pressure over the flights, gauge [bar]."""
    remarks: list[str]
    """What to know about the study."""
    faults: dict[str, FaultBounds]
    """Bounds by fault."""


@shape
class Isolability(IsolabilityStudy):
    """Bounds of every kind of fault for one pump type and circuit."""

    pump_type: str
    """Id of the pump type."""
    circuit: str
    """Circuit around the pump."""
    fluid: str | None
    """Product name of the fluid; null: the pump type's own."""
