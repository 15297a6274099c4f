"""``casedrain watch``: flight records of a folder or store are sent as they come."""

import json
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from service.command_line.command import Command
from service.command_line.console import failure, listener, say
from service.command_line.mapping_options import (
    MappingOption,
    Naming,
    PatternOption,
    SetOption,
    set_values,
    stored_name,
)

if TYPE_CHECKING:
    from service.inbox.watching import Event, Inbox

app = typer.Typer()
_COLOURS = {"stored": "green", "refused": "red", "delayed": "yellow"}
_RETRIES = 2


@app.command(cls=Command)
def watch(
    place: Annotated[str, typer.Argument(help="Folder, or what fsspec lists: s3://…, sftp://…, memory://…")],
    url: Annotated[
        str, typer.Option(envvar="CASEDRAIN_URL", help="Where the service listens")
    ] = "http://127.0.0.1:8000",
    key: Annotated[str | None, typer.Option(envvar="CASEDRAIN_KEY", help="API key")] = None,
    mapping: MappingOption = None,
    set_: SetOption = None,
    name_pattern: PatternOption = None,
    interval: Annotated[
        float, typer.Option(min=0.1, help="Seconds between two looks; who has not changed meanwhile is complete")
    ] = 5.0,
    marker: Annotated[
        str | None, typer.Option(help="A file is complete when one of its name and this suffix lies beside it: .ok")
    ] = None,
    leave: Annotated[
        Path | None,
        typer.Option(metavar="JOURNAL", help="Leave files where they are; this file remembers them", dir_okay=False),
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="Send what is there, then stop")] = False,
    json_: Annotated[bool, typer.Option("--json", help="Print one JSON document a line per file")] = False,
) -> None:
    """Send every flight record of a folder once, as soon as it is complete, and move it to done/ or refused/.

    Killed at any moment and started again it goes on: no record is lost and none is stored twice. Beside a refused file
    lies its .problem.json; moved back into the folder it is sent again. With --once the exit code is 1 if a file was
    refused or the service did not answer.

    With --json a line is {"event": "stored|refused|waiting|delayed|passed over", "file", "words", "record_id",
    "status", "problem"}.
    """
    from service.client import Client, RefusedError  # noqa: PLC0415 - heavy, and only here
    from service.errors import Problem  # noqa: PLC0415
    from service.inbox.journal import Journal  # noqa: PLC0415
    from service.inbox.place import Place  # noqa: PLC0415
    from service.inbox.watching import Inbox, Rules, WrongSetUpError  # noqa: PLC0415
    from service.ingest.upload_files import content_type_of  # noqa: PLC0415

    values = set_values(set_)
    naming = Naming(name_pattern, values)
    rules = Rules(interval, marker, leave is not None)
    try:
        looked_at = Place(place)
        looked_at.look()
    except (ValueError, ImportError, OSError) as error:
        raise failure(f"{place} cannot be watched: {error}", 2) from None
    with Journal(leave or _journal_of(looked_at)) as kept, Client(url, key, retries=_RETRIES) as client:

        def send(name: str, content: bytes) -> Any:
            path = Path(name)
            try:
                metadata = naming.of(path)
            except Problem as problem:
                raise RefusedError(problem.body()) from None
            # a mapping may read metadata from the file's name
            called = path.name if named else None
            return client.upload(content, content_type_of(path), metadata=metadata, mapping=named, file_name=called)

        named = _named(client, mapping, values)
        inbox = Inbox(looked_at, kept, send, rules)
        told = _Told(json_)
        try:
            if once:
                _look_once(inbox, told, rules.settle_s)
            else:
                _look_on(inbox, told, interval)
        except WrongSetUpError as error:
            raise failure(f"the service refuses every file: {error}") from None
        except KeyboardInterrupt:
            say("Stopped.", to=listener(json_))
            return
    if once and (told.n_refused or told.is_delayed):
        raise typer.Exit(1)


def _named(client: Any, mapping: str | None, values: dict[str, str]) -> str | None:
    """Name of a stored mapping; only one from a file needs the service before there is anything to send."""
    import httpx2  # noqa: PLC0415

    try:
        return stored_name(client, mapping, values.get("operator"))
    except httpx2.HTTPError as error:
        raise failure(f"the service does not answer ({error}): the mapping of {mapping} cannot be stored") from None


def _journal_of(place: Any) -> Path:
    """The journal's own place: in the folder, or among this user's files for a store elsewhere."""
    import hashlib  # noqa: PLC0415

    from platformdirs import user_state_path  # noqa: PLC0415

    if place.is_local:
        return Path(place.root) / ".casedrain" / "journal.sqlite"
    name = hashlib.sha256(place.root.encode()).hexdigest()[:16]
    return user_state_path("casedrain") / "inboxes" / f"{name}.sqlite"


class _Told:
    """Says what happens, and counts it."""

    def __init__(self, as_json: bool) -> None:
        self._as_json = as_json
        self.to = listener(as_json)
        self.n_refused = 0
        self.is_delayed = False

    def tell(self, events: "Iterator[Event]") -> None:
        """Tell the events of one look."""
        was_delayed, self.is_delayed = self.is_delayed, False
        for event in events:
            self.n_refused += event.kind == "refused"
            if event.kind == "delayed":
                self.is_delayed = True
                if was_delayed:
                    continue
            self._say(event)

    def _say(self, event: "Event") -> None:
        answer = event.answer
        status = answer["status"] if answer else None
        if self._as_json:
            record_id = answer["record_id"] if answer else None
            line = {"event": event.kind, "file": event.name or None, "words": event.words or None}
            line |= {"record_id": record_id, "status": status, "problem": event.problem}
            sys.stdout.write(json.dumps(line) + "\n")
            sys.stdout.flush()
            return
        advice = answer["verdict"]["advice"] if answer and answer.get("verdict") else ""
        words = event.words or f"{status}. {advice}"
        say((event.kind, _COLOURS.get(event.kind, "")), f"  {event.name or 'nothing is lost'}: {words}", to=self.to)


def _look_once(inbox: "Inbox", told: _Told, settle_s: float) -> None:
    told.tell(inbox.look())
    if inbox.unsettled and not told.is_delayed:
        time.sleep(settle_s + 0.01)
        told.tell(inbox.look())
    if inbox.unsettled:
        say(f"{inbox.unsettled} file(s) are not complete yet: left for the next time", to=told.to)


def _look_on(inbox: "Inbox", told: _Told, interval_s: float) -> None:
    from service.inbox.watching import waits  # noqa: PLC0415

    delays = waits(interval_s)
    while True:
        told.tell(inbox.look())
        if told.is_delayed:
            time.sleep(next(delays))
        else:
            delays = waits(interval_s)
            time.sleep(interval_s)
