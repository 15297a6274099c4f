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


class _Chamber(NamedTuple):
    """A changing chamber over angle, each over the fluid that the change needs [1/rad].

    What its turning moves per sine of the angle, its leakage, what its tilting moves per rate of the tilt, and what an
    open port lets through at the full pressure difference, halved.
    """

    turned: float
    leak: float
    tilted: float
    port: float
    leak_start: float
    bend: float
    low: float


@compiled
def _turn(angle: float) -> complex:
    return complex(math.cos(angle), math.sin(angle))


@compiled
def _span(plate: PortPlate, needed: float, v_0: float, omega: float) -> float:
    """Angle that the opening port alone needs to fill a chamber [rad], with a margin."""
    filling = 2.0 * needed * plate.phi_ramp**2 * omega / (plate.C_q * plate.A_port * v_0)
    return min(1.2 * math.pow(filling, 1.0 / 3.0), 0.6 * plate.phi_ramp)


@compiled
def _fluid_share(bend: float, p: float) -> float:
    """Share of a change's fluid by its share of pressure."""
    return (1.0 + bend) * p / (1.0 + bend * p)


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
def _chamber(plate: PortPlate, change: Change, swing: float, arm: float, v_0: float, omega: float) -> _Chamber:
    per = 1.0 / ((1.0 + change.bend) * change.needed * omega)
    port = 0.5 * plate.C_q * plate.A_port * v_0 * per
    return _Chamber(swing * omega * per, change.leak * per, arm * per, port, change.leak_start, change.bend, change.low)


@compiled
def _moved(c: _Chamber, p: float, sine: float, rate: float) -> float:
    """Share that turning, leakage and tilting move [1/rad]."""
    return c.turned * sine + c.leak * (c.leak_start - p) - c.tilted * rate


@compiled
def _while_closing(c: _Chamber, p: float, moved: float, open_angle: float, implicit: bool) -> float:
    """Growth of the share in a substep while the old port still takes back what moves."""
    b = c.port * open_angle
    left = p + moved
    if not implicit:
        # by the mean of both ends: the port no longer holds the chamber
        left -= b * math.copysign(math.sqrt(abs(p)), p)
        b *= 0.5
    root = math.sqrt(b * b + abs(left)) - b
    return (min(root * root, 0.98) if left > 0.0 else max(-root * root, c.low)) - p


@compiled
def _while_closed(c: _Chamber, p: float, moved: float) -> float:
    """Growth of the share in a substep while both ports are shut."""
    g = 1.0 + c.bend * p
    g += 0.5 * c.bend * moved * g * g
    return min(max(moved * g * g, c.low - p), 0.98 - p)


@compiled
def _while_opening(
    c: _Chamber, p: float, moved: float, u_a: float, u_b: float, ramp: float, middle: float
) -> tuple[float, float]:
    """Growth of the share in a substep while the next port opens from u_a to u_b ramps, and its lag.

    Half of what moves, then the port alone, which lets the root of what is left fall, then the other half. The lag is
    the part that came through the port times its mean angle past ``middle`` [rad].
    """
    g = 1.0 + c.bend * p
    moved *= 0.5 * g * g
    done = min(p + moved, 1.0)
    b = c.port * ramp * (_opened(u_b) - _opened(u_a))
    r_0 = math.sqrt(1.0 - done)
    r_1 = max(r_0 - 0.5 * b, 0.0)
    g = 1.0 + c.bend * (1.0 - r_1 * r_1)
    b *= g * g
    r_1 = max(r_0 - b, 0.0)
    late = 0.0
    if r_0 > 0.0:
        if r_1 == 0.0:
            v_a = u_a * u_a * u_a
            u_b = math.pow(v_a + (u_b * u_b * u_b - v_a) * r_0 / b, 1.0 / 3.0)
        late = (r_0 * r_0 - r_1 * r_1) * (ramp * _centre(u_a, u_b, r_0, r_1) - middle)
    return min(1.0 - r_1 * r_1 + moved, 1.0) - p, late


