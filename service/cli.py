"""The command line."""

import json
import sys
import time
from datetime import datetime
from pathlib import Path
from typing import Annotated

import httpx2
import structlog
import typer
import uvicorn
from rich.console import Console
from rich.progress import Progress, track
from rich.table import Table
from rich.text import Text

from detectors.curve_svg import curve_svg
from service import __version__
from service.client import Client, RefusedError
from service.errors import Problem
from service.ingest.decode import Limits
from service.settings import Settings

app = typer.Typer(no_args_is_help=True, help="Condition monitoring of hydraulic pumps.", pretty_exceptions_enable=False)
keys_app = typer.Typer(no_args_is_help=True, help="API keys.")
users_app = typer.Typer(no_args_is_help=True, help="Users of the pages.")
db_app = typer.Typer(no_args_is_help=True, help="The database's schema.")
app.add_typer(keys_app, name="keys")
app.add_typer(users_app, name="users")
app.add_typer(db_app, name="db")
console = Console()
complaints = Console(stderr=True)

Files = Annotated[
    list[Path], typer.Argument(help="Flight records: CSV, gzipped CSV, JSON", exists=True, dir_okay=False)
]
Url = Annotated[str, typer.Option(envvar="CASEDRAIN_URL", help="Where the service listens")]
Key = Annotated[str | None, typer.Option(envvar="CASEDRAIN_KEY", help="API key")]
Port = Annotated[int, typer.Option(help="Port to listen on")]


def _fail(words: str, code: int = 1) -> typer.Exit:
    complaints.print("[bold red]error:[/]", Text(words), highlight=False, soft_wrap=True)
    return typer.Exit(code)


def _version(wanted: bool) -> None:
    if wanted:
        console.print(f"casedrain {__version__}", highlight=False)
        raise typer.Exit


