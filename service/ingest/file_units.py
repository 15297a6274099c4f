"""Units that a file itself gives to its columns: used where nothing else says one, and loud where they contradict a name."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from service.errors import Fault
from service.ingest.conversion import Conversion
from service.ingest.raw import RawFile
from service.ingest.unit_words import word
from twin.recording import OPTIONAL_CHANNELS, REQUIRED_CHANNELS

_OURS = (*REQUIRED_CHANNELS, *OPTIONAL_CHANNELS)
_MOST_OTHER = ("bar", "rpm", "lpm", "s", "degc")


def unit_of_file(unit: str | None, channel: str) -> Conversion | None:
    """Conversion by a unit that a file gives; None where it gives none or says nothing that is understood.

    Words of a file are read with the table of usual words alone: what it calls ``-`` or ``n/a`` is no unit.
    """
    if unit is None or not unit.strip():
        return None
    try:
        found = word(unit, channel)
    except ValueError:
        return None
    return None if found is None else Conversion(found.slope, found.intercept, found.reference)


def measures_something_else(unit: str, channel: str) -> bool:
    """Whether a word is a unit, and none that a channel could have."""
    try:
        if word(unit, channel) is not None:
            return False
        return any(word(unit, f"x_{suffix}") is not None for suffix in _MOST_OTHER)
    except ValueError:
        return False


def in_own_units(file: RawFile, converted: Collection[str] = ()) -> RawFile:
    """The file with faults where the file's unit of one of our channels is not the one in its name.

    Parameters
    ----------
    converted
        Channels that a mapping has brought to our units already.
    """
    faults, references = list(file.faults), dict(file.references)
    for table in file.tables:
        for name, unit in table.units.items():
            if name not in _OURS or name in converted or name not in table.channels:
                continue
            found = unit_of_file(unit, name)
            if found is None:
                if measures_something_else(unit, name):
                    faults.append(Fault(f"channels.{name}", f"is in {unit!r} by the file, which is no unit of it"))
                continue
            if not np.isclose(found.slope, 1.0, rtol=1e-6) or abs(found.intercept) > 1e-6:
                text = (
                    f"is in {unit!r} by the file, which is not the unit of its name: rename it, or map it with its unit"
                )
                faults.append(Fault(f"channels.{name}", text))
            elif found.reference is not None:
                references[name] = found.reference
    return replace(file, faults=faults, references=references)
