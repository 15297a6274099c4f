"""What ``upload`` and ``analyse`` are told about foreign files: a mapping, metadata, a pattern of their names."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from service.command_line.console import failure

if TYPE_CHECKING:
    from service.client import Client
    from service.errors import Problem
    from service.ingest.mapping import ChannelMapping
    from service.ingest.mapping_files import MappingFile
    from service.settings import Settings

MappingOption = Annotated[
    str | None,
    typer.Option("--mapping", help="Channel mapping that the files need: a JSON file, or the name of a stored one"),
]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Metadata that win over the files' own; may be repeated"),
]
PatternOption = Annotated[
    str | None,
    typer.Option(
        "--name-pattern", help="Metadata from the files' names, as in '{aircraft}_{started_at:%Y%m%d-%H%M}_{flight_id}'"
    ),
]


def set_values(given: Sequence[str] | None) -> dict[str, str]:
    """Metadata from ``key=value``; what is none ends the command."""
    from service.ingest.metadata import KNOWN  # noqa: PLC0415 - no help needs it

    pairs = [text.partition("=") for text in given or ()]
    bad = [f"{key}{mark}{value}" for key, mark, value in pairs if key.strip() not in KNOWN or not mark]
    if bad:
        raise failure(f"--set {', '.join(bad)}: write key=value, the keys being {', '.join(KNOWN)}", 2)
    keys = [key.strip() for key, _, _ in pairs]
    twice = sorted({key for key in keys if keys.count(key) > 1})
    if twice:
        raise failure(f"--set gives {', '.join(twice)} twice", 2)
    return {key.strip(): value for key, _, value in pairs}


class Naming:
    """Metadata of each file: what ``--set`` says, then what its name says by ``--name-pattern``."""

    def __init__(self, pattern: str | None, values: Mapping[str, str]) -> None:
        from pydantic import ValidationError  # noqa: PLC0415

        from service.ingest.mapping import NameRule  # noqa: PLC0415

        self._values = dict(values)
        try:
            self._pattern = NameRule(pattern=pattern).made if pattern else None
        except ValidationError as error:
            raise failure(f"--name-pattern {error.errors()[0]['msg'].removeprefix('Value error, ')}", 2) from None

    def of(self, path: Path) -> dict[str, str]:
        """Metadata of a file.

        Raises
        ------
        Invalid
            when its name does not match.
        """
        from service.ingest.file_names import named_by  # noqa: PLC0415

        return named_by(self._pattern, path.name, self._values)


def mapping_file(words: str | None) -> "MappingFile | None":
    """The mapping of a file; None where the words name no file."""
    from service.ingest.mapping_files import mapping_of_file  # noqa: PLC0415

    if words is None or not (Path(words).is_file() or words.endswith(".json")):
        return None
    try:
        return mapping_of_file(Path(words))
    except (ValueError, OSError) as error:
        raise failure(f"--mapping {error}", 2) from None


def stored_name(client: "Client", words: str | None, operator: str | None) -> str | None:
    """Name of a stored mapping; one from a file is stored where the service has none of its name.

    One of that name that says something else is left as it is, and ends the command.
    """
    from service.client import RefusedError  # noqa: PLC0415
    from service.ingest.mapping import ChannelMapping  # noqa: PLC0415
    from service.ingest.mapping_files import ABOUT  # noqa: PLC0415

    found = mapping_file(words)
    if found is None:
        return words
    try:
        held: Mapping[str, Any] | None = client.mapping(found.name, operator)
    except RefusedError as error:
        if error.problem.get("status") != 404:
            raise failure(f"--mapping {words}: {error}") from None
        held = None
    if held is None:
        try:
            client.store_mapping(found.body(), operator)
        except RefusedError as error:
            raise failure(f"--mapping {words}: {error}") from None
        return found.name
    known = {name: held[name] for name in ChannelMapping.model_fields if name not in ABOUT}
    if ChannelMapping.model_validate(known) != found.mapping:
        raise failure(
            f"the service has a mapping {found.name} that says something else than {words}: give the file another name, "
            f"or store it as a new version (PUT /api/v1/mappings/{found.name})"
        )
    return found.name


def local_mapping(words: str | None, settings: "Settings", operator: str | None) -> "ChannelMapping | None":
    """A mapping without a server: a file's, or one that the database of this machine's settings holds."""
    found = mapping_file(words)
    if found is not None or words is None:
        return found.mapping if found else None
    from sqlalchemy.engine import make_url  # noqa: PLC0415 - heavy, and only here
    from sqlalchemy.exc import SQLAlchemyError  # noqa: PLC0415

    from service.errors import Problem  # noqa: PLC0415
    from service.ingest.mappings import mapping_version  # noqa: PLC0415
    from service.storage.database import Database  # noqa: PLC0415

    url = settings.effective_database_url
    place = make_url(url)
    why = f"--mapping {words} is no file, and no database of this machine holds one of that name"
    if place.get_backend_name() == "sqlite" and not Path(place.database or "").is_file():
        raise failure(why, 2)
    database = Database(url)
    try:
        with database.reading() as session:
            return mapping_version(session, operator or "default", words).mapping
    except (Problem, SQLAlchemyError):
        raise failure(why, 2) from None
    finally:
        database.close()


def told(problem: "Problem") -> str:
    """A problem with every fault, as a refusal of the service is written."""
    return "\n".join([problem.detail, *(f"  {fault.where}: {fault.problem}" for fault in problem.errors)])