@app.callback()
def main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Condition monitoring of hydraulic pumps."""
    structlog.configure(
        processors=[
            structlog.contextvars.merge_contextvars,
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.format_exc_info,
            structlog.processors.JSONRenderer(),
        ],
        # asked for at every call: a test or a supervisor may have put another stream in its place
        logger_factory=lambda *_: structlog.PrintLogger(sys.stderr),
    )


@app.command()
def demo(
    flights: Annotated[int, typer.Option(min=12, max=1000, help="Flights per pump")] = 40,
    seed: Annotated[int, typer.Option(min=0, help="Another seed is another fleet")] = 1,
    port: Port = 8000,
    exit_: Annotated[
        bool, typer.Option("--exit", help="Stop after the table; exit code 1 if a verdict is wrong")
    ] = False,
) -> None:
    """Simulate a small fleet, upload it through the API, show its verdicts, leave the server running."""
    from service.demo.run import compare, free_port, operator_of, served, upload_fleet  # noqa: PLC0415 - heavy, and only here

    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(40))
    host = "127.0.0.1"
    settings = Settings(auth="off")
    place = free_port(host, port)
    console.print("Starting the service (the first start compiles the twin, some minutes) …")
    try:
        with served(settings, host, place) as address:
            with Client(address) as client:
                upload_fleet(client, flights, seed, console)
                good = compare(client, operator_of(flights, seed), console)
            console.print(f"Fleet page: [bold]{address}/[/]   API: {address}/openapi.json", highlight=False)
            if not exit_:
                console.print("The server keeps running; stop it with Ctrl-C.")
                while True:
                    time.sleep(3600)
    except KeyboardInterrupt:
        console.print("Stopped.")
        return
    except (RefusedError, RuntimeError, httpx2.HTTPError) as error:
        raise _fail(str(error)) from None
    raise typer.Exit(0 if good else 1)


@app.command()
def serve(
    host: Annotated[str, typer.Option(help="Address to listen on")] = "127.0.0.1",
    port: Port = 8000,
) -> None:
    """Serve API and pages."""
    from service.app import create_app, opened  # noqa: PLC0415 - heavy, and only here

    settings = Settings()
    fault = settings.binding_fault(host)
    if fault is not None:
        raise _fail(fault)
    try:
        opened(settings).database.close()
    except Exception as error:
        raise _fail(str(error)) from None
    uvicorn.run(create_app(settings), host=host, port=port, access_log=False, server_header=False)


@app.command()
def upload(
    places: Annotated[
        list[str],
        typer.Argument(help="Flight records: files, folders (with all below them) and patterns like 'a/*.csv'"),
    ],
    url: Url = "http://127.0.0.1:8000",
    key: Key = None,
    mapping: Annotated[str | None, typer.Option(help="Name of the channel mapping that the files need")] = None,
) -> None:
    """Upload flight records and print a result per file; started again, it goes on: what is known stays as it is."""
    from service.upload_files import content_type_of, files_of  # noqa: PLC0415 - only here

    files, missing = files_of(places)
    if missing:
        raise _fail(f"no flight records at {', '.join(missing)}; nothing was uploaded", 2)
    n_refused = 0
    with Client(url, key) as client:
        for path in track(files, "uploading", console=complaints, transient=True):
            try:
                answer = client.upload(path.read_bytes(), content_type_of(path), mapping=mapping)
            except RefusedError as error:
                n_refused += 1
                console.print(f"[red]refused[/]  {path}: {error}", highlight=False)
            except httpx2.HTTPError as error:
                raise _fail(f"{url} does not answer ({error}): is `casedrain serve` running?") from None
            else:
                verdict = answer.get("verdict", {})
                words = answer.get("explanation") or verdict.get("advice", "")
                console.print(
                    f"[green]{answer['status']}[/] {path}: {verdict.get('state', '')}. {words}", highlight=False
                )
    if n_refused:
        raise _fail(f"{n_refused} of {len(files)} files were refused")


@app.command()
def reprocess(
    pump: Annotated[str | None, typer.Option(help="Only this serial number")] = None,
    pump_type: Annotated[str | None, typer.Option(help="Only this pump type")] = None,
    operator: Annotated[str | None, typer.Option(help="Only this operator")] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show what would change, change nothing")] = False,
    url: Url = "http://127.0.0.1:8000",
    key: Key = None,
) -> None:
    """Reduce records and fold pumps anew with today's twin and thresholds; prints the verdicts that differ."""
    parameters = {"pump": pump, "pump_type": pump_type, "dry_run": dry_run}
    try:
        with Client(url, key) as client, Progress(console=complaints, transient=True) as bar:
            task = bar.add_task("reprocessing", total=None)
            job = client.start_job("reprocess", parameters, operator)
            job = client.finished_job(
                job["id"], lambda done, total: bar.update(task, completed=done, total=total, refresh=True)
            )
            items = list(client.job_items(job["id"]))
    except RefusedError as error:
        raise _fail(str(error)) from None
    except httpx2.HTTPError as error:
        raise _fail(f"{url} does not answer ({error}): is `casedrain serve` running?") from None
    for item in items:
        if item["status"] == "failed":
            left = f"{item['pump']} ({item['operator']}): left as it was, {item['problem']['detail']}"
            complaints.print(left, highlight=False, markup=False)
            continue
        words = f"{item['pump']} ({item['operator']}): {item['changed']} of {item['records']} verdicts differ"
        console.print(f"{words}; {item['state_before']} -> {item['state_after']}", highlight=False, markup=False)
    if job["status"] != "succeeded":
        raise _fail(f"the job is {job['status']}: {(job['problem'] or {}).get('detail', 'see its items')}")


