"""Write an FMU of the operating point: description, C sources with the table, and a binary where there is a compiler."""

import platform
import shutil
import subprocess
import tempfile
import zipfile
from datetime import UTC, datetime
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from service.identity import sentence
from service.studies.fmu.table import LINEAR, Table, table_of
from twin.condition import OUTPUTS
from twin.parameters import PumpType
from twin.pumps.circuit_sets import CircuitSet

VERSIONS = ("2.0", "3.0")
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
_COMPILERS = ("cc", "gcc", "clang")
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
    token = "{" + sha256(table.values.tobytes() + version.encode()).hexdigest()[:32] + "}"
    source = files("service.studies.fmu").joinpath("model.c").read_text(encoding="utf-8")
    header = _header(table, starts, token)
    platform_name, binary = _compiled(source, header, version)
    output.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(output, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", _description(kind, circuit, version, token, starts))
        archive.writestr("sources/model.c", f"#ifndef FMI_VERSION\n#define FMI_VERSION {version[0]}\n#endif\n{source}")
        archive.writestr("sources/map.h", header)
        if version == "3.0":
            archive.writestr("sources/buildDescription.xml", _BUILD)
        if binary is not None:
            archive.writestr(f"binaries/{platform_name}/{MODEL}.{_suffix()}", binary)
    return platform_name if binary is not None else None


_BUILD = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiBuildDescription fmiVersion="3.0">
  <BuildConfiguration modelIdentifier="{MODEL}">
    <SourceFileSet language="C99"><SourceFile name="model.c"/></SourceFileSet>
  </BuildConfiguration>
</fmiBuildDescription>
"""


def variables() -> list[tuple[str, str]]:
    """Name and role of each variable in the order of the value references, from 1 on."""
    found = [(name, "input" if i < N_CONDITIONS else "parameter") for i, name in enumerate(INPUTS)]
    found += [(output_name(name), "output") for name in OUTPUTS]
    return [*found, ("status", "output")]


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


def _compiled(source: str, header: str, version: str) -> tuple[str, bytes | None]:
    """Shared library for this machine, or None without a compiler."""
    system, machine = platform.system(), platform.machine().lower()
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(machine, machine)
    kind = {"Linux": "linux", "Darwin": "darwin", "Windows": "windows"}.get(system, system.lower())
    short = {"linux": "linux", "darwin": "darwin", "windows": "win"}.get(kind, kind)
    name = f"{machine}-{kind}" if version == "3.0" else f"{short}64"
    compiler = next((found for found in map(shutil.which, _COMPILERS) if found), None)
    if compiler is None:
        return name, None
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        (place / "model.c").write_text(source, encoding="utf-8")
        (place / "map.h").write_text(header, encoding="utf-8")
        library = place / f"model.{_suffix()}"
        flags = ["-std=c99", "-O1", "-shared", "-fPIC", f"-DFMI_VERSION={version[0]}"]
        asked = [compiler, *flags, str(place / "model.c"), "-o", str(library), "-lm"]
        made = subprocess.run(asked, capture_output=True, text=True, timeout=300, check=False)  # noqa: S603 - our own source
        if made.returncode:
            raise ValueError(f"{compiler} refuses the source: {made.stderr.strip()[:500]}")
        return name, library.read_bytes()


def _suffix() -> str:
    return {"Windows": "dll", "Darwin": "dylib"}.get(platform.system(), "so")


def _description(kind: PumpType, circuit: CircuitSet, version: str, token: str, starts: tuple[float, ...]) -> str:
    """modelDescription.xml of either version."""
    about = quoteattr(f"{kind.title} in {circuit.name}: cycle-averaged operating point as a table")
    made = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    listed = variables()
    first = 1 + len(INPUTS)
    head = (
        f'modelName="{MODEL}" description={about} generationTool={quoteattr(sentence())} generationDateAndTime="{made}"'
    )
    scalars = []
    for vr, (name, role) in enumerate(listed, 1):
        variability = "tunable" if role == "parameter" else "continuous"
        begun = f' start="{starts[vr - 1]:.17g}"' if role != "output" else ""
        words = f" description={quoteattr(_STATUS)}" if name == "status" else ""
        causal = f'name="{name}" valueReference="{vr}" causality="{role}" variability="{variability}"{words}'
        if version == "2.0":
            initial = ' initial="exact"' if role == "parameter" else ""
            scalars.append(f"    <ScalarVariable {causal}{initial}><Real{begun}/></ScalarVariable>")
        else:
            scalars.append(f"    <Float64 {causal}{begun}/>")
    outputs = range(first, 1 + len(listed))
    body = "\n".join(scalars)
    if version == "2.0":
        unknowns = "".join(f'<Unknown index="{vr}"/>' for vr in outputs)
        return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" guid="{token}" {head} variableNamingConvention="flat">
  <CoSimulation modelIdentifier="{MODEL}" canHandleVariableCommunicationStepSize="true">
    <SourceFiles><File name="model.c"/></SourceFiles>
  </CoSimulation>
  <DefaultExperiment startTime="0" stopTime="1" stepSize="0.1"/>
  <ModelVariables>
{body}
  </ModelVariables>
  <ModelStructure><Outputs>{unknowns}</Outputs><InitialUnknowns>{unknowns}</InitialUnknowns></ModelStructure>
</fmiModelDescription>
"""
    unknowns = "".join(f'<Output valueReference="{vr}"/>' for vr in outputs)
    unknowns += "".join(f'<InitialUnknown valueReference="{vr}"/>' for vr in outputs)
    clock = '    <Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>'
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" instantiationToken="{token}" {head} variableNamingConvention="flat">
  <CoSimulation modelIdentifier="{MODEL}" canHandleVariableCommunicationStepSize="true"/>
  <DefaultExperiment startTime="0" stopTime="1" stepSize="0.1"/>
  <ModelVariables>
{clock}
{body}
  </ModelVariables>
  <ModelStructure>{unknowns}</ModelStructure>
</fmiModelDescription>
"""
