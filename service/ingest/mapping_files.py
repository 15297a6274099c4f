"""A channel mapping as a file: the body of ``POST /mappings``, its name being the file's where it gives none."""

import json
import re
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from service.answers.documents import JsonObject
from service.ingest.mapping import ChannelMapping

ABOUT = ("name", "description", "aircraft_type")
"""What such a file may say beside the mapping itself."""
_LONGEST = 100


@dataclass(frozen=True, slots=True)
class MappingFile:
    """A mapping with what its file says about it."""

    name: str
    about: JsonObject
    mapping: ChannelMapping

    def body(self) -> JsonObject:
        """Body of ``POST /mappings``."""
        return {"name": self.name, **self.about, **self.mapping.document()}


def mapping_of_file(path: Path) -> MappingFile:
    """A mapping from a JSON file.

    Raises
    ------
    ValueError
        with every fault of it.
    OSError
        when it cannot be read.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ValueError(f"{path} is not JSON: {error}") from None
    if not isinstance(document, dict):
        raise ValueError(f"{path} holds no JSON object")
    about = {name: document.pop(name) for name in ABOUT if name in document}
    try:
        mapping = ChannelMapping.model_validate(document)
    except ValidationError as error:
        faults = "".join(
            f"\n  {'.'.join(map(str, e['loc']))}: {e['msg'].removeprefix('Value error, ')}" for e in error.errors()
        )
        raise ValueError(f"{path} holds {error.error_count()} fault(s):{faults}") from None
    return MappingFile(str(about.pop("name", None) or plain_name(path)), about, mapping)


def plain_name(path: Path) -> str:
    """Name of a mapping after a file: its stem without what a name cannot hold."""
    stem = path.name.removesuffix(".json").removesuffix(".mapping")
    return re.sub(r"[^A-Za-z0-9._-]+", "-", stem).strip("-._")[:_LONGEST] or "mapping"
