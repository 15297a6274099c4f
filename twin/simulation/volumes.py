"""Volumes that chambers share: fluid that they hold at the start of a step, and their pressures from it at its end."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.compiled import inlined
from twin.laws.compressibility import density_and_slope, pressure_of
from twin.parameters import Pump
from twin.simulation.layout import P_C, P_CTRL, P_D, P_I
from twin.simulation.scene import Scene

Vector = NDArray[np.float64]


class Held(NamedTuple):
    """Fluid of discharge, case, return and control volume [m3 at ambient density] and their capacities [m3/Pa]."""

    fluid_d: float
    fluid_c: float
    fluid_i: float
    fluid_x: float
    capacity_d: float
    capacity_c: float
    capacity_i: float
    capacity_x: float


@inlined
def held_fluid(pump: Pump, scene: Scene, y: Vector) -> Held:
    """What the shared volumes hold at the pressures of ``y``."""
    volumes, m = pump.volumes, scene.medium
    w_d, k_d = density_and_slope(m, y[P_D])
    w_c, k_c = density_and_slope(m, y[P_C])
    w_i, k_i = density_and_slope(m, y[P_I])
    w_x, k_x = density_and_slope(m, y[P_CTRL])
    return Held(
        w_d * volumes.discharge, w_c * volumes.case, w_i * volumes.return_line, w_x * volumes.control,
        k_d * volumes.discharge, k_c * volumes.case, k_i * volumes.return_line, k_x * volumes.control,
    )  # fmt: skip


@inlined
def set_pressures(pump: Pump, scene: Scene, held: Vector, y: Vector) -> None:
    """Pressures of the shared volumes by the fluid that they hold, (>= N_VOLUMES,), into ``y``, which holds guesses."""
    volumes, m = pump.volumes, scene.medium
    y[P_D] = pressure_of(m, held[P_D], volumes.discharge, y[P_D])
    y[P_C] = pressure_of(m, held[P_C], volumes.case, y[P_C])
    y[P_I] = pressure_of(m, held[P_I], volumes.return_line, y[P_I])
    y[P_CTRL] = pressure_of(m, held[P_CTRL], volumes.control, y[P_CTRL])
