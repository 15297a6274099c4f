"""The command line."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

import typer

from service.command_line.administration import db_app, keys_app, users_app
from service.command_line.analysed import analysed_pump, refusal, safe_name, show_pump, show_refusal
from service.command_line.command import Command, Commands, tell_version
from service.command_line.console import Json, complaints, failure, listener, say, say_json
from service.command_line.failures import WRONG_SETTING
from service.command_line.inbox import app as inbox
from service.command_line.keeping import app as keeping
from service.command_line.keeping import audit_app
from service.command_line.mapping import app as mapping_app
from service.command_line.mapping_options import (
    MappingOption,
    Naming,
    PatternOption,
    SetOption,
    local_mapping,
    set_values,
    stored_name,
    told,
)
from service.command_line.pump import pump_app
from service.command_line.studies import app as studies
from service.command_line.twin_studies import app as twin_studies

if TYPE_CHECKING:
    from service.answers.records import Record

app = typer.Typer(
    cls=Commands,
    no_args_is_help=True,
    help="Condition monitoring of hydraulic pumps.",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.add_typer(studies)
app.add_typer(mapping_app)
app.add_typer(inbox)
app.add_typer(keeping)
app.add_typer(audit_app, name="audit")
app.add_typer(twin_studies)
app.add_typer(keys_app, name="keys")
app.add_typer(users_app, name="users")
app.add_typer(db_app, name="db")
app.add_typer(pump_app, name="pump")

Files = Annotated[
    list[Path], typer.Argument(help="Flight records: CSV, gzipped CSV, JSON", exists=True, dir_okay=False)
]
Url = Annotated[str, typer.Option(envvar="CASEDRAIN_URL", help="Where the service listens")]
Key = Annotated[str | None, typer.Option(envvar="CASEDRAIN_KEY", help="API key")]


class Uploaded(TypedDict):
    """What became of a file that was sent: the service's answer, or in a sentence why it was refused."""

    file: str
    answer: "Record | None"
    refusal: str | None


_UPLOAD_RETRIES = 12
"""Some four minutes of a service that is away: a restart of its database, an upgrade."""
_NOT_THE_FILE = (401, 403, 429, 500, 502, 503, 504, 507)
"""Answers that say nothing about a file: the next one would get the same."""
_MOST_PASSED_OVER = 20
"""Files that are named one by one; the rest is counted."""
Port = Annotated[int, typer.Option(min=1, max=65535, help="Port to listen on")]


@app.callback(invoke_without_command=True)
def main(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Show release and commit.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="With --version: release, commit and sources")] = False,
) -> None:
    """Condition monitoring of hydraulic pumps."""
    if version:
        tell_version(as_json)
        raise typer.Exit
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())
        raise typer.Exit


@app.command(cls=Command)
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
    json_: Json = False,
) -> None:
    """Simulate a small fleet, upload it through the API, show its verdicts, leave the server running.

    With --json: {"address", "operator", "good", "pumps": [{"serial", "aircraft", "position", "truth", "state",
    "candidates", "side", "probability", "agrees"}]}; with --files: {"folder", "files"}.
    """
    import httpx2  # noqa: PLC0415 - heavy, and only here
    import structlog  # noqa: PLC0415

    from service.client import Client, RefusedError  # noqa: PLC0415
    from service.demo.run import (  # noqa: PLC0415
        compared,
        free_port,
        is_good,
        operator_of,
        served,
        table_of,
        upload_fleet,
        write_fleet,
    )
    from service.settings import Settings  # noqa: PLC0415

    to = listener(json_)
    if files is not None:
        n_files = write_fleet(files, flights, seed)
        say(f"{n_files} flight records in {files}", to=to)
        if json_:
            say_json({"folder": str(files), "files": n_files})
        return
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(40))
    host = "127.0.0.1"
    settings = Settings(auth="off")
    place = free_port(host, port)
    operator = operator_of(flights, seed)
    say("Starting the service (the first start compiles the twin, a minute or two) …", to=to)
    try:
        with served(settings, host, place) as address:
            with Client(address) as client:
                upload_fleet(client, flights, seed, to)
                rows = compared(client, operator)
            to.print(table_of(rows))
            if json_:
                say_json({"address": address, "operator": operator, "good": is_good(rows), "pumps": rows})
            say("Fleet page: ", (f"{address}/", "bold"), f"   API: {address}/openapi.json", to=to)
            if not exit_:
                say("The server keeps running; stop it with Ctrl-C.", to=to)
                while True:
                    time.sleep(3600)
    except KeyboardInterrupt:
        say("Stopped.", to=to)
        return
    except (RefusedError, RuntimeError, httpx2.HTTPError) as error:
        raise failure(str(error)) from None
    raise typer.Exit(0 if is_good(rows) else 1)


