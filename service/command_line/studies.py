"""Commands of engineers: simulate, compare with published evidence, study sensors and verdicts."""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from service.command_line.command import Command
from service.command_line.console import STANDARD_OUTPUT, Json, complaints, failure, listener, say, say_json

if TYPE_CHECKING:
    from rich.console import Console

app = typer.Typer(rich_markup_mode=None)


@app.command(cls=Command)
def simulate(
    scenario: Annotated[Path, typer.Argument(help="Scenario file: TOML", exists=True, dir_okay=False)],
    output: Annotated[Path, typer.Option(help="Flight record to write: .parquet or .csv")],
    picture: Annotated[Path | None, typer.Option(help="Picture to draw: .svg or .png")] = None,
    pump: Annotated[str, typer.Option(help="Pump type: a name, or a .toml or .json file")] = "h225",
    circuit: Annotated[str, typer.Option(help="Circuit round the pump: its name, or a file")] = "shared_return",
    sensors: Annotated[str, typer.Option(help="none (the truth), helicopter or test_bench")] = "none",
    seed: Annotated[int, typer.Option(min=0, help="Another seed is other chance in the sensors")] = 1,
    json_: Json = False,
) -> None:
    """Simulate a scenario into a flight record; exit code 1 if it stops early, 2 if it is wrong.

    With --json: {"output", "rows", "end_s", "complete", "advice", "missing_metadata": [name]}.
    """
    from rich.progress import Progress  # noqa: PLC0415

    from service.studies.simulation.run import asked, run_file  # noqa: PLC0415 - heavy, and only here
    from service.studies.simulation.scenario_file import ScenarioFaultsError  # noqa: PLC0415

    try:
        file, kind = asked(scenario, output, picture, pump, circuit, sensors)
        with Progress(console=complaints(), transient=True) as bar:
            task = bar.add_task("simulating", total=1.0)
            outcome = run_file(
                file, kind, circuit, sensors, seed, output, picture, lambda share: bar.update(task, completed=share)
            )
    except ScenarioFaultsError as error:
        raise failure(f"{scenario} has {len(error.faults)} fault(s)\n  " + "\n  ".join(error.faults), 2) from None
    except (RuntimeError, OSError) as error:
        raise failure(str(error)) from None
    status = outcome.status
    to = listener(json_)
    say(f"{output}: {outcome.n_rows} rows, {status.time_s:.6g} s", to=to)
    if status.ok and status.outside:
        say(f"{status.advice[0].upper()}{status.advice[1:]}.", to=to)
    if outcome.missing:
        say(f"To upload it, say in the scenario's table metadata: {', '.join(outcome.missing)}.", to=to)
    if json_:
        document = {"output": str(output), "rows": outcome.n_rows, "end_s": float(status.time_s)}
        advice = None if status.ok and not status.outside else status.advice
        say_json(document | {"complete": bool(status.ok), "advice": advice, "missing_metadata": list(outcome.missing)})
    if not outcome.status.ok:
        raise failure(f"{outcome.status.advice}. What was computed until then is kept.")


@app.command(cls=Command)
def identify(
    points: Annotated[Path, typer.Argument(help="Test-bench points: CSV", exists=True, dir_okay=False)],
    output: Annotated[Path, typer.Option(help="Parameter set to write: .toml", dir_okay=False)],
    id_: Annotated[str, typer.Option("--id", help="Name of the new pump type")],
    pump: Annotated[str, typer.Option(help="Pump type to start from: its name, or a parameter file")] = "h225",
    circuit: Annotated[str, typer.Option(help="Circuit that the pump ran in")] = "acceptance_stand",
    keep_misfit: Annotated[bool, typer.Option(help="Write the set although it does not explain the points")] = False,
    free: Annotated[list[str] | None, typer.Option(help="Number to find, e.g. slipper.h; may be repeated")] = None,
    json_: Annotated[
        Path | None, typer.Option("--json", help="Also write all numbers: JSON; - is standard output", dir_okay=False)
    ] = None,
) -> None:
    """Calibrate a pump type from test-bench points: its most probable numbers, and which of them the prior decides.

    Exit code 1 if no pump of the type explains the points (p < 0.01) or they determine none of its numbers: then
    nothing is written; 2 if the file or an option is wrong.
    The JSON: {"pump_type", "circuit", "estimates", "undetermined", "covariance", "correlation", "residuals",
    "chi_square", "degrees_of_freedom", "p_value", "misfit", "warnings"}; an estimate has its path, unit, start, value, low,
    high, its prior with prior_source and prior_share, and decided_by (points or prior).
    """
    from service.studies.bench_points import PointFaultsError  # noqa: PLC0415 - heavy, and only here
    from service.studies.identification import identified  # noqa: PLC0415

    try:
        found = identified(points, output, id_, pump, circuit, free, keep_misfit)
    except PointFaultsError as error:
        raise failure(f"{points} has {len(error.faults)} fault(s)\n  " + "\n  ".join(error.faults), 2) from None
    except (ValueError, OSError) as error:
        raise failure(str(error), 2) from None
    to = _listener(json_)
    to.print(found.table)
    for line in found.remarks:
        say(line, to=to)
    _write(json_, found.json)
    if found.fault is not None:
        raise failure(found.fault)
    say(f"Parameter set: {output}", to=to)


