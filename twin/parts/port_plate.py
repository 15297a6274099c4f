"""Port plate: how far a chamber is open to the discharge and to the suction kidney as the shaft turns."""

import math

from twin.compiled import compiled
from twin.parameters import PortPlate
from twin.parts.swashplate import Vibration, vibration_rate


@compiled
def _smooth_step(s: float) -> float:
    if s <= 0.0:
        return 0.0
    if s >= 1.0:
        return 1.0
    return s * s * (3.0 - 2.0 * s)


_CLOSED, _FILLING = 3, 6
"""Substeps of a commutation while both ports are shut, and while the next one opens."""


@compiled
def commutation_angle(
    plate: PortPlate,
    needed: float,
    swing: float,
    leak: float,
    leak_start: float,
    arm: float,
    shaking: Vibration,
    v_0: float,
    omega: float,
) -> float:
    """Angle past dead centre at which the pressure of a chamber changes over, in the mean [rad].

    The share s of the change that is done follows from the chamber's balance over angle,
    ``needed omega ds/dphi = swing omega sin(phi) + leak (leak_start - s) - arm w(phi) + C_q A(phi) v_0 sqrt(1 - s)``:
    piston's motion, leakage, plate's motion, port; the angle is the centroid of ds.

    Parameters
    ----------
    plate
        Closed from ``phi_commutation - phi_seal`` on, the next port opening ``2 phi_seal`` later.
    needed
        Fluid that the whole change asks for [m3].
    swing
        Half of the stroke's volume [m3].
    leak, leak_start
        Leakage at the full pressure difference [m3/s], and 0 for a chamber being filled, 1 for one being emptied.
    arm, shaking
        Volume per tilt of a chamber at dead centre [m3/rad], and the plate's vibration that moves it.
    v_0
        Speed of a jet under the full pressure difference [m/s].
    """
    first, last = plate.phi_commutation - plate.phi_seal, plate.phi_commutation + plate.phi_seal
    per = 1.0 / (needed * omega)
    # a first guess of the centroid and of the angle that filling takes, from the port alone
    filling = 2.0 * needed * plate.phi_ramp**2 * omega / (plate.C_q * plate.A_port * v_0)
    span = min(1.2 * math.pow(filling, 1.0 / 3.0), 0.6 * plate.phi_ramp)
    centre = last + 0.4 * span
    for _ in range(2):
        s = centroid = 0.0
        d = 2.0 * plate.phi_seal / _CLOSED
        phi = first + 0.5 * d
        c, sn = math.cos(shaking.teeth * (phi - centre)), math.sin(shaking.teeth * (phi - centre))
        turn_c, turn_s = math.cos(shaking.teeth * d), math.sin(shaking.teeth * d)
        for _closed in range(_CLOSED):
            flow = swing * omega * math.sin(phi) + leak * (leak_start - s) - arm * vibration_rate(shaking, c, sn)
            c, sn = c * turn_c - sn * turn_s, sn * turn_c + c * turn_s
            ds = min(max(flow * per * d, -s), 0.98 - s)
            s += ds
            centroid += ds * phi
            phi += d
        d = span / _FILLING
        phi = last + 0.5 * d
        c, sn = math.cos(shaking.teeth * (phi - centre)), math.sin(shaking.teeth * (phi - centre))
        turn_c, turn_s = math.cos(shaking.teeth * d), math.sin(shaking.teeth * d)
        for _filling in range(_FILLING):
            u = (phi - last) / plate.phi_ramp
            port = plate.C_q * plate.A_port * u * u * (3.0 - 2.0 * u) * v_0
            flow = swing * omega * math.sin(phi) + leak * (leak_start - s) - arm * vibration_rate(shaking, c, sn)
            c, sn = c * turn_c - sn * turn_s, sn * turn_c + c * turn_s
            # the port alone lets the root of what is left fall linearly
            root = max(math.sqrt(max(1.0 - s, 0.0)) - 0.5 * port * per * d, 0.0)
            ds = min(1.0 - root * root + flow * per * d, 1.0) - s
            s += ds
            centroid += ds * phi
            phi += d
        # what is left after the span
        centre = centroid + (1.0 - s) * phi
    return centre


@compiled
def opening(plate: PortPlate, phi: float) -> float:
    """Open area towards a kidney that a chamber passes between 0 and pi [m2].

    ``phi`` is the chamber's angle past the dead centre at which the kidney begins [rad, any]; the area is
    periodic, continuous in value and slope, and 0 on the sealing lands.
    """
    delayed = (phi - plate.phi_commutation) % (2.0 * math.pi)
    return window(plate, delayed) if delayed < math.pi else 0.0


@compiled
def window(plate: PortPlate, delayed: float) -> float:
    """Open area at an angle between 0 and pi past the delayed dead centre [m2]."""
    rising = _smooth_step((delayed - plate.phi_seal) / plate.phi_ramp)
    falling = _smooth_step((math.pi - plate.phi_seal - delayed) / plate.phi_ramp)
    return plate.A_port * min(rising, falling)
