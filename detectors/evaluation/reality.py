"""Simulated realities: what differs from pump to pump, from flight to flight, and from the model that judges.

The truth comes from the operating point, the judge works with a reduced twin round the *nominal* pump. Beyond that
the realities differ from it in what ``DIFFERENCES`` lists; the judge is told none of it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from detectors.evaluation.regulating import ERODED_SETTING_BAR_PER_UM, regulation
from detectors.expectation.reduced_twin import SLIPPER_VISCOSITY
from twin.condition import INPUTS, Health
from twin.laws.fluid import kinematic_viscosity
from twin.operating_point import operating_points
from twin.operating_point.equations import drain_viscosity_ratio
from twin.parameters import Circuit, PumpType
from twin.units import KELVIN_AT_0_DEGC

Array = NDArray[np.float64]

DIFFERENCES: tuple[str, ...] = (
    "drain law: k_c ~ nu^n, nu of the case's warmed fluid, with n drawn from 0 to 0.6, or a nu Q + b Q^2 with a's share drawn "
    "from 0.2 to 0.8; "
    "the judge: constant, pipe and fitting parts with weights of its own",
    "droop 0.01 to 0.3 bar/(L/min), log-uniform over pumps; the judge: 0.15 times or over 2, unknown",
    "system leakage by an orifice or by a laminar gap",
    "leakage by clearances of pistons, slippers and port plate drawn apart (+-30 %), compensator's own leak +-15 %",
    "viscosity of the batch +-4 %, changed by a new batch every 120 flights or so; the data sheet's +-0 for the judge",
    "spring softening off by +-50 % of the twin's; temperature probe off by +-1 K for each aircraft",
    "discharge sensor drifting by some 0.15 bar in 300 flights, case zero by 0.06 bar; outliers, dropouts, missing zeros",
    "growing slippers run into their throttle: 0 to 25 % of the added leakage, drawn per pump, follows an orifice "
    "(the twin's own gap gives x1.85 to x1.97 from 50 to 80 degC, this mixture x1.73 to x1.97)",
    "regulation ripple of 0.1 to 1.6 bar at 10 to 28 Hz, drawn for each pump; busier and calmer flights (15 to 50 %), one in "
    "fifty three times as busy, a drift of some 30 % of ripple and 4 % of frequency in 250 flights; the frequency follows "
    "the consumers; a jam shows on 70 % of the flights; the judge: one spread for all, which each chart learns",
    "under load: the return line's drop 15 % off the circuit's, with a temperature law of its own; the flow 2 % off the "
    "command for each aircraft and 0.25 L/min from run to run; 0.2 bar of discharge pressure at 20 L/min, linear and square",
)
DROOP_AT_NOMINAL = 0.15
"""Droop of the nominal pump [bar/(L/min)] (own operating point; physics table of the system leakage)."""


@dataclass(frozen=True, slots=True)
class Reality:
    """One family of worlds."""

    name: str
    drain: str
    """``viscous`` (k_c ~ nu^n) or ``fittings`` (a nu Q + b Q^2)."""
    system_leak: str
    """``orifice`` or ``laminar``."""


REALITIES: tuple[Reality, ...] = (
    Reality("viscous drain, orifice leak", "viscous", "orifice"),
    Reality("viscous drain, laminar leak", "viscous", "laminar"),
    Reality("fittings drain, orifice leak", "fittings", "orifice"),
    Reality("fittings drain, laminar leak", "fittings", "laminar"),
)


@dataclass(frozen=True)
class Flights:
    """True pressures and conditions of a fleet's flights, arrays of shape (n_pumps, n_flights) in edge units."""

    speed: Array
    temperature: Array
    reservoir: Array
    discharge: Array
    case: Array
    case_flow_at_reference: Array
    leakage: Array
    """Internal leakage at the reference condition, what was added by the fault [L/min]."""
    once: Array
    """Line at once per revolution of discharge pressure [bar]."""
    ripple: Array
    """Discharge pressure below order 1, root mean square [bar]."""
    frequency: Array
    """Where that ripple lies [Hz]."""
    rows: Array
    """Inputs of the operating point, shape (n_pumps, n_flights, len(INPUTS))."""
    circuit: Circuit


