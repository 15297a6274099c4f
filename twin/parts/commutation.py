"""Commutation: a chamber's pressure changes over at each dead centre, and the plate vibrates in step with the changes.

Harmonic balance. Every chamber that changes over throws the plate; the plate stands on the fluid of the control volume
and on its spring, and answers at the multiples of the number of pistons; its motion in turn hastens or delays the
changes. Between the changes the chambers' torque on the plate is known in closed form, so that the moments ``E_m`` of
both changes, the means of ``exp(-i m n phi)`` over the change of pressure, give its harmonics.
"""

import math
from typing import NamedTuple

from twin.compiled import compiled
from twin.parameters import PortPlate

_CLOSING, _CLOSED, _OPENING = 2, 3, 3
"""Substeps of a change while the old port still closes, while both are shut, and while the next one opens."""
_ROUNDS, _RELAXATION = 3, 0.7
"""Rounds of the balance and the share of a round's news that it takes before it has two rounds to compare.

Against many rounds on a fine grid, over 200 random conditions: 0.0002 rad (rms) of the sum of both angles.
"""


class Change(NamedTuple):
    """A chamber about to change over.

    ``needed`` is the fluid that the whole change asks for [m3], ``leak`` its leakage at the full pressure difference
    [m3/s]; ``leak_start`` is 0 for a chamber being filled and 1 for one being emptied. Fluid stiffens with pressure:
    the share p of the change of pressure takes the share ``(1 + bend) p / (1 + bend p)`` of the fluid, exact without
    air. ``low`` is the share at which a cavity opens: before the dead centre a closing chamber still moves away from
    its change.
    """

    needed: float
    leak: float
    leak_start: float
    bend: float
    low: float


class Support(NamedTuple):
    """What the plate stands on.

    Inertia [kg m2], damping [N m s], stiffness of its spring [N m/rad], the stroking piston's volume per tilt [m3/rad],
    and of the control volume the capacity [m3/Pa] and the conductance of its passages to a small change of pressure
    [m3/s/Pa]; ``share`` of the chambers' torque that it carries, the rest being the tilt stop's [-].
    """

    J: float
    damping: float
    stiffness: float
    arm: float
    capacity: float
    conductance: float
    share: float


class Commutations(NamedTuple):
    """Mean angles past the dead centres at which pressure rises and falls [rad], and what else a revolution feels.

    ``ripple`` is the standard deviation of the control pressure [Pa]; ``drawn`` is the fluid [m3] that a chamber takes
    from suction to discharge beyond its mean stroke: where its ports shut the vibrating plate stands off its mean tilt,
    and the change has begun.
    """

    rising: float
    falling: float
    ripple: float
    drawn: float


class Harmonics(NamedTuple):
    """Complex amplitudes at n, 2 n, 3 n and 4 n times a shaft angle that counts from a dead centre."""

    h_1: complex
    h_2: complex
    h_3: complex
    h_4: complex


class _Grid(NamedTuple):
    """Turns ``exp(i n phi)`` of the first angle and of half a substep of each stretch; span of the last one [rad]."""

    first: complex
    closing: complex
    closed: complex
    opening: complex
    span: float


@compiled
def _turn(angle: float) -> complex:
    return complex(math.cos(angle), math.sin(angle))


@compiled
def _span(plate: PortPlate, needed: float, v_0: float, omega: float) -> float:
    """Angle that the opening port alone needs to fill a chamber [rad], with a margin."""
    filling = 2.0 * needed * plate.phi_ramp**2 * omega / (plate.C_q * plate.A_port * v_0)
    return min(1.2 * math.pow(filling, 1.0 / 3.0), 0.6 * plate.phi_ramp)


@compiled
def _opened(u: float) -> float:
    """Integral of the smooth step u^2 (3 - 2 u) of an opening port from 0 to u [-]."""
    return u * u * u * (1.0 - 0.5 * u)


