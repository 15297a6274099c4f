"""Write an FMU of the operating point: description, C sources with the table, and a binary where there is a compiler."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from service.studies.fmu.packing import VERSIONS, Unit, Variable, pack, template, token_of
from service.studies.fmu.table import LINEAR, Table, table_of
from twin.condition import OUTPUTS
from twin.parameters import PumpType
from twin.pumps.circuit_sets import CircuitSet

MODEL = "casedrain_operating_point"
INPUTS: tuple[str, ...] = (
    "speed_rpm",
    "fluid_temperature_degc",
    "discharge_flow_lpm",
    "reservoir_pressure_bar",
    "pump_leakage_scale",
    "system_leakage_lpm",
    "pressure_setting_change_bar",
    "drain_resistance_scale",
)
"""Four conditions, then four health parameters; the C source counts on this order."""
N_CONDITIONS = 4
_STATUS = "0 solved, 1 clamped to the table, 2 no steady state: the last values stay"


def export_fmu(kind: PumpType, circuit: CircuitSet, version: str, output: Path) -> str | None:
    """Write the FMU.

    Parameters
    ----------
    version
        ``2.0`` or ``3.0``; co-simulation.

    Returns
    -------
    str or None
        The platform that a binary was compiled for; None where there is no C compiler, then it holds sources alone.

    Raises
    ------
    ValueError
        for another version, or a pump without a steady state.
    OSError
        when it cannot be written.
    """
    if version not in VERSIONS:
        raise ValueError(f"FMI {version}: is not one of {', '.join(VERSIONS)}")
    table = table_of(kind, circuit)
    starts = (kind.nominal_speed_rpm, 50.0, 0.0, kind.nominal_reservoir_pressure_bar, 1.0, 0.0, 0.0, 1.0)
    token = token_of(table.values.tobytes(), version)
    sources = {
        "model.c": template("model.c"),
        "fmi.h": template("fmi.h"),
        "map.h": _header(table, starts, token),
    }
    about = f"{kind.title} in {circuit.name}: cycle-averaged operating point as a table"
    return pack(Unit(MODEL, about, variables(starts), sources, "model.c", 0.1), token, version, output)


def variables(starts: tuple[float, ...]) -> list[Variable]:
    """Variables in the order of the value references."""
    found = [Variable(name, "input" if i < N_CONDITIONS else "parameter", starts[i]) for i, name in enumerate(INPUTS)]
    found += [Variable(output_name(name), "output") for name in OUTPUTS]
    return [*found, Variable("status", "output", words=_STATUS)]


def output_name(name: str) -> str:
    """Name of an output; the delivered flow is told from the asked one."""
    return "delivered_flow_lpm" if name == "discharge_flow_lpm" else name


def _header(table: Table, starts: tuple[float, ...], token: str) -> str:
    """The table as C."""
    lines = [
        f'#define TOKEN "{token}"',
        f"#define N_INPUTS {len(INPUTS)}",
        f"#define N_OUTPUTS {len(OUTPUTS)}",
        f"#define N_LINEAR {len(LINEAR)}",
        f"#define DELIVERY {table.delivery_lpm_per_rpm!r}",
        f"static const double STARTS[] = {_braces(np.array(starts))};",
        f"static const double ORIGIN[] = {_braces(np.array(table.origin))};",
        f"static const int LENGTHS[] = {{{', '.join(str(len(axis)) for axis in table.axes)}}};",
    ]
    lines += [f"static const double AXIS_{i}[] = {_braces(axis)};" for i, axis in enumerate(table.axes)]
    names = ", ".join(f"AXIS_{i}" for i in range(len(table.axes)))
    lines += [f"static const double *const AXES[] = {{{names}}};"]
    rows = table.values.reshape(-1, 1 + len(LINEAR))
    lines += ["static const double MAP[] = {", *(_braces(row)[1:-1] + "," for row in rows), "};"]
    return "\n".join(lines) + "\n"


def _braces(values: NDArray[np.float64]) -> str:
    return "{" + ", ".join("NAN" if np.isnan(v) else f"{v:.12g}" for v in values.tolist()) + "}"
