"""Slippers whose gap follows from the forces, as a revolution sees them: a metamodel fitted to the transient pump.

Sections 2.6.3 and 3.4 end with it. A Gaussian process with a Matern kernel (nu = 5/2) over tilt, speed, pressures,
temperature and wear, and over two forces that decide whether a slipper lifts. It answers with what the slippers add to a
pump without any: flows, torque on the plate and on the shaft, and the mean gap.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled
from twin.laws.fluid import P_ATMOSPHERE, Fluid, dynamic_viscosity
from twin.laws.friction import gap_drag
from twin.parameters import Pump
from twin.parts.piston import piston_area
from twin.parts.slipper import land_area, outer_area
from twin.units import (
    KELVIN_AT_0_DEGC,
    M3_PER_S_PER_LPM,
    PA_PER_BAR,
    RAD_PER_DEG,
    RAD_PER_S_PER_RPM,
)

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

AXES: tuple[str, ...] = (
    "swashplate_angle_deg",
    "shaft_speed_rpm",
    "discharge_over_case_bar",
    "case_over_suction_bar",
    "suction_pressure_bar",
    "fluid_temperature_degc",
    "ln_slipper_leakage_scale",
)
"""What a metamodel is asked at; the suction pressure is gauge."""
TILT, SPEED, OVER_CASE, OVER_SUCTION, SUCTION, TEMPERATURE, WEAR = range(len(AXES))
N_AXES = len(AXES)
LIFT, MARGIN = N_AXES, N_AXES + 1
N_FEATURES = N_AXES + 2
"""The axes (viscosity's logarithm in place of temperature), then the force that lifts a slipper off the plate while its
chamber fills and the force that lifts it while its chamber empties [N]."""
ANSWERS: tuple[str, ...] = (
    "from_discharge_lpm",
    "from_suction_lpm",
    "plate_torque_nm",
    "shaft_torque_nm",
    "mean_gap_um",
)
"""What the slippers add: flow out of the discharge and out of the suction side, torque that tilts the plate up, torque on
the shaft; and their gap, the mean over a revolution and all of them. Both flows together leak into the case."""
FROM_DISCHARGE, FROM_SUCTION, PLATE_TORQUE, SHAFT_TORQUE, MEAN_GAP = range(len(ANSWERS))
_ROOT_5 = math.sqrt(5.0)
_SMALL_DROP_BAR = 0.03


class SlipperMap(NamedTuple):
    """A metamodel, as a kernel takes it; without nodes it is none, and the gap is the set's constant one.

    Attributes
    ----------
    nodes
        Scaled features of the runs that it was fitted to, shape (m, N_FEATURES).
    weights
        Of each node in each answer, shape (m, len(ANSWERS)): in the answer's unit, that of ``from_suction_lpm`` over
        ``throttle_capacity`` [-].
    centre, per_length
        A feature is scaled as ``(feature - centre) * per_length``, shapes (N_FEATURES,).
    mean
        Answers far from every node, shape (len(ANSWERS),).
    low, high
        Range of the axes that was fitted, shapes (N_AXES,); outside, the edge's value is taken.
    """

    nodes: Matrix
    weights: Matrix
    centre: Vector
    per_length: Vector
    mean: Vector
    low: Vector
    high: Vector


NO_MAP = SlipperMap(
    np.empty((0, N_FEATURES)),
    np.empty((0, len(ANSWERS))),
    np.zeros(N_FEATURES),
    np.ones(N_FEATURES),
    np.zeros(len(ANSWERS)),
    np.zeros(N_AXES),
    np.zeros(N_AXES),
)
"""No metamodel."""


class Slippers(NamedTuple):
    """What all slippers add to a pump without any, means of a revolution: flows out of discharge and suction side [m3/s],
    torque on the plate and on the shaft [N m], gap [m]; ``mapped`` is 1 where a metamodel says so, else 0.
    """

    from_discharge: float
    from_suction: float
    plate_torque: float
    shaft_torque: float
    gap: float
    mapped: float


NO_SLIPPERS = Slippers(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""Slippers of a constant gap: their leakage is the operating point's own."""


@compiled
def write_features(pump: Pump, axes: Vector, P_amb: float, out: Vector) -> None:
    """Features of a point of the axes (N_AXES,) at an ambient pressure [Pa] into ``out`` (N_FEATURES,)."""
    piston, slipper, fluid = pump.piston, pump.slipper, pump.fluid
    alpha = axes[TILT] * RAD_PER_DEG
    t, omega = math.tan(alpha), axes[SPEED] * RAD_PER_S_PER_RPM
    mu = _ambient_viscosity(fluid, axes[TEMPERATURE] + KELVIN_AT_0_DEGC)
    P_s = axes[SUCTION] * PA_PER_BAR + P_amb
    P_c = P_s + axes[OVER_SUCTION] * PA_PER_BAR
    A, S = piston_area(piston), land_area(piston, slipper)
    # what the case's pressure does on the part of the slipper's back that no pocket answers (repaired: none)
    back = (1.0 - slipper.pumped_repair) * (outer_area(piston, slipper) - S) * (P_c - P_amb)
    along = A / math.cos(alpha) - S
    thrown = piston.m * piston.R * t * omega * omega
    drag = slipper.damping + gap_drag(mu, piston.d_p, piston.b, piston.e_rel, piston.l_mean)
    dragged = drag * piston.R * t * omega
    for j in range(N_AXES):
        out[j] = axes[j]
    out[TEMPERATURE] = math.log(mu)
    out[LIFT] = math.copysign(math.hypot(thrown, dragged), t) + along * (P_c - P_s) - back
    out[MARGIN] = -along * axes[OVER_CASE] * PA_PER_BAR - back


@compiled
def throttle_capacity(pump: Pump, over_suction: float) -> float:
    """What half of the slippers' throttles let pass by case over suction pressure [bar], never 0 [L/min].

    The flow that slippers let back from the case is a share of it, which the metamodel holds instead of the flow.
    """
    slipper = pump.slipper
    area = slipper.C_q * 0.25 * math.pi * slipper.d_throttle**2
    drop = math.sqrt(over_suction * over_suction + _SMALL_DROP_BAR * _SMALL_DROP_BAR) * PA_PER_BAR
    return 0.5 * pump.piston.n * area * math.sqrt(2.0 * drop / pump.fluid.rho_ref) / M3_PER_S_PER_LPM


@compiled
def _ambient_viscosity(fluid: Fluid, T: float) -> float:
    return dynamic_viscosity(fluid, T, P_ATMOSPHERE)


@compiled
def mapped(pump: Pump, model: SlipperMap, axes: Vector, P_amb: float) -> Slippers:
    """Answers of a metamodel at a point of the axes (N_AXES,), which is moved into the fitted range."""
    x = np.empty(N_FEATURES)
    for j in range(N_AXES):
        axes[j] = min(max(axes[j], model.low[j]), model.high[j])
    write_features(pump, axes, P_amb, x)
    for j in range(N_FEATURES):
        x[j] = (x[j] - model.centre[j]) * model.per_length[j]
    a_0, a_1, a_2, a_3, a_4 = model.mean[0], model.mean[1], model.mean[2], model.mean[3], model.mean[4]
    nodes, weights = model.nodes, model.weights
    for i in range(nodes.shape[0]):
        square = 0.0
        for j in range(N_FEATURES):
            d = x[j] - nodes[i, j]
            square += d * d
        r = _ROOT_5 * math.sqrt(square)
        k = (1.0 + r + r * r / 3.0) * math.exp(-r)
        a_0 += k * weights[i, 0]
        a_1 += k * weights[i, 1]
        a_2 += k * weights[i, 2]
        a_3 += k * weights[i, 3]
        a_4 += k * weights[i, 4]
    a_1 *= throttle_capacity(pump, axes[OVER_SUCTION])
    return Slippers(a_0 * M3_PER_S_PER_LPM, a_1 * M3_PER_S_PER_LPM, a_2, a_3, a_4 * 1.0e-6, 1.0)