@compiled
def _centre(a: float, b: float, r_0: float, r_1: float) -> float:
    """Mean angle, between a and b past its opening, of what a port of area as u^2 lets pass.

    The port lets the root of what is left fall from r_0 to r_1, evenly over u^3.
    """
    v_a, a_4, b_4 = a * a * a, a * a * a * a, b * b * b * b
    dv = b * b * b - v_a
    fall = (r_0 - r_1) / dv
    passed = (r_0 + fall * v_a) * 0.75 * (b_4 - a_4) - fall * (3.0 / 7.0) * (b_4 * b * b * b - a_4 * v_a)
    return 2.0 * passed / ((r_0 + r_1) * dv)


@compiled
def _change(
    plate: PortPlate,
    change: Change,
    grid: _Grid,
    w: Harmonics,
    n: float,
    swing: float,
    arm: float,
    v_0: float,
    omega: float,
) -> tuple[float, float, Harmonics]:
    """Mean angle of a change of pressure, share of its fluid when the old port has shut, and moments.

    The share p that is done follows from the chamber's balance over angle, ``needed omega ds/dphi = swing omega sin(phi)
    + leak (leak_start - p) - arm w(phi)`` plus what the ports let through, s being the fluid's share: the closing port
    ``-C_q A v_0 sqrt(p)``, the opening one ``C_q A v_0 sqrt(1 - p)``.
    """
    first = plate.phi_commutation - plate.phi_seal
    last = plate.phi_commutation + plate.phi_seal
    bend, low = change.bend, change.low
    per = 1.0 / ((1.0 + bend) * change.needed * omega)
    port = 0.5 * plate.C_q * plate.A_port * v_0 * per
    turned, leak, tilted = swing * omega * per, change.leak * per, arm * per
    per_ramp = 1.0 / plate.phi_ramp
    p = centroid = shut = 0.0
    m_1 = m_2 = m_3 = m_4 = complex(0.0, 0.0)
    boundary, phi = grid.first, first - plate.phi_seal
    for stretch in range(3):
        if stretch == 0:
            count, half, d = _CLOSING, grid.closing, plate.phi_seal / _CLOSING
        elif stretch == 1:
            count, half, d = _CLOSED, grid.closed, 2.0 * plate.phi_seal / _CLOSED
        else:
            count, half, d = _OPENING, grid.opening, grid.span / _OPENING
        z, whole = boundary * half, half * half
        phi += 0.5 * d
        # leakage at the middle of a substep: p grows by half of what moves
        step = d / (1.0 + 0.5 * leak * d)
        for k in range(count):
            z_2 = z * z
            z_3, z_4 = z * z_2, z_2 * z_2
            rate = (w.h_1 * z + w.h_2 * z_2 + w.h_3 * z_3 + w.h_4 * z_4).real
            # the sine by its series: within 1e-5 here
            moved = turned * (phi - phi * phi * phi / 6.0) + leak * (change.leak_start - p) - tilted * rate
            moved *= step
            late = 0.0
            if stretch == 0:
                # implicit while the port holds the chamber, then by the mean of both ends: it hardly feeds what moves
                u = (first - phi) * per_ramp
                b = port * d * u * u * (3.0 - 2.0 * u)
                left = p + moved
                if k > 0:
                    left -= b * math.copysign(math.sqrt(abs(p)), p)
                    b *= 0.5
                root = math.sqrt(b * b + abs(left)) - b
                dp = (min(root * root, 0.98) if left > 0.0 else max(-root * root, low)) - p
            elif stretch == 1:
                g = 1.0 + bend * p
                g += 0.5 * bend * moved * g * g
                dp = min(max(moved * g * g, low - p), 0.98 - p)
            else:
                # half of what moves, then the port alone, which lets the root of what is left fall, then the other half
                g = 1.0 + bend * p
                moved *= 0.5 * g * g
                done = min(p + moved, 1.0)
                u_b = (phi + 0.5 * d - last) * per_ramp
                u_a = max(u_b - d * per_ramp, 0.0)
                b = port * plate.phi_ramp * (_opened(u_b) - _opened(u_a))
                r_0 = math.sqrt(1.0 - done)
                r_1 = max(r_0 - 0.5 * b, 0.0)
                g = 1.0 + bend * (1.0 - r_1 * r_1)
                b *= g * g
                r_1 = max(r_0 - b, 0.0)
                if r_0 > 0.0:
                    if r_1 == 0.0:
                        v_a = u_a * u_a * u_a
                        u_b = math.pow(v_a + (u_b * u_b * u_b - v_a) * r_0 / b, 1.0 / 3.0)
                    late = (r_0 * r_0 - r_1 * r_1) * (last - phi + plate.phi_ramp * _centre(u_a, u_b, r_0, r_1))
                dp = min(1.0 - r_1 * r_1 + moved, 1.0) - p
            p += dp
            centroid += dp * phi + late
            m_1 += z * complex(dp, n * late)
            m_2 += z_2 * complex(dp, 2.0 * n * late)
            m_3 += z_3 * complex(dp, 3.0 * n * late)
            m_4 += z_4 * complex(dp, 4.0 * n * late)
            z *= whole
            phi += d
        if stretch == 0:
            shut = (1.0 + bend) * p / (1.0 + bend * p)
        phi -= 0.5 * d
        boundary = z * half.conjugate()
    # what is left after the span
    left = 1.0 - p
    z = boundary
    z_2 = z * z
    m_1 += left * z
    m_2 += left * z_2
    m_3 += left * (z * z_2)
    m_4 += left * (z_2 * z_2)
    moments = Harmonics(m_1.conjugate(), m_2.conjugate(), m_3.conjugate(), m_4.conjugate())
    return centroid + left * phi, shut, moments


