"""Slippers of a variable gap by their metamodel, in place of pockets, gaps and microseconds: what they add to a run.

The metamodel answers with means of a revolution (``twin.parts.slipper_map``). It is asked once per passing piston, at the
means since the piston before; in between its flows follow the pressures as conductances do, so that a step stays stable.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin import columns as at
from twin.compiled import compiled, inlined
from twin.parameters import Pump
from twin.parts.slipper_map import (
    N_AXES,
    N_FEATURES,
    NO_MAP,
    OVER_CASE,
    OVER_SUCTION,
    SPEED,
    SUCTION,
    TEMPERATURE,
    TILT,
    WEAR,
    SlipperMap,
    mapped,
    write_features,
)
from twin.simulation.layout import ALPHA, OMEGA, P_C, P_D, TILT_RATE
from twin.slipper_maps import stored_map
from twin.units import PA_PER_BAR, RAD_PER_DEG, RAD_PER_S_PER_RPM

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

G_DISCHARGE, G_SUCTION, Q_FROM_SUCTION, PLATE, SHAFT = range(5)
N_ADDED = 5
"""What slippers add to a step: conductances from discharge and from suction into the case [m3/s/Pa], flow from suction
[m3/s], torque that tilts the plate up, torque on the shaft [N m]."""

TURNED, SPENT, TILT_SUM, DISCHARGE_SUM, CASE_SUM, OUTSIDE, FIRST_OUTSIDE = range(7)
N_GATHERED = 7
"""Since the metamodel was asked: angle [rad] and time [s], integrals of tilt and pressures; then how long a run was outside
of the metamodel's domain [s], and when first (infinity: never)."""
_SMALL_DROP = 3.0e3
"""Difference of case and suction pressure below which a flow between them counts as constant [Pa]."""
_ROUNDING = 1.0e-9
_SHUT = 1.0e-12
"""A gap that lets nothing pass [m]."""


class Gaps(NamedTuple):
    """A metamodel with the distance from its runs as far as which its stated errors hold [-]."""

    model: SlipperMap
    reach: float


NO_GAPS = Gaps(NO_MAP, 0.0)
"""No metamodel."""


def metamodel_faults(pump: Pump) -> list[str]:
    """Why no metamodel can stand for the slippers of a pump, in words; none where one can."""
    if pump.slipper.variable < 0.5:
        return ["slipper_gaps = 'metamodel': the gaps of this set are constant (slipper.variable is 0)"]
    if stored_map(pump) is None:
        return [
            "slipper_gaps = 'metamodel': none was fitted to the numbers of this set; casedrain pump gaps fits one, or "
            "resolve the gaps"
        ]
    return []


def by_metamodel(pump: Pump) -> tuple[Pump, Gaps]:
    """A pump whose slippers leak nothing, and the metamodel that says what they add.

    Raises
    ------
    ValueError
        naming what ``metamodel_faults`` finds.
    """
    stored = stored_map(pump)
    if stored is None:
        raise ValueError("; ".join(metamodel_faults(pump)))
    return pump._replace(slipper=pump.slipper._replace(variable=0.0, h=_SHUT)), Gaps(stored.model, stored.reach)


@inlined
def assemble(added: Vector, P_s: float, A: Matrix, b: Vector) -> None:
    """Put what slippers add, (N_ADDED,), into the shared system (6, 6), (6,)."""
    G_d, G_s = added[G_DISCHARGE], added[G_SUCTION]
    A[P_D, P_D] += G_d
    A[P_D, P_C] -= G_d
    A[P_C, P_D] -= G_d
    A[P_C, P_C] += G_d + G_s
    b[P_C] += G_s * P_s + added[Q_FROM_SUCTION]
    b[TILT_RATE] += added[PLATE]


@inlined
def flows(added: Vector, P_d: float, P_c: float, P_s: float) -> tuple[float, float]:
    """Flows of the slippers from discharge and from suction into the case [m3/s]."""
    return added[G_DISCHARGE] * (P_d - P_c), added[G_SUCTION] * (P_s - P_c) + added[Q_FROM_SUCTION]


