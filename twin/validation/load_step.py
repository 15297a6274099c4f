"""The rig of figure 2-19: a pump, its discharge volume and a load that shuts and opens; what its answer is read by."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.condition import INPUTS, Condition, Health, input_rows
from twin.operating_point import operating_points
from twin.parameters import Circuit, Compensator, Pump
from twin.recording import Recording
from twin.simulation.layout import X
from twin.simulation.run import simulate
from twin.simulation.scenario import Scenario, Schedule, Value
from twin.simulation.start import load_coefficient, starting_state
from twin.units import PA_PER_BAR

Vector = NDArray[np.float64]

CONDITION = Condition(speed_rpm=4600.0, fluid_temperature_degc=60.0)
SHUT_S, OPENED_S, END_S = 0.25, 1.25, 2.0
"""When the load shuts and opens, figure 2-20; the end of the run is our choice."""
MOVE_S = 0.005
"""Time in which the load shuts or opens; at once (0 s) the peak is 0.2 bar higher."""
SAMPLE_RATE_HZ = 10_000.0
FULL_FLOW_BAR = 160.8
"""Discharge pressure at full flow, acceptance sheet of annex A-4."""
RATED_ZERO_FLOW_BAR = (173.0, 177.0)
"""Zero-flow pressure that table 2-1 asks for."""
_LOAD = "load_conductance_lpm_per_sqrt_bar"
_LATE_S = 0.5
"""Time after a change from which on the remaining oscillation is measured: half of what may pass until it settles."""


def full_flow_opening(pump: Pump, circuit: Circuit) -> float:
    """Opening of the load that holds ``FULL_FLOW_BAR`` at full tilt [L/min/sqrt(bar)]."""
    openings = np.linspace(1.5, 3.5, 401)
    rows = np.repeat(input_rows([CONDITION], [Health()]), len(openings), axis=0)
    k_d = np.array([load_coefficient(float(opening)) for opening in openings])
    pressure = operating_points(pump, rows, circuit, load_coefficient=k_d).value("discharge_pressure_bar")
    return float(np.interp(FULL_FLOW_BAR, pressure[::-1], openings[::-1]))


def zero_flow_pressure(pump: Pump, circuit: Circuit) -> float:
    """Discharge pressure at zero flow [bar]."""
    points = operating_points(pump, input_rows([CONDITION], [Health()]), circuit)
    return float(points.value("discharge_pressure_bar")[0])


def at_setting(pump: Pump, circuit: Circuit, compensator: Compensator) -> Pump:
    """Pump with another valve whose preload gives the same zero-flow pressure, its zero position being there."""
    wanted = zero_flow_pressure(pump, circuit)
    other = pump._replace(compensator=compensator)
    inputs = Scenario(1.0, CONDITION).table(int(pump.piston.n))[1][0]
    # the spool's balance is nearly linear in the preload
    for _ in range(6):
        missing = (wanted - zero_flow_pressure(other, circuit)) * PA_PER_BAR
        preload = compensator.F_preload + missing * compensator.A_spool
        x_zero = float(starting_state(other, circuit, inputs)[0][X])
        compensator = compensator._replace(F_preload=preload, x_zero=x_zero)
        other = pump._replace(compensator=compensator)
    return other


def load_step(
    pump: Pump,
    circuit: Circuit,
    changes: dict[str, Value] | None = None,
    *,
    opened_s: float = OPENED_S,
    end_s: float = END_S,
) -> Recording:
    """Full flow, zero flow from ``SHUT_S`` on, full flow again from ``opened_s`` on; ``changes`` beside the load.

    Raises
    ------
    RuntimeError
        when the simulation does not reach its end.
    """
    opening = full_flow_opening(pump, circuit)
    at = (SHUT_S, SHUT_S + MOVE_S, opened_s, opened_s + MOVE_S)
    load = Schedule(at, (opening, 0.0, 0.0, opening))
    scenario = Scenario(end_s, CONDITION, changes={_LOAD: load, **(changes or {})})
    run = simulate(pump, circuit, scenario, sample_rate_hz=SAMPLE_RATE_HZ)
    if not run.status.ok:
        raise RuntimeError(run.status.advice)
    return run.recording


def revolution_mean(samples: Vector) -> Vector:
    """Moving mean over one revolution, shape as ``samples``; the ends are held."""
    width = round(60.0 / CONDITION.speed_rpm * SAMPLE_RATE_HZ)
    left = width // 2
    padded = np.pad(samples, (left, width - 1 - left), mode="edge")
    return np.convolve(padded, np.full(width, 1.0 / width), mode="valid")


def last_outside(time: Vector, samples: Vector, low: float, high: float) -> float:
    """Last instant at which samples lie outside [low, high], the first instant where they never do [s]."""
    outside = np.flatnonzero((samples < low) | (samples > high))
    return float(time[outside[-1]]) if len(outside) else float(time[0])


class Answer(NamedTuple):
    """What the acceptance test reads from a load step; times [s] count from the change, oscillations are half-widths.

    ``response`` is the time to the first extreme of the pressure (neither the acceptance test nor the thesis says what
    it counts); ``settle_shut`` the last time outside the rated zero-flow pressure, ``inside_shut`` outside the envelope
    of 20.7 bar; ``settle_open`` the last time below 90 % of the full-flow pressure.
    """

    peak_bar: float
    trough_bar: float
    response_shut_s: float
    response_open_s: float
    settle_shut_s: float
    inside_shut_s: float
    settle_open_s: float
    zero_flow_bar: float
    full_flow_bar: float
    oscillation_shut_bar: float
    oscillation_open_bar: float


def answer(recording: Recording, envelope_bar: float, opened_s: float = OPENED_S) -> Answer:
    """Read a load step; ``envelope_bar`` is the half-width of the allowed oscillation."""
    time, pressure = recording.time_s, recording["discharge_pressure_bar"]
    shut, opened = (time >= SHUT_S) & (time < opened_s), time >= opened_s
    t_0, P_0, t_1, P_1 = time[shut], pressure[shut], time[opened], pressure[opened]
    late_0, late_1 = P_0[t_0 >= SHUT_S + _LATE_S], P_1[t_1 >= opened_s + _LATE_S]
    zero, full = float(late_0.mean()), float(late_1.mean())
    return Answer(
        peak_bar=float(P_0.max()),
        trough_bar=float(P_1.min()),
        response_shut_s=float(t_0[np.argmax(P_0)]) - SHUT_S,
        response_open_s=float(t_1[np.argmin(P_1)]) - opened_s,
        settle_shut_s=last_outside(t_0, P_0, *RATED_ZERO_FLOW_BAR) - SHUT_S,
        inside_shut_s=last_outside(t_0, P_0, zero - envelope_bar, zero + envelope_bar) - SHUT_S,
        settle_open_s=last_outside(t_1, P_1, 0.9 * full, np.inf) - opened_s,
        zero_flow_bar=zero,
        full_flow_bar=full,
        oscillation_shut_bar=0.5 * float(np.ptp(late_0)),
        oscillation_open_bar=0.5 * float(np.ptp(late_1)),
    )


def pressure_gain(pump: Pump, circuit: Circuit, rounding_um: float) -> tuple[Vector, Vector, float]:
    """Static pressure gain of the valve in the pump, from operating points between zero flow and near full flow.

    Returns discharge and control pressure over case pressure [bar], and the gain between 0 and 5 L/min: control
    pressure per discharge pressure [-].
    """
    flows = np.array([0.0, 5.0, 10.0, 15.0, 20.0, 24.0])
    rows = np.repeat(input_rows([CONDITION], [Health(edge_rounding_um=rounding_um)]), len(flows), axis=0)
    rows[:, INPUTS.index("discharge_flow_lpm")] = flows
    points = operating_points(pump, rows, circuit)
    case = points.value("case_pressure_bar")
    P_d, P_ctrl = points.value("discharge_pressure_bar") - case, points.value("control_pressure_bar") - case
    return P_d, P_ctrl, float((P_ctrl[0] - P_ctrl[1]) / (P_d[0] - P_d[1]))