@compiled
def _fluid(support: Support, w: float) -> complex:
    """Control pressure per tilt rate at the angular frequency w [Pa s/rad]."""
    return support.arm / complex(support.conductance, w * support.capacity)


@compiled
def _answer(support: Support, n: float, torque: float, omega: float, m: float) -> complex:
    """Tilt rate at m n times the shaft's speed, per sum of both changes' moments [rad/s].

    A torque that jumps by ``torque`` at each change and runs as a cosine between them.
    """
    q = m * n
    w = q * omega
    resistance = complex(support.damping, support.J * w - support.stiffness / w) + support.arm * _fluid(support, w)
    return complex(0.0, -n / math.pi * torque * q / (q * q - 1.0)) / resistance


@compiled
def _tilted(w: Harmonics, z: complex, turned: float, omega_n: float) -> float:
    """Tilt off its mean at the turn z past the outer plus that past the inner dead centre [rad], rates being w."""
    z_2 = z * z
    both = 1.0 + turned
    sine = (both * w.h_1 * z).imag + (w.h_2 * z_2).imag + (both * w.h_3 * z * z_2).imag / 3.0
    return (sine + 0.5 * (w.h_4 * z_2 * z_2).imag) / omega_n


@compiled
def _sum(a: Harmonics, s: float, b: Harmonics) -> Harmonics:
    """``a + s b``."""
    return Harmonics(a.h_1 + s * b.h_1, a.h_2 + s * b.h_2, a.h_3 + s * b.h_3, a.h_4 + s * b.h_4)


@compiled
def _product(a: Harmonics, b: Harmonics) -> float:
    """Inner product of both as real vectors."""
    total = (a.h_1 * b.h_1.conjugate()).real + (a.h_2 * b.h_2.conjugate()).real
    return total + (a.h_3 * b.h_3.conjugate()).real + (a.h_4 * b.h_4.conjugate()).real


