"""From the loop's numbers to channels in edge units: recordings and cycle means."""

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled
from twin.laws.compressibility import P_FLOOR
from twin.parameters import Pump
from twin.parts.drive import case_temperature, friction_torque, viscous_torque
from twin.recording import TIME, Recording
from twin.simulation.layout import (
    ALPHA,
    END,
    FIRST_MEAN,
    N_SHARED,
    N_STATE_MEANS,
    OMEGA,
    P_C,
    P_CTRL,
    P_D,
    P_I,
    Q_DRAIN,
    Q_LOAD,
    Q_RETURN,
    Q_SLIPPER,
    Q_SUCTION,
    Q_SYSTEM,
    TILT_MEAN,
    TORQUE,
    X,
)
from twin.simulation.scene import SCENE_INPUTS
from twin.units import KELVIN_AT_0_DEGC, M3_PER_S_PER_LPM, PA_PER_BAR, RAD_PER_DEG, RAD_PER_S_PER_RPM

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

_PRESSURES: dict[str, int] = {
    "discharge_pressure_bar": P_D,
    "case_pressure_bar": P_C,
    "return_pressure_bar": P_I,
    "control_pressure_bar": P_CTRL,
}
_FLOWS: dict[str, int] = {
    "discharge_flow_lpm": Q_LOAD,
    "case_flow_lpm": Q_DRAIN,
    "return_flow_lpm": Q_RETURN,
    "suction_flow_lpm": Q_SUCTION,
    "system_leakage_lpm": Q_SYSTEM,
    "slipper_leakage_lpm": Q_SLIPPER,
}
_FIRST_FLOW = FIRST_MEAN + N_STATE_MEANS
MEANS: tuple[str, ...] = (*_PRESSURES, "swashplate_angle_deg", *_FLOWS, "shaft_torque_nm")
"""Cycle means of a run; the torque is the shaft's, friction included, as the operating point's."""


def _column(name: str, times: Vector, table: Matrix, at: Vector) -> Vector:
    return np.interp(at, times, table[:, SCENE_INPUTS.index(name)])


@compiled
def _case_temperatures(pump: Pump, T: Vector, omega: Vector, dP: Vector, Q_c: Vector, out: Vector) -> None:
    viscous = 0.0
    for i in range(len(out)):
        if i == 0 or T[i] != T[i - 1] or omega[i] != omega[i - 1]:
            viscous = viscous_torque(pump.drive, pump.fluid, T[i], omega[i])
        friction = friction_torque(pump.drive, viscous, dP[i]) * omega[i]
        out[i] = case_temperature(pump.drive, pump.fluid, T[i], dP[i], Q_c[i], friction)


def recording_of(pump: Pump, title: str, times: Vector, table: Matrix, at: Vector, samples: Matrix) -> Recording:
    """Recording of samples, shape (m, N_SAMPLE), at instants (m,); pressures are gauge.

    The case's temperature is the balance of each instant: housing and fluid of the case store no heat.
    """
    ambient = _column("ambient_pressure_bar", times, table, at)
    channels: dict[str, Vector] = {TIME: at}
    for name, j in _PRESSURES.items():
        # a state below the floor counts the fluid that is missing from a cavity
        channels[name] = np.maximum(samples[:, j], P_FLOOR) / PA_PER_BAR - ambient
    channels["shaft_speed_rpm"] = samples[:, OMEGA] / RAD_PER_S_PER_RPM
    channels["fluid_temperature_degc"] = _column("fluid_temperature_degc", times, table, at)
    channels["reservoir_pressure_bar"] = _column("reservoir_pressure_bar", times, table, at)
    for name, j in _FLOWS.items():
        channels[name] = samples[:, N_SHARED + j] / M3_PER_S_PER_LPM
    channels["swashplate_angle_deg"] = samples[:, ALPHA] / RAD_PER_DEG
    channels["spool_position_mm"] = samples[:, X] * 1.0e3
    channels["shaft_torque_nm"] = samples[:, N_SHARED + TORQUE].copy()
    warmth = np.empty(len(at))
    kelvin = channels["fluid_temperature_degc"] + KELVIN_AT_0_DEGC
    omega, over = np.ascontiguousarray(samples[:, OMEGA]), samples[:, P_D] - samples[:, P_C]
    _case_temperatures(pump, kelvin, omega, over, np.ascontiguousarray(samples[:, N_SHARED + Q_DRAIN]), warmth)
    channels["case_temperature_degc"] = warmth - KELVIN_AT_0_DEGC
    return Recording(channels, {"scenario": title} if title else {})


def cycle_means(times: Vector, table: Matrix, rows: Matrix) -> dict[str, Vector]:
    """Means of whole revolutions by the names of ``MEANS``, and ``end_s``; rows have shape (m, FIRST_MEAN + N_MEAN)."""
    ambient = _column("ambient_pressure_bar", times, table, rows[:, END])
    means: dict[str, Vector] = {"end_s": rows[:, END].copy()}
    for j, name in enumerate(_PRESSURES):
        means[name] = rows[:, FIRST_MEAN + j] / PA_PER_BAR - ambient
    means["swashplate_angle_deg"] = rows[:, FIRST_MEAN + TILT_MEAN] / RAD_PER_DEG
    for name, j in _FLOWS.items():
        means[name] = rows[:, _FIRST_FLOW + j] / M3_PER_S_PER_LPM
    means["shaft_torque_nm"] = rows[:, _FIRST_FLOW + TORQUE].copy()
    return means
