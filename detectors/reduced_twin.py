"""The pressures that a pump with this state shows, in closed form around an anchor, with every slope.

Discharge minus case pressure is set by the compensator: nominal value, setting, and the droop that every flow out of
the high-pressure side costs. From it follow the leakages by their own laws, from their sum the drops of drain and
return line. What it leaves out against the operating point is second order in the droop and is bounded by a test.
"""

import numpy as np
from numpy.typing import NDArray

from detectors import components as c
from detectors.anchor import COLUMN
from twin.compiled import compiled
from twin.laws.bench import drain_pressure_drop, return_pressure_drop

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
_K_INF, _K, _GAMMA = COLUMN["return_coefficient"], COLUMN["return_constant"], COLUMN["return_exponent"]
_SHARED, _SLIPPER_LAW, _LAMINAR_LAW = COLUMN["shared"], COLUMN["slipper_law"], COLUMN["laminar_law"]
_SYSTEM_LAW, _WARMTH = COLUMN["system_law"], COLUMN["warmth"]

_COUNTED = 175.0
"""Pressure difference at which leaks of the circuit and throttled leakage are counted [bar]."""
_SLIPPER_VISCOSITY = 0.5
"""Exponent of slipper leakage in viscosity: between its land (1) and its throttle (0)."""
N_OUTPUTS = 2


@compiled
def pressures(anchor: Array, full: Array, y: Array, slopes: Array) -> float:
    """Discharge and case pressure without sensor offsets [bar gauge] into ``y``, shape (2,); case flow [L/min].

    ``anchor`` is one row of ``detectors.anchor``; ``full`` the components of ``detectors.components``, shape (N,);
    ``slopes``, shape (2, N), receives the derivatives.
    """
    N = c.N_COMPONENTS
    e_s = np.exp(full[c.LN_SLIPPER] - _SLIPPER_VISCOSITY * full[c.LN_VISCOSITY])
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
    h = 1.0e-3
    drop_i = return_pressure_drop(Q_i, anchor[_K_INF], anchor[_K], anchor[_GAMMA])
    R_i = (return_pressure_drop(Q_i + h, anchor[_K_INF], anchor[_K], anchor[_GAMMA]) - drop_i) / h
    if shared < 0.5:
        drop_i, R_i = 0.0, 0.0
    k_c = anchor[_DRAIN] * np.exp(full[c.LN_DRAIN])
    w_nu, w_Q = anchor[_W_NU] + full[c.DRAIN_VISCOSITY], anchor[_W_Q] + full[c.DRAIN_FLOW]
    nu = anchor[_NU] * np.exp(full[c.LN_VISCOSITY])
    drop_c = drain_pressure_drop(Q_c, k_c, w_nu, w_Q, nu, anchor[_Q_REF])
    R_c = k_c * (w_nu * nu + 2.0 * w_Q * abs(Q_c) / anchor[_Q_REF] + 1.0 - w_nu - w_Q)
    P_c = anchor[_P_R] + full[c.RESERVOIR] + drop_i + drop_c + anchor[_WARMTH] * full[c.CASE_WARMTH]
    y[0], y[1] = P_c + D, P_c

    Q_c_by_D = (slip + lam) / D_0 + 0.5 * throttled / (root * D_0)
    Q_sys_by_D = 0.5 * sys_o / (np.sqrt(share) * _COUNTED) + sys_l * law_sys / _COUNTED
    for i in range(N):
        dD, dQ, dC, dS, direct = 0.0, 0.0, 0.0, 0.0, 0.0
        if i == c.LN_SLIPPER:
            dQ = slip_0 * e_s
            dD = d * anchor[_BY_SLIPPERS] * dQ
            dC = anchor[_C_SLIPPERS] * dQ
        elif i == c.LN_LAMINAR:
            dQ = lam_0 * e_l
            dD = d * anchor[_BY_LAMINAR] * dQ
            dC = anchor[_C_LAMINAR] * dQ
        elif i == c.SLIPPER_EXTRA:
            dQ = anchor[_SLIPPER_LAW]
            dD = d * anchor[_BY_SLIPPERS] * dQ
            dC = anchor[_C_SLIPPERS] * dQ
        elif i == c.LAMINAR_EXTRA:
            dQ = anchor[_LAMINAR_LAW]
            dD = d * anchor[_BY_LAMINAR] * dQ
            dC = anchor[_C_LAMINAR] * dQ
        elif i == c.THROTTLED:
            dD = d * anchor[_BY_THROTTLED]
            dC = root + anchor[_C_THROTTLED]
        elif i == c.BLEED:
            dD = d * anchor[_BY_BLEED]
            dC = anchor[_C_BLEED]
        elif i == c.SYSTEM_ORIFICE:
            dD = d * anchor[_BY_SYSTEM]
            dC = anchor[_C_SYSTEM]
            dS = np.sqrt(share)
        elif i == c.SYSTEM_LAMINAR:
            dD = d * anchor[_BY_SYSTEM] * law_sys
            dC = anchor[_C_SYSTEM] * law_sys
            dS = law_sys * share
        elif i == c.SETTING:
            dD = set_by
            dC = anchor[_C_SETTING]
        elif i == c.SOFTENING:
            dD = anchor[_WARMTH]
        elif i == c.LN_DROOP:
            dD = d * (anchor[_DROOP] + sagging + (anchor[_BY_SETTING] - 1.0) * full[c.SETTING])
        elif i == c.LN_DRAIN:
            direct = drop_c
        elif i == c.DRAIN_VISCOSITY:
            direct = k_c * Q_c * (nu - 1.0)
        elif i == c.DRAIN_FLOW:
            direct = k_c * Q_c * (abs(Q_c) / anchor[_Q_REF] - 1.0)
        elif i == c.RESERVOIR:
            direct = 1.0
        elif i == c.CASE_WARMTH:
            direct = anchor[_WARMTH]
        elif i == c.LN_VISCOSITY:
            dQ = -_SLIPPER_VISCOSITY * slip_0 * e_s - lam_0 * e_l
            dD = d * (
                -_SLIPPER_VISCOSITY * anchor[_BY_SLIPPERS] * slip_0 * e_s
                - anchor[_BY_LAMINAR] * lam_0 * e_l
                - anchor[_BY_SYSTEM] * law_sys * sys_l
            )
            dC = (
                -_SLIPPER_VISCOSITY * anchor[_C_SLIPPERS] * slip_0 * e_s
                - anchor[_C_LAMINAR] * lam_0 * e_l
                - anchor[_C_SYSTEM] * law_sys * sys_l
            )
            dS = -law_sys * sys_l * share
            direct = k_c * Q_c * w_nu * nu
        case_flow = r * dQ + dC + Q_c_by_D * dD
        dP_c = R_i * (dS + Q_sys_by_D * dD + shared * case_flow) + R_c * case_flow + direct
        slopes[0, i] = dP_c + dD
        slopes[1, i] = dP_c
    return float(Q_c)


def nominal_pressures(anchor: Array) -> tuple[float, float]:
    """Discharge and case pressure of the nominal healthy pump at an anchor [bar gauge]."""
    y = np.empty(2)
    pressures(anchor, np.zeros(c.N_COMPONENTS), y, np.empty((2, c.N_COMPONENTS)))
    return float(y[0]), float(y[1])