@compiled
def _changes(
    plate: PortPlate, rise: _Chamber, fall: _Chamber, grid: _Grid, w: Harmonics, n: float, turned: float
) -> tuple[float, float, float, float, Harmonics]:
    """Mean angles of both changes of pressure, shares done when the old ports have shut, moments of both together.

    The share p that is done follows from the chamber's balance over angle, ``needed omega ds/dphi = swing omega sin(phi)
    + leak (leak_start - p) - arm w(phi)`` plus what the ports let through, s being the fluid's share: the closing port
    ``-C_q A v_0 sqrt(p)``, the opening one ``C_q A v_0 sqrt(1 - p)``.
    """
    first = plate.phi_commutation - plate.phi_seal
    last = plate.phi_commutation + plate.phi_seal
    ramp, per_ramp = plate.phi_ramp, 1.0 / plate.phi_ramp
    p = q = rising = falling = shut_p = shut_q = 0.0
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
        # leakage as in the middle of a substep
        d_p, d_q = d / (1.0 + 0.5 * rise.leak * d), d / (1.0 + 0.5 * fall.leak * d)
        for k in range(count):
            z_2 = z * z
            z_3, z_4 = z * z_2, z_2 * z_2
            odd, even = (w.h_1 * z + w.h_3 * z_3).real, (w.h_2 * z_2 + w.h_4 * z_4).real
            # the sine by its series: within 1e-5 here
            sine = phi - phi * phi * phi / 6.0
            moved_p = d_p * _moved(rise, p, sine, even + odd)
            moved_q = d_q * _moved(fall, q, sine, even + turned * odd)
            late_p = late_q = 0.0
            if stretch == 0:
                u = (first - phi) * per_ramp
                open_angle = d * u * u * (3.0 - 2.0 * u)
                dp = _while_closing(rise, p, moved_p, open_angle, k == 0)
                dq = _while_closing(fall, q, moved_q, open_angle, k == 0)
            elif stretch == 1:
                dp, dq = _while_closed(rise, p, moved_p), _while_closed(fall, q, moved_q)
            else:
                u_a, u_b, middle = k * d * per_ramp, (k + 1.0) * d * per_ramp, phi - last
                dp, late_p = _while_opening(rise, p, moved_p, u_a, u_b, ramp, middle)
                dq, late_q = _while_opening(fall, q, moved_q, u_a, u_b, ramp, middle)
            p += dp
            q += dq
            rising += dp * phi + late_p
            falling += dq * phi + late_q
            both, apart = dp + dq, dp + turned * dq
            late, parted = n * (late_p + late_q), n * (late_p + turned * late_q)
            m_1 += z * complex(apart, parted)
            m_2 += z_2 * complex(both, 2.0 * late)
            m_3 += z_3 * complex(apart, 3.0 * parted)
            m_4 += z_4 * complex(both, 4.0 * late)
            z *= whole
            phi += d
        if stretch == 0:
            shut_p, shut_q = p, q
        phi -= 0.5 * d
        boundary = z * half.conjugate()
    # what is left after the span
    both, apart = 2.0 - p - q, 1.0 - p + turned * (1.0 - q)
    z = boundary
    z_2 = z * z
    m_1 += apart * z
    m_2 += both * z_2
    m_3 += apart * (z * z_2)
    m_4 += both * (z_2 * z_2)
    moments = Harmonics(m_1.conjugate(), m_2.conjugate(), m_3.conjugate(), m_4.conjugate())
    return rising + (1.0 - p) * phi, falling + (1.0 - q) * phi, shut_p, shut_q, moments


@compiled
def _power(support: Support, w: float, rate: complex) -> float:
    """Square of the control pressure's amplitude [Pa2] by the tilt rate's at the angular frequency w."""
    g, s = support.conductance, w * support.capacity
    return support.arm * support.arm * (rate.real * rate.real + rate.imag * rate.imag) / (g * g + s * s)


@compiled
def _answer(support: Support, n: float, torque: float, omega: float, m: float) -> complex:
    """Tilt rate at m n times the shaft's speed, per sum of both changes' moments [rad/s].

    A torque that jumps by ``torque`` at each change and runs as a cosine between them.
    """
    q = m * n
    w = q * omega
    g, s = support.conductance, w * support.capacity
    spring = support.arm * support.arm / (g * g + s * s)
    real = support.damping + spring * g
    imaginary = support.J * w - support.stiffness / w - spring * s
    push = -n / math.pi * torque * q / ((q * q - 1.0) * (real * real + imaginary * imaginary))
    return complex(push * imaginary, push * real)


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
    # a chamber at its outer dead centre takes longer to fill than one at its inner to empty
    span = _span(plate, rise.needed, v_0, omega)
    grid = _Grid(first, closing, closed, _turn(0.5 * n * span / _OPENING), span)
    filled, emptied = _chamber(plate, rise, swing, arm, v_0, omega), _chamber(plate, fall, swing, arm, v_0, omega)
    # first guess: both changes at once, early in the opening of the port, spread as widely as the seal
    z = _turn(-n * (plate.phi_commutation + plate.phi_seal + 0.2 * span))
    g, z_2, both = math.exp(-0.5 * (n * plate.phi_seal) ** 2), z * z, 1.0 + turned
    g_4 = g * g * g * g
    w = Harmonics(
        a_1 * (both * g * z), a_2 * (2.0 * g_4 * z_2), a_3 * (both * g_4 * g_4 * g * z * z_2),
        a_4 * (2.0 * g_4 * g_4 * g_4 * g_4 * z_2 * z_2),
    )  # fmt: skip
    rising = falling = shut_r = shut_f = 0.0
    before, news_before = w, w
    for k in range(_ROUNDS):
        rising, falling, shut_r, shut_f, m = _changes(plate, filled, emptied, grid, w, n, turned)
        news = Harmonics(a_1 * m.h_1 - w.h_1, a_2 * m.h_2 - w.h_2, a_3 * m.h_3 - w.h_3, a_4 * m.h_4 - w.h_4)
        following = _sum(w, _RELAXATION, news)
        if k > 0:
            # two rounds show where the news would vanish (Anderson's method of depth one)
            less = _sum(news, -1.0, news_before)
            back = _product(less, news) / max(_product(less, less), 1.0e-30)
            back = min(max(back, -1.0), 1.0)
            following = _sum(following, -back, _sum(_sum(w, -1.0, before), _RELAXATION, less))
        before, news_before, w = w, news, following
    shut = _turn(n * (plate.phi_commutation - plate.phi_seal))
    drawn = rise.needed * _fluid_share(rise.bend, shut_r) + fall.needed * _fluid_share(fall.bend, shut_f)
    drawn += arm * _tilted(w, shut, turned, n * omega)
    power = _power(support, n * omega, w.h_1) + _power(support, 2.0 * n * omega, w.h_2)
    power += _power(support, 3.0 * n * omega, w.h_3) + _power(support, 4.0 * n * omega, w.h_4)
    return Commutations(rising, falling, math.sqrt(0.5 * power), drawn)
