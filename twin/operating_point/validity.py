"""What of an operating point lies outside what the twin was held against: solved all the same, and said by name.

An answer is one of three: inside, outside (``outside`` names the quantities), or none (``problem``).
"""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from twin.condition import INPUTS, OperatingPoints
from twin.laws.fluid import P_ATMOSPHERE, density
from twin.parameters import Pump, PumpType
from twin.slipper_maps import is_inside, stored_map
from twin.units import (
    KELVIN_AT_0_DEGC,
    M3_PER_S_PER_LPM,
    PA_PER_BAR,
    RAD_PER_DEG,
    RAD_PER_S_PER_RPM,
    STANDARD_ATMOSPHERE_BAR,
)

SPEEDS = (0.2, 1.2)
"""Of the nominal speed: the test matrix of annex A-1 runs from 920 to 5500 rpm, and so do the comparisons with CVODE."""
TEMPERATURES_DEGC = (20.0, 100.0)
"""Measured at 50, 63 and 100 degC; the operating point is held against the transient from 20 to 100."""
RESERVOIR_BAR_ABSOLUTE = (1.0, 2.5 + STANDARD_ATMOSPHERE_BAR)
"""Measured with the tank open and at 2.5 bar (tables 3-10 and 3-11; annex A-1: 1.0 and 3.5)."""
OVER_SETTING = 1.2
"""Largest discharge pressure over the upper limit of the setting: estimate, nothing above it was measured at rest."""
AIR_RELEASE_BAR = 0.3
"""Absolute pressure in a filling chamber below which air comes out of the oil: estimate; the sets know no suction line."""
VARIABLE_GAP = "slipper.variable"
"""Named where a set's slipper gap follows from the forces and no metamodel was fitted to its numbers: the operating point
takes the constant ``slipper.h`` instead."""
GAP_MODEL = "slipper.metamodel"
"""Named where the metamodel of a set's variable gap is asked beyond the runs that it was fitted to."""
SUCTION = "suction_pressure_bar"
"""Named where a chamber cannot fill: too fast, too far tilted, too little pressure behind it."""


def validated(kind: PumpType) -> Mapping[str, tuple[float, float]]:
    """Lowest and highest value that a pump type was held against, by quantity.

    Names and units are those of conditions and outputs, but for ``reservoir_pressure_bar`` and
    ``suction_pressure_bar``, which are absolute, and ``case_pressure_bar``, which counts from the reservoir's.
    """
    low, high = SPEEDS
    unlimited = math.inf
    return {
        "speed_rpm": (low * kind.nominal_speed_rpm, high * kind.nominal_speed_rpm),
        "fluid_temperature_degc": TEMPERATURES_DEGC,
        "reservoir_pressure_bar": RESERVOIR_BAR_ABSOLUTE,
        "discharge_flow_lpm": (0.0, geometric_delivery(kind.pump, kind.nominal_speed_rpm)),
        "discharge_pressure_bar": (-unlimited, OVER_SETTING * kind.limits["zero_flow_pressure_high_bar"].value),
        "case_pressure_bar": (-unlimited, kind.limits["case_pressure_limit_bar"].value),
        "case_flow_lpm": (0.0, unlimited),
        SUCTION: (AIR_RELEASE_BAR, unlimited),
    }


def geometric_delivery(pump: Pump, speed_rpm: float) -> float:
    """Swept volume at full tilt times speed [L/min]: what no leakage and no compressibility would leave."""
    piston = pump.piston
    stroke = 2.0 * piston.R * math.tan(pump.swashplate.alpha_max)
    swept = piston.n * 0.25 * math.pi * piston.d_p**2 * stroke
    return swept * speed_rpm / 60.0 / M3_PER_S_PER_LPM


