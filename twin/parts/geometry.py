"""What a parameter set must keep to be a pump at all, and its fluid one: every fault by name, with its unit."""

import math

from twin.laws.fluid import Fluid, kinematic_viscosity
from twin.parameters import Pump
from twin.units import KELVIN_AT_0_DEGC

_UM, _MM = 1.0e6, 1.0e3
_COLDEST, _HOTTEST = KELVIN_AT_0_DEGC - 55.0, KELVIN_AT_0_DEGC + 150.0
"""Between these a fluid must be one [K]."""
MOST_FREE_AIR = 0.2
"""Free air by volume at ambient pressure beyond which nothing is a liquid with bubbles any more (estimate) [-]."""


def geometry_faults(pump: Pump) -> list[str]:
    """Faults of a parameter set in words, none for a pump that can be built.

    Blocks hold bare floats, so an engineer who replaces a number is told here what cannot be: crossed land diameters,
    gaps that are not positive, a stroke longer than the bore, a piston count that is not whole.
    """
    faults: list[str] = []
    for block_name, block in pump._asdict().items():
        faults += [
            f"{block_name}.{name} is not a finite number"
            for name, value in block._asdict().items()
            if not math.isfinite(value)
        ]
    if faults:
        return faults
    piston, slipper, plate, comp, servo = pump.piston, pump.slipper, pump.port_plate, pump.compensator, pump.servo
    if piston.n != int(piston.n) or not 5 <= piston.n <= 13:
        faults.append(f"piston.n = {piston.n:g} (allowed: 5 to 13, whole)")
    gaps = {
        "piston.b": piston.b,
        "slipper.h": slipper.h,
        "slipper.h_min": slipper.h_min,
        "port_plate.h": plate.h,
        "compensator.c_edge": comp.c_edge,
        "servo.b_stroke": servo.b_stroke,
        "servo.b_rate": servo.b_rate,
    }
    faults += [f"{name} = {gap * _UM:g} um (must be above 0)" for name, gap in gaps.items() if not gap > 0.0]
    if comp.c_spool < 0.0:
        faults.append(f"compensator.c_spool = {comp.c_spool * _UM:g} um (0 for a tight spool, or above)")
    lengths = {"piston.d_p": piston.d_p, "piston.R": piston.R, "piston.l_mean": piston.l_mean, "piston.m": piston.m}
    lengths |= {"slipper.d_throttle": slipper.d_throttle, "compensator.A_spool": comp.A_spool}
    lengths |= {f"volumes.{name}": value for name, value in pump.volumes._asdict().items()}
    faults += [f"{name} = {value:g} (SI; must be above 0)" for name, value in lengths.items() if not value > 0.0]
    for name, e_rel in (("piston.e_rel", piston.e_rel), ("compensator.e_rel", comp.e_rel)):
        if not 0.0 <= e_rel <= 1.0:
            faults.append(f"{name} = {e_rel:g} (0 centred to 1 touching)")
    if not slipper.diameter_ratio > 1.0:
        faults.append(
            f"slipper.diameter_ratio = {slipper.diameter_ratio:g} (the land's outer diameter must exceed its inner one)"
        )
    if not slipper.h_retainer > slipper.h_min:
        faults.append(
            f"slipper.h_retainer = {slipper.h_retainer * _UM:g} um (must exceed h_min = {slipper.h_min * _UM:g} um)"
        )
    swash = pump.swashplate
    if not -0.5 * math.pi < swash.alpha_min < swash.alpha_max < 0.5 * math.pi:
        faults.append(
            f"swashplate.alpha_min, alpha_max = {swash.alpha_min:g}, {swash.alpha_max:g} rad "
            "(must rise, within a quarter turn)"
        )
    else:
        half_stroke = piston.R * math.tan(max(swash.alpha_max, -swash.alpha_min))
        if half_stroke >= piston.l_mean:
            faults.append(
                f"piston.l_mean = {piston.l_mean * _MM:g} mm (half of the stroke is {half_stroke * _MM:.3g} mm: "
                "the piston would leave its bore)"
            )
    if not 0.0 < plate.phi_seal + plate.phi_ramp < 0.5 * math.pi:
        faults.append(
            f"port_plate.phi_seal + phi_ramp = {plate.phi_seal + plate.phi_ramp:g} rad (must leave an open kidney: below pi/2)"
        )
    if not comp.x_low < comp.x_high:
        faults.append(f"compensator.x_low, x_high = {comp.x_low * _MM:g}, {comp.x_high * _MM:g} mm (must rise)")
    return faults + fluid_faults(pump.fluid)


def fluid_faults(fluid: Fluid) -> list[str]:
    """Faults of a fluid's constants in words, none for a liquid that thins with warmth, compresses and weighs something."""
    faults: list[str] = []
    nu = kinematic_viscosity(fluid, KELVIN_AT_0_DEGC + 40.0) * 1.0e6 if 0.0 < fluid.astm_b < 10.0 else math.nan
    if not 1.0 <= nu <= 1000.0:
        faults.append(
            f"fluid.astm_a = {fluid.astm_a:g}, with astm_b = {fluid.astm_b:g} (must give 1 to 1000 cSt at 40 degC)"
        )
    linear = {
        "rho": (fluid.rho_ref, fluid.rho_slope, 500.0, 2000.0, "kg/m3"),
        "B": (fluid.B_ref, fluid.B_slope, 2.0e8, 3.0e10, "Pa"),
    }
    for name, (ref, slope, low, high, unit) in linear.items():
        ends = [ref + slope * (T - fluid.T_ref) for T in (_COLDEST, _HOTTEST)]
        if not all(low <= value <= high for value in ends):
            faults.append(
                f"fluid.{name}_ref = {ref:g} {unit}, with {name}_slope = {slope:g} (must stay within {low:g} and {high:g} "
                "from -55 to 150 degC)"
            )
    plain = {
        "B_pressure_gain": (fluid.B_pressure_gain, 0.0, 30.0),
        "alpha_p": (fluid.alpha_p, 0.0, 1.0e-7),
        "c_p": (fluid.c_p, 500.0, 5000.0),
        "air": (fluid.air, 0.0, MOST_FREE_AIR),
        "air_exponent": (fluid.air_exponent, 1.0, 1.67),
    }
    for name, (value, low, high) in plain.items():
        if not low <= value <= high:
            faults.append(f"fluid.{name} = {value:g} (SI; allowed: {low:g} to {high:g})")
    return faults