@compiled
def commutations(
    plate: PortPlate,
    support: Support,
    rise: Change,
    fall: Change,
    n: float,
    swing: float,
    arm: float,
    dP: float,
    v_0: float,
    omega: float,
) -> Commutations:
    """Both mean angles, and the ripple of the control pressure.

    Parameters
    ----------
    plate
        Closed from ``phi_commutation - phi_seal`` on, the next port opening ``2 phi_seal`` later.
    support, rise, fall
        What the plate stands on, and the chambers at the outer and at the inner dead centre.
    n
        Number of pistons.
    swing, arm
        Half of the stroke's volume [m3]; volume per tilt of a chamber at dead centre, its torque arm too [m3/rad].
    dP, v_0
        Pressure difference of a change [Pa], speed of a jet under it [m/s].
    omega
        Shaft speed [rad/s].
    """
    # seen from the inner dead centre odd multiples of an odd number of pistons stand the other way round
    turned = -1.0 if n % 2.0 > 0.5 else 1.0
    torque = support.share * arm * dP
    a_1, a_2 = _answer(support, n, torque, omega, 1.0), _answer(support, n, torque, omega, 2.0)
    a_3, a_4 = _answer(support, n, torque, omega, 3.0), _answer(support, n, torque, omega, 4.0)
    first = _turn(n * (plate.phi_commutation - 2.0 * plate.phi_seal))
    closing = _turn(0.5 * n * plate.phi_seal / _CLOSING)
    closed = _turn(n * plate.phi_seal / _CLOSED)
    span_r, span_f = _span(plate, rise.needed, v_0, omega), _span(plate, fall.needed, v_0, omega)
    grid_r = _Grid(first, closing, closed, _turn(0.5 * n * span_r / _OPENING), span_r)
    grid_f = _Grid(first, closing, closed, _turn(0.5 * n * span_f / _OPENING), span_f)
    # first guess: both changes at once, early in the opening of the port, spread as widely as the seal
    z = _turn(-n * (plate.phi_commutation + plate.phi_seal + 0.2 * span_r))
    g, z_2, both = math.exp(-0.5 * (n * plate.phi_seal) ** 2), z * z, 1.0 + turned
    g_4 = g * g * g * g
    w = Harmonics(
        a_1 * (both * g * z), a_2 * (2.0 * g_4 * z_2), a_3 * (both * g_4 * g_4 * g * z * z_2),
        a_4 * (2.0 * g_4 * g_4 * g_4 * g_4 * z_2 * z_2),
    )  # fmt: skip
    rising = falling = begun = 0.0
    before, news_before = w, w
    for k in range(_ROUNDS):
        rising, shut_r, r = _change(plate, rise, grid_r, w, n, swing, arm, v_0, omega)
        seen = Harmonics(turned * w.h_1, w.h_2, turned * w.h_3, w.h_4)
        falling, shut_f, f = _change(plate, fall, grid_f, seen, n, swing, arm, v_0, omega)
        begun = rise.needed * shut_r + fall.needed * shut_f
        news = Harmonics(
            a_1 * (r.h_1 + turned * f.h_1) - w.h_1,
            a_2 * (r.h_2 + f.h_2) - w.h_2,
            a_3 * (r.h_3 + turned * f.h_3) - w.h_3,
            a_4 * (r.h_4 + f.h_4) - w.h_4,
        )
        following = _sum(w, _RELAXATION, news)
        if k > 0:
            # two rounds show where the news would vanish (Anderson's method of depth one)
            less = _sum(news, -1.0, news_before)
            back = _product(less, news) / max(_product(less, less), 1.0e-30)
            back = min(max(back, -1.0), 1.0)
            following = _sum(following, -back, _sum(_sum(w, -1.0, before), _RELAXATION, less))
        before, news_before, w = w, news, following
    shut = _turn(n * (plate.phi_commutation - plate.phi_seal))
    drawn = begun + arm * _tilted(w, shut, turned, n * omega)
    p_1, p_2 = w.h_1 * _fluid(support, n * omega), w.h_2 * _fluid(support, 2.0 * n * omega)
    p_3, p_4 = w.h_3 * _fluid(support, 3.0 * n * omega), w.h_4 * _fluid(support, 4.0 * n * omega)
    power = p_1.real**2 + p_1.imag**2 + p_2.real**2 + p_2.imag**2
    power += p_3.real**2 + p_3.imag**2 + p_4.real**2 + p_4.imag**2
    return Commutations(rising, falling, math.sqrt(0.5 * power), drawn)