@app.command(cls=Command)
def serve(
    host: Annotated[str, typer.Option(help="Address to listen on")] = "127.0.0.1",
    port: Port = 8000,
) -> None:
    """Serve API and pages."""
    from service.command_line.server import Server, bound_socket  # noqa: PLC0415 - heavy, and only here
    from service.running import opened  # noqa: PLC0415
    from service.settings import Settings  # noqa: PLC0415
    from service.web.app import create_app  # noqa: PLC0415

    settings = Settings()
    fault = settings.binding_fault(host)
    if fault is not None:
        raise failure(fault)
    try:
        listening = bound_socket(host, port)
    except OSError as error:
        raise failure(f"--host {host} --port {port} cannot be listened on: {error.strerror}", WRONG_SETTING) from None
    with listening:
        try:
            opened(settings).database.close()
            application = create_app(settings)
        except RuntimeError as error:
            raise failure(str(error), WRONG_SETTING) from None
        Server(application, settings, host, port).run(sockets=[listening])


@app.command(cls=Command)
def upload(
    places: Annotated[
        list[str],
        typer.Argument(help="Flight records: files, folders (with all below them) and patterns like 'a/*.csv'"),
    ],
    url: Url = "http://127.0.0.1:8000",
    key: Key = None,
    mapping: MappingOption = None,
    set_: SetOption = None,
    name_pattern: PatternOption = None,
    json_: Json = False,
) -> None:
    """Upload flight records and print a result per file; started again, it goes on: what is known stays as it is.

    What lies in a folder and is no flight record by its name is passed over and listed.

    With --json: {"files": [{"file", "answer", "refusal"}], "passed_over": [{"file", "why"}]}; the answer is the API's to
    the upload, or null where the refusal says why the file was not taken.
    """
    import httpx2  # noqa: PLC0415 - heavy, and only here
    from rich.progress import track  # noqa: PLC0415

    from service.client import Client, RefusedError  # noqa: PLC0415
    from service.errors import Problem  # noqa: PLC0415
    from service.ingest.upload_files import content_type_of, files_of, passed_over  # noqa: PLC0415

    values = set_values(set_)
    naming = Naming(name_pattern, values)
    files, missing = files_of(places)
    others = passed_over(places)
    for path, why in others[:_MOST_PASSED_OVER]:
        say(("passed over", "yellow"), f" {path}: {why}", to=complaints())
    if len(others) > _MOST_PASSED_OVER:
        say(f"… and {len(others) - _MOST_PASSED_OVER} more files passed over", to=complaints())
    if missing:
        raise failure(f"no flight records at {', '.join(missing)}; nothing was uploaded", 2)
    n_refused = 0
    rows: list[Uploaded] = []
    to = listener(json_)
    with Client(url, key, retries=_UPLOAD_RETRIES, needs_answer=True) as client:
        try:
            named = stored_name(client, mapping, values.get("operator"))
        except httpx2.HTTPError as error:
            raise failure(f"{url} does not answer ({error}): is `casedrain serve` running?") from None
        for path in track(files, "uploading", console=complaints(), transient=True):
            try:
                answer = client.upload(
                    path.read_bytes(),
                    content_type_of(path),
                    metadata=naming.of(path),
                    mapping=named,
                    file_name=path.name if named else None,
                )
            except (RefusedError, Problem) as error:
                if isinstance(error, RefusedError) and int(error.problem.get("status", 0)) in _NOT_THE_FILE:
                    words = (
                        f"{path} was not taken, and nothing after it: {error}. Run the command again: it goes on here"
                    )
                    raise failure(words) from None
                n_refused += 1
                words = told(error) if isinstance(error, Problem) else str(error)
                rows.append({"file": str(path), "answer": None, "refusal": words})
                say(("refused", "red"), f"  {path}: {words}", to=to)
            except httpx2.HTTPError as error:
                raise failure(f"{url} does not answer ({error}): is `casedrain serve` running?") from None
            else:
                rows.append({"file": str(path), "answer": answer, "refusal": None})
                verdict = answer.get("verdict", {})
                words = answer.get("explanation") or verdict.get("advice", "")
                say((answer["status"], "green"), f" {path}: {verdict.get('state', '')}. {words}", to=to)
    if json_:
        say_json({"files": rows, "passed_over": [{"file": str(path), "why": why} for path, why in others]})
    if n_refused:
        raise failure(f"{n_refused} of {len(files)} files were refused")


