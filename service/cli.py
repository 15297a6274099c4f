"""The command line."""

import json
import sys
import time
from pathlib import Path
from typing import Annotated

import httpx2
import structlog
import typer
import uvicorn
from rich.progress import Progress, track
from rich.table import Table

from detectors.curve.picture import curve_svg
from service.cli_administration import db_app, keys_app, users_app
from service.cli_studies import app as studies
from service.client import Client, RefusedError
from service.console import complaints, console, failure
from service.errors import Problem
from service.ingest.decode import Limits
from service.settings import Settings

app = typer.Typer(no_args_is_help=True, help="Condition monitoring of hydraulic pumps.", pretty_exceptions_enable=False)
app.add_typer(studies)
app.add_typer(keys_app, name="keys")
app.add_typer(users_app, name="users")
app.add_typer(db_app, name="db")

Files = Annotated[
    list[Path], typer.Argument(help="Flight records: CSV, gzipped CSV, JSON", exists=True, dir_okay=False)
]
Url = Annotated[str, typer.Option(envvar="CASEDRAIN_URL", help="Where the service listens")]
Key = Annotated[str | None, typer.Option(envvar="CASEDRAIN_KEY", help="API key")]
Port = Annotated[int, typer.Option(help="Port to listen on")]


@app.callback(invoke_without_command=True)
def main(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Show release and commit.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="With --version: release, commit and sources")] = False,
) -> None:
    """Condition monitoring of hydraulic pumps."""
    if version:
        from service.identity import in_words, software  # noqa: PLC0415 - only here is git asked and code hashed

        typer.echo(json.dumps(software().to_json()) if as_json else in_words())
        raise typer.Exit
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())
        raise typer.Exit
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
    files: Annotated[
        Path | None, typer.Option(help="Only write the flight records, into this folder", file_okay=False)
    ] = None,
) -> None:
    """Simulate a small fleet, upload it through the API, show its verdicts, leave the server running."""
    from service.demo.run import compare, free_port, operator_of, served, upload_fleet, write_fleet  # noqa: PLC0415 - heavy, and only here

    if files is not None:
        n_files = write_fleet(files, flights, seed)
        console.print(f"{n_files} flight records in {files}", highlight=False, soft_wrap=True)
        return
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
        raise failure(str(error)) from None
    raise typer.Exit(0 if good else 1)


@app.command()
def serve(
    host: Annotated[str, typer.Option(help="Address to listen on")] = "127.0.0.1",
    port: Port = 8000,
) -> None:
    """Serve API and pages."""
    from service.running import opened  # noqa: PLC0415 - heavy, and only here
    from service.web.app import create_app  # noqa: PLC0415 - heavy, and only here

    settings = Settings()
    fault = settings.binding_fault(host)
    if fault is not None:
        raise failure(fault)
    try:
        opened(settings).database.close()
    except Exception as error:
        raise failure(str(error)) from None
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
    from service.ingest.upload_files import content_type_of, files_of  # noqa: PLC0415 - only here

    files, missing = files_of(places)
    if missing:
        raise failure(f"no flight records at {', '.join(missing)}; nothing was uploaded", 2)
    n_refused = 0
    with Client(url, key) as client:
        for path in track(files, "uploading", console=complaints, transient=True):
            try:
                answer = client.upload(path.read_bytes(), content_type_of(path), mapping=mapping)
            except RefusedError as error:
                n_refused += 1
                console.print(f"[red]refused[/]  {path}: {error}", highlight=False)
            except httpx2.HTTPError as error:
                raise failure(f"{url} does not answer ({error}): is `casedrain serve` running?") from None
            else:
                verdict = answer.get("verdict", {})
                words = answer.get("explanation") or verdict.get("advice", "")
                console.print(
                    f"[green]{answer['status']}[/] {path}: {verdict.get('state', '')}. {words}", highlight=False
                )
    if n_refused:
        raise failure(f"{n_refused} of {len(files)} files were refused")


