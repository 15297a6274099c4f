"""Write an FMU of the transient pump with the ports of figure 2-2: the simulation's own kernels, translated to C.

What stands behind a port is the other model's: at suction, at the far end of the drain and at the shaft it gives a pressure or a
speed and gets a flow or a torque, at discharge it draws a flow and gets a pressure, at the thermal port it gives the fluid's
temperature and gets that of the leakage. The discharge line's volume, the case's and the drain's resistance belong to the pump.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from service.studies.fmu.packing import VERSIONS, Unit, Variable, pack, template, token_of
from service.studies.fmu.translation import Translation
from twin import columns as at
from twin.condition import HEALTH_INPUTS, INPUTS, Condition, Health
from twin.laws.compressibility import P_FLOOR
from twin.operating_point import operating_point, problem
from twin.parameters import Circuit, Pump, PumpType
from twin.pumps.circuit_sets import CircuitSet
from twin.simulation import layout
from twin.simulation.loop import advance
from twin.simulation.run import FULL_STEP_RPM, default_step
from twin.simulation.scenario import Scenario
from twin.simulation.scene import N_SCENE, scene_of
from twin.simulation.start import starting_state
from twin.units import PA_PER_BAR, STANDARD_ATMOSPHERE_BAR

MODEL = "casedrain_transient_pump"
PORTS: tuple[tuple[str, str, str], ...] = (
    ("shaft_speed_rpm", "speed_rpm", "shaft"),
    ("suction_pressure_bar", "reservoir_pressure_bar", "suction: bar gauge"),
    ("discharge_flow_lpm", "discharge_flow_lpm", "discharge: flow that is drawn"),
    ("case_line_pressure_bar", "", "case: pressure at the far end of the drain, bar gauge"),
    ("fluid_temperature_degc", "fluid_temperature_degc", "thermal: fluid at suction"),
)
"""Inputs: name, the condition that they are, port."""
OUTPUTS: tuple[tuple[str, str], ...] = (
    ("discharge_pressure_bar", "discharge: at the end of the step, bar gauge"),
    ("case_pressure_bar", "case: at the end of the step, bar gauge"),
    ("control_pressure_bar", "at the end of the step, bar gauge"),
    ("suction_flow_lpm", "suction: mean over the step"),
    ("case_flow_lpm", "case: mean over the step"),
    ("shaft_torque_nm", "shaft: hydraulic part, mean over the step"),
    ("swashplate_angle_deg", "at the end of the step"),
    ("case_temperature_degc", "thermal: leakage throttled into the case"),
)
_PINNED_M3 = 1.0e6
"""Volume behind the drain: so large that no flow moves the pressure that the other model gives."""
_STATUS = "0 runs, 1 left the numbers: the last values stay"
_OWN_HEALTH = ("system_leakage_lpm",)
"""Health that belongs to the circuit, not to the pump at its ports."""
HEALTH: tuple[str, ...] = tuple(name for name in HEALTH_INPUTS if name not in _OWN_HEALTH)


def at_ports(kind: PumpType, circuit: CircuitSet) -> tuple[Pump, Circuit]:
    """Pump and circuit of the unit: the drain ends in a volume whose pressure nothing moves."""
    pump = circuit.around(kind).pump
    volumes = pump.volumes._replace(return_line=_PINNED_M3)
    return pump._replace(volumes=volumes), circuit.circuit._replace(shared=1.0)


def export_transient(kind: PumpType, circuit: CircuitSet, version: str, output: Path) -> str | None:
    """Write the FMU; returns the platform of its binary, None where there is no C compiler.

    It starts at the operating point of nominal speed, 50 degC and no flow; what is set otherwise it finds by itself.

    Raises
    ------
    ValueError
        for another version, a pump with variable gaps, or one without a steady state there.
    OSError
        when it cannot be written.
    """
    if version not in VERSIONS:
        raise ValueError(f"FMI {version}: is not one of {', '.join(VERSIONS)}")
    if kind.pump.slipper.variable > 0.5:
        raise ValueError(f"{kind.name}: variable slipper gaps choose steps of a microsecond, which the unit does not")
    pump, around = at_ports(kind, circuit)
    condition = Condition(kind.nominal_speed_rpm, 50.0, kind.nominal_reservoir_pressure_bar)
    point = operating_point(pump, condition, around)
    if (fault := problem(point, 0)) is not None:
        raise ValueError(f"{kind.name} at nominal speed, 50 degC and no flow: {fault}")
    state = first_state(pump, around, condition)
    numbers = [*_numbers(pump), *_numbers(around, "circuit")]
    variables = _variables(condition, numbers)
    kernels, header = _sources(pump, condition, state, variables, [float(point.value(n)[0]) for n, _ in OUTPUTS])
    token = token_of((kernels + header).encode(), version)
    sources = {
        "transient.c": template("transient.c"),
        "fmi.h": template("fmi.h"),
        "kernels.h": f'{kernels}\n#define TOKEN "{token}"\n{header}',
    }
    about = f"{kind.title} with the drain of {circuit.name}: transient pump at its ports"
    return pack(Unit(MODEL, about, variables, sources, "transient.c", 1.0e-3), token, version, output)


def first_state(pump: Pump, circuit: Circuit, condition: Condition) -> np.ndarray[Any, np.dtype[np.float64]]:
    """State that the unit starts from, SI absolute, shape (n_states,); the drain's far end at the suction pressure."""
    n = int(pump.piston.n)
    row = np.ones(N_SCENE + 2 * n)
    row[:N_SCENE] = 0.0
    row[: len(INPUTS)] = (*condition, *Health())
    state, _ = starting_state(pump, circuit, row)
    state[layout.P_I] = (condition.reservoir_pressure_bar + condition.ambient_pressure_bar) * PA_PER_BAR
    return state


