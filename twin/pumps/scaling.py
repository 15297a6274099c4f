"""Another pump from a base by scaling: delivery, pressure, speed and pistons, with stated rules.

The pump is geometrically similar at the same tilt: ``length`` is the cube root of the ratio of swept volumes. Pistons share
the swept volume, clearances stay what machining leaves, forces follow pressure times area. Every number says its rule.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

from twin.condition import Condition
from twin.operating_point import operating_point, problem
from twin.operating_point.validity import geometric_delivery
from twin.parameters import PumpType, Quantity, Sensor
from twin.pumps import circuit_parameters
from twin.pumps.own_limits import limit_faults
from twin.pumps.written import ParameterFaultsError, document_of, pump_type_from
from twin.units import KELVIN_AT_0_DEGC

FLOWS_LPM, PRESSURES_BAR = (8.0, 60.0), (103.0, 210.0)
"""What helicopters fly, table 1-1."""
SPEEDS_RPM, PISTONS = (1500.0, 8000.0), (5, 13)
DELIVERED = 0.97
"""Delivery at full tilt over swept volume times speed: what compression and leakage leave (the base: 28.4 of 29.2)."""
_FULL_SCALES_BAR = (160.0, 250.0, 350.0, 400.0)
_REFERENCE_DEGC = 50.0


class Wanted(NamedTuple):
    """The pump on the drawing: delivery at full tilt [L/min], zero-flow pressure [bar], speed [rpm], pistons."""

    flow_lpm: float
    pressure_bar: float
    speed_rpm: float
    pistons: int


class Ratios(NamedTuple):
    """New over base: length, pressure, speed, number of pistons, swept volume, piston diameter."""

    length: float
    pressure: float
    speed: float
    pistons: float
    volume: float
    diameter: float


Rule = tuple[str, Callable[[Ratios], float]]
_LENGTH: Rule = ("length", lambda r: r.length)
_AREA: Rule = ("length^2", lambda r: r.length**2)
_VOLUME: Rule = ("swept volume", lambda r: r.volume)
_FORCE: Rule = ("pressure times length^2", lambda r: r.pressure * r.length**2)
_RATE: Rule = ("pressure times length", lambda r: r.pressure * r.length)
_TORQUE: Rule = ("pressure times swept volume", lambda r: r.pressure * r.volume)
_PISTON_VOLUME: Rule = ("swept volume per piston", lambda r: r.volume / r.pistons)

RULES: Mapping[str, Rule] = {
    "piston.d_p": ("length over the root of the number of pistons", lambda r: r.diameter),
    "piston.R": _LENGTH,
    "piston.l_mean": _LENGTH,
    "piston.V_dead": _PISTON_VOLUME,
    "piston.m": _PISTON_VOLUME,
    "slipper.V_pocket": _PISTON_VOLUME,
    "port_plate.A_port": ("piston area times piston speed", lambda r: r.diameter**2 * r.length * r.speed),
    "swashplate.J": ("length^5", lambda r: r.length**5),
    "swashplate.damping": ("length^3", lambda r: r.length**3),
    "swashplate.k_stop": _TORQUE,
    "swashplate.d_stop": ("length^3", lambda r: r.length**3),
    "compensator.k_spool": ("pressure: the same droop per share of the delivery", lambda r: r.pressure),
    "compensator.w_edge": ("length^2: the control volume is filled as fast", lambda r: r.length**2),
    "compensator.d_bleed": _LENGTH,
    "servo.A_stroke": _AREA,
    "servo.L_stroke": _LENGTH,
    "servo.l_stroke": _LENGTH,
    "servo.m_stroke": ("length^3", lambda r: r.length**3),
    "servo.A_rate": _AREA,
    "servo.L_rate": _LENGTH,
    "servo.l_rate": _LENGTH,
    "servo.m_rate": ("length^3", lambda r: r.length**3),
    "servo.F_rate": _FORCE,
    "servo.k_rate": _RATE,
    "volumes.discharge": _VOLUME,
    "volumes.case": _VOLUME,
    "volumes.return_line": _VOLUME,
    "volumes.control": _VOLUME,
    "drive.torque_viscous_ref": ("length^3 times speed", lambda r: r.length**3 * r.speed),
    "drive.torque_pressure": _VOLUME,
    "drive.film_conductance": ("length^2", lambda r: r.length**2),
    "drive.case_conductance": ("length^2", lambda r: r.length**2),
}
"""Numbers that scale, each by its rule; gaps, ratios, laws and the valve's spool stay as they are."""
_CASE_FLOWS = ("case_flow_lpm", "case_flow_low_lpm")
"""Limits that keep the base's margin over the healthy pump's case flow."""
_POPULATION_RULES: Mapping[str, Rule] = {
    "pressure_setting_bar": ("pressure", lambda r: r.pressure),
    "system_leakage_lpm": ("delivery", lambda r: r.volume * r.speed),
}


