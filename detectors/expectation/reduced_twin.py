"""The pressures that a pump with this state shows, in closed form around an anchor, with every slope.

Discharge minus case pressure is set by the compensator: nominal value, setting, and the droop that every flow out of
the high-pressure side costs. From it follow the leakages by their own laws, from their sum the drops of drain and
return line. The case's fluid is the cooler the more of it flows, for friction warms it: the drain's viscous part knows that.
What it leaves out against the operating point is second order in flows and droop and is bounded by a test.
"""

import numpy as np
from numpy.typing import NDArray

from detectors.expectation import components as c
from detectors.expectation.anchor import COLUMN
from twin.compiled import compiled
from twin.laws.lines import drain_pressure_drop, return_pressure_drop_with_slope
from twin.numbers import ZERO_FLOW_BAR

Array = NDArray[np.float64]

_D, _P_R, _Q_L = COLUMN["regulated_difference"], COLUMN["reservoir"], COLUMN["load_flow"]
_SLIPPER, _LAMINAR, _COMP = COLUMN["slipper_flow"], COLUMN["laminar_flow"], COLUMN["compensator_flow"]
_DROOP, _BY_SLIPPERS, _BY_LAMINAR = COLUMN["droop"], COLUMN["by_slippers"], COLUMN["by_laminar"]
_BY_THROTTLED, _BY_SYSTEM, _BY_BLEED = COLUMN["by_throttled"], COLUMN["by_system"], COLUMN["by_bleed"]
_BY_SETTING, _DRAIN, _W_NU = COLUMN["by_setting"], COLUMN["drain"], COLUMN["drain_weight_viscosity"]
_C_SLIPPERS, _C_LAMINAR = COLUMN["compensator_by_slippers"], COLUMN["compensator_by_laminar"]
_C_THROTTLED, _C_SYSTEM = COLUMN["compensator_by_throttled"], COLUMN["compensator_by_system"]
_C_BLEED, _C_SETTING = COLUMN["compensator_by_bleed"], COLUMN["compensator_by_setting"]
_W_Q, _Q_REF, _NU = COLUMN["drain_weight_flow"], COLUMN["drain_flow"], COLUMN["viscosity_ratio"]
_FRICTION, _HEAT_FLOW = COLUMN["friction_warmth"], COLUMN["heat_flow"]
_K_INF, _K, _GAMMA = COLUMN["return_coefficient"], COLUMN["return_constant"], COLUMN["return_exponent"]
_SHARED, _SLIPPER_LAW, _LAMINAR_LAW = COLUMN["shared"], COLUMN["slipper_law"], COLUMN["laminar_law"]
_SYSTEM_LAW, _WARMTH = COLUMN["system_law"], COLUMN["warmth"]

_COUNTED = ZERO_FLOW_BAR
"""Pressure difference at which leaks of the circuit and throttled leakage are counted [bar]."""
SLIPPER_VISCOSITY = 0.9
"""Exponent of slipper leakage in viscosity: between its land (1) and its throttle (0); the operating point of the H225 has 0.88
to 0.92 from 40 to 90 degC."""
_LEAST_WEIGHT = 0.1
_AT = c.PLACES
_UNSEEN = (c.CASE_OFFSET, c.LN_RIPPLE, c.LN_CASE_RIPPLE, c.ONCE, c.CASE_RIPPLE_WARMTH, c.ANSWER, c.CASE_SPAN)
"""Components that move neither pressure."""
_UNMOVED = (*(_AT[i] for i in (c.LOAD_DISCHARGE, c.LOAD_DISCHARGE_SQUARE, *_UNSEEN)), c.AMPLITUDE, c.RATE, c.LAW)
"""Places of all that does not move the case pressure."""


@compiled
def _weight(own: float) -> tuple[float, float]:
    """A weight of the drain's law and its slope: itself, but never far below zero, for a drain cannot push."""
    if own >= 0.0:
        return own, 1.0
    shrunk = np.exp(own / _LEAST_WEIGHT)
    return _LEAST_WEIGHT * (shrunk - 1.0), shrunk