@app.command()
def analyse(
    files: Files,
    output: Annotated[Path | None, typer.Option(help="Folder for the pictures")] = None,
    serial: Annotated[str | None, typer.Option(help="Pump serial, where the files do not say it")] = None,
) -> None:
    """Analyse files without a server: windows, verdict and picture per pump."""
    from service.monitoring.offline import analyse_files  # noqa: PLC0415 - heavy, and only here

    settings = Settings()
    limits = Limits(settings.max_inflated_bytes, settings.max_rows)
    found = analyse_files(files, limits, {"pump_serial": serial} if serial else {})
    for path, problem in found.refused:
        _show_refusal(path, problem)
    for pump in found.pumps:
        table = Table(title=f"Pump {pump.serial}")
        for heading in ("file", "zero-flow window", "case residual [bar]", "discharge residual [bar]", "state"):
            table.add_column(heading)
        states = {a.record_id: a.verdict.state.value for a in pump.assessments}
        for file in sorted(pump.files, key=lambda f: (f.observation.at, f.observation.record_id)):
            window = file.observation.reduction.zero_flow
            span = f"{window.start_s:.0f} to {window.end_s:.0f} s" if window else file.observation.reduction.explanation
            numbers = [
                f"{r.residual:+.3f} ± {1.645 * r.standard_deviation:.3f}" if r else "–"
                for r in (file.residuals.get(c) for c in ("case_pressure_bar", "discharge_pressure_bar"))
            ]
            table.add_row(file.path.name, span, *numbers, states[file.observation.record_id])
        console.print(table)
        verdict = pump.assessments[-1].verdict
        console.print(f"[bold]{verdict.state.value}[/], side {verdict.side.value}: {verdict.advice}", highlight=False)
        if verdict.resolving_measurement:
            console.print(f"What would tell: {verdict.resolving_measurement}.", highlight=False)
        folder = output or Path()
        folder.mkdir(parents=True, exist_ok=True)
        picture = folder / f"{_safe(pump.serial)}-damage-identification-curve.svg"
        picture.write_text(curve_svg(pump.curve, f"pump {pump.serial}"), encoding="utf-8")
        console.print(f"Picture: {picture}", highlight=False)
    if found.refused:
        raise _fail(f"{len(found.refused)} of {len(files)} files were refused")


@app.command()
def simulate(
    scenario: Annotated[Path, typer.Argument(help="Scenario file: TOML", exists=True, dir_okay=False)],
    output: Annotated[Path, typer.Option(help="Flight record to write: .parquet or .csv")],
    picture: Annotated[Path | None, typer.Option(help="Picture to draw: .svg or .png")] = None,
    pump: Annotated[str, typer.Option(help="Pump type")] = "h225",
    circuit: Annotated[str, typer.Option(help="Circuit round the pump")] = "shared_return",
    sensors: Annotated[str, typer.Option(help="none (the truth), helicopter or test_bench")] = "none",
    seed: Annotated[int, typer.Option(min=0, help="Another seed is other chance in the sensors")] = 1,
) -> None:
    """Simulate a scenario into a flight record; exit code 1 if it stops early, 2 if it is wrong."""
    from service.simulation.run import asked, run_file  # noqa: PLC0415 - heavy, and only here
    from service.simulation.scenario_file import ScenarioFaultsError  # noqa: PLC0415

    try:
        file, kind = asked(scenario, output, picture, pump, circuit, sensors)
        with Progress(console=complaints, transient=True) as bar:
            task = bar.add_task("simulating", total=1.0)
            outcome = run_file(
                file, kind, circuit, sensors, seed, output, picture, lambda share: bar.update(task, completed=share)
            )
    except ScenarioFaultsError as error:
        raise _fail(f"{scenario} has {len(error.faults)} fault(s)\n  " + "\n  ".join(error.faults), 2) from None
    except (RuntimeError, OSError) as error:
        raise _fail(str(error)) from None
    console.print(f"{output}: {outcome.n_rows} rows, {outcome.status.time_s:.6g} s", highlight=False, soft_wrap=True)
    if outcome.missing:
        words = f"To upload it, say in the scenario's table metadata: {', '.join(outcome.missing)}."
        console.print(words, highlight=False, soft_wrap=True)
    if not outcome.status.ok:
        raise _fail(f"{outcome.status.advice}. What was computed until then is kept.")


