"""Where a metamodel of the slipper gap is fitted: states that a pump reaches, and a margin round them.

A box over seven axes is mostly empty: no pump has full tilt at zero flow. Operating points with constant gaps, over
conditions, loads, wear and circuits, say where the pump goes; what a variable gap moves is drawn on top.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from twin.condition import Condition, Health, input_rows
from twin.operating_point import operating_points
from twin.operating_point.validity import RESERVOIR_BAR_ABSOLUTE, SPEEDS, TEMPERATURES_DEGC, geometric_delivery
from twin.parameters import PumpType
from twin.parts.slipper_map import N_AXES, SPEED, SUCTION, TEMPERATURE, WEAR
from twin.pumps.circuits import CIRCUITS
from twin.units import PA_PER_BAR, RAD_PER_DEG, STANDARD_ATMOSPHERE_BAR

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

_SPEED, _WARM, _RESERVOIR, _LOAD, _WEAR, _GAP, _CIRCUIT, _SETTING, _DRAIN, _PRESSURE, _MORE, _TILTED = range(12)
"""Columns of the design."""
_IDLE, _FULL = 0.3, 0.85
"""Shares of the design's load up to which the flow is zero, and from which on the pump is fully tilted."""
_WEARS = (0.4, 6.0)
_GAPS_UM = (4.0, 13.0)
_RESERVOIR_BAR = 2.5
_SETTING_BAR, _DRAINS, _LOWEST_BAR = 8.0, (0.6, 1.8), 30.0
_FACTORS, _TILTS_DEG = (0.3, 1.3), (-1.0, 0.6)
"""Case over suction pressure, over that of the constant gap; tilt less that of the constant gap, where it delivers."""
_HIGHEST_OVER_BAR = 4.0


def places(kind: PumpType, n: int, seed: int) -> Matrix:
    """Points of ``twin.parts.slipper_map.AXES`` that a pump reaches, shape (n, N_AXES), from a Sobol sequence.

    Parameters
    ----------
    kind
        The pump type; its gaps are taken as constant here.
    n, seed
        How many, and which scrambling of the sequence: another seed gives points held out.
    """
    found: list[Vector] = []
    drawn = qmc.Sobol(12, rng=seed).random_base2(math.ceil(math.log2(3 * n)))
    for share in drawn:
        place = _place(kind, share)
        if place is not None:
            found.append(place)
        if len(found) == n:
            break
    return np.array(found).reshape(-1, N_AXES)


def bounds(kind: PumpType, drawn: Matrix) -> tuple[Vector, Vector]:
    """Lowest and highest value of every axis: those of the design, and of drawn points (m, N_AXES) where it has none."""
    low, high = drawn.min(axis=0), drawn.max(axis=0)
    designed = {
        SPEED: (SPEEDS[0] * kind.nominal_speed_rpm, SPEEDS[1] * kind.nominal_speed_rpm),
        SUCTION: (RESERVOIR_BAR_ABSOLUTE[0] - STANDARD_ATMOSPHERE_BAR, _RESERVOIR_BAR),
        TEMPERATURE: TEMPERATURES_DEGC,
        WEAR: (math.log(_WEARS[0]), math.log(_WEARS[1])),
    }
    for axis, (lowest, highest) in designed.items():
        low[axis], high[axis] = lowest, highest
    return low, high


def _between(share: float, bounds: tuple[float, float]) -> float:
    return bounds[0] + (bounds[1] - bounds[0]) * share


def _place(kind: PumpType, share: Vector) -> Vector | None:
    """A point of the axes by shares of the design in 0 to 1; None where the pump has no steady state."""
    speed = kind.nominal_speed_rpm * _between(share[_SPEED], SPEEDS)
    celsius = _between(share[_WARM], TEMPERATURES_DEGC)
    reservoir = _RESERVOIR_BAR * share[_RESERVOIR]
    full = 0.97 * geometric_delivery(kind.pump, speed)
    load = float(share[_LOAD])
    flow = 0.0 if load < _IDLE else (load - _IDLE) / (_FULL - _IDLE) * full
    k_d = 0.0
    if load > _FULL:
        setting = kind.limits["zero_flow_pressure_low_bar"].value
        k_d = _between(share[_PRESSURE], (_LOWEST_BAR, setting)) * PA_PER_BAR / (full / 60.0e3) ** 2
        flow = 0.0
    slipper = kind.pump.slipper._replace(variable=0.0, h=_between(share[_GAP], _GAPS_UM) * 1.0e-6)
    setting_change = _SETTING_BAR * (2.0 * share[_SETTING] - 1.0)
    health = Health(pressure_setting_change_bar=setting_change, drain_resistance_scale=_between(share[_DRAIN], _DRAINS))
    circuit = list(CIRCUITS.values())[int(share[_CIRCUIT] * len(CIRCUITS))]
    row = input_rows([Condition(speed, celsius, reservoir, flow)], [health])
    points = operating_points(kind.pump._replace(slipper=slipper), row, circuit, load_coefficient=k_d)
    if points.status[0] != 0:
        return None
    case = points.value("case_pressure_bar")[0]
    over_case = points.value("discharge_pressure_bar")[0] - case
    over_suction = (case - reservoir) * _between(share[_MORE], _FACTORS)
    tilt = points.value("swashplate_angle_deg")[0]
    top = kind.pump.swashplate.alpha_max / RAD_PER_DEG
    if load < _IDLE:
        # the leakage sets the tilt: any share of it, and a little more
        tilt *= _between(share[_TILTED], (0.3, 1.6))
    elif load < _FULL:
        tilt += _between(share[_TILTED], _TILTS_DEG)
    # the stop's own torque begins at the top
    tilt = min(max(tilt, -0.3), top - 1.0e-3)
    if over_suction > _HIGHEST_OVER_BAR:
        return None
    wear = math.log(_WEARS[0]) + math.log(_WEARS[1] / _WEARS[0]) * share[_WEAR]
    return np.array([tilt, speed, over_case, over_suction, reservoir, celsius, wear])