def _numbers(block: Any, prefix: str = "") -> list[tuple[str, float]]:
    """Names and SI values of nested tuples, in the order in which they lie in memory."""
    found: list[tuple[str, float]] = []
    for name, value in zip(block._fields, block, strict=True):
        path = f"{prefix}.{name}" if prefix else name
        found += _numbers(value, path) if hasattr(value, "_fields") else [(path, float(value))]
    return found


def _variables(condition: Condition, numbers: Sequence[tuple[str, float]]) -> list[Variable]:
    health = Health()._asdict()
    first = {**condition._asdict(), "": condition.reservoir_pressure_bar}
    found = [Variable(name, "input", first[known], words) for name, known, words in PORTS]
    found += [Variable(name, "parameter", health[name]) for name in HEALTH]
    found += [Variable(path, "parameter", value, "SI") for path, value in numbers]
    found += [Variable(name, "output", words=words) for name, words in OUTPUTS]
    return [*found, Variable("status", "output", words=_STATUS)]


def _sources(
    pump: Pump,
    condition: Condition,
    state: Sequence[float] | np.ndarray[Any, np.dtype[np.float64]],
    variables: Sequence[Variable],
    outputs: Sequence[float],
) -> tuple[str, str]:
    """Translated kernels, and what the model's own C counts on."""
    translation = Translation()
    translation.add(advance)
    translation.add(scene_of)
    starts = [v.start for v in variables if v.role != "output"]
    columns = [INPUTS.index(known) if known else -1 for _, known, _ in PORTS]
    n = int(pump.piston.n)
    defined = {
        "N_INPUTS": len(PORTS), "N_HEALTH": len(HEALTH), "N_NUMBERS": len(starts) - len(PORTS) - len(HEALTH),
        "N_OUTPUTS": len(OUTPUTS), "N_PISTONS": n, "N_STATES": len(state), "N_ROW": N_SCENE + 2 * n,
        "N_FLOWS": layout.N_FLOWS, "N_COLUMNS": layout.N_COLUMNS, "AMBIENT_COLUMN": at.AMBIENT,
        "AMBIENT": STANDARD_ATMOSPHERE_BAR, "FLOOR": P_FLOOR, "FULL_STEP_RPM": FULL_STEP_RPM,
        "STEP_S": default_step(pump, Scenario(1.0, condition._replace(speed_rpm=FULL_STEP_RPM))),
    }  # fmt: skip
    defined |= {name: getattr(layout, name) for name in (
        "P_D", "P_C", "P_I", "P_CTRL", "ALPHA", "THETA", "Q_SUCTION", "Q_DRAIN", "TORQUE")}  # fmt: skip
    lines = [f"#define {name} {value!r}" for name, value in defined.items()]
    for name, values in (("STARTS", starts), ("STATE", state), ("FIRST_OUTPUTS", outputs)):
        lines.append(f"static const double {name}[] = {{{', '.join(f'{float(v):.17g}' for v in values)}}};")
    lines.append(f"static const int INPUT_COLUMN[] = {{{', '.join(str(c) for c in columns)}}};")
    at_health = ", ".join(str(INPUTS.index(name)) for name in HEALTH)
    lines.append(f"static const int HEALTH_COLUMN[] = {{{at_health}}};")
    return translation.text, "\n".join(lines) + "\n"
