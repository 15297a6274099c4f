"""Port plate: how far a chamber is open to the discharge and to the suction kidney as the shaft turns."""

import math

from twin.compiled import compiled
from twin.parameters import PortPlate


@compiled
def _smooth_step(s: float) -> float:
    if s <= 0.0:
        return 0.0
    if s >= 1.0:
        return 1.0
    return s * s * (3.0 - 2.0 * s)


@compiled
def commutation_angle(
    plate: PortPlate, V: float, V_swing: float, Q: float, dP: float, B: float, rho: float, omega: float
) -> float:
    """Angle past dead centre at which the pressure of a chamber of volume V changes over, in the mean [rad].

    The chamber is closed from ``phi_commutation - phi_seal`` on. Until its next port opens, ``2 phi_seal`` later, the
    piston's motion (``V_swing (cos phi_0 - cos phi)``, the swing being half of the stroke's volume) and the flow
    ``Q`` (leakage, the plate's own motion) already bring a share f of the change ``V dP / B``. The port's area then grows as
    ``3 A (phi / phi_ramp)^2``, less its cubic part, and the rest is over at ``phi_end^3 (1 - phi_end / 2 phi_ramp) =
    2 (1 - f) V dP / B phi_ramp^2 omega / (C_q A v_0)``; with p = 1 - (1 - u^3)^2 on the way the centroid of that part
    lies at ``1 - 2/4 + 1/7`` = 9/14 of phi_end.
    """
    first, last = plate.phi_commutation - plate.phi_seal, plate.phi_commutation + plate.phi_seal
    needed = V * max(dP, 1.0) / B
    closed = last - first
    moved = V_swing * (math.cos(first) - math.cos(last))
    share = min(max((moved + Q * closed / omega) / needed, 0.0), 0.95)
    spent = V_swing * (math.cos(first) * closed - math.sin(last) + math.sin(first))
    before = min(max((spent + 0.5 * Q * closed * closed / omega) / needed, 0.0), 0.95 * closed)
    v_0 = math.sqrt(2.0 * max(dP, 1.0) * (1.0 - share) / rho)
    filling = 2.0 * (1.0 - share) * needed * plate.phi_ramp**2 * omega / (plate.C_q * plate.A_port * v_0)
    phi_end = math.pow(filling, 1.0 / 3.0)
    phi_end = math.pow(filling / (1.0 - min(0.5 * phi_end / plate.phi_ramp, 0.5)), 1.0 / 3.0)
    return last - before + (1.0 - share) * 9.0 / 14.0 * phi_end


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
