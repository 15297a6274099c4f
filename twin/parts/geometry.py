"""What a parameter set must keep to be a pump at all: every fault by name, with its unit."""

import math

from twin.parameters import Pump

_UM, _MM = 1.0e6, 1.0e3


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
    return faults