@app.command(cls=Command)
def learn_priors(
    output: Annotated[Path, typer.Option(help="Parameter set to write: .toml", dir_okay=False)],
    id_: Annotated[str, typer.Option("--id", help="Name of the new pump type")],
    pump: Annotated[str, typer.Option(help="Pump type to learn for")] = "h225",
    operator: Annotated[str | None, typer.Option(help="Learn from this operator's pumps only")] = None,
    json_: Json = False,
) -> None:
    """Learn how pumps differ from the healthy ones of the stored fleet, as a pump type that can be added.

    With --json: {"output", "pumps", "healthy", "document"}; the document is the body of POST /pump-types.
    """
    from service.errors import Problem  # noqa: PLC0415
    from service.pump_types.parameter_files import derived_toml  # noqa: PLC0415
    from service.running import opened  # noqa: PLC0415 - heavy, and only here
    from service.settings import Settings  # noqa: PLC0415
    from service.studies.fleet_priors import learn, remarks  # noqa: PLC0415

    if output.suffix.lower() != ".toml":
        raise failure(f"--output {output}: ends not in .toml", 2)
    try:
        context = opened(Settings())
    except RuntimeError as error:
        raise failure(str(error)) from None
    try:
        found = learn(context.database, context.archive, pump, id_, operator)
        output.parent.mkdir(parents=True, exist_ok=True)
        output.write_text(derived_toml(found.document, tuple(remarks(found))), encoding="utf-8")
    except Problem as problem:
        faults = "".join(f"\n  {f.where}: {f.problem}" for f in problem.errors)
        raise failure(f"{problem.detail}{faults}") from None
    except OSError as error:
        raise failure(str(error)) from None
    finally:
        context.database.close()
    if json_:
        say_json({"output": str(output), "pumps": found.pumps, "healthy": found.healthy, "document": found.document})
        return
    for line in remarks(found):
        say(line)
    say(f"Parameter set: {output}; add it with POST /pump-types")


@app.command(cls=Command)
def validate(
    output: Annotated[Path, typer.Option(help="Where the page goes", dir_okay=False)] = Path("report.html"),
    json_: Annotated[
        Path | None, typer.Option("--json", help="Also write the rows as JSON; - is standard output", dir_okay=False)
    ] = None,
    only: Annotated[list[str] | None, typer.Option(help="Only this comparison; may be repeated")] = None,
) -> None:
    """Compare the twin with published evidence; exit code 1 if a row is missed that is not known to be.

    The JSON: [{"evidence", "quantity", "unit", "reference", "value", "tolerance", "within", "fitted", "class", "known_miss",
    "note"}]; what is no number is null. The class is independent (nothing was fitted to it), fitted or plausible (a sign,
    an order of events, an own baseline); rows that only state have within null and are counted in none.
    """
    from rich.progress import track  # noqa: PLC0415

    from service.studies.validation.report import counts_of, news, report_html, rows_json  # noqa: PLC0415 - heavy, and only here
    from twin.validation.catalogue import EVIDENCE  # noqa: PLC0415

    unknown = [name for name in only or () if name not in EVIDENCE]
    if unknown:
        raise failure(f"no comparison {', '.join(unknown)}; known: {', '.join(EVIDENCE)}")
    names = [name for name in EVIDENCE if not only or name in only]
    found = {name: EVIDENCE[name]() for name in track(names, "comparing", console=complaints(), transient=True)}
    counts = counts_of(found)
    to = _listener(json_)
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_text(report_html(found), encoding="utf-8")
    _write(json_, json.dumps(rows_json(found), indent=1) + "\n")
    say(counts.sentence, to=to)
    say(f"Report: {output}", to=to)
    missed = news(found)
    if missed:
        raise failure(f"not met: {'; '.join(missed)}")