@dataclass(frozen=True)
class Course:
    """How a fault runs: its size over the flights, one row per pump, shape (n_pumps, n_flights).

    ``kind`` is a key of ``FAULTS``; sizes are in the fault's own unit.
    """

    kind: str
    size: Array


def _column(name: str) -> int:
    return INPUTS.index(name)


def viscosity_ratio(pump: PumpType, celsius: Array, batch: Array) -> Array:
    """Viscosity here over that of the data sheet at 50 degC."""
    fluid = pump.pump.fluid
    table = np.arange(-20.0, 141.0, 0.5)
    nu = np.array([kinematic_viscosity(fluid, t + KELVIN_AT_0_DEGC) for t in table])
    nu_50 = kinematic_viscosity(fluid, 50.0 + KELVIN_AT_0_DEGC)
    return np.asarray(np.interp(celsius, table, nu) / nu_50 * batch)


def drain_viscosity(pump: PumpType, circuit: Circuit, case_celsius: Array) -> Array:
    """Viscosity of the case's fluid over that of the reference bench, whose case is warmed as well."""
    fluid, drive = pump.pump.fluid, pump.pump.drive
    table = np.arange(-20.0, 181.0, 0.5)
    ratio = [drain_viscosity_ratio(drive, fluid, circuit.Q_ref, t + KELVIN_AT_0_DEGC) for t in table]
    return np.asarray(np.interp(case_celsius, table, ratio))


