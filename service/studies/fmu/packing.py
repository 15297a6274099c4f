"""What every FMU is packed from: a description of its variables, C sources, and a binary where there is a compiler."""

import platform
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

from service.identity import sentence

VERSIONS = ("2.0", "3.0")
_COMPILERS = ("cc", "gcc", "clang")


class Variable(NamedTuple):
    """One variable of a model: name, role (``input``, ``parameter``, ``output``), start, and words where it needs some."""

    name: str
    role: str
    start: float = 0.0
    words: str = ""


class Unit(NamedTuple):
    """A co-simulation unit.

    ``variables`` stand in the order of their value references, from 1 on: inputs and parameters, then outputs. ``sources``
    are files of C by name, ``main`` the one that is compiled.
    """

    model: str
    about: str
    variables: Sequence[Variable]
    sources: Mapping[str, str]
    main: str
    step_s: float


def template(name: str) -> str:
    """A C source of this room."""
    return files("service.studies.fmu").joinpath(name).read_text(encoding="utf-8")


def token_of(content: bytes, version: str) -> str:
    """Identity of a unit, by what it holds."""
    return "{" + sha256(content + version.encode()).hexdigest()[:32] + "}"


def pack(unit: Unit, token: str, version: str, output: Path) -> str | None:
    """Write a unit; returns the platform of its binary, None where there is no C compiler.

    Raises
    ------
    ValueError
        for another FMI version, or where the compiler refuses the source.
    OSError
        when it cannot be written.
    """
    if version not in VERSIONS:
        raise ValueError(f"FMI {version}: is not one of {', '.join(VERSIONS)}")
    main = f"#ifndef FMI_VERSION\n#define FMI_VERSION {version[0]}\n#endif\n{unit.sources[unit.main]}"
    sources = {**unit.sources, unit.main: main}
    platform_name, binary = _compiled(sources, unit.main, version)
    output.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(output, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", _description(unit, version, token))
        for name, text in sources.items():
            archive.writestr(f"sources/{name}", text)
        if version == "3.0":
            archive.writestr("sources/buildDescription.xml", _build(unit))
        if binary is not None:
            archive.writestr(f"binaries/{platform_name}/{unit.model}.{_suffix()}", binary)
    return platform_name if binary is not None else None


def _build(unit: Unit) -> str:
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiBuildDescription fmiVersion="3.0">
  <BuildConfiguration modelIdentifier="{unit.model}">
    <SourceFileSet language="C99"><SourceFile name="{unit.main}"/></SourceFileSet>
  </BuildConfiguration>
</fmiBuildDescription>
"""


def _compiled(sources: Mapping[str, str], main: str, version: str) -> tuple[str, bytes | None]:
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
        for source, text in sources.items():
            (place / source).write_text(text, encoding="utf-8")
        library = place / f"unit.{_suffix()}"
        flags = ["-std=c99", "-O2", "-shared", "-fPIC", f"-DFMI_VERSION={version[0]}"]
        asked = [compiler, *flags, str(place / main), "-o", str(library), "-lm"]
        made = subprocess.run(asked, capture_output=True, text=True, timeout=300, check=False)  # noqa: S603 - our own source
        if made.returncode:
            raise ValueError(f"{compiler} refuses the source: {made.stderr.strip()[:500]}")
        return name, library.read_bytes()


def _suffix() -> str:
    return {"Windows": "dll", "Darwin": "dylib"}.get(platform.system(), "so")


def _description(unit: Unit, version: str, token: str) -> str:
    """modelDescription.xml of either version."""
    made = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    head = (
        f'modelName="{unit.model}" description={quoteattr(unit.about)} '
        f'generationTool={quoteattr(sentence())} generationDateAndTime="{made}"'
    )
    scalars = []
    for vr, variable in enumerate(unit.variables, 1):
        variability = "tunable" if variable.role == "parameter" else "continuous"
        begun = f' start="{variable.start:.17g}"' if variable.role != "output" else ""
        words = f" description={quoteattr(variable.words)}" if variable.words else ""
        causal = f'name="{variable.name}" valueReference="{vr}" causality="{variable.role}" variability="{variability}"{words}'
        if version == "2.0":
            initial = ' initial="exact"' if variable.role == "parameter" else ""
            scalars.append(f"    <ScalarVariable {causal}{initial}><Real{begun}/></ScalarVariable>")
        else:
            scalars.append(f"    <Float64 {causal}{begun}/>")
    outputs = [vr for vr, variable in enumerate(unit.variables, 1) if variable.role == "output"]
    body = "\n".join(scalars)
    named = "structured" if any("." in variable.name for variable in unit.variables) else "flat"
    if version == "2.0":
        unknowns = "".join(f'<Unknown index="{vr}"/>' for vr in outputs)
        return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" guid="{token}" {head} variableNamingConvention="{named}">
  <CoSimulation modelIdentifier="{unit.model}" canHandleVariableCommunicationStepSize="true">
    <SourceFiles><File name="{unit.main}"/></SourceFiles>
  </CoSimulation>
  <DefaultExperiment startTime="0" stopTime="1" stepSize="{unit.step_s:g}"/>
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
<fmiModelDescription fmiVersion="3.0" instantiationToken="{token}" {head} variableNamingConvention="{named}">
  <CoSimulation modelIdentifier="{unit.model}" canHandleVariableCommunicationStepSize="true"/>
  <DefaultExperiment startTime="0" stopTime="1" stepSize="{unit.step_s:g}"/>
  <ModelVariables>
{clock}
{body}
  </ModelVariables>
  <ModelStructure>{unknowns}</ModelStructure>
</fmiModelDescription>
"""
