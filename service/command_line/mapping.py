"""``casedrain map``: look at a file and write the mapping that it seems to need, for a person to confirm."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from service.command_line.command import Command, Commands
from service.command_line.console import Json, failure, listener, say, say_json
from service.command_line.mapping_options import SetOption, set_values

if TYPE_CHECKING:
    from service.answers.mappings import MappingSuggestion

app = typer.Typer(cls=Commands)


@app.command("map", cls=Command)
def map_file(
    file: Annotated[
        Path, typer.Argument(help="A record as your recorder writes it, of any format", exists=True, dir_okay=False)
    ],
    output: Annotated[
        Path | None, typer.Option("--output", help="Where the mapping goes; default: beside the file", dir_okay=False)
    ] = None,
    name: Annotated[str | None, typer.Option(help="Name of the mapping; default: the file's")] = None,
    set_: SetOption = None,
    json_: Json = False,
) -> None:
    """Propose a channel mapping for a file: what each channel seems to come from, how certain that is, what is open.

    It is written as JSON for --mapping of upload and analyse; nothing is sent or stored elsewhere. With --json: the
    document of POST /mappings/suggest, with "file": where the mapping was written.
    """
    from service.errors import Problem  # noqa: PLC0415
    from service.ingest.decode import Limits  # noqa: PLC0415
    from service.ingest.mapping_files import plain_name  # noqa: PLC0415
    from service.ingest.parse import parsed  # noqa: PLC0415
    from service.ingest.suggesting import proposed  # noqa: PLC0415
    from service.ingest.upload_files import content_type_of  # noqa: PLC0415
    from service.settings import Settings  # noqa: PLC0415

    settings = Settings()
    limits = Limits(settings.max_inflated_bytes, settings.max_rows)
    named: dict[str, object] = dict(set_values(set_))
    kind = content_type_of(file)
    try:
        content = file.read_bytes()
        found = proposed(file, kind, "", lambda dialect: parsed(content, kind, "", limits, dialect), named)
    except (Problem, OSError) as problem:
        faults = [f"\n  {f.where}: {f.problem}" for f in getattr(problem, "errors", ())]
        raise failure(f"{file}: {getattr(problem, 'detail', problem)}{''.join(faults)}") from None
    place = output or file.with_name(f"{file.name.partition('.')[0]}.mapping.json")
    document = {"name": name or plain_name(Path(file.name.partition(".")[0])), **found["mapping"]}
    if place.exists():
        raise failure(f"{place} exists already, and may have been completed: give another --output")
    try:
        place.write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    except OSError as error:
        raise failure(f"{place} cannot be written: {error}") from None
    if json_:
        say_json({**found, "file": str(place)})
    _show(found, place, json_)


def _show(found: "MappingSuggestion", place: Path, json_: bool) -> None:
    from rich.table import Table  # noqa: PLC0415 - slow, and no help needs it
    from rich.text import Text  # noqa: PLC0415

    to = listener(json_)
    for line in found["looked_at"]:
        say(line, to=to)
    table = Table()
    for heading in ("channel", "comes from", "unit", "certainty", "because"):
        table.add_column(heading)
    for row in found["channels"]:
        cells = (
            row["channel"],
            row["source"] or "-",
            row["unit"] or "",
            f"{row['certainty']:.0%}",
            "; ".join(row["because"]),
        )
        table.add_row(*map(Text, cells))
    to.print(table)
    for line in found["could_not_tell"]:
        say(("could not tell: ", "bold"), line, to=to)
    say(f"Mapping: {place}. Confirm it, complete it, and use it: casedrain analyse FILE --mapping {place}", to=to)
