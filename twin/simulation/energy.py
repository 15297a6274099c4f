"""Where the shaft's power goes: hydraulic power at the ports and named losses, from the states of a run.

Flows count volume at ambient density, so the power that a flow carries is the elastic head of its pressure; each
passage turns the difference of the heads at its ends into heat. Constant slipper gaps and no air only.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled
from twin.laws.compressibility import P_FLOOR, elastic_head
from twin.parameters import Circuit, Pump
from twin.parts.drive import friction_torque
from twin.simulation import chambers
from twin.simulation.layout import (
    ALPHA_DOT,
    DRAG,
    G_D,
    G_LAND,
    G_RING,
    G_S,
    N_COLUMNS,
    N_SHARED,
    OMEGA,
    P_C,
    P_CTRL,
    P_D,
    P_I,
    ROTATION,
    V_SPOOL,
)
from twin.simulation.scene import N_SCENE, Scene, scene_of
from twin.simulation.step import passages, pose_of

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

POWERS: tuple[str, ...] = (
    "shaft",
    "discharge",
    "drain",
    "ports",
    "slippers",
    "pistons",
    "port_plate",
    "compensator",
    "system_leakage",
    "damping",
    "friction",
)
SHAFT, DISCHARGE, DRAIN, PORTS, SLIPPERS, PISTONS, PORT_PLATE, COMPENSATOR, SYSTEM, DAMPING, FRICTION = range(
    len(POWERS)
)
"""Powers of a balance [W]: the shaft's input, what leaves with the load and the drain, then the losses by name."""


@compiled
def _powers(
    pump: Pump, circuit: Circuit, scene: Scene, y: Vector, n: int, gaps: Matrix, ch: Matrix, out: Vector
) -> None:
    """Add the powers of one state to ``out``, shape (len(POWERS),)."""
    s = passages(pump, circuit, scene, y, pose_of(y), n, gaps, ch)
    chambers.ports(pump, scene, y, n, ch)
    m, P_s = scene.medium, scene.P_s
    P_d, P_c, P_i, P_x, w, v = y[P_D], y[P_C], y[P_I], max(y[P_CTRL], P_FLOOR), y[ALPHA_DOT], y[V_SPOOL]
    e_d, e_c, e_x, e_s = elastic_head(m, P_d), elastic_head(m, P_c), elastic_head(m, P_x), elastic_head(m, P_s)
    for k in range(n):
        P = y[N_SHARED + k]
        e = elastic_head(m, P)
        out[SHAFT] -= (P - P_c) * ch[k, ROTATION]
        out[PORTS] += ch[k, G_D] * (P - P_d) * (e - e_d) + ch[k, G_S] * (P_s - P) * (e_s - e)
        out[SLIPPERS] += ch[k, G_LAND] * (P - P_c) * (e - e_c)
        out[PISTONS] += (ch[k, G_RING] * (P - P_c) + ch[k, DRAG]) * (e - e_c)
    q_load, q_sys = s.load * (P_d - P_i) + scene.Q_load, s.system * (P_d - P_s)
    P_down = P_i if circuit.shared > 0.5 else P_s
    out[DISCHARGE] += q_load * (e_d - e_s)
    out[DRAIN] += s.drain * (P_c - P_down) * (e_c - e_s)
    out[PORT_PLATE] += s.plate_d * (P_d - P_c) * (e_d - e_c) + s.plate_s * (P_s - P_c) * (e_s - e_c)
    out[COMPENSATOR] += s.e_in * (P_d - P_x) * (e_d - e_x) + (s.e_out * (P_x - P_c) + s.bleed) * (e_x - e_c)
    out[COMPENSATOR] += (s.rate_leak + s.throttled) * (P_d - P_c) * (e_d - e_c)
    out[SYSTEM] += q_sys * (e_d - e_s)
    friction = friction_torque(pump.drive, scene.viscous, P_d - P_c) * y[OMEGA]
    out[SHAFT] += friction
    out[FRICTION] += friction
    out[DAMPING] += s.F_spring_v * v * v - s.torque_rate * w * w


@compiled
def _summed(pump: Pump, circuit: Circuit, scene: Scene, states: Matrix, n: int, gaps: Matrix, out: Vector) -> None:
    ch = np.empty((n, N_COLUMNS))
    for i in range(states.shape[0]):
        _powers(pump, circuit, scene, states[i], n, gaps, ch, out)


def power_balance(pump: Pump, circuit: Circuit, inputs: Vector, states: Matrix) -> dict[str, float]:
    """Mean powers over states sampled evenly through whole revolutions at constant inputs.

    Parameters
    ----------
    inputs
        One row of a scenario's table, shape (N_SCENE + 2 n,).
    states
        States of a run with ``keep_states``, shape (m, n_states), SI; commutation asks for steps of a few us.

    Returns
    -------
    dict
        Names of ``POWERS`` to powers [W], and ``unexplained``: shaft less all the others.

    Raises
    ------
    ValueError
        for variable slipper gaps, whose film stores and gives back work.
    """
    if pump.slipper.variable > 0.5:
        raise ValueError("the balance of powers knows constant slipper gaps only")
    n = int(pump.piston.n)
    scene: Any = scene_of(pump, circuit, inputs)
    gaps = np.ascontiguousarray(inputs[N_SCENE:].reshape(2, n).T)
    total = np.zeros(len(POWERS))
    _summed(pump, circuit, scene, np.ascontiguousarray(states), n, gaps, total)
    powers = dict(zip(POWERS, (total / len(states)).tolist(), strict=True))
    powers["unexplained"] = powers["shaft"] - sum(powers[name] for name in POWERS[1:])
    return powers