@app.command(cls=Command)
def isolability(
    pump: Annotated[str, typer.Option(help="Pump type")] = "h225",
    circuit: Annotated[str, typer.Option(help="Circuit round the pump: its name, or a file")] = "shared_return",
    flights: Annotated[int, typer.Option(help="Flights with the fault")] = 30,
    baseline_flights: Annotated[int, typer.Option(help="Healthy flights before it")] = 30,
    windows: Annotated[int, typer.Option(help="Zero-flow windows per flight")] = 1,
    temperatures: Annotated[tuple[float, float], typer.Option(help="Lowest and highest fluid temperature [degC]")] = (
        30.0,
        80.0,
    ),
    full_scale: Annotated[float, typer.Option(help="Full scale of the case sensor [bar]")] = 5.0,
    accuracy: Annotated[float, typer.Option(help="Its accuracy [% of full scale]")] = 1.0,
    zero: Annotated[bool, typer.Option(help="Each flight has a pump-off zero")] = True,
    reservoir: Annotated[bool, typer.Option(help="A reservoir sensor is fitted")] = True,
    burst: Annotated[bool, typer.Option(help="Each flight has 2 s at 10 kHz")] = False,
    ground_run_every: Annotated[
        int | None, typer.Option(help="Every so many flights has windows at 10 and 20 L/min; none without")
    ] = None,
    svg: Annotated[Path | None, typer.Option(help="Also draw it", dir_okay=False)] = None,
    json_: Annotated[
        Path | None, typer.Option("--json", help="Also write it as JSON; - is standard output", dir_okay=False)
    ] = None,
) -> None:
    """Smallest fault of each kind that given sensors detect and isolate; exit code 2 if the study is wrong.

    The JSON is the document that POST /twin/isolability answers with.
    """
    from service.studies.isolability import IsolabilityOptions, isolability_study, isolability_table  # noqa: PLC0415 - heavy, and only here

    options = IsolabilityOptions(
        pump,
        circuit,
        flights,
        baseline_flights,
        windows,
        temperatures,
        full_scale,
        accuracy,
        zero,
        reservoir,
        burst,
        ground_run_every,
    )
    try:
        study = isolability_study(options)
    except ValueError as error:
        raise failure(str(error), 2) from None
    to = _listener(json_)
    to.print(isolability_table(study))
    for remark in study.found.remarks:
        say(f"Note: {remark}.", to=to)
    if svg is not None:
        svg.parent.mkdir(parents=True, exist_ok=True)
        svg.write_text(study.svg(), encoding="utf-8")
    if json_ is not None:
        _write(json_, study.json())


@app.command(cls=Command)
def evaluate(
    json_: Annotated[
        Path | None, typer.Option("--json", help="Write all numbers as JSON; - is standard output", dir_okay=False)
    ] = None,
    html: Annotated[Path | None, typer.Option(help="Write the page", dir_okay=False)] = None,
    pumps: Annotated[int | None, typer.Option(min=4, help="Pumps in each row, over all realities [300]")] = None,
    healthy_records: Annotated[
        int | None, typer.Option(min=100, help="Healthy records in each reality [100000]")
    ] = None,
    rows: Annotated[list[str] | None, typer.Option(help="Only this row; may be repeated")] = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes [as many as cores]")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Another seed is another fleet")] = 1,
    resume: Annotated[
        Path | None,
        typer.Option(help="Folder that keeps what is judged: the same study goes on there", file_okay=False),
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="A smoke run of about a minute: few pumps")] = False,
) -> None:
    """Detection study on simulated fleets that differ from the judge's model.

    The JSON holds every number of the page: the study as asked for, each row, and each target with what was found.
    """
    from service.studies.evaluation.command import Outputs, available_cores  # noqa: PLC0415 - heavy, and only here
    from service.studies.evaluation.command import evaluate as evaluated  # noqa: PLC0415
    from service.studies.evaluation.numbers import study_json  # noqa: PLC0415
    from service.studies.evaluation.plan import StudyFaultsError, sized  # noqa: PLC0415
    from service.studies.evaluation.report import missed  # noqa: PLC0415

    try:
        study = sized(rows or (), pumps, healthy_records, seed, quick=quick)
        file = None if _is_output(json_) else json_
        results = evaluated(study, Outputs(file, html, resume), workers or available_cores(), complaints())
    except StudyFaultsError as error:
        raise failure("\n  ".join(error.faults), 2) from None
    except (RuntimeError, OSError) as error:
        raise failure(str(error)) from None
    except KeyboardInterrupt:
        kept = f"what is judged is kept: the same command goes on from {resume}" if resume else "nothing is kept"
        raise failure(f"stopped; {kept}", 130) from None
    asked = [f for f in results.findings if f.met is not None]
    to = _listener(json_)
    for words in missed(results.findings):
        say(("not met", "red"), f" {words}", to=to)
    say(f"{sum(f.met is True for f in asked)} of {len(asked)} targets met", to=to)
    for path in (html, file):
        if path is not None:
            say(f"Written: {path}", to=to)
    if _is_output(json_):
        say_json(study_json(results))


def _is_output(path: Path | None) -> bool:
    return path is not None and str(path) == STANDARD_OUTPUT


def _listener(path: Path | None) -> "Console":
    return listener(_is_output(path))


def _write(path: Path | None, text: str) -> None:
    """Write a file of numbers, or print it where the name says so."""
    if path is None:
        return
    if _is_output(path):
        sys.stdout.write(text)
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