@compiled
def is_near(pump: Pump, gaps: Gaps, axes: Vector, P_amb: float) -> bool:
    """Whether a point of the axes (N_AXES,) lies among the runs, as ``twin.slipper_maps.is_inside`` says it."""
    model = gaps.model
    for j in range(N_AXES):
        if not model.low[j] - _ROUNDING <= axes[j] <= model.high[j] + _ROUNDING:
            return False
    x = np.empty(N_FEATURES)
    write_features(pump, axes, P_amb, x)
    nodes = model.nodes
    nearest = math.inf
    for i in range(nodes.shape[0]):
        square = 0.0
        for j in range(N_FEATURES):
            d = (x[j] - model.centre[j]) * model.per_length[j] - nodes[i, j]
            square += d * d
        nearest = min(nearest, square)
    return math.sqrt(nearest) <= gaps.reach


@compiled
def ask(
    pump: Pump, gaps: Gaps, row: Vector, clearances: Vector, omega: float, gathered: Vector, time: float, added: Vector
) -> None:
    """Ask the metamodel at the means that were gathered, and begin to gather anew.

    Parameters
    ----------
    row
        Inputs of the instant in the order of ``SCENE_INPUTS``.
    clearances
        Factors on the gap of each slipper, (n,): uneven ones count by the mean of their cubes.
    gathered
        Shape (N_GATHERED,); ``time`` [s] is when it is asked.
    added
        Shape (N_ADDED,), overwritten.
    """
    spent = gathered[SPENT]
    alpha, P_d, P_c = gathered[TILT_SUM] / spent, gathered[DISCHARGE_SUM] / spent, gathered[CASE_SUM] / spent
    P_amb = row[at.AMBIENT] * PA_PER_BAR
    P_s = row[at.RESERVOIR] * PA_PER_BAR + P_amb
    wear = 0.0
    for h in clearances:
        wear += h * h * h / len(clearances)
    model = gaps.model
    axes = np.empty(N_AXES)
    # the stop's own torque begins at the top, so that no run stands exactly there
    stopped = alpha > pump.swashplate.alpha_max - 1.0e-4
    axes[TILT] = min(alpha / RAD_PER_DEG, model.high[TILT]) if stopped else alpha / RAD_PER_DEG
    axes[SPEED], axes[TEMPERATURE], axes[SUCTION] = omega / RAD_PER_S_PER_RPM, row[at.TEMPERATURE], row[at.RESERVOIR]
    axes[OVER_CASE], axes[OVER_SUCTION] = (P_d - P_c) / PA_PER_BAR, (P_c - P_s) / PA_PER_BAR
    axes[WEAR] = math.log(max(row[at.PUMP_SCALE] * row[at.SLIPPER_SCALE] * wear, 1.0e-30))
    if not is_near(pump, gaps, axes, P_amb):
        gathered[OUTSIDE] += spent
        gathered[FIRST_OUTSIDE] = min(gathered[FIRST_OUTSIDE], max(time - spent, 0.0))
    s = mapped(pump, model, axes, P_amb)
    added[PLATE], added[SHAFT] = s.plate_torque, s.shaft_torque
    added[G_DISCHARGE] = s.from_discharge / max(P_d - P_c, _SMALL_DROP)
    down = P_s - P_c
    # a flow along its pressure difference follows it, one against it is pumped
    follows = abs(down) > _SMALL_DROP and s.from_suction * down > 0.0
    added[G_SUCTION] = s.from_suction / down if follows else 0.0
    added[Q_FROM_SUCTION] = 0.0 if follows else s.from_suction
    for j in range(OUTSIDE):
        gathered[j] = 0.0


@inlined
def gather(y: Vector, step: float, gathered: Vector) -> None:
    """Add a step [s] that ended in the state ``y``."""
    gathered[TURNED] += y[OMEGA] * step
    gathered[SPENT] += step
    gathered[TILT_SUM] += y[ALPHA] * step
    gathered[DISCHARGE_SUM] += y[P_D] * step
    gathered[CASE_SUM] += y[P_C] * step