def scaled(base: PumpType, name: str, wanted: Wanted) -> PumpType:
    """A pump type of the wanted size from a base.

    Parameters
    ----------
    base
        What is scaled; numbers that no rule names are kept, with their sources.
    name
        Id of the new type.
    wanted
        Delivery, pressure, speed and number of pistons.

    Returns
    -------
    PumpType
        With limits, nominal speed, sensors and population spreads of its own; its preload is set so that it holds the
        wanted pressure at zero flow and 50 degC.

    Raises
    ------
    ParameterFaultsError
        naming every fault: outside the fleet's range, pistons that do not fit, a pump that does not regulate.
    """
    faults = _range_faults(wanted)
    if faults:
        raise ParameterFaultsError(faults)
    ratios = _ratios(base, wanted)
    room = 2.0 * math.pi * base.pump.piston.R * ratios.length
    taken = wanted.pistons * base.pump.piston.d_p * ratios.diameter
    if taken > 0.95 * room:
        words = f"{wanted.pistons} pistons take {1e3 * taken:.0f} mm of a pitch circle of {1e3 * room:.0f} mm"
        raise ParameterFaultsError([("pistons", words)])
    quantities = {path: _by_rule(q, RULES.get(path), ratios, base.name) for path, q in base.quantities.items()}
    quantities["piston.n"] = Quantity(wanted.pistons, "-", "asked for")
    kind = _framed(base, name, wanted, ratios, quantities)
    kind = _with_case_flows(_at_pressure(kind, wanted), base)
    faults = limit_faults(kind)
    if faults:
        raise ParameterFaultsError(faults)
    return kind


def _range_faults(wanted: Wanted) -> list[tuple[str, str]]:
    """What lies outside the fleet's range, and what is no number of pistons."""
    limits = {"flow": FLOWS_LPM, "pressure": PRESSURES_BAR, "speed": SPEEDS_RPM, "pistons": PISTONS}
    units = {"flow": "L/min, table 1-1", "pressure": "bar, table 1-1", "speed": "rpm", "pistons": "pistons"}
    return [
        (where, f"{value:g} is not between {limits[where][0]:g} and {limits[where][1]:g} {units[where]}")
        for where, value in zip(limits, wanted, strict=True)
        if not limits[where][0] <= value <= limits[where][1]
    ]


def _ratios(base: PumpType, wanted: Wanted) -> Ratios:
    swept = geometric_delivery(base.pump, 1.0)
    volume = wanted.flow_lpm / DELIVERED / wanted.speed_rpm / swept
    limits = base.limits
    setting = 0.5 * (limits["zero_flow_pressure_low_bar"].value + limits["zero_flow_pressure_high_bar"].value)
    pistons = wanted.pistons / base.pump.piston.n
    length = volume ** (1.0 / 3.0)
    return Ratios(
        length,
        wanted.pressure_bar / setting,
        wanted.speed_rpm / base.nominal_speed_rpm,
        pistons,
        volume,
        length / math.sqrt(pistons),
    )


