"""Parameter sets in files: read where a command takes a pump type, written by an identification."""

import json
import tomllib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from service.pump_types.slipper_maps import beside, take
from twin.parameters import PumpType
from twin.pumps import PUMP_TYPES
from twin.pumps.circuit_sets import CIRCUIT_SETS, CircuitSet, circuit_set_from
from twin.pumps.written import ParameterFaultsError, document_of, pump_type_from

Read = TypeVar("Read")


def named_or_written(text: str) -> PumpType:
    """Pump type of a built-in name, or of a TOML or JSON file; its metamodel beside it becomes known.

    Raises
    ------
    ValueError
        with every fault; several stand on lines of their own.
    """
    if text in PUMP_TYPES:
        return PUMP_TYPES[text]
    kind = _from_file(text, PUMP_TYPES, pump_type_from)
    take(beside(Path(text)))
    return kind


def circuit_named_or_written(text: str) -> CircuitSet:
    """Circuit of a built-in name, or of a TOML or JSON file.

    Raises
    ------
    ValueError
        with every fault; several stand on lines of their own.
    """
    if text in CIRCUIT_SETS:
        return CIRCUIT_SETS[text]
    return _from_file(text, CIRCUIT_SETS, circuit_set_from)


def _from_file(text: str, known: Iterable[str], reader: Callable[[Mapping[str, Any]], Read]) -> Read:
    """What a file describes; ``known`` are the names that would have done without one."""
    path = Path(text)
    if path.suffix.lower() not in (".toml", ".json"):
        raise ValueError(f"{text}: is not known (known: {', '.join(known)}, or a .toml or .json file)")
    try:
        content = path.read_text(encoding="utf-8")
        document = tomllib.loads(content) if path.suffix.lower() == ".toml" else json.loads(content)
    except (OSError, ValueError) as error:
        raise ValueError(f"{path} cannot be read: {error}") from None
    if not isinstance(document, Mapping):
        raise ValueError(f"{path} holds no parameter set")
    try:
        return reader(document)
    except ParameterFaultsError as error:
        faults = "".join(f"\n  {where}: {words}" for where, words in error.faults)
        raise ValueError(f"{path} has {len(error.faults)} fault(s){faults}") from None


def derived_toml(document: Mapping[str, Any], remarks: tuple[str, ...] = ()) -> str:
    """A derived parameter set as TOML, remarks first as comments."""
    lines = [f"# {remark}" for remark in remarks]
    lines += [f"{name} = {_value(document[name])}" for name in ("id", "base", "title")]
    for path, quantity in document["changes"].items():
        lines += ["", f'[changes."{path}"]', *(f"{name} = {_value(value)}" for name, value in quantity.items())]
    return "\n".join(lines) + "\n"


def whole_toml(kind: PumpType, remarks: tuple[str, ...] = ()) -> str:
    """A whole parameter set as TOML, remarks first as comments, one line per quantity."""
    document = document_of(kind)
    lines = [f"# {remark}" for remark in remarks]
    lines += [f"{name} = {_value(value)}" for name, value in document.items() if not isinstance(value, Mapping)]
    for group, entries in ((name, value) for name, value in document.items() if isinstance(value, Mapping)):
        lines += ["", f"[{group}]"]
        lines += [f"{_value(path)} = {_inline(entry)}" for path, entry in entries.items()]
    return "\n".join(lines) + "\n"


def _inline(entry: Mapping[str, Any]) -> str:
    pairs = (f"{name} = {_value(value)}" for name, value in entry.items() if value is not None)
    return f"{{ {', '.join(pairs)} }}"


def _value(value: Any) -> str:
    # JSON's strings and numbers of printable text are TOML's
    return json.dumps(value, ensure_ascii=False)
