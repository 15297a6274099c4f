"""Everything between the shared states: passages and forces at one instant, and their place in the 6 x 6 system.

Unknowns of the system, all at the end of the step: P_d, P_c, P_i, P_ctrl, spool speed, tilt rate. Servo pistons in
sporadic contact are bodies of their own and are eliminated from it.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled, inlined
from twin.laws.compressibility import P_FLOOR
from twin.laws.fluid import film_viscosity
from twin.laws.friction import friction_damping, friction_damping_ahead
from twin.operating_point.equations import drain_viscosity_ratio
from twin.parameters import Circuit, Pump
from twin.parts import servo as servo_part
from twin.parts.circuit import counted_conductance, drain_conductance, return_conductance, turbulent_conductance
from twin.parts.compensator import (
    bleed_conductance,
    inlet,
    jet_stiffness,
    outlet,
    spool_stop,
    transient_jet_damping,
)
from twin.parts.drive import case_temperature, friction_torque
from twin.parts.swashplate import inertia_torque, stop
from twin.simulation.layout import (
    ALPHA,
    ALPHA_DOT,
    OMEGA,
    P_C,
    P_CTRL,
    P_D,
    P_I,
    SPOOL_SPEED,
    TILT_RATE,
    V_RATE,
    V_SPOOL,
    V_STROKE,
    X_RATE,
    X_STROKE,
    X,
)
from twin.simulation.scene import Scene
from twin.simulation.volumes import Held, held_fluid

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
_BLEED_ROUNDS = 6


class Servo(NamedTuple):
    """One servo piston as a body of its own: push without pressure [N], contact force [N], contact and own damping
    [N s/m], plate's speed at its contact per tilt rate [m/rad], mass over step left to the step.
    """

    push: float
    elastic: float
    contact: float
    stiffness: float
    own: float
    own_stiffness: float
    reach: float


class Shared(NamedTuple):
    """Conductances [m3/s/Pa], flows and forces of everything but the chambers at one instant.

    ``bleed`` is the flow at that instant, which a step takes as it will be (``bleed_ahead``);
    ``e_in_x``, ``e_out_x`` are slopes of the control flows by the spool's position [m2/s]; ``F_spring`` with its
    slopes acts against discharge pressure on the spool, ``F_friction_v`` being the part of ``F_spring_v`` that is friction
    at the spool's speed of now; ``torque`` is what acts on the plate besides pressures; ``held`` is the volumes' fluid.
    """

    load: float
    system: float
    throttled: float
    plate_d: float
    plate_s: float
    rate_leak: float
    e_in: float
    e_in_x: float
    e_out: float
    e_out_x: float
    bleed: float
    drain: float
    ret: float
    F_spring: float
    F_spring_x: float
    F_spring_v: float
    F_friction_v: float
    torque: float
    torque_alpha: float
    torque_rate: float
    J: float
    arm: float
    arm_rate: float
    stroke: Servo
    rate: Servo
    held: Held


@compiled
def _servo_contact(depth: float, rate: float, k: float, d: float) -> tuple[float, float, float]:
    elastic = k * depth if depth > 0.0 else 0.0
    stiffness = k if depth > 0.0 else 0.0
    return elastic, stiffness, servo_part.contact_damping(elastic, rate, d)


@compiled
def _warmed_drain(pump: Pump, scene: Scene, k_c: float, k_cQ: float, dP: float, drop: float, omega: float) -> float:
    """Laminar part of the drain's resistance with the case's own viscosity [Pa s/m3].

    The flow warms the case less the larger it is, and the warmer case lets more flow: two rounds settle it.
    """
    drive, found = pump.drive, k_c
    friction = friction_torque(drive, scene.viscous, dP) * omega
    for _ in range(3):
        Q_c = drain_conductance(drop, found, k_cQ) * drop
        T_c = case_temperature(drive, pump.fluid, scene.T, dP, Q_c, friction)
        ratio = drain_viscosity_ratio(drive, pump.fluid, scene.Q_ref, T_c)
        found = k_c + scene.k_c * scene.w_nu * (ratio - 1.0)
    return found


@inlined
def shared_passages(pump: Pump, circuit: Circuit, scene: Scene, y: Vector, t: float) -> Shared:
    """Passages and forces between the shared states of ``y``, ``t`` being the tangent of its tilt."""
    comp, gap, plate, servo = pump.compensator, pump.port_plate, pump.swashplate, pump.servo
    P_d, P_c, P_i, P_ctrl = y[P_D], y[P_C], y[P_I], max(y[P_CTRL], P_FLOOR)
    x, v, alpha, alpha_dot = y[X], y[V_SPOOL], y[ALPHA], y[ALPHA_DOT]
    rho = scene.rho
    plate_gap = scene.plate_scale * gap.h**3 / 12.0 * gap.shape
    mu_case = film_viscosity(scene.film, P_d, P_c)
    mu_in = film_viscosity(scene.film, P_d, P_ctrl)
    mu_out = film_viscosity(scene.film, P_ctrl, P_c)
    e_in, e_in_x = inlet(comp, scene.edge, x, P_d - P_ctrl, rho, mu_in, scene.nu)
    e_out, e_out_x = outlet(comp, scene.edge, x, P_ctrl - P_c, rho, mu_out, scene.nu)
    e_out += servo_part.stroking_leakage(servo, mu_out) + bleed_conductance(comp, P_ctrl - P_c, rho)
    bleed = 0.0
    if scene.bleed > 0.0:
        bleed = servo_part.bleed_flow(servo, scene.bleed, P_ctrl - P_c)

    jet, jet_x = jet_stiffness(comp, scene.edge, x, P_d - P_ctrl)
    stopped, stop_x = spool_stop(comp, x)
    F_v = comp.damping + transient_jet_damping(comp, x, P_d - P_ctrl, rho)
    rubbing = friction_damping(comp.F_coulomb + scene.jam, comp.F_static + scene.jam, v, comp.v_friction)

    end, end_x, end_v = stop(plate, alpha, alpha_dot)
    friction = friction_damping(
        plate.T_coulomb + scene.plate_friction, plate.T_static + scene.plate_friction, alpha_dot, plate.w_friction
    )
    torque_rate = end_v - plate.damping - friction
    torque = end - end_v * alpha_dot
    torque_alpha = end_x
    if pump.slipper.variable < 0.5:
        torque += inertia_torque(pump.piston, t, y[OMEGA])
    reach_s, reach_r = servo.L_stroke * (1.0 + t * t), servo.L_rate * (1.0 + t * t)
    own_s = servo_part.stroking_drag(servo, mu_case)
    own_r = servo_part.rate_drag(servo, mu_case)
    v_s, v_r = -reach_s * alpha_dot, reach_r * alpha_dot
    if servo.contact > 0.5:
        v_s, v_r = y[V_STROKE], y[V_RATE]
    own_s += friction_damping(servo.F_coulomb_stroke, servo.F_static_stroke, v_s, servo.v_friction)
    own_r += friction_damping(servo.F_coulomb_rate, servo.F_static_rate, v_r, servo.v_friction)
    J = plate.J
    if servo.contact > 0.5:
        depth_s, depth_r = y[X_STROKE] + servo.L_stroke * t, y[X_RATE] - servo.L_rate * t
        F_s, k_s, d_s = _servo_contact(depth_s, v_s + reach_s * alpha_dot, servo.k_contact, servo.d_contact)
        F_r, k_r, d_r = _servo_contact(depth_r, v_r - reach_r * alpha_dot, servo.k_contact, servo.d_contact)
        spring = servo.F_rate + servo.k_rate * (servo.L_rate * scene.t_max - y[X_RATE])
        # the bore's end holds a stroking piston that has left the plate at full tilt
        bottom = -servo.L_stroke * math.tan(plate.alpha_max + 0.05)
        seat = servo.k_contact * (bottom - y[X_STROKE]) if y[X_STROKE] < bottom else 0.0
        stroke = Servo(seat, F_s, d_s, k_s, own_s, servo.k_contact if seat > 0.0 else 0.0, reach_s)
        rate = Servo(spring, F_r, d_r, k_r, own_r, servo.k_rate, reach_r)
    else:
        torque += servo_part.spring_torque(servo, scene.t_max, t)
        torque_alpha -= servo.k_rate * servo.L_rate**2 * (1.0 + t * t) ** 2
        torque_rate -= own_s * reach_s * reach_s + own_r * reach_r * reach_r
        J += servo_part.carried_inertia(servo, t)
        stroke = rate = Servo(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    k_c, k_cQ = scene.k_c * (1.0 - scene.w_Q), scene.k_c * scene.w_Q / scene.Q_ref
    P_down = P_i if circuit.shared > 0.5 else scene.P_s
    if scene.w_nu != 0.0:
        k_c = _warmed_drain(pump, scene, k_c, k_cQ, P_d - P_c, P_c - P_down, y[OMEGA])
    return Shared(
        load=turbulent_conductance(P_d - P_i, scene.load),
        system=counted_conductance(P_d - scene.P_s, scene.Q_sys),
        throttled=counted_conductance(P_d - P_c, scene.throttled),
        plate_d=plate_gap / mu_case,
        plate_s=plate_gap / film_viscosity(scene.film, P_c, P_c),
        rate_leak=servo_part.rate_leakage(servo, mu_case),
        e_in=e_in,
        e_in_x=e_in_x,
        e_out=e_out,
        e_out_x=e_out_x,
        bleed=bleed,
        drain=drain_conductance(P_c - P_down, k_c, k_cQ),
        ret=return_conductance(P_i - scene.P_s, scene.k_inf, scene.K, circuit.gamma),
        F_spring=scene.preload + scene.k_valve * x + jet - stopped,
        F_spring_x=scene.k_valve + jet_x + stop_x,
        F_spring_v=F_v + rubbing,
        F_friction_v=rubbing,
        torque=torque,
        torque_alpha=torque_alpha,
        torque_rate=torque_rate,
        J=J,
        arm=servo_part.stroking_arm(servo, t),
        arm_rate=servo_part.rate_arm(servo, t),
        stroke=stroke,
        rate=rate,
        held=held_fluid(pump, scene, y),
    )


@inlined
def assemble(pump: Pump, circuit: Circuit, scene: Scene, s: Shared, y: Vector, dt: float, A: Matrix, b: Vector) -> None:
    """Put the shared passages into ``A`` (6, 6) and ``b`` (6,), overwriting both."""
    comp, held, P_s, per_dt = pump.compensator, s.held, scene.P_s, 1.0 / dt
    P_d, P_c, P_i, P_ctrl = y[P_D], y[P_C], y[P_I], y[P_CTRL]
    shared = 1.0 if circuit.shared > 0.5 else 0.0
    for i in range(6):
        b[i] = 0.0
        for j in range(6):
            A[i, j] = 0.0
    C_d, C_c = held.capacity_d * per_dt, held.capacity_c * per_dt
    C_i, C_x = held.capacity_i * per_dt, held.capacity_x * per_dt
    G_dc = s.plate_d + s.throttled + s.rate_leak
    # discharge
    A[P_D, P_D] = C_d + s.load + s.system + s.e_in + G_dc
    A[P_D, P_C] = -G_dc
    A[P_D, P_I] = -s.load
    A[P_D, P_CTRL] = -s.e_in
    A[P_D, SPOOL_SPEED] = s.e_in_x * dt
    b[P_D] = C_d * P_d - scene.Q_load + s.system * P_s
    # case; a separate drain ends in the reservoir
    A[P_C, P_D] = -G_dc
    A[P_C, P_C] = C_c + G_dc + s.plate_s + s.e_out + s.drain
    A[P_C, P_I] = -s.drain * shared
    A[P_C, P_CTRL] = -s.e_out
    A[P_C, SPOOL_SPEED] = -s.e_out_x * dt
    b[P_C] = C_c * P_c + s.plate_s * P_s + s.drain * (1.0 - shared) * P_s
    # return junction
    A[P_I, P_D] = -s.load - s.system
    A[P_I, P_C] = -s.drain * shared
    A[P_I, P_I] = C_i + s.load + s.ret + s.drain * shared
    b[P_I] = C_i * P_i + scene.Q_load - s.system * P_s + s.ret * P_s
    # control volume
    A[P_CTRL, P_D] = -s.e_in
    A[P_CTRL, P_C] = -s.e_out
    A[P_CTRL, P_CTRL] = C_x + s.e_in + s.e_out
    A[P_CTRL, SPOOL_SPEED] = -(s.e_in_x - s.e_out_x) * dt
    b[P_CTRL] = C_x * P_ctrl
    # spool
    A[SPOOL_SPEED, P_D] = -comp.A_spool
    A[SPOOL_SPEED, P_C] = comp.A_spool
    A[SPOOL_SPEED, SPOOL_SPEED] = comp.m_spool * per_dt + s.F_spring_x * dt + s.F_spring_v
    b[SPOOL_SPEED] = comp.m_spool * per_dt * y[V_SPOOL] - s.F_spring
    if s.F_friction_v > 0.0:
        inertia, drive = A[SPOOL_SPEED, SPOOL_SPEED] - s.F_friction_v, b[SPOOL_SPEED] + comp.A_spool * (P_d - P_c)
        coulomb, static = comp.F_coulomb + scene.jam, comp.F_static + scene.jam
        A[SPOOL_SPEED, SPOOL_SPEED] = inertia + friction_damping_ahead(coulomb, static, comp.v_friction, drive, inertia)
    # plate
    A[TILT_RATE, TILT_RATE] = s.J * per_dt - s.torque_rate - s.torque_alpha * dt
    b[TILT_RATE] = s.J * per_dt * y[ALPHA_DOT] + s.torque
    if pump.servo.contact > 0.5:
        _assemble_servos(pump, s, y, dt, A, b)
        return
    # carried pistons: the control volume grows as the tilt falls, the case as it rises
    A[P_C, TILT_RATE] += s.arm - s.arm_rate
    A[P_CTRL, TILT_RATE] -= s.arm
    # the plate on the control volume is an oscillator that a wholly implicit step damps: pushing it by the mean of old
    # and new control pressure halves that and stays stable at any step
    A[TILT_RATE, P_CTRL] += 0.5 * s.arm
    b[TILT_RATE] -= 0.5 * s.arm * max(P_ctrl, P_FLOOR)
    A[TILT_RATE, P_C] -= s.arm - s.arm_rate
    A[P_D, TILT_RATE] += s.arm_rate
    A[TILT_RATE, P_D] -= s.arm_rate


@compiled
def servo_speed(sv: Servo, v: float, mass: float, dt: float) -> tuple[float, float, float]:
    """Speed of a servo piston as ``a_0 + a_p dP' + a_w reach alpha_dot'``: a_0, 1/D, and K/D of its contact."""
    K = sv.stiffness * dt + sv.contact
    D = mass / dt + K + sv.own + sv.own_stiffness * dt
    return (mass / dt * v + sv.push - sv.elastic) / D, 1.0 / D, K / D


@inlined
def _assemble_servos(pump: Pump, s: Shared, y: Vector, dt: float, A: Matrix, b: Vector) -> None:
    servo = pump.servo
    a_0, a_p, share = servo_speed(s.stroke, y[V_STROKE], servo.m_stroke, dt)
    K, reach, area = s.stroke.stiffness * dt + s.stroke.contact, s.stroke.reach, servo.A_stroke
    a_p *= area
    a_w = -share * reach
    # speed times area leaves the control volume and enters the case
    A[P_CTRL, P_CTRL] += area * a_p
    A[P_CTRL, P_C] -= area * a_p
    A[P_CTRL, TILT_RATE] += area * a_w
    b[P_CTRL] -= area * a_0
    A[P_C, P_CTRL] -= area * a_p
    A[P_C, P_C] += area * a_p
    A[P_C, TILT_RATE] -= area * a_w
    b[P_C] += area * a_0
    # contact force pushes the tilt down
    A[TILT_RATE, P_CTRL] += reach * K * a_p
    A[TILT_RATE, P_C] -= reach * K * a_p
    A[TILT_RATE, TILT_RATE] += reach * K * (a_w + reach)
    b[TILT_RATE] -= reach * (s.stroke.elastic + K * a_0)

    a_0, a_p, share = servo_speed(s.rate, y[V_RATE], servo.m_rate, dt)
    K, reach, area = s.rate.stiffness * dt + s.rate.contact, s.rate.reach, servo.A_rate * servo.rate_fed
    a_p *= area
    a_w = share * reach
    A[P_D, P_D] += area * a_p
    A[P_D, P_C] -= area * a_p
    A[P_D, TILT_RATE] += area * a_w
    b[P_D] -= area * a_0
    A[P_C, P_D] -= area * a_p
    A[P_C, P_C] += area * a_p
    A[P_C, TILT_RATE] -= area * a_w
    b[P_C] += area * a_0
    # contact force pushes the tilt up
    A[TILT_RATE, P_D] -= reach * K * a_p
    A[TILT_RATE, P_C] += reach * K * a_p
    A[TILT_RATE, TILT_RATE] += reach * K * (reach - a_w)
    b[TILT_RATE] += reach * (s.rate.elastic + K * a_0)


@inlined
def ended_control(y: Vector, A: Matrix, b: Vector) -> float:
    """Control pressure at the step's end times its own coefficient, the other states standing [m3/s]."""
    left = b[P_CTRL] - A[P_CTRL, P_D] * y[P_D] - A[P_CTRL, P_C] * y[P_C]
    return float(left - A[P_CTRL, SPOOL_SPEED] * y[V_SPOOL] - A[P_CTRL, TILT_RATE] * y[ALPHA_DOT])