@app.command()
def validate(
    output: Annotated[Path, typer.Option(help="Where the page goes", dir_okay=False)] = Path("report.html"),
    json_: Annotated[Path | None, typer.Option("--json", help="Also write the rows as JSON", dir_okay=False)] = None,
    only: Annotated[list[str] | None, typer.Option(help="Only this comparison; may be repeated")] = None,
) -> None:
    """Compare the twin with published evidence; exit code 1 if a row that validates is not met."""
    from service.validation.report import counts_of, report_html, rows_json  # noqa: PLC0415 - heavy, and only here
    from twin.validation.catalogue import EVIDENCE  # noqa: PLC0415

    unknown = [name for name in only or () if name not in EVIDENCE]
    if unknown:
        raise _fail(f"no comparison {', '.join(unknown)}; known: {', '.join(EVIDENCE)}")
    names = [name for name in EVIDENCE if not only or name in only]
    found = {name: EVIDENCE[name]() for name in track(names, "comparing", console=complaints, transient=True)}
    counts = counts_of(found)
    for path, text in ((output, report_html(found)), (json_, json.dumps(rows_json(found), indent=1) + "\n")):
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
    words = f"{counts.met} rows met, {counts.not_met} not met; fitted: {counts.fitted_met} met, "
    console.print(f"{words}{counts.fitted_not_met} not met; {counts.stated} only stated", highlight=False)
    console.print(f"Report: {output}", highlight=False)
    if counts.not_met:
        missed = [row.quantity for e in found.values() for row in e.rows if row.within is False and not row.fitted]
        raise _fail(f"not met: {'; '.join(missed)}")


@app.command()
def isolability(
    pump: Annotated[str, typer.Option(help="Pump type")] = "h225",
    circuit: Annotated[str, typer.Option(help="Circuit round the pump")] = "shared_return",
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
    svg: Annotated[Path | None, typer.Option(help="Also draw it", dir_okay=False)] = None,
    json_: Annotated[Path | None, typer.Option("--json", help="Also write it as JSON", dir_okay=False)] = None,
) -> None:
    """Smallest fault of each kind that given sensors detect and isolate; exit code 2 if the study is wrong."""
    from service.isolability_study import IsolabilityOptions, isolability_study, isolability_table  # noqa: PLC0415 - heavy, and only here

    options = IsolabilityOptions(
        pump, circuit, flights, baseline_flights, windows, temperatures, full_scale, accuracy, zero, reservoir, burst
    )
    try:
        study = isolability_study(options)
    except ValueError as error:
        raise _fail(str(error), 2) from None
    console.print(isolability_table(study))
    for remark in study.found.remarks:
        console.print(f"Note: {remark}.", highlight=False, soft_wrap=True)
    for path, text in ((svg, study.svg), (json_, study.json)):
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text(), encoding="utf-8")


