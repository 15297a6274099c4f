"""An identification from a file to a parameter set: the table, the remarks, the numbers as JSON."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

from rich.table import Table

from service.pump_types.parameter_files import derived_toml
from service.studies.bench_points import PointFaultsError, read_points
from twin.identification import DEFAULT_PARAMETERS, Identification, identify
from twin.pumps import PUMP_TYPES


@dataclass(frozen=True, slots=True)
class Identified:
    """What there is to show; ``written`` is False where the points determine no number of the pump."""

    table: Table
    remarks: tuple[str, ...]
    json: str
    written: bool


def identified(path: Path, output: Path, name: str, pump: str, circuit: str, free: Sequence[str] | None) -> Identified:
    """Identify and write the parameter set.

    Raises
    ------
    PointFaultsError
        with every fault of the file.
    ValueError
        with every fault of what stands beside it.
    OSError
        when a file cannot be read or written.
    """
    faults = []
    if pump not in PUMP_TYPES:
        faults.append(f"--pump {pump}: is not known (known: {', '.join(PUMP_TYPES)}); the new set derives from it")
    if output.suffix.lower() != ".toml":
        faults.append(f"--output {output}: ends not in .toml")
    if name in PUMP_TYPES:
        faults.append(f"--id {name}: there is a pump type of that name already")
    if faults:
        raise ValueError("; ".join(faults))
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise PointFaultsError(["the file is not UTF-8 text"]) from None
    found = identify(PUMP_TYPES[pump], read_points(text), circuit, free or DEFAULT_PARAMETERS)
    source = f"identified from {path.name} on {datetime.now(UTC):%Y-%m-%d}"
    remarks = _remarks(found)
    written = bool(found.changes(source))
    if written:
        output.parent.mkdir(parents=True, exist_ok=True)
        output.write_text(derived_toml(found.document(name, source), remarks), encoding="utf-8")
    return Identified(_table(found), remarks, _json(found), written)


def _table(found: Identification) -> Table:
    table = Table(title=f"{found.kind.name} in {found.circuit}")
    for heading in ("number", "start", "found", "90 % interval", "unit"):
        table.add_column(heading)
    for e in found.estimates:
        table.add_row(e.path, f"{e.start:.5g}", f"{e.value:.5g}", f"{e.low:.5g} to {e.high:.5g}", e.unit)
    return table


def _remarks(found: Identification) -> tuple[str, ...]:
    freedom = f"{found.degrees_of_freedom} degrees of freedom"
    lines = [f"chi-square {found.chi_square:.1f} with {freedom}, p = {found.p_value:.2g}"]
    lines += [
        f"{e.path} = {e.value:.5g} {e.unit} belongs to the bench, not to the pump: not written"
        for e in found.estimates
        if e.path.startswith("circuit.")
    ]
    for u in found.undetermined:
        beside = f"; cannot be told from {', '.join(u.beside)}" if u.beside else ""
        lines.append(f"{u.path} is not determined by these points and stays at its start{beside}")
    for i, e in enumerate(found.estimates):
        for k in range(i):
            if abs(found.correlation[i, k]) > 0.95:
                words = (
                    f"{found.estimates[k].path} and {e.path} move together (correlation {found.correlation[i, k]:.2f})"
                )
                lines.append(words)
    lines += [f"warning: {warning}" for warning in found.warnings]
    worst = sorted(found.residuals, key=lambda r: -abs(r.normalised))[:3]
    lines += [
        f"point {r.point}, {r.output}: measured {r.measured:.5g}, twin {r.twin:.5g} ({r.normalised:+.1f} sd)"
        for r in worst
    ]
    return tuple(lines)


def _json(found: Identification) -> str:
    document = {
        "pump_type": found.kind.name,
        "circuit": found.circuit,
        "estimates": [asdict(e) for e in found.estimates],
        "undetermined": [asdict(u) for u in found.undetermined],
        "covariance": found.covariance.tolist(),
        "correlation": found.correlation.tolist(),
        "residuals": [asdict(r) for r in found.residuals],
        "chi_square": found.chi_square,
        "degrees_of_freedom": found.degrees_of_freedom,
        "p_value": found.p_value,
        "warnings": list(found.warnings),
    }
    return json.dumps(document, indent=1) + "\n"
