"""Port plate: how far a chamber is open to the discharge and to the suction kidney as the shaft turns."""

import math

from twin.compiled import compiled
from twin.parameters import PortPlate


@compiled
def opened_share(delayed: float, seal: float, per_ramp: float) -> float:
    """Open share of a port at an angle between 0 and pi past the delayed dead centre [-], without a branch."""
    s = min(delayed, math.pi - delayed) - seal
    s = min(max(s * per_ramp, 0.0), 1.0)
    return s * s * (3.0 - 2.0 * s)


@compiled
def opening(plate: PortPlate, phi: float) -> float:
    """Open area towards a kidney that a chamber passes between 0 and pi [m2].

    ``phi`` is the chamber's angle past the dead centre at which the kidney begins [rad, any]; the area is
    periodic, continuous in value and slope, and 0 on the sealing lands.

    Not called by the pump yet: its chambers keep their angle and ask for ``window``.
    """
    delayed = (phi - plate.phi_commutation) % (2.0 * math.pi)
    return window(plate, delayed) if delayed < math.pi else 0.0


@compiled
def window(plate: PortPlate, delayed: float) -> float:
    """Open area at an angle between 0 and pi past the delayed dead centre [m2]."""
    return plate.A_port * opened_share(delayed, plate.phi_seal, 1.0 / plate.phi_ramp)