@app.command()
def evaluate(
    json_: Annotated[Path | None, typer.Option("--json", help="Write all numbers as JSON", dir_okay=False)] = None,
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
    """Detection study on simulated fleets that differ from the judge's model."""
    from service.evaluation.command import Outputs, available_cores  # noqa: PLC0415 - heavy, and only here
    from service.evaluation.command import evaluate as evaluated  # noqa: PLC0415
    from service.evaluation.plan import StudyFaultsError, sized  # noqa: PLC0415
    from service.evaluation.report import missed  # noqa: PLC0415

    try:
        study = sized(rows or (), pumps, healthy_records, seed, quick=quick)
        results = evaluated(study, Outputs(json_, html, resume), workers or available_cores(), complaints)
    except StudyFaultsError as error:
        raise _fail("\n  ".join(error.faults), 2) from None
    except (RuntimeError, OSError) as error:
        raise _fail(str(error)) from None
    except KeyboardInterrupt:
        kept = f"what is judged is kept: the same command goes on from {resume}" if resume else "nothing is kept"
        raise _fail(f"stopped; {kept}", 130) from None
    asked = [f for f in results.findings if f.met is not None]
    for words in missed(results.findings):
        console.print(f"[red]not met[/] {words}", highlight=False, soft_wrap=True)
    console.print(f"{sum(f.met is True for f in asked)} of {len(asked)} targets met", highlight=False)
    for path in (html, json_):
        if path is not None:
            console.print(f"Written: {path}", highlight=False, soft_wrap=True)


@keys_app.command("create")
def create_key(
    role: Annotated[str, typer.Option(help="viewer, analyst, engineer or admin")],
    operator: Annotated[str | None, typer.Option(help="Bind the key to one operator")] = None,
    owner: Annotated[str, typer.Option(help="Who holds the key")] = "command line",
    expires: Annotated[datetime | None, typer.Option(help="When it stops working (UTC)")] = None,
) -> None:
    """Make an API key and print it once."""
    from datetime import UTC  # noqa: PLC0415

    from service import audit  # noqa: PLC0415 - heavy, and only here
    from service.app import opened  # noqa: PLC0415
    from service.security import AT_THE_MACHINE, new_key  # noqa: PLC0415

    try:
        context = opened(Settings())
        with context.database.writing() as session:
            row, key = new_key(session, owner, role, operator, expires.replace(tzinfo=UTC) if expires else None)
            audit.note(session, AT_THE_MACHINE, "key.make", f"key/{row.id}", operator, {"owner": owner, "role": role})
    except (ValueError, RuntimeError) as error:
        raise _fail(str(error)) from None
    context.database.close()
    # plain print: the key must come out unwrapped, alone on its line
    print(key)


@users_app.command("create")
def create_user(
    name: Annotated[str, typer.Argument(help="Name to sign in with")],
    role: Annotated[str, typer.Option(help="viewer, analyst, engineer or admin")],
    password: Annotated[
        str, typer.Option(prompt=True, confirmation_prompt=True, hide_input=True, envvar="CASEDRAIN_NEW_PASSWORD")
    ],
    operator: Annotated[str | None, typer.Option(help="Bind the user to one operator")] = None,
    email: Annotated[str | None, typer.Option(help="Address for mails")] = None,
    mail: Annotated[bool, typer.Option("--mail", help="Send mails about alarms there")] = False,
) -> None:
    """Make a user of the pages; the password is asked for."""
    from service import audit  # noqa: PLC0415 - heavy, and only here
    from service.app import opened  # noqa: PLC0415
    from service.security import AT_THE_MACHINE  # noqa: PLC0415
    from service.users import new_user  # noqa: PLC0415

    try:
        context = opened(Settings())
    except RuntimeError as error:
        raise _fail(str(error)) from None
    try:
        with context.database.writing() as session:
            row = new_user(session, name, password, role, operator, email, mail)
            audit.note(session, AT_THE_MACHINE, "user.make", f"user/{row.name}", operator, {"role": role})
    except Problem as problem:
        faults = "".join(f"\n  {f.where}: {f.problem}" for f in problem.errors)
        raise _fail(f"{problem.detail}{faults}") from None
    finally:
        context.database.close()
    console.print(f"User {name} can sign in now.", highlight=False, markup=False)


@db_app.command("upgrade")
def upgrade_database() -> None:
    """Bring the database of the settings to the newest schema."""
    from service.database import upgrade  # noqa: PLC0415 - heavy, and only here

    settings = Settings()
    upgrade(settings.effective_database_url)
    console.print("The database is up to date.")


def _show_refusal(path: Path, problem: Problem) -> None:
    console.print(f"[red]refused[/] {path}: {problem.detail}", highlight=False)
    for fault in problem.errors:
        console.print(f"  {fault.where}: {fault.problem}", highlight=False, markup=False)


def _safe(name: str) -> str:
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in name).lstrip(".") or "pump"
