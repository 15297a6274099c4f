"""Rig of figures 2-31 to 2-33: one piston with its slipper, the chamber's pressure prescribed over the shaft angle.

One piston at fixed tilt and speed steps through the transient pump's own film (``twin.simulation.slippers``); its
chamber follows the prescribed pressure.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled
from twin.condition import Condition, Health, input_rows
from twin.laws.compressibility import P_FLOOR, pressure, relative_compressibility, relative_density
from twin.laws.fluid import Film
from twin.parameters import Pump
from twin.pumps import circuit_parameters
from twin.simulation.film import Motion, Stance, film
from twin.simulation.layout import ALPHA, N_SHARED, OMEGA, P_C, THETA, n_states
from twin.simulation.scene import TRANSIENT_INPUTS, Scene, scene_of
from twin.units import M3_PER_S_PER_LPM, PA_PER_BAR, RAD_PER_DEG

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

STEPS_PER_TURN = 16_000
"""0.8 us at 4600 rpm: halving it moves the means of table 2-13 by less than 0.002 L/min."""
_SETTLE = 20
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
    piston, slipper, medium = pump.piston, pump.slipper, scene.medium
    A_p, S = 0.25 * math.pi * piston.d_p**2, scene.S_eq
    extra = (1.0 - slipper.pumped_repair) * (scene.A_outer - S)
    t = math.tan(y[ALPHA])
    cos_alpha = 1.0 / math.sqrt(1.0 + t * t)
    i, P_c = N_SHARED, y[P_C]
    for j in range(skipped + len(kept)):
        P, P_p, h, u, phi = y[i], y[i + 1], y[i + 2], y[i + 3], y[THETA]
        phi_new = phi + y[OMEGA] * dt
        r = cos_alpha * piston.R * t * (math.cos(phi_new) - math.cos(phi)) / dt
        f = film(
            pump,
            scene,
            Stance(1.0, 1.0, t, cos_alpha, math.cos(phi)),
            Motion(P, max(P_p, P_FLOOR), P_c, h, u, cos_alpha * u + r),
        )
        P_new = prescribed_pressure(P_d, P_s, ramp, phi_new)
        # pocket pressure and speed at the step's end, linearly implicit as in the whole pump; no leak of the bore
        w_p = relative_density(medium, P_p)
        C_p = relative_compressibility(medium, P_p) * (slipper.V_pocket + S * h) / dt
        D_p = 1.0 / (C_p + f.throttle + f.land)
        q_0 = (C_p * P_p + f.throttle * P_new + f.land * P_c - w_p * S * r) * D_p
        K = f.stiffness * dt + f.damping
        push = cos_alpha * (S * (q_0 - P_c) + extra * (scene.P_amb - P_c) + f.elastic - K * r)
        inert = piston.m / dt + f.held + cos_alpha * cos_alpha * (K + w_p * S * S * D_p)
        y[i + 3] = (piston.m / dt * u + push - A_p * (P_new - P_c)) / inert
        P_end = q_0 - w_p * S * D_p * cos_alpha * y[i + 3]
        if P_end < P_FLOOR:
            # a cavity: its pressure stands, the state counts what is missing
            P_end = P_FLOOR
            push += cos_alpha * S * (P_FLOOR - q_0)
            inert = piston.m / dt + f.held + cos_alpha * cos_alpha * K
            y[i + 3] = (piston.m / dt * u + push - A_p * (P_new - P_c)) / inert
        h_dot = cos_alpha * y[i + 3] + r
        y[i + 2] = h + dt * h_dot
        land, throttle = f.land * (P_end - P_c), f.throttle * (P_new - P_end)
        held = w_p * (slipper.V_pocket + S * h) + dt * (throttle - land)
        y[i], y[i + 1] = P_new, pressure(medium, held / (slipper.V_pocket + S * y[i + 2]), P_end)
        y[THETA] = phi_new
        if j >= skipped:
            row = kept[j - skipped]
            row[_ANGLE], row[_CHAMBER], row[_GAP] = phi_new, P_new, y[i + 2]
            row[_POCKET_PRESSURE] = max(y[i + 1], P_FLOOR)
            row[_LAND], row[_THROTTLE], row[_CASE] = land, throttle, land + (S + extra) * h_dot - A_p * y[i + 3]


def rig_scene(pump: Pump, case: RigCase) -> Scene:
    """Scene of a case at 50 degC with its viscosity, the same at every pressure."""
    row = input_rows([Condition(case.speed_rpm, 50.0)], [Health()])[0]
    scene = scene_of(pump, circuit_parameters("shared_return"), np.append(row, np.zeros(len(TRANSIENT_INPUTS))))
    return scene._replace(film=Film(case.viscosity_pa_s, 0.0, 0.0))


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
