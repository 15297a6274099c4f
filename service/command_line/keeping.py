"""Commands of who keeps an installation: backup, restore, check, and the proof of the audit log."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from service.command_line.command import Command
from service.command_line.console import Json, failure, say, say_json

if TYPE_CHECKING:
    from service.access.audit_proof import Findings

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)
audit_app = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="The audit log and its proof.")
Place = Annotated[Path, typer.Argument(help="A folder, or one file whose name ends in .zip")]


@app.command(cls=Command)
def backup(
    place: Annotated[Path | None, typer.Argument(help="A new folder, or a new file whose name ends in .zip")] = None,
    with_gaps: Annotated[
        bool, typer.Option("--with-gaps", help="Keep the rest where raw bytes are missing or damaged")
    ] = False,
    removed: Annotated[
        str | None, typer.Option(help="Instead: note that the backup of this id is no more", metavar="ID")
    ] = None,
    json_: Json = False,
) -> None:
    """Back up database, job engine and raw bytes as one consistent set while the server works.

    With --json: the backup's manifest, or {"removed"}.
    """
    from service.keeping.backup import forget_backup, make_backup  # noqa: PLC0415 - heavy, and only here
    from service.keeping.installation import installation  # noqa: PLC0415
    from service.settings import Settings  # noqa: PLC0415

    if (place is None) == (removed is None):
        raise failure("name the place of the backup, or --removed with the id of one that is no more", 2)
    with _refusals(), installation(Settings()) as kept:
        if removed is not None:
            forget_backup(kept, removed)
        manifest = None if place is None else make_backup(kept, place, with_gaps=with_gaps)
    if json_:
        say_json(manifest or {"removed": removed})
    elif manifest is None:
        say(f"Receipts of deletions no longer name backup {removed}.")
    else:
        gaps = f", {len(manifest['gaps'])} raw files missing" if manifest["gaps"] else ""
        say(
            f"Backup {manifest['id']} in {place}: {manifest['raw_files']} raw files of {manifest['raw_bytes']} bytes, "
            f"{manifest['audit']['count']} links of the audit log{gaps}."
        )
        say("It holds hashes of keys and passwords and the key of the audit log: keep it as you keep the data folder.")


@app.command(cls=Command)
def restore(
    place: Place,
    force: Annotated[bool, typer.Option("--force", help="Overwrite a database that is used")] = False,
    json_: Json = False,
) -> None:
    """Put a backup back to where the settings point; the server must not run. Either database takes either's backup.

    With --json: the backup's manifest.
    """
    from service.keeping.restore import restore as put_back  # noqa: PLC0415 - heavy, and only here
    from service.settings import Settings  # noqa: PLC0415

    with _refusals():
        manifest = put_back(Settings(), place, force=force)
    if json_:
        say_json(manifest)
    else:
        say(f"Restored backup {manifest['id']} of {manifest['made_at']}: see with `casedrain check`.")


@app.command(cls=Command)
def check(
    place: Annotated[Path | None, typer.Argument(help="A backup; without it the installation of the settings")] = None,
    json_: Json = False,
) -> None:
    """Look whether an installation, or a backup, is whole: every fault on a line, exit code 1 if there is one.

    With --json: {"whole", "records", "raw_files", "raw_bytes", "audit", "faults", "remarks"}.
    """
    from service.keeping.check import check_backup, check_installation  # noqa: PLC0415 - heavy, and only here
    from service.keeping.installation import installation  # noqa: PLC0415
    from service.settings import Settings  # noqa: PLC0415

    with _refusals():
        if place is not None:
            found = check_backup(place)
        else:
            with installation(Settings()) as kept:
                found = check_installation(kept)
    if json_:
        say_json(found.to_json())
    else:
        for line in (*found.faults, *found.remarks):
            say(line)
        links = found.audit.links if found.audit else 0
        say(f"{found.records} records, {found.raw_files} raw files, {links} links of the audit log.")
    if found.faults:
        raise failure(f"{len(found.faults)} faults")
    if not json_:
        say("Whole.")


@app.command(cls=Command)
def bundle(
    serial: Annotated[str, typer.Argument(help="Serial number of the pump")],
    place: Annotated[Path, typer.Argument(help="A new folder, or a new file whose name ends in .zip")],
    operator: Annotated[str, typer.Option(help="Whose pump")] = "default",
    json_: Json = False,
) -> None:
    """Write a pump's bundle: all that its verdict rests on, with the verdict; `casedrain replay` makes it again.

    With --json: the bundle's manifest.
    """
    from sqlalchemy import select  # noqa: PLC0415 - heavy, and only here

    from service.keeping.bundle import make_bundle  # noqa: PLC0415
    from service.keeping.installation import installation  # noqa: PLC0415
    from service.settings import Settings  # noqa: PLC0415
    from service.storage.tables import Pump  # noqa: PLC0415

    with _refusals(), installation(Settings()) as kept:
        with kept.database.reading() as session:
            pump_id = session.scalar(select(Pump.id).where(Pump.serial == serial, Pump.operator == operator))
        if pump_id is None:
            raise ValueError(f"operator {operator} has no pump {serial}")
        manifest = make_bundle(kept.database, kept.raw_store, pump_id, place)
    if json_:
        say_json(manifest)
    else:
        say(f"Bundle of pump {serial} in {place}: {manifest['raw_files']} raw files.")


@app.command(cls=Command)
def replay(
    place: Annotated[Path, typer.Argument(help="A bundle", exists=True)],
    json_: Json = False,
) -> None:
    """Reduce and fold a bundle's records anew and compare the verdict with the one it holds; exit code 1 if they differ.

    With --json: {"identical", "pump", "operator", "issued_by", "replayed_by", "explanation", "differences": [{"where",
    "expected", "found"}], "expected", "verdict"}.
    """
    from service.keeping.replay import replay as replayed  # noqa: PLC0415

    with _refusals():
        done = replayed(place)
    told = done.to_json()
    if json_:
        say_json(told)
    else:
        for difference in told["differences"]:
            say(f"{difference['where']}: {difference['expected']} was issued, {difference['found']} is found")
        if told["explanation"]:
            say(told["explanation"])
    if not done.is_identical:
        raise failure(f"the verdict on pump {told['pump']} is not the one that was issued")
    if not json_:
        say(
            f"The verdict on pump {told['pump']} is the one that was issued, to the last digit: {done.verdict['state']}."
        )


@app.command("import-operator", cls=Command)
def import_operator(
    place: Annotated[Path, typer.Argument(help="What GET /operators/{operator}/export gave", exists=True)],
    json_: Json = False,
) -> None:
    """Take an operator's export into this installation, all of it or nothing; its verdicts are made again by the server.

    With --json: {"operator", "rows", "raw_files"}.
    """
    from service.keeping.installation import installation  # noqa: PLC0415 - heavy, and only here
    from service.keeping.operator_import import import_operator as taken_in  # noqa: PLC0415
    from service.settings import Settings  # noqa: PLC0415

    with _refusals(), installation(Settings()) as kept:
        done = taken_in(kept.database, kept.raw_store, place, kept.database.revision() or "")
    if json_:
        say_json(done)
    else:
        records = done["rows"].get("records", 0)
        say(
            f"Operator {done['operator']}: {records} records, {done['raw_files']} raw files. Keys and users are to be made anew."
        )


@audit_app.command("verify", cls=Command)
def verify_log(
    file: Annotated[Path | None, typer.Option(help="A proof that was exported, instead of the database")] = None,
    public_key: Annotated[str | None, typer.Option(help="Key that must have signed it, 64 hexadecimal digits")] = None,
    against: Annotated[
        Path | None, typer.Option(help="A head that was kept elsewhere (`audit head`): the log must go through it")
    ] = None,
    json_: Json = False,
) -> None:
    """Verify the audit log: what was changed, removed, inserted, reordered or cut off; exit code 1 if anything was.

    With --json: {"whole", "links", "erased", "withheld", "head", "faults"}.
    """
    from service.access.audit_proof import verify, verify_database  # noqa: PLC0415 - heavy, and only here
    from service.keeping.installation import installation  # noqa: PLC0415
    from service.settings import Settings  # noqa: PLC0415
    from service.storage.audit_anchor import anchor_from, move_anchor, read_anchor  # noqa: PLC0415

    with _refusals():
        anchors = [anchor_from(against.read_text(encoding="utf-8"))] if against else []
        if file is not None:
            with file.open(encoding="utf-8") as lines:
                found = verify(_json_lines(lines), public_key, anchors)
        else:
            with installation(Settings()) as kept:
                remembered = read_anchor(kept.folder)
                anchors += [remembered] if remembered else []
                found = verify_database(kept.database, public_key or kept.audit_key.public, anchors)
                if not found.faults and found.head:
                    move_anchor(kept.database, found.head, kept.folder)
    _show(found, json_)


@audit_app.command("export", cls=Command)
def export_log(
    file: Annotated[Path, typer.Argument(help="Where to write the proof, as JSON lines")],
    operator: Annotated[
        str | None, typer.Option(help="Show this operator's entries only, hashes of all others")
    ] = None,
    json_: Json = False,
) -> None:
    """Write the audit log with its proof: `casedrain audit verify --file` needs nothing else.

    With --json: {"file", "links", "public_key"}.
    """
    from service.access.audit_proof import stored_proof  # noqa: PLC0415 - heavy, and only here
    from service.keeping.installation import installation  # noqa: PLC0415
    from service.settings import Settings  # noqa: PLC0415

    partial = file.with_name(file.name + ".partial")
    n_lines, head = 0, None
    try:
        with _refusals(), installation(Settings()) as kept:
            with kept.database.snapshot() as session, partial.open("w", encoding="utf-8") as to:
                for line in stored_proof(session, operator):
                    head = line["head"] if "head" in line else head  # noqa: SIM401 - tells kinds of lines apart
                    to.write(json.dumps(line) + "\n")
                    n_lines += 1
            partial.replace(file)
    finally:
        partial.unlink(missing_ok=True)
    public_key = head["public_key"] if head else ""
    if json_:
        say_json({"file": str(file), "links": n_lines - 1, "public_key": public_key})
    else:
        say(f"{n_lines - 1} links in {file}, signed with the key {public_key}.")


@audit_app.command("head", cls=Command)
def show_head(json_: Json = False) -> None:
    """Print the signed head: kept elsewhere, it shows later that nothing before it was changed.

    With or without --json: {"chain_id", "count", "link", "public_key", "signature"}.
    """
    from service.keeping.installation import installation  # noqa: PLC0415 - heavy, and only here
    from service.settings import Settings  # noqa: PLC0415
    from service.storage.audit_chain import HEAD_ID, head_of  # noqa: PLC0415
    from service.storage.tables import AuditHead  # noqa: PLC0415

    with _refusals(), installation(Settings()) as kept, kept.database.reading() as session:
        row = session.get(AuditHead, HEAD_ID)
        head = head_of(row).to_json() if row else None
    if head is None:
        raise failure("the audit log has no head: it was taken away")
    if json_:
        say_json(head)
    else:
        print(json.dumps(head))


@audit_app.command("adopt", cls=Command)
def adopt_entries(
    reason: Annotated[str, typer.Option(help="Why there are entries beside the chain; it stands in the log")],
    json_: Json = False,
) -> None:
    """Chain entries that a release before the chain has written while this one was at work.

    With --json: {"adopted"}.
    """
    from service.access import audit  # noqa: PLC0415 - heavy, and only here
    from service.access.security import AT_THE_MACHINE  # noqa: PLC0415
    from service.keeping.installation import installation  # noqa: PLC0415
    from service.settings import Settings  # noqa: PLC0415

    with _refusals(), installation(Settings()) as kept, kept.database.writing() as session:
        count = audit.adopt(session, AT_THE_MACHINE, reason)
    if json_:
        say_json({"adopted": count})
    else:
        say(f"{count} entries were chained.")


@contextmanager
def _refusals() -> Iterator[None]:
    """What is wrong with files, settings or the database is one sentence and exit code 1."""
    from sqlalchemy.exc import DBAPIError  # noqa: PLC0415 - heavy, and no help needs it

    from service.errors import Problem  # noqa: PLC0415

    try:
        yield
    except (ValueError, Problem) as error:
        raise failure(str(error)) from None
    except DBAPIError as error:
        raise failure(f"the database cannot be read or written: {error.orig}") from None


def _show(found: "Findings", as_json: bool) -> None:
    told = found.to_json()
    if as_json:
        say_json(told)
    else:
        for fault in told["faults"]:
            say(fault)
        said = f"{found.links} links, {found.erased} of them erased with their operators"
        say(f"{said}, {found.withheld} withheld." if found.withheld else f"{said}.")
        if found.head and found.head.public_key:
            say(f"Signed with the key {found.head.public_key}.")
    if told["faults"]:
        raise failure("the audit log is not whole")
    if not as_json:
        say("Whole.")


def _json_lines(lines: Any) -> Any:
    for line in lines:
        try:
            found = json.loads(line)
        except ValueError:
            found = {}
        yield found if isinstance(found, dict) else {}