@app.command(cls=Command)
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
    json_: Json = False,
) -> None:
    """Reduce records and fold pumps anew with today's versions or others; prints verdicts and alarms that differ.

    With --json: {"job", "items"}, as the API's GET /jobs/{id} and GET /jobs/{id}/items say them.
    """
    import httpx2  # noqa: PLC0415 - heavy, and only here
    from rich.progress import Progress  # noqa: PLC0415

    from service.client import Client, RefusedError  # noqa: PLC0415

    parameters = {
        "pump": pump,
        "pump_type": pump_type,
        "dry_run": dry_run,
        "only": "verdicts" if only_verdicts else "everything",
        "threshold_version": threshold_version,
        "twin_version": twin_version,
    }
    try:
        with Client(url, key) as client, Progress(console=complaints(), transient=True) as bar:
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
    to = listener(json_)
    if json_:
        say_json({"job": job, "items": items})
    for item in items:
        if item["status"] == "failed":
            problem = item["problem"]
            why = problem["detail"] if problem else "no reason given"
            left = f"{item['pump']} ({item['operator']}): left as it was, {why}"
            say(left, to=complaints())
            continue
        words = f"{item['pump']} ({item['operator']}): {item['changed']} of {item['records']} verdicts differ"
        say(f"{words}; {item['state_before']} -> {item['state_after']}", to=to)
        for what in ("gained", "lost"):
            for alarm in item["alarms"][what]:
                line = f"  alarm {what}: {alarm['verdict_state']}, {alarm['priority']}, raised {alarm['raised_at']}"
                say(line, to=to)
    if job["status"] != "succeeded":
        raise failure(f"the job is {job['status']}: {job['problem']['detail'] if job['problem'] else 'see its items'}")


@app.command(cls=Command)
def analyse(
    files: Files,
    output: Annotated[Path | None, typer.Option(help="Folder for the pictures")] = None,
    serial: Annotated[str | None, typer.Option(help="Pump serial, where the files do not say it")] = None,
    instead: Annotated[
        str | None,
        typer.Option("--pump", help="Pump type instead of the files' own: a name, or a .toml or .json file"),
    ] = None,
    mapping: MappingOption = None,
    set_: SetOption = None,
    name_pattern: PatternOption = None,
    json_: Json = False,
) -> None:
    """Analyse files without a server: windows, verdict and picture per pump.

    With --json: {"pumps": [{"serial", "verdict", "files", "picture"}], "refused": [{"file", "detail", "errors"}]}. A
    verdict has state, side, confidence, probabilities, candidates, advice, resolving_measurement, fit, blind_spots,
    probability_beyond_limit, crossing, intermittent, resolved_by, missing_evidence, case_pressure and quality, as the API
    gives them; a file has file, state, zero_flow_s (start and end, or null), explanation and residuals: per channel value and
    standard_deviation [bar]. Errors have where and problem.
    """
    from detectors.curve.picture import curve_svg  # noqa: PLC0415 - heavy, and only here
    from service.ingest.decode import Limits  # noqa: PLC0415
    from service.pump_types.parameter_files import named_or_written  # noqa: PLC0415
    from service.settings import Settings  # noqa: PLC0415
    from service.studies.offline import analyse_files  # noqa: PLC0415

    settings = Settings()
    limits = Limits(settings.max_inflated_bytes, settings.max_rows)
    try:
        kind = named_or_written(instead) if instead else None
    except ValueError as error:
        raise failure(f"--pump {error}", 2) from None
    values = ({"pump_serial": serial} if serial else {}) | set_values(set_)
    naming = Naming(name_pattern, values)
    found = analyse_files(files, limits, naming.of, kind, local_mapping(mapping, settings, values.get("operator")))
    to = listener(json_)
    for path, problem in found.refused:
        show_refusal(path, problem, to)
    folder = output or Path()
    answers = []
    for pump in found.pumps:
        answer = analysed_pump(pump)
        show_pump(answer, to)
        folder.mkdir(parents=True, exist_ok=True)
        picture = folder / f"{safe_name(pump.serial)}-damage-identification-curve.svg"
        picture.write_text(curve_svg(pump.curve, f"pump {pump.serial}"), encoding="utf-8")
        say(f"Picture: {picture}", to=to)
        answers.append({**answer, "picture": str(picture)})
    if json_:
        say_json({"pumps": answers, "refused": [refusal(path, problem) for path, problem in found.refused]})
    if found.refused:
        raise failure(f"{len(found.refused)} of {len(files)} files were refused")
