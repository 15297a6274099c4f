"""Types of a parameter set: one immutable block of SI numbers per pump part, each number with unit and source."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

from twin.laws.fluid import Fluid
from twin.units import SI_PER_UNIT


class Piston(NamedTuple):
    """Pistons in their bores; ``n`` of them, equally spaced (a float for the kernels, a whole number).

    ``e_rel`` is eccentricity over clearance (0 centred, 1 touching); ``m`` the mass of a piston with its slipper.
    """

    n: float
    d_p: float
    R: float
    b: float
    e_rel: float
    l_mean: float
    V_dead: float
    m: float


class Slipper(NamedTuple):
    """Hydrostatic bearing under each slipper.

    With ``variable`` 0 the gap is ``h``; with 1 it follows from the forces (section 2.6.2), between touching the plate
    and the retainer's clearance ``h_retainer``. ``balance`` is S_eq of equation 2-37 over the piston's area.
    ``pumped_repair`` 1 takes the same area for the swept volume and the force (section 2.6.3), 0 follows the thesis'
    text; ``squeeze`` scales the damping of the film on the land.
    """

    h: float
    diameter_ratio: float
    d_throttle: float
    C_q: float
    variable: float
    balance: float
    V_pocket: float
    h_min: float
    h_retainer: float
    k_contact: float
    d_contact: float
    damping: float
    squeeze: float
    pumped_repair: float


class PortPlate(NamedTuple):
    """Gap between barrel and port plate, and the kidneys that the chambers pass.

    ``shape`` is arc length over land width of one kidney's lands. A chamber's port opens ``phi_seal`` after dead
    centre plus the delay ``phi_commutation``, over a ramp ``phi_ramp`` to the full area, and closes alike;
    ``dP_laminar`` is the pressure difference below which its flow is laminar.
    """

    h: float
    shape: float
    phi_commutation: float
    phi_seal: float
    phi_ramp: float
    A_port: float
    C_q: float
    dP_laminar: float


class Swashplate(NamedTuple):
    """Tilting plate with its stops. ``T_coulomb``, ``T_static`` are friction beside the viscous ``damping``,
    full from the tilt rate ``w_friction`` on.
    """

    alpha_min: float
    alpha_max: float
    J: float
    damping: float
    T_coulomb: float
    T_static: float
    w_friction: float
    k_stop: float
    d_stop: float


class Compensator(NamedTuple):
    """Spool valve of the pressure compensator: spool, spring, metering edges, bleed of the control volume.

    ``edge_law`` is a code of ``twin.laws.metering_edge``; the smooth law takes its opening from ``c_edge`` and its
    seals from ``l_seal_*``, the published ones take all from ``edge_radius``, ``delta_lambda`` and ``K_rec``.
    ``L_jet`` is the damping length of the transient jet (2-22), ``F_coulomb`` and ``F_static`` friction that is full
    from the speed ``v_friction`` on.
    """

    A_spool: float
    F_preload: float
    k_spool: float
    x_zero: float
    x_low: float
    x_high: float
    k_stop: float
    edge_law: float
    n_edge: float
    w_edge: float
    c_edge: float
    edge_radius: float
    delta_lambda: float
    K_rec: float
    x_overlap: float
    C_q: float
    cos_jet: float
    L_jet: float
    d_spool: float
    c_spool: float
    e_rel: float
    l_seal_discharge: float
    l_seal_case: float
    d_bleed: float
    spring_softening: float
    m_spool: float
    damping: float
    F_coulomb: float
    F_static: float
    v_friction: float


class ServoPistons(NamedTuple):
    """Stroking piston (control pressure, drives the tilt down) and rate piston (spring, drives it up).

    With ``contact`` 0 both follow the plate; with 1 they are bodies of their own that push it through the contact of
    equation 2-14 and may leave it (sporadic contact). Each has its bore's clearance ``b``, eccentricity over clearance
    ``e_rel``, length ``l``, mass ``m`` and friction. The rate piston's bore is fed from discharge with ``rate_fed`` 1.
    """

    A_stroke: float
    L_stroke: float
    b_stroke: float
    e_rel_stroke: float
    l_stroke: float
    m_stroke: float
    F_coulomb_stroke: float
    F_static_stroke: float
    A_rate: float
    L_rate: float
    F_rate: float
    k_rate: float
    rate_fed: float
    b_rate: float
    e_rel_rate: float
    l_rate: float
    m_rate: float
    F_coulomb_rate: float
    F_static_rate: float
    viscous: float
    v_friction: float
    contact: float
    k_contact: float
    d_contact: float


class Volumes(NamedTuple):
    """Fluid volumes that turn flow into pressure."""

    discharge: float
    case: float
    return_line: float
    control: float


class Drive(NamedTuple):
    """What turns the shaft, and its losses beside the hydraulic work.

    ``torque_viscous_ref`` is the viscous drag at 50 degC and 4600 rpm; its films pass their heat on by
    ``film_conductance`` [W/K]. ``heat_share`` of all friction warms the case, which passes it on to its flow and by
    ``case_conductance`` [W/K] to the housing.

    With ``J`` 0 the speed is what is asked for; else the motor gives ``stiffness`` [N m s] of torque per missing
    speed on top of what the first instant asked for (figure 3-16).
    """

    torque_viscous_ref: float
    torque_pressure: float
    film_conductance: float
    heat_share: float
    case_conductance: float
    J: float
    stiffness: float


class Pump(NamedTuple):
    """All blocks of one pump, at most two levels deep: ``pump.slipper.h``."""

    piston: Piston
    slipper: Slipper
    port_plate: PortPlate
    swashplate: Swashplate
    compensator: Compensator
    servo: ServoPistons
    volumes: Volumes
    drive: Drive
    fluid: Fluid


class Circuit(NamedTuple):
    """What the pump's ports see. ``shared`` is 1 where the drain joins the return line, 0 with its own line.

    ``k_c`` grows linearly with temperature from ``T_ref``: ``k_c (1 + k_c_slope (T - T_ref))``.
    """

    shared: float
    k_c: float
    k_c_slope: float
    w_nu: float
    w_Q: float
    Q_ref: float
    k_inf: float
    k_inf_slope: float
    K: float
    K_slope: float
    gamma: float
    T_ref: float


@dataclass(frozen=True, slots=True)
class Quantity:
    """One number as its source states it.

    Attributes
    ----------
    value, unit
        As written in the source; ``si`` converts.
    source
        Thesis table or section, standard, measurement, or an estimate with its reason.
    uncertainty
        Relative one-sigma spread between pumps or of the estimate [-]; None where the source gives none.
    """

    value: float
    unit: str
    source: str
    uncertainty: float | None = None

    @property
    def si(self) -> float:
        """The value in SI units."""
        return self.value * SI_PER_UNIT[self.unit]


Block = TypeVar("Block", bound=NamedTuple)


def block(kind: type[Block], quantities: Mapping[str, Quantity]) -> Block:
    """Block of SI floats from its quantities.

    Raises
    ------
    ValueError
        naming every missing and every unknown field at once.
    """
    fields: tuple[str, ...] = kind._fields
    faults = [f"missing: {name}" for name in fields if name not in quantities]
    faults += [f"unknown: {name}" for name in quantities if name not in fields]
    if faults:
        raise ValueError(f"{kind.__name__}: {'; '.join(faults)}")
    numbers: list[Any] = [float(quantities[name].si) for name in fields]
    return kind(*numbers)


@dataclass(frozen=True, slots=True)
class Sensor:
    """What a pressure sensor is: full scale [bar], accuracy and repeatability as fractions of full scale [-]."""

    full_scale_bar: float
    accuracy_fs: float
    repeatability_fs: float

    @property
    def repeatability_bar(self) -> float:
        """What the sensor repeats to [bar]."""
        return self.full_scale_bar * self.repeatability_fs

    @property
    def resolution_bar(self) -> float:
        """A tenth of its repeatability [bar] (estimate): honest samples of a quiet channel differ by that much."""
        return 0.1 * self.full_scale_bar * self.repeatability_fs


OPEN_TANK_BAR = 0.02
"""Spread of the reservoir pressure up to which it is taken as known (estimate: an open tank follows its fluid level)."""


@dataclass(frozen=True, slots=True)
class PumpType:
    """A pump type: kernel parameters, where each number comes from, and the facts that detection needs.

    Attributes
    ----------
    quantities
        ``"part.field"`` to quantity, for every number in ``pump``.
    limits
        Acceptance limits and reference condition, by name with the unit in it.
    population
        One-sigma spreads between pumps and aircraft, by name with the unit in it.
    lacks
        Required channels that records of the type do not have, by name; never both pressures.
    own_twin
        False for a type that nobody has modelled: it is watched for change against its measured healthy curve, and
        ``pump`` is a base's that stands in where a pump of any kind is asked for.
    """

    name: str
    title: str
    pump: Pump
    quantities: Mapping[str, Quantity]
    nominal_speed_rpm: float
    nominal_reservoir_pressure_bar: float
    sensors: Mapping[str, Sensor]
    limits: Mapping[str, Quantity]
    population: Mapping[str, Quantity]
    lacks: tuple[str, ...] = ()
    own_twin: bool = True

    @property
    def has_both_pressures(self) -> bool:
        """Whether discharge and case pressure are both recorded: one alone cannot tell what has moved it."""
        return not {"discharge_pressure_bar", "case_pressure_bar"}.intersection(self.lacks)

    @property
    def reservoir_is_known(self) -> bool:
        """Whether the reservoir pressure is known without a sensor: an open tank, as its stated spread says."""
        return self.population["reservoir_pressure_bar"].value <= OPEN_TANK_BAR