@app.command()
def reprocess(
    pump: Annotated[str | None, typer.Option(help="Only this serial number")] = None,
    pump_type: Annotated[str | None, typer.Option(help="Only this pump type")] = None,
    operator: Annotated[str | None, typer.Option(help="Only this operator")] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show what would change, change nothing")] = False,
    only_verdicts: Annotated[bool, typer.Option("--only-verdicts", help="Fold the stored windows")] = False,
    threshold_version: Annotated[int | None, typer.Option(help="Thresholds as of this version number")] = None,
    twin_version: Annotated[str | None, typer.Option(help="Twin to judge with, as verdicts name it")] = None,
    url: Url = "http://127.0.0.1:8000",
    key: Key = None,
) -> None:
    """Reduce records and fold pumps anew with today's versions or others; prints verdicts and alarms that differ."""
    parameters = {
        "pump": pump,
        "pump_type": pump_type,
        "dry_run": dry_run,
        "only": "verdicts" if only_verdicts else "everything",
        "threshold_version": threshold_version,
        "twin_version": twin_version,
    }
    try:
        with Client(url, key) as client, Progress(console=complaints, transient=True) as bar:
            task = bar.add_task("reprocessing", total=None)
            job = client.start_job("reprocess", parameters, operator)
            job = client.finished_job(
                job["id"], lambda done, total: bar.update(task, completed=done, total=total, refresh=True)
            )
            items = list(client.job_items(job["id"]))
    except RefusedError as error:
        raise failure(str(error)) from None
    except httpx2.HTTPError as error:
        raise failure(f"{url} does not answer ({error}): is `casedrain serve` running?") from None
    for item in items:
        if item["status"] == "failed":
            left = f"{item['pump']} ({item['operator']}): left as it was, {item['problem']['detail']}"
            complaints.print(left, highlight=False, markup=False)
            continue
        words = f"{item['pump']} ({item['operator']}): {item['changed']} of {item['records']} verdicts differ"
        console.print(f"{words}; {item['state_before']} -> {item['state_after']}", highlight=False, markup=False)
        for what in ("gained", "lost"):
            for alarm in item["alarms"][what]:
                line = f"  alarm {what}: {alarm['verdict_state']}, {alarm['priority']}, raised {alarm['raised_at']}"
                console.print(line, highlight=False, markup=False)
    if job["status"] != "succeeded":
        raise failure(f"the job is {job['status']}: {(job['problem'] or {}).get('detail', 'see its items')}")


@app.command()
def analyse(
    files: Files,
    output: Annotated[Path | None, typer.Option(help="Folder for the pictures")] = None,
    serial: Annotated[str | None, typer.Option(help="Pump serial, where the files do not say it")] = None,
    instead: Annotated[
        str | None,
        typer.Option("--pump", help="Pump type instead of the files' own: a name, or a .toml or .json file"),
    ] = None,
) -> None:
    """Analyse files without a server: windows, verdict and picture per pump."""
    from service.pump_types.parameter_files import named_or_written  # noqa: PLC0415
    from service.studies.offline import analyse_files  # noqa: PLC0415 - heavy, and only here

    settings = Settings()
    limits = Limits(settings.max_inflated_bytes, settings.max_rows)
    try:
        kind = named_or_written(instead) if instead else None
    except ValueError as error:
        raise failure(f"--pump {error}", 2) from None
    found = analyse_files(files, limits, {"pump_serial": serial} if serial else {}, kind)
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
        raise failure(f"{len(found.refused)} of {len(files)} files were refused")


def _show_refusal(path: Path, problem: Problem) -> None:
    console.print(f"[red]refused[/] {path}: {problem.detail}", highlight=False)
    for fault in problem.errors:
        console.print(f"  {fault.where}: {fault.problem}", highlight=False, markup=False)


def _safe(name: str) -> str:
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in name).lstrip(".") or "pump"
