"""A whole flight in quasi-steady form: off, run-up, window, loads, run-down, each instant an operating point.

Between standstill and ``LOWEST_RPM`` pressures and flows rise in proportion to the speed: there a pump lives on its
leakage, and no law of it was validated. No pulsation, no overshoot: what takes less than some tenths of a second is the
transient's.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from twin import columns as at
from twin.condition import OUTPUTS, RANGES
from twin.operating_point import operating_points, problem
from twin.parameters import Circuit, Pump
from twin.parts.geometry import geometry_faults
from twin.recording import TIME, Recording
from twin.simulation.loop import CAVITATED, RUNNING
from twin.simulation.output import MEANS
from twin.simulation.run import Run, Status
from twin.simulation.scenario import Scenario
from twin.simulation.scene import PLATE_FRICTION, SPOOL_JAMMING
from twin.simulation.start import steady_inputs
from twin.units import RAD_PER_DEG

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

LOWEST_RPM = RANGES["speed_rpm"][0]
_PIECE = 4096
"""Samples of a piece."""
_PRESSURES = ("discharge_pressure_bar", "case_pressure_bar", "return_pressure_bar", "control_pressure_bar")
_OTHERS = (
    "discharge_flow_lpm",
    "case_flow_lpm",
    "suction_flow_lpm",
    "slipper_leakage_lpm",
    "shaft_torque_nm",
)


def quasi_steady(pump: Pump, circuit: Circuit, scenario: Scenario, sample_rate_hz: float) -> Iterator[Run]:
    """A scenario as a sequence of operating points, piece by piece.

    Parameters
    ----------
    scenario
        With ``quasi_steady`` True: its speed may be 0.
    sample_rate_hz
        Rate of the output [Hz].

    Yields
    ------
    Run
        Channels of the transient's recording but spool, return flow and the leak of the circuit; no cycle means, no
        states. The last one's status says where no operating point was found.

    Raises
    ------
    ValueError
        naming every fault: of the scenario, and friction or jamming, which have no steady state.
    """
    faults = geometry_faults(pump)
    n = int(pump.piston.n) if not faults else 9
    try:
        times, table = scenario.table(n)
    except ValueError as fault:
        raise ValueError("; ".join([*faults, str(fault)])) from None
    if (table[:, [SPOOL_JAMMING, PLATE_FRICTION]] != 0.0).any():
        faults.append("friction of spool and plate has no steady state: simulate it in the transient form")
    if faults:
        raise ValueError("; ".join(faults))
    total = max(1, round(scenario.duration_s * sample_rate_hz))
    for first in range(0, total, _PIECE):
        instants = np.arange(first + 1, min(first + _PIECE, total) + 1) / sample_rate_hz
        run = _piece(pump, circuit, scenario, instants, _at(instants, times, table))
        yield run
        if not run.status.ok:
            return


def _at(instants: Vector, times: Vector, table: Matrix) -> Matrix:
    """Inputs at instants (m,), shape (m, columns): at a step the later value."""
    place = np.clip(np.searchsorted(times, instants, side="right") - 1, 0, len(times) - 1)
    after = np.minimum(place + 1, len(times) - 1)
    span = times[after] - times[place]
    share = np.where(span > 0.0, (instants - times[place]) / np.where(span > 0.0, span, 1.0), 0.0)
    found: Matrix = table[place] + np.clip(share, 0.0, 1.0)[:, None] * (table[after] - table[place])
    return found


def _piece(pump: Pump, circuit: Circuit, scenario: Scenario, instants: Vector, inputs: Matrix) -> Run:
    m = len(instants)
    asked = [steady_inputs(pump, row) for row in inputs]
    rows, k_d = np.array([a.row for a in asked]), np.array([a.k_d for a in asked])
    clearances = np.array([a.pump.piston.b for a in asked])
    speed = rows[:, at.SPEED].copy()
    rows[:, at.SPEED] = np.maximum(speed, LOWEST_RPM)
    turning = np.minimum(speed / LOWEST_RPM, 1.0)
    # an imposed flow stands for consumers, which move nothing before the pump does
    rows[:, at.ASKED_FLOW] *= turning
    moving = turning > 0.0
    values, failures = np.zeros((m, len(OUTPUTS))), dict[int, str | None]()
    # one pump for all instants, unless clearances wear in between
    for b in np.unique(clearances[moving]):
        places = np.flatnonzero(moving & (clearances == b))
        solved = operating_points(asked[places[0]].pump, rows[places], circuit, load_coefficient=k_d[places])
        values[places] = solved.values
        failures |= {int(places[i]): problem(solved, int(i)) for i in np.flatnonzero(solved.status)}
    done, status = m, Status(RUNNING, float(instants[-1]), "", m)
    if failures:
        done = min(failures)
        status = Status(CAVITATED, float(instants[done]), failures[done] or "", done)
    found = dict(zip(OUTPUTS, values.T, strict=True))
    reservoir = rows[:, at.RESERVOIR]
    channels: dict[str, Vector] = {TIME: instants}
    for name in _PRESSURES:
        channels[name] = reservoir + turning * np.where(moving, found[name] - reservoir, 0.0)
    channels["shaft_speed_rpm"] = speed
    channels["fluid_temperature_degc"] = rows[:, at.TEMPERATURE].copy()
    channels["reservoir_pressure_bar"] = reservoir.copy()
    for name in _OTHERS:
        channels[name] = turning * found[name]
    # the rate piston's spring tilts a plate that nothing holds
    top = pump.swashplate.alpha_max / RAD_PER_DEG
    channels["swashplate_angle_deg"] = top + turning * np.where(moving, found["swashplate_angle_deg"] - top, 0.0)
    warmer = np.where(moving, found["case_temperature_degc"] - rows[:, at.TEMPERATURE], 0.0)
    channels["case_temperature_degc"] = rows[:, at.TEMPERATURE] + turning * warmer
    attributes: dict[str, str | float] = {"form": "quasi_steady"}
    if scenario.title:
        attributes["scenario"] = scenario.title
    recording = Recording({name: samples[:done] for name, samples in channels.items()}, attributes)
    means = {name: np.empty(0) for name in ("end_s", *MEANS)}
    return Run(recording, means, status, np.empty((0, 0)))