def _by_rule(quantity: Quantity, rule: Rule | None, ratios: Ratios, base: str) -> Quantity:
    if rule is None:
        return replace(quantity, source=f"{base}, kept: {quantity.source}"[:500])
    words, factor = rule
    spread = max(quantity.uncertainty or 0.0, 0.3)
    return Quantity(quantity.value * factor(ratios), quantity.unit, f"scaled from {base} with {words}", spread)


def _framed(base: PumpType, name: str, wanted: Wanted, ratios: Ratios, quantities: Mapping[str, Quantity]) -> PumpType:
    setting = wanted.pressure_bar
    half = 2.0 * ratios.pressure
    limits = {n: _by_rule(q, None, ratios, base.name) for n, q in base.limits.items()}
    words = "asked for, give or take the base's tolerance in proportion"
    limits["zero_flow_pressure_low_bar"] = Quantity(setting - half, "bar", words)
    limits["zero_flow_pressure_high_bar"] = Quantity(setting + half, "bar", words)
    population = {n: _by_rule(q, _POPULATION_RULES.get(n), ratios, base.name) for n, q in base.population.items()}
    full_scale = next(scale for scale in _FULL_SCALES_BAR if scale >= 1.5 * setting)
    sensors = dict(base.sensors)
    known = sensors["discharge_pressure_bar"]
    sensors["discharge_pressure_bar"] = Sensor(full_scale, known.accuracy_fs, known.repeatability_fs)
    document = document_of(
        replace(
            base,
            name=name,
            title=f"{wanted.flow_lpm:g} L/min at {setting:g} bar and {wanted.speed_rpm:g} rpm, scaled from {base.name}",
            nominal_speed_rpm=wanted.speed_rpm,
            sensors=sensors,
            quantities=_preloaded(quantities, setting),
            limits=limits,
            population=population,
        )
    )
    return pump_type_from(document)


def _with_case_flows(kind: PumpType, base: PumpType) -> PumpType:
    """The same with limits of the case flow that stand to the healthy pump's as the base's do to the base's."""
    ratio = _healthy_case_flow(kind) / _healthy_case_flow(base)
    words = f"the margin of {base.name} over the healthy pump's case flow at the reference temperature"
    limits = {n: Quantity(base.limits[n].value * ratio, "L/min", words) for n in _CASE_FLOWS}
    return replace(kind, limits={**kind.limits, **limits})


def _healthy_case_flow(kind: PumpType) -> float:
    temperature = kind.limits["reference_temperature_k"].value - KELVIN_AT_0_DEGC
    condition = Condition(kind.nominal_speed_rpm, temperature, kind.nominal_reservoir_pressure_bar)
    point = operating_point(kind.pump, condition, circuit_parameters("shared_return"))
    return float(point.value("case_flow_lpm")[0])


def _preloaded(quantities: Mapping[str, Quantity], pressure_bar: float) -> dict[str, Quantity]:
    """The quantities with a preload of pressure times the spool's area [mm2]: a tenth of a newton per bar and mm2."""
    source = "set for the wanted pressure at zero flow and 50 degC"
    force = 0.1 * quantities["compensator.A_spool"].value * pressure_bar
    return {**quantities, "compensator.F_preload": Quantity(force, "N", source, 0.005)}


def _at_pressure(kind: PumpType, wanted: Wanted) -> PumpType:
    """The same with a preload that holds the wanted pressure: the pressure follows it nearly in proportion."""
    for _ in range(4):
        condition = Condition(kind.nominal_speed_rpm, _REFERENCE_DEGC, kind.nominal_reservoir_pressure_bar)
        point = operating_point(kind.pump, condition, circuit_parameters("shared_return"))
        fault = problem(point, 0)
        if fault is not None:
            raise ParameterFaultsError([("pump", f"at {wanted.speed_rpm:g} rpm, 50 degC and zero flow: {fault}")])
        missing = wanted.pressure_bar - float(point.value("discharge_pressure_bar")[0])
        document = document_of(kind)
        preload = document["quantities"]["compensator.F_preload"]
        preload["value"] += 0.1 * kind.quantities["compensator.A_spool"].value * missing
        kind = pump_type_from(document)
    return kind