def suction_pressure(pump: Pump, points: OperatingPoints) -> NDArray[np.float64]:
    """Lowest absolute pressure in a filling chamber [bar], shape (n,); below zero it cannot fill as fast as it grows.

    The reservoir's pressure less what the port takes at the piston's fastest, mid-stroke (equation 2-3). It is an upper
    bound: the suction line before the port, which takes more, is no part of a circuit.
    """
    rows = points.inputs
    omega = rows[:, _INPUT["speed_rpm"]] * RAD_PER_S_PER_RPM
    tilt = points.value("swashplate_angle_deg") * RAD_PER_DEG
    speed = pump.piston.R * np.tan(np.abs(tilt)) * omega
    area = 0.25 * math.pi * pump.piston.d_p**2
    through = speed * area / (pump.port_plate.C_q * pump.port_plate.A_port)
    rho = np.array(
        [density(pump.fluid, T + KELVIN_AT_0_DEGC, P_ATMOSPHERE) for T in rows[:, _INPUT["fluid_temperature_degc"]]]
    )
    found: NDArray[np.float64] = _reservoir(rows) - 0.5 * rho * through**2 / PA_PER_BAR
    return found


def outside(kind: PumpType, points: OperatingPoints) -> tuple[tuple[str, ...], ...]:
    """Names of the quantities of each point that lie outside what was validated, shape (n,) of tuples.

    Empty for a point inside; empty as well for a point without a solution, of which ``problem`` speaks.
    """
    rows = points.inputs
    reservoir = _reservoir(rows)
    shown: dict[str, NDArray[np.float64]] = {
        "speed_rpm": rows[:, _INPUT["speed_rpm"]],
        "fluid_temperature_degc": rows[:, _INPUT["fluid_temperature_degc"]],
        "reservoir_pressure_bar": reservoir,
        "discharge_flow_lpm": points.value("discharge_flow_lpm"),
        "discharge_pressure_bar": points.value("discharge_pressure_bar"),
        "case_pressure_bar": points.value("case_pressure_bar") - rows[:, _INPUT["reservoir_pressure_bar"]],
        "case_flow_lpm": points.value("case_flow_lpm"),
        SUCTION: suction_pressure(kind.pump, points),
    }
    ranges = validated(kind)
    # rounding of a unit's conversion is no excursion
    beyond = {
        name: ~((values >= ranges[name][0] - 1.0e-9) & (values <= ranges[name][1] + 1.0e-9))
        for name, values in shown.items()
    }
    gaps = _gap_words(kind.pump, points)
    return tuple(
        (*(name for name in beyond if beyond[name][i]), *gaps[i]) if points.status[i] == 0 else ()
        for i in range(len(points))
    )


def _gap_words(pump: Pump, points: OperatingPoints) -> list[tuple[str, ...]]:
    """What is to be said of each point's slipper gap, length n."""
    n = len(points)
    if pump.slipper.variable < 0.5:
        return [()] * n
    stored = stored_map(pump)
    if stored is None:
        return [(VARIABLE_GAP,)] * n
    rows = points.inputs
    case = points.value("case_pressure_bar")
    reservoir = rows[:, _INPUT["reservoir_pressure_bar"]]
    wear = np.log(rows[:, _INPUT["pump_leakage_scale"]] * rows[:, _INPUT["slipper_leakage_scale"]])
    axes = np.column_stack(
        [
            points.value("swashplate_angle_deg"),
            rows[:, _INPUT["speed_rpm"]],
            points.value("discharge_pressure_bar") - case,
            case - reservoir,
            reservoir,
            rows[:, _INPUT["fluid_temperature_degc"]],
            wear,
        ]
    )
    # the stop's own torque begins at the top, so that no run stands exactly there
    axes[:, 0] = np.minimum(axes[:, 0], stored.model.high[0])
    ambient = rows[:, _INPUT["ambient_pressure_bar"]]
    return [() if is_inside(pump, stored, axes[i], float(ambient[i])) else (GAP_MODEL,) for i in range(n)]


_INPUT = {name: i for i, name in enumerate(INPUTS)}


def _reservoir(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Absolute reservoir pressure [bar], shape (n,)."""
    found: NDArray[np.float64] = rows[:, _INPUT["reservoir_pressure_bar"]] + rows[:, _INPUT["ambient_pressure_bar"]]
    return found
