"""What ``casedrain analyse`` answers with, as a document and as a table."""

from pathlib import Path
from typing import TYPE_CHECKING, TypedDict, cast

from service.answers.documents import JsonObject
from service.command_line.console import say, shown

if TYPE_CHECKING:
    from rich.console import Console

    from service.answers.verdicts import Verdict
    from service.errors import Problem
    from service.studies.offline import AnalysedPump

_SHOWN = ("case_pressure_bar", "discharge_pressure_bar")
_SAID = (
    *("state", "side", "confidence", "probabilities", "candidates", "advice", "resolving_measurement"),
    *("fit", "blind_spots", "probability_beyond_limit", "crossing", "intermittent", "resolved_by", "missing_evidence"),
    *("case_pressure", "quality"),
)
"""Of the verdict in the shape of the API: what an answer says."""
_SIGMAS_90 = 1.645
"""Half of a normal distribution's central 90 %, in standard deviations."""
_LONGEST_NAME = 60
"""Characters: at four bytes they leave room in the 255 of a file's name."""


class ResidualSaid(TypedDict):
    """Measured minus the twin's, and its standard deviation [bar]."""

    value: float
    standard_deviation: float


class FileSaid(TypedDict):
    """A file of a pump: what it made of the state, its zero-flow window [s] or why there is none."""

    file: str
    state: str
    zero_flow_s: list[float] | None
    explanation: str | None
    residuals: dict[str, ResidualSaid]


class PumpSaid(TypedDict):
    """A pump's answer; ``verdict`` holds some members of the API's."""

    serial: str
    verdict: JsonObject
    files: list[FileSaid]


class FaultSaid(TypedDict):
    """A fault and its place."""

    where: str
    problem: str


class RefusalSaid(TypedDict):
    """A file that was not taken."""

    file: str
    detail: str
    errors: list[FaultSaid]


def analysed_pump(pump: "AnalysedPump") -> PumpSaid:
    """One pump's answer: its last verdict, and its files in their order in time; residuals in bar."""
    states = {a.record_id: a.verdict.state.value for a in pump.assessments}
    files: list[FileSaid] = []
    for file in sorted(pump.files, key=lambda f: (f.observation.at, f.observation.record_id)):
        window = file.observation.reduction.zero_flow
        residuals: dict[str, ResidualSaid] = {
            channel: {"value": float(r.residual), "standard_deviation": float(r.standard_deviation)}
            for channel, r in file.residuals.items()
        }
        files.append(
            {
                "file": str(file.path),
                "state": states[file.observation.record_id],
                "zero_flow_s": [float(window.start_s), float(window.end_s)] if window else None,
                "explanation": None if window else file.observation.reduction.explanation,
                "residuals": residuals,
            }
        )
    verdict: JsonObject = {**pump.verdict}
    return {"serial": pump.serial, "verdict": {name: verdict[name] for name in _SAID}, "files": files}


def show_pump(answer: PumpSaid, to: "Console") -> None:
    """Print a pump's answer as a table and its verdict in words."""
    from rich.table import Table  # noqa: PLC0415 - slow, and no help needs it

    from service.reports.remarks import remarks  # noqa: PLC0415

    table = Table(title=f"Pump {shown(answer['serial'])}")
    for heading in ("file", "zero-flow window", "case residual [bar]", "discharge residual [bar]", "state"):
        table.add_column(heading)
    for file in answer["files"]:
        span = file["zero_flow_s"]
        words = f"{span[0]:.0f} to {span[1]:.0f} s" if span else file["explanation"]
        numbers = [
            f"{r['value']:+.3f} ± {_SIGMAS_90 * r['standard_deviation']:.3f}" if r else "–"
            for r in (file["residuals"].get(channel) for channel in _SHOWN)
        ]
        table.add_row(shown(Path(file["file"]).name), words, *numbers, file["state"])
    to.print(table)
    verdict = answer["verdict"]
    say((verdict["state"], "bold"), f", side {verdict['side']}: {verdict['advice']}", to=to)
    if verdict["resolving_measurement"]:
        say(f"What would tell: {verdict['resolving_measurement']}.", to=to)
    for flag in verdict["quality"]["flags"]:
        say(("flag", "yellow"), f" {flag}", to=to)
    for remark in remarks(cast("Verdict", verdict)):
        for sentence in remark.sentences:
            say(f"{remark.heading}: {sentence}.", to=to)


def refusal(path: Path, problem: "Problem") -> RefusalSaid:
    """A file that was not taken, and every fault of it."""
    errors: list[FaultSaid] = [{"where": fault.where, "problem": fault.problem} for fault in problem.errors]
    return {"file": str(path), "detail": problem.detail, "errors": errors}


def show_refusal(path: Path, problem: "Problem", to: "Console") -> None:
    """Print why a file was not taken."""
    say(("refused", "red"), f" {path}: {problem.detail}", to=to)
    for fault in problem.errors:
        say(f"  {fault.where}: {fault.problem}", to=to)


def safe_name(name: str) -> str:
    """A serial number as the name of a file."""
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in name).lstrip(".")[:_LONGEST_NAME] or "pump"
