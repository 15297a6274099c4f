"""Rig of figures 2-31 to 2-33: one piston with its slipper, the chamber's pressure prescribed over the shaft angle.

It steps the transient pump's own functions (``twin.simulation.slippers``) with one piston at fixed tilt and speed.
The chamber hangs on the prescribed pressure by a passage so wide that the difference stays below a hundred pascal.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled
from twin.condition import Condition, Health, input_rows
from twin.parameters import Pump
from twin.pumps import circuit_parameters
from twin.simulation.layout import (
    ALPHA,
    CAPACITY,
    COS,
    DENSITY,
    DRAG,
    G_D,
    G_RING,
    MASS,
    N_COLUMNS,
    N_FLOWS,
    N_SHARED,
    OMEGA,
    P_C,
    Q_SLIPPER,
    SIN,
    THETA,
    VOLUME,
    n_states,
)
from twin.simulation.scene import TRANSIENT_INPUTS, Scene, scene_of
from twin.simulation.slippers import eliminate_lifted, update_lifted, variable_gaps
from twin.units import M3_PER_S_PER_LPM, PA_PER_BAR, RAD_PER_DEG

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

STEPS_PER_TURN = 16_000
"""0.8 us at 4600 rpm: halving it moves the means of table 2-13 by less than 0.002 L/min."""
_SETTLE = 20
_WIDE = 1.0e-5
_ANGLE, _CHAMBER, _POCKET_PRESSURE, _GAP, _LAND, _THROTTLE, _CASE = range(7)


@dataclass(frozen=True, slots=True)
class RigCase:
    """What the rig prescribes: tilt [deg], gauge pressures [bar], speed [rpm], viscosity [Pa s].

    Between suction (second half turn) and discharge (first half turn) the pressure follows a smooth ramp over
    ``ramp_deg`` round each dead centre.
    """

    tilt_deg: float
    discharge_bar: float = 160.0
    suction_bar: float = 1.8
    case_bar: float = 3.0
    speed_rpm: float = 4600.0
    viscosity_pa_s: float = 0.0148
    ramp_deg: float = 5.0


@dataclass(frozen=True, slots=True)
class RigRun:
    """The last two revolutions of a settled run; all of shape (2 STEPS_PER_TURN,), flows of one slipper.

    Attributes
    ----------
    angle_deg
        Shaft angle past the dead centre at which discharge begins [deg].
    chamber_bar, pocket_bar
        Gauge pressures [bar].
    gap_um
        Height of the gap [um] (2-32); below the slipper's ``h_min`` it presses on the plate.
    land_lpm, throttle_lpm, case_lpm
        Flow over the land (2-26), through the throttle (2-3), and into the case with what slipper and piston pump
        there (2-44) [L/min].
    """

    angle_deg: Vector
    chamber_bar: Vector
    pocket_bar: Vector
    gap_um: Vector
    land_lpm: Vector
    throttle_lpm: Vector
    case_lpm: Vector

    def leakage(self, n: float) -> float:
        """Mean leakage of n slippers over the last revolution [L/min]."""
        return float(n * self.land_lpm[-STEPS_PER_TURN:].mean())


@compiled
def prescribed_pressure(P_d: float, P_s: float, ramp: float, phi: float) -> float:
    """Chamber pressure at an angle past dead centre [Pa]: P_d for half a turn, then P_s, smooth over ``ramp``."""
    x = min(max(math.sin(phi) / math.sin(0.5 * ramp), -1.0), 1.0)
    return 0.5 * (P_d + P_s) + 0.5 * (P_d - P_s) * x * (1.5 - 0.5 * x * x)


@compiled
def _turn(
    pump: Pump, scene: Scene, y: Vector, P_d: float, P_s: float, ramp: float, dt: float, skipped: int, kept: Matrix
) -> None:
    """Step the slipper; rows of ``kept``, shape (m, 7), take what comes after the skipped steps."""
    ch, A, b, b_unused = np.zeros((1, N_COLUMNS)), np.zeros((6, 6)), np.zeros(6), np.zeros(6)
    flows, clearances = np.zeros(N_FLOWS), np.ones((1, 2))
    t = math.tan(y[ALPHA])
    i = N_SHARED
    b[1] = y[P_C]
    for j in range(skipped + len(kept)):
        phi = y[THETA]
        ch[0, COS], ch[0, SIN] = math.cos(phi), math.sin(phi)
        variable_gaps(pump, scene, y, 1, clearances, ch)
        # the chamber only passes its pressure on: no leak of the bore, nothing stored
        ch[0, G_D], ch[0, G_RING], ch[0, DRAG], ch[0, DENSITY], ch[0, CAPACITY] = _WIDE, 0.0, 0.0, 1.0, 0.0
        eliminate_lifted(pump, scene, y, 1, dt, ch, A, b_unused)
        y[THETA] = phi + y[OMEGA] * dt
        b[0] = prescribed_pressure(P_d, P_s, ramp, y[THETA])
        to_discharge, leaked = update_lifted(pump, scene, y, 1, dt, ch, b, t, flows)
        y[i] = b[0]
        if j >= skipped:
            row = kept[j - skipped]
            row[0], row[1], row[2], row[3] = y[THETA], y[i], y[i + 1], y[i + 2]
            # what has left the chamber and has not gone back through the wide passage
            row[4], row[5] = flows[Q_SLIPPER], -(ch[0, MASS] - ch[0, VOLUME]) / dt - to_discharge
            row[6] = leaked


def rig_scene(pump: Pump, case: RigCase) -> Scene:
    """Scene of a case at 50 degC with its viscosity, the same at every pressure."""
    row = input_rows([Condition(case.speed_rpm, 50.0)], [Health()])[0]
    scene = scene_of(pump, circuit_parameters("shared_return"), np.append(row, np.zeros(len(TRANSIENT_INPUTS))))
    return scene._replace(mu_0=case.viscosity_pa_s, mu_slope=0.0)


def rig_state(pump: Pump, case: RigCase, scene: Scene) -> Vector:
    """State in which the rig starts: at dead centre, pocket half way, gap at the retainer or 10 um, shape (18,)."""
    y = np.zeros(n_states(1, variable=True))
    y[P_C], y[OMEGA], y[ALPHA] = case.case_bar * PA_PER_BAR + scene.P_amb, scene.omega, case.tilt_deg * RAD_PER_DEG
    y[N_SHARED : N_SHARED + 2] = 0.5 * (case.discharge_bar + case.suction_bar) * PA_PER_BAR + scene.P_amb
    y[N_SHARED + 2] = min(1.0e-5, pump.slipper.h_retainer)
    return y


def rig_run(pump: Pump, case: RigCase) -> RigRun:
    """Run the rig until it repeats itself and give two revolutions."""
    scene = rig_scene(pump, case)
    y = rig_state(pump, case, scene)
    kept = np.empty((2 * STEPS_PER_TURN, 7))
    P_d, P_s = (p * PA_PER_BAR + scene.P_amb for p in (case.discharge_bar, case.suction_bar))
    dt = 2.0 * math.pi / (scene.omega * STEPS_PER_TURN)
    _turn(pump, scene, y, P_d, P_s, case.ramp_deg * RAD_PER_DEG, dt, _SETTLE * STEPS_PER_TURN, kept)
    return RigRun(
        angle_deg=(kept[:, _ANGLE] - 2.0 * math.pi * _SETTLE) / RAD_PER_DEG,
        chamber_bar=(kept[:, _CHAMBER] - scene.P_amb) / PA_PER_BAR,
        pocket_bar=(kept[:, _POCKET_PRESSURE] - scene.P_amb) / PA_PER_BAR,
        gap_um=kept[:, _GAP] * 1.0e6,
        land_lpm=kept[:, _LAND] / M3_PER_S_PER_LPM,
        throttle_lpm=kept[:, _THROTTLE] / M3_PER_S_PER_LPM,
        case_lpm=kept[:, _CASE] / M3_PER_S_PER_LPM,
    )