def fleet(
    reality: Reality,
    pump: PumpType,
    circuit: Circuit,
    rng: np.random.Generator,
    n_pumps: int,
    n_flights: int,
    courses: tuple[Course, ...] = (),
    *,
    worn: bool = False,
    moved_at: int | None = None,
    exchanged: bool = False,
) -> Flights:
    """Draw a fleet and fly it.

    Parameters
    ----------
    courses
        Faults beside each other; empty for healthy pumps.
    worn
        Pumps that arrive with a case flow at the reference above 2.2 L/min.
    moved_at
        Flight from which each pump sits in another aircraft; None: it stays where it is.
    exchanged
        The other aircraft is that of another pump of the fleet: the first half and the second change places. Faults of an
        aircraft stay with it only if ``courses`` says so.
    """
    shape = (n_pumps, n_flights)
    own = rng.normal

    def by_aircraft(draw: Callable[[], Array]) -> Array:
        return drawn_by_aircraft(draw, n_flights, moved_at, exchanged=exchanged)

    speed = pump.nominal_speed_rpm * (1.0 + by_aircraft(lambda: own(0.0, 0.005, (n_pumps, 1))) + own(0.0, 0.004, shape))
    day = np.arange(n_flights) / 300.0 + by_aircraft(lambda: rng.uniform(0.0, 1.0, (n_pumps, 1)))
    climate = by_aircraft(lambda: rng.uniform(45.0, 70.0, (n_pumps, 1)))
    season = by_aircraft(lambda: rng.uniform(4.0, 14.0, (n_pumps, 1))) * np.sin(2.0 * np.pi * day)
    # a window may come minutes after the start or after an hour of flight
    temperature = np.clip(climate + season + own(0.0, 10.0, shape), 20.0, 100.0)
    reservoir = np.clip(by_aircraft(lambda: rng.uniform(0.2, 2.0, (n_pumps, 1))) + own(0.0, 0.1, shape), 0.0, 2.5)
    batch = 1.0 + 0.04 * by_aircraft(lambda: _batches(rng, shape))
    thin = viscosity_ratio(pump, temperature, np.ones(shape)) * batch

    rows = np.tile(np.array([pump.nominal_speed_rpm, 50.0, 0.0, 0.0, 1.01325, *Health()]), (*shape, 1))
    rows[..., _column("speed_rpm")] = speed
    rows[..., _column("fluid_temperature_degc")] = temperature
    rows[..., _column("reservoir_pressure_bar")] = reservoir
    for part in ("slipper", "piston", "port_plate"):
        spread = np.exp(np.clip(own(0.0, 0.25, (n_pumps, 1)), -0.5, 0.2))  # within the acceptance limits
        rows[..., _column(f"{part}_leakage_scale")] = spread / batch ** (
            SLIPPER_VISCOSITY if part == "slipper" else 1.0
        )
    droop = np.exp(rng.uniform(np.log(0.01), np.log(0.3), (n_pumps, 1))) / DROOP_AT_NOMINAL
    rows[..., _column("droop_scale")] = droop
    setting = np.clip(own(0.0, 0.8, (n_pumps, 1)), -1.8, 1.8)
    softening = rng.uniform(-0.5, 0.5, (n_pumps, 1)) * _softening(pump, circuit) * (temperature - 50.0)
    rows[..., _column("pressure_setting_change_bar")] = setting + softening
    rows[..., _column("control_bleed_lpm")] = np.clip(own(0.02, 0.02, (n_pumps, 1)), 0.0, None)
    by_pass = by_aircraft(lambda: rng.uniform(0.3, 0.7, (n_pumps, 1))) * np.ones(shape)
    rows[..., _column("system_leakage_lpm")] = by_pass / (thin if reality.system_leak == "laminar" else 1.0)
    drain = by_aircraft(lambda: np.exp(own(0.0, 0.18, (n_pumps, 1))))
    if reality.drain == "viscous":
        exponent = by_aircraft(lambda: rng.uniform(0.0, 0.6, (n_pumps, 1)))
        rows[..., _column("drain_resistance_scale")] = drain
    else:
        pipe = by_aircraft(lambda: rng.uniform(0.2, 0.8, (n_pumps, 1)))
        # a nu Q + b Q^2 and nothing else: the weights of both parts are shares of what they add up to
        whole = pipe * batch + 1.0 - pipe
        rows[..., _column("drain_resistance_scale")] = drain * whole
        rows[..., _column("drain_viscosity_weight_change")] = pipe * batch / whole
        rows[..., _column("drain_flow_weight_change")] = (1.0 - pipe) / whole
    nominal = nominal_leakage(pump, circuit)
    if worn:
        needed = rng.uniform(2.25, 3.2, (n_pumps, 1)) - 0.5
        rows[..., _column("pump_leakage_scale")] = needed / sum(nominal.values())
    leakage, once = np.zeros(shape), np.abs(own(0.0, 0.03, (n_pumps, 1))) * np.ones(shape)
    for course in courses:
        added, line = apply(course, rows, nominal, thin, reality, rng)
        leakage, once = leakage + added, once + line
    if reality.drain == "viscous":
        # how warm the case is asks for what flows, and hardly for what the drain makes of it
        found = operating_points(pump.pump, rows.reshape(-1, len(INPUTS)), circuit)
        case = found.value("case_temperature_degc").reshape(shape)
        rows[..., _column("drain_resistance_scale")] *= (drain_viscosity(pump, circuit, case) * batch) ** exponent
    points = operating_points(pump.pump, rows.reshape(-1, len(INPUTS)), circuit)
    return Flights(
        speed,
        temperature,
        rows[..., _column("reservoir_pressure_bar")],
        points.value("discharge_pressure_bar").reshape(shape),
        points.value("case_pressure_bar").reshape(shape),
        case_flow_at_reference(rows, pump, circuit),
        leakage,
        once,
        *regulation(courses, (temperature - 50.0) / 30.0, rng.spawn(1)[0]),
        rows,
        circuit,
    )


