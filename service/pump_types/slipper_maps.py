"""Metamodels of variable slipper gaps in files: beside a parameter file, or in the folder of an installation."""

import json
from pathlib import Path

from twin.slipper_maps import StoredMap, document_of, map_from, register

SUFFIX = ".gaps.json"
FOLDER = "slipper-maps"
"""In the data directory: what lies there is known to a service from its start."""


def written_map(stored: StoredMap) -> str:
    """A metamodel as the text of its file."""
    return json.dumps(document_of(stored)) + "\n"


def beside(parameter_file: Path) -> Path:
    """Where the metamodel of a parameter file lies: ``my-pump.toml`` has ``my-pump.gaps.json``."""
    return parameter_file.with_name(parameter_file.stem + SUFFIX)


def take(path: Path) -> None:
    """Make the metamodel in a file known; a missing file is none.

    Raises
    ------
    ValueError
        when it is no metamodel.
    """
    if not path.is_file():
        return
    try:
        register(map_from(json.loads(path.read_text(encoding="utf-8"))))
    except (OSError, ValueError, TypeError, AttributeError) as error:
        raise ValueError(f"{path}: {error}") from None


def take_all(data_dir: Path) -> None:
    """Make every metamodel of an installation known.

    Raises
    ------
    ValueError
        naming the first that is none.
    """
    for path in sorted((data_dir / FOLDER).glob("*.json")):
        take(path)