@compiled
def bleed_ahead(pump: Pump, scene: Scene, y: Vector, A: Matrix, b: Vector) -> tuple[float, float]:
    """Put a bleed of the control volume into the shared system; its flow is ``k + g (P_ctrl' - P_c')``.

    It empties that small volume in microseconds and then fades, so that it is taken about the pressure at which the step
    will end: ``z + a tanh z = r``, by Newton's method from the left, where it never leaps.
    """
    faded = servo_part.faded_pressure(pump.servo)
    per = 1.0 / (A[P_CTRL, P_CTRL] * faded)
    a = scene.bleed * per
    r = ended_control(y, A, b) * per - y[P_C] / faded
    end = abs(r)
    z = max(end - a, end / (1.0 + a))
    th = math.tanh(z)
    for _ in range(_BLEED_ROUNDS):
        z += (end - z - a * th) / (1.0 + a * (1.0 - th * th))
        th = math.tanh(z)
    g = scene.bleed / faded * (1.0 - th * th)
    k = math.copysign(scene.bleed * th - g * faded * z, r)
    A[P_CTRL, P_CTRL] += g
    A[P_CTRL, P_C] -= g
    A[P_C, P_CTRL] -= g
    A[P_C, P_C] += g
    b[P_CTRL] -= k
    b[P_C] += k
    return k, g


@inlined
def open_cavity(y: Vector, A: Matrix, b: Vector) -> None:
    """Hold the control pressure of the system at ``P_FLOOR`` where the step would take it below: nothing pulls a fluid.

    The state, which follows from the mass, counts what is missing until the cavity is filled again.
    """
    if ended_control(y, A, b) < P_FLOOR * A[P_CTRL, P_CTRL]:
        for j in range(6):
            A[P_CTRL, j] = 0.0
        A[P_CTRL, P_CTRL], b[P_CTRL] = 1.0, P_FLOOR