def drawn_by_aircraft(
    draw: Callable[[], Array], n_flights: int, moved_at: int | None, *, exchanged: bool = False
) -> Array:
    """What belongs to the aircraft: drawn once, or once more for the flights from ``moved_at`` on.

    ``draw`` gives an array that broadcasts with (n_pumps, n_flights). Where pumps are ``exchanged`` the first half of
    them gets from then on what the second half had, and the other way round.
    """
    first = draw()
    if moved_at is not None and exchanged:
        return np.where(np.arange(n_flights) < moved_at, first, np.roll(first, len(first) // 2, axis=0))
    return first if moved_at is None else np.where(np.arange(n_flights) < moved_at, first, draw())


def _batches(rng: np.random.Generator, shape: tuple[int, int]) -> Array:
    """Standard-normal levels that change at random, once in 120 flights, shape ``shape``."""
    n, m = shape
    levels = np.clip(rng.normal(0.0, 1.0, (n, m)), -2.0, 2.0)
    change = rng.uniform(size=(n, m)) < 1.0 / 120.0
    change[:, 0] = True
    held = np.maximum.accumulate(np.where(change, np.arange(m), 0), axis=1)
    return np.take_along_axis(levels, held, axis=1)


def _softening(pump: PumpType, circuit: Circuit) -> float:
    """Fall of the regulated pressure per kelvin of the nominal pump [bar/K], positive."""
    row = np.array([pump.nominal_speed_rpm, 50.0, 0.0, 0.0, 1.01325, *Health()])
    point = operating_points(pump.pump, row, circuit, derivatives=True)
    return abs(float(point.derivative("discharge_pressure_bar", "fluid_temperature_degc")[0]))


def _reference_rows(rows: Array, pump: PumpType) -> Array:
    at = rows.copy()
    at[..., _column("speed_rpm")] = pump.nominal_speed_rpm
    at[..., _column("fluid_temperature_degc")] = pump.limits["reference_temperature_k"].value - KELVIN_AT_0_DEGC
    return at


def case_flow_at_reference(rows: Array, pump: PumpType, circuit: Circuit) -> Array:
    """True case flow at the reference condition of every row's health, shape of ``rows`` without its last axis."""
    at = _reference_rows(rows, pump)
    points = operating_points(pump.pump, at.reshape(-1, len(INPUTS)), circuit)
    return points.value("case_flow_lpm").reshape(rows.shape[:-1])


def nominal_leakage(pump: PumpType, circuit: Circuit) -> dict[str, float]:
    """Leakage of slippers, pistons and port plate of the nominal pump at the reference condition [L/min]."""
    row = _reference_rows(np.array([4600.0, 60.0, 0.0, 0.0, 1.01325, *Health()]), pump)
    points = operating_points(pump.pump, row, circuit)
    return {part: float(points.value(f"{part}_leakage_lpm")[0]) for part in ("slipper", "piston", "port_plate")}


def apply(
    course: Course,
    rows: Array,
    nominal: dict[str, float],
    thin: Array,
    reality: Reality,
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """Write a fault into the rows; what it adds to leakage [L/min at the reference] and to the once-per-turn line."""
    size = course.size
    none = np.zeros(size.shape)
    unequal = rng.uniform(0.6, 1.4, (len(size), 1))
    choked = rng.uniform(0.0, 0.25, (len(size), 1))

    def scale(part: str, added: Array) -> None:
        whole = rows[..., _column("pump_leakage_scale")] * nominal[part]
        rows[..., _column(f"{part}_leakage_scale")] += added / whole

    if course.kind == "slippers":
        scale("slipper", (1.0 - choked) * size)
        rows[..., _column("throttled_leakage_lpm")] += choked * size
        return size, none
    if course.kind == "three slippers":
        scale("slipper", (1.0 - choked) * size)
        rows[..., _column("throttled_leakage_lpm")] += choked * size
        return size, 0.8 * unequal * size
    if course.kind == "three pistons":
        scale("piston", size)
        return size, 1.0 * unequal * size
    if course.kind == "one slipper":
        scale("slipper", size)
        return size, 1.2 * unequal * size
    if course.kind == "port plate":
        scale("port_plate", size)
        return size, none
    if course.kind == "system":
        rows[..., _column("system_leakage_lpm")] += size / (thin if reality.system_leak == "laminar" else 1.0)
    elif course.kind == "drain":
        rows[..., _column("drain_resistance_scale")] *= 1.0 + size
    elif course.kind == "setting":
        rows[..., _column("pressure_setting_change_bar")] += size
    elif course.kind == "bleed":
        rows[..., _column("control_bleed_lpm")] += size
    elif course.kind == "erosion":
        rows[..., _column("edge_rounding_um")] += size
    elif course.kind == "erosion, closed-centre valve":
        rows[..., _column("pressure_setting_change_bar")] += ERODED_SETTING_BAR_PER_UM * size
    elif course.kind in {"sticking spool", "stuck spool"}:
        pass  # its swings are in the regulation; no mean moves
    elif course.kind == "reservoir":
        rows[..., _column("reservoir_pressure_bar")] += size
    else:
        raise ValueError(f"no fault called {course.kind!r}")
    return none, none
