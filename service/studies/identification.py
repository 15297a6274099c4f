"""An identification from a file to a parameter set: the table, the remarks, the numbers as JSON."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

from rich.table import Table

from service.pump_types.parameter_files import derived_toml, named_or_written, whole_toml
from service.studies.bench_points import PointFaultsError, read_points
from twin.identification import DEFAULT_PARAMETERS, Identification, identify
from twin.pumps import PUMP_TYPES
from twin.pumps.written import pump_type_from


@dataclass(frozen=True, slots=True)
class Identified:
    """What there is to show; ``fault`` is why no parameter set was written, None where it was."""

    table: Table
    remarks: tuple[str, ...]
    json: str
    fault: str | None


def identified(
    path: Path,
    output: Path,
    name: str,
    pump: str,
    circuit: str,
    free: Sequence[str] | None,
    keep_misfit: bool = False,
) -> Identified:
    """Identify and write the parameter set; a misfit (p < 0.01) only with ``keep_misfit``.

    ``pump`` is a built-in name or a file; a set that starts from a file is written whole, because nobody else may have
    its base.

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
    kind = PUMP_TYPES["h225"]
    try:
        kind = named_or_written(pump)
    except ValueError as error:
        faults.append(f"--pump {error}")
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
    found = identify(kind, read_points(text), circuit, free or DEFAULT_PARAMETERS)
    source = f"identified from {path.name} on {datetime.now(UTC):%Y-%m-%d}"
    remarks = _remarks(found)
    fault = _fault(found, source, keep_misfit)
    if fault is None:
        document = found.document(name, source)
        output.parent.mkdir(parents=True, exist_ok=True)
        content = (
            derived_toml(document, remarks)
            if kind.name in PUMP_TYPES
            else whole_toml(pump_type_from(document, {kind.name: kind}), remarks)
        )
        output.write_text(content, encoding="utf-8")
    return Identified(_table(found), remarks, _json(found), fault)


def _fault(found: Identification, source: str, keep_misfit: bool) -> str | None:
    """Why there is no parameter set to write."""
    if not found.changes(source):
        return "the points determine no number of the pump, the prior decides all; nothing was written"
    if found.is_misfit and not keep_misfit:
        return (
            f"no pump of this type explains the points (chi-square {found.chi_square:.1f} of {found.degrees_of_freedom}, "
            f"p = {found.p_value:.2g}, below 0.01): look at the points above, their standard deviations, circuit and base; "
            f"nothing was written (--keep-misfit writes it all the same)"
        )
    return None


def _table(found: Identification) -> Table:
    table = Table(title=f"{found.kind.name} in {found.circuit}")
    for heading in ("number", "start", "prior, 1 sigma", "found", "90 % interval", "unit", "decided by"):
        table.add_column(heading)
    for e in found.estimates:
        prior = f"{100.0 * e.prior:.3g} %" if e.prior_is_ratio else f"{e.prior:.3g} {e.unit}"
        interval = f"{e.low:.5g} to {e.high:.5g}"
        table.add_row(e.path, f"{e.start:.5g}", prior, f"{e.value:.5g}", interval, e.unit, e.decided_by)
    return table


def _remarks(found: Identification) -> tuple[str, ...]:
    freedom = f"{found.degrees_of_freedom} degrees of freedom"
    lines = [f"chi-square {found.chi_square:.1f} with {freedom}, p = {found.p_value:.2g}"]
    lines += [f"prior of {e.path}: {e.prior_source}" for e in found.estimates]
    lines += [
        f"{e.path} = {e.value:.5g} {e.unit} belongs to the bench, not to the pump: not written"
        for e in found.estimates
        if e.path.startswith("circuit.")
    ]
    for u in found.undetermined:
        beside = f"; cannot be told from {', '.join(u.beside)}" if u.beside else ""
        lines.append(f"{u.path} is not determined by these points, the prior decides it{beside}")
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
        "estimates": [asdict(e) | {"decided_by": e.decided_by} for e in found.estimates],
        "undetermined": [asdict(u) for u in found.undetermined],
        "covariance": found.covariance.tolist(),
        "correlation": found.correlation.tolist(),
        "residuals": [asdict(r) for r in found.residuals],
        "chi_square": found.chi_square,
        "degrees_of_freedom": found.degrees_of_freedom,
        "p_value": found.p_value,
        "misfit": found.is_misfit,
        "warnings": list(found.warnings),
    }
    return json.dumps(document, indent=1) + "\n"