@compiled
def _slope(
    slopes: Array,
    i: int,
    by: tuple[float, float, float, float, float, float],
    gaps: float,
    difference: float,
    other: float,
    circuit: float,
    direct: float,
) -> None:
    """Carry what a component moves at first hand on to both pressures and the case flow.

    Leakage of the gaps at the anchor, regulated difference, other case flow, leak of the circuit, and case pressure
    itself; ``by`` is how they hang together: the regulated difference over its anchor, the slopes of case flow and of
    the circuit's leak by it, the share of the case flow in the return line, the slopes of return and drain line.
    """
    r, Q_c_by_D, Q_sys_by_D, shared, R_i, R_c = by
    flow = r * gaps + other + Q_c_by_D * difference
    case = R_i * (circuit + Q_sys_by_D * difference + shared * flow) + R_c * flow + direct
    slopes[0, i], slopes[1, i], slopes[2, i] = case + difference, case, flow


@compiled
def pressures(anchor: Array, full: Array, y: Array, slopes: Array) -> float:
    """Discharge and case pressure without sensor offsets [bar gauge] into ``y``, shape (2,); case flow [L/min].

    ``anchor`` is one row of ``detectors.expectation.anchor``; ``full`` the components of ``detectors.expectation.components``, shape (N,);
    ``slopes``, shape (3, N_PLACES) or larger, receives the derivatives of both and of the case flow, each component's in its
    place of a state; nothing where a state holds its fault.
    """
    e_s = np.exp(full[c.LN_SLIPPER] - SLIPPER_VISCOSITY * full[c.LN_VISCOSITY])
    e_l = np.exp(full[c.LN_LAMINAR] - full[c.LN_VISCOSITY])
    d = np.exp(full[c.LN_DROOP])
    throttled = full[c.THROTTLED]
    bleed, sys_o, sys_l = full[c.BLEED], full[c.SYSTEM_ORIFICE], full[c.SYSTEM_LAMINAR]
    slip_0, lam_0 = anchor[_SLIPPER], anchor[_LAMINAR]
    thin = np.exp(-full[c.LN_VISCOSITY])
    slip = slip_0 * e_s + anchor[_SLIPPER_LAW] * full[c.SLIPPER_EXTRA]
    lam = lam_0 * e_l + anchor[_LAMINAR_LAW] * full[c.LAMINAR_EXTRA]
    law_sys = anchor[_SYSTEM_LAW] * thin
    sagging = (
        anchor[_BY_SLIPPERS] * (slip - slip_0)
        + anchor[_BY_LAMINAR] * (lam - lam_0)
        + anchor[_BY_THROTTLED] * throttled
        + anchor[_BY_SYSTEM] * (sys_o + law_sys * sys_l)
        + anchor[_BY_BLEED] * bleed
    )
    D_0 = anchor[_D]
    set_by = 1.0 + d * (anchor[_BY_SETTING] - 1.0)
    D = D_0 + set_by * full[c.SETTING] + anchor[_WARMTH] * full[c.SOFTENING] + (d - 1.0) * anchor[_DROOP] + d * sagging
    D = max(D, 0.05 * D_0)
    r = D / D_0
    root = np.sqrt(r)
    compensator = (
        anchor[_COMP]
        + anchor[_C_SLIPPERS] * (slip - slip_0)
        + anchor[_C_LAMINAR] * (lam - lam_0)
        + anchor[_C_THROTTLED] * throttled
        + anchor[_C_SYSTEM] * (sys_o + law_sys * sys_l)
        + anchor[_C_BLEED] * bleed
        + anchor[_C_SETTING] * full[c.SETTING]
    )
    Q_c = r * (slip + lam) + root * throttled + max(compensator, 0.0)
    share = D / _COUNTED
    Q_sys = sys_o * np.sqrt(share) + sys_l * law_sys * share
    shared = anchor[_SHARED]
    Q_i = anchor[_Q_L] + Q_sys + shared * Q_c
    drop_i, R_i = 0.0, 0.0
    if shared >= 0.5:
        drop_i, R_i = return_pressure_drop_with_slope(Q_i, anchor[_K_INF], anchor[_K], anchor[_GAMMA])
    k_c = anchor[_DRAIN] * np.exp(full[c.LN_DRAIN])
    w_nu, nu_by = _weight(anchor[_W_NU] + full[c.DRAIN_VISCOSITY])
    w_Q, Q_by = _weight(anchor[_W_Q] + full[c.DRAIN_FLOW])
    # the less flows, the warmer the shaft's friction makes it
    carries, carried = max(Q_c, 0.0) + anchor[_HEAT_FLOW], slip_0 + lam_0 + anchor[_COMP] + anchor[_HEAT_FLOW]
    nu = anchor[_NU] * np.exp(full[c.LN_VISCOSITY] + anchor[_FRICTION] * (1.0 - carried / carries))
    cooled = anchor[_FRICTION] * carried / carries**2 if Q_c > 0.0 else 0.0
    # what clogs the drain adds a resistance with the drain's own law, a filter's (viscous) or a narrowed fitting's
    flow_ratio, whole = abs(Q_c) / anchor[_Q_REF], 1.0 + full[c.DRAIN_EXTRA]
    viscous, orifice = k_c * full[c.DRAIN_VISCOUS] * nu, k_c * full[c.DRAIN_ORIFICE] * flow_ratio
    own = drain_pressure_drop(Q_c, k_c, w_nu, w_Q, nu, anchor[_Q_REF])
    drop_c = whole * own + (viscous + orifice) * Q_c
    thick = whole * k_c * w_nu * nu + viscous
    R_c = thick * (1.0 + Q_c * cooled) + whole * k_c * (2.0 * w_Q * flow_ratio + 1.0 - w_nu - w_Q) + 2.0 * orifice
    P_c = anchor[_P_R] + full[c.RESERVOIR] + drop_i + drop_c + anchor[_WARMTH] * full[c.CASE_WARMTH]
    load = anchor[_Q_L] / c.LOAD_LPM
    P_c += load * (full[c.LOAD_CASE] + load * full[c.LOAD_CASE_SQUARE] + anchor[_WARMTH] * full[c.LOAD_WARMTH])
    missed = load * (full[c.LOAD_DISCHARGE] + load * full[c.LOAD_DISCHARGE_SQUARE])
    y[0], y[1] = P_c + D + missed, P_c

    Q_c_by_D = (slip + lam) / D_0 + 0.5 * throttled / (root * D_0)
    Q_sys_by_D = 0.5 * sys_o / (np.sqrt(share) * _COUNTED) + sys_l * law_sys / _COUNTED
    # per unit of each component: leakage of the gaps at the anchor, regulated difference, other case flow, circuit's leak
    by = (r, Q_c_by_D, Q_sys_by_D, shared, R_i, R_c)
    b_s, b_l, b_sys = d * anchor[_BY_SLIPPERS], d * anchor[_BY_LAMINAR], d * anchor[_BY_SYSTEM]
    c_s, c_l, c_sys = anchor[_C_SLIPPERS], anchor[_C_LAMINAR], anchor[_C_SYSTEM]
    own_s, own_l = slip_0 * e_s, lam_0 * e_l
    law_s, law_l, leak_l = anchor[_SLIPPER_LAW], anchor[_LAMINAR_LAW], law_sys * sys_l
    droop = d * (anchor[_DROOP] + sagging + (anchor[_BY_SETTING] - 1.0) * full[c.SETTING])
    _slope(slopes, _AT[c.LN_SLIPPER], by, own_s, b_s * own_s, c_s * own_s, 0.0, 0.0)
    _slope(slopes, _AT[c.LN_LAMINAR], by, own_l, b_l * own_l, c_l * own_l, 0.0, 0.0)
    _slope(slopes, _AT[c.SLIPPER_EXTRA], by, law_s, b_s * law_s, c_s * law_s, 0.0, 0.0)
    _slope(slopes, _AT[c.LAMINAR_EXTRA], by, law_l, b_l * law_l, c_l * law_l, 0.0, 0.0)
    _slope(slopes, _AT[c.THROTTLED], by, 0.0, d * anchor[_BY_THROTTLED], root + anchor[_C_THROTTLED], 0.0, 0.0)
    _slope(slopes, _AT[c.BLEED], by, 0.0, d * anchor[_BY_BLEED], anchor[_C_BLEED], 0.0, 0.0)
    _slope(slopes, _AT[c.SYSTEM_ORIFICE], by, 0.0, b_sys, c_sys, np.sqrt(share), 0.0)
    _slope(slopes, _AT[c.SYSTEM_LAMINAR], by, 0.0, b_sys * law_sys, c_sys * law_sys, law_sys * share, 0.0)
    _slope(slopes, _AT[c.SETTING], by, 0.0, set_by, anchor[_C_SETTING], 0.0, 0.0)
    _slope(slopes, _AT[c.SOFTENING], by, 0.0, anchor[_WARMTH], 0.0, 0.0, 0.0)
    _slope(slopes, _AT[c.LN_DROOP], by, 0.0, droop, 0.0, 0.0, 0.0)
    _slope(slopes, _AT[c.LN_DRAIN], by, 0.0, 0.0, 0.0, 0.0, drop_c)
    _slope(slopes, _AT[c.DRAIN_EXTRA], by, 0.0, 0.0, 0.0, 0.0, own)
    _slope(slopes, _AT[c.DRAIN_VISCOUS], by, 0.0, 0.0, 0.0, 0.0, k_c * nu * Q_c)
    _slope(slopes, _AT[c.DRAIN_ORIFICE], by, 0.0, 0.0, 0.0, 0.0, k_c * flow_ratio * Q_c)
    _slope(slopes, _AT[c.DRAIN_VISCOSITY], by, 0.0, 0.0, 0.0, 0.0, whole * k_c * Q_c * (nu - 1.0) * nu_by)
    _slope(slopes, _AT[c.DRAIN_FLOW], by, 0.0, 0.0, 0.0, 0.0, whole * k_c * Q_c * (flow_ratio - 1.0) * Q_by)
    _slope(slopes, _AT[c.CASE_WARMTH], by, 0.0, 0.0, 0.0, 0.0, anchor[_WARMTH])
    _slope(slopes, _AT[c.RESERVOIR], by, 0.0, 0.0, 0.0, 0.0, 1.0)
    thinner_s, thinner_l = -SLIPPER_VISCOSITY * own_s, -own_l
    _slope(
        slopes,
        _AT[c.LN_VISCOSITY],
        by,
        thinner_s + thinner_l,
        b_s * thinner_s + b_l * thinner_l - b_sys * leak_l,
        c_s * thinner_s + c_l * thinner_l - c_sys * leak_l,
        -leak_l * share,
        thick * Q_c,
    )
    _slope(slopes, _AT[c.LOAD_CASE], by, 0.0, 0.0, 0.0, 0.0, load)
    _slope(slopes, _AT[c.LOAD_CASE_SQUARE], by, 0.0, 0.0, 0.0, 0.0, load * load)
    _slope(slopes, _AT[c.LOAD_WARMTH], by, 0.0, 0.0, 0.0, 0.0, load * anchor[_WARMTH])
    for i in _UNMOVED:
        slopes[0, i], slopes[1, i], slopes[2, i] = 0.0, 0.0, 0.0
    slopes[0, _AT[c.LOAD_DISCHARGE]], slopes[0, _AT[c.LOAD_DISCHARGE_SQUARE]] = load, load * load
    return float(Q_c)


def nominal_pressures(anchor: Array) -> tuple[float, float]:
    """Discharge and case pressure of the nominal healthy pump at an anchor [bar gauge]."""
    y = np.empty(2)
    pressures(anchor, np.zeros(c.N_COMPONENTS), y, np.empty((3, c.N_PLACES)))
    return float(y[0]), float(y[1])
