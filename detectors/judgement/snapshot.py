"""Snapshots of the fold: all that it carries between two observations, as bytes that can be checked.

The bytes are a magic word with the format's number, the SHA-256 of what follows, and a zlib stream of
``detectors.judgement.packing``. They say nothing about what they were made from: that is the business of whoever keeps them.
"""

import hashlib
import zlib
from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from typing import Any, get_type_hints

import numpy as np

# which records are still needed is the bank's own business; a second copy of these numbers could drift
from detectors.bank.bank import _FITTED_ANEW_AT, Bank
from detectors.bank.lines import LineScatter
from detectors.bank.shapes import Freed
from detectors.bank.window import Measurement
from detectors.expectation.type_correction import HealthyCurve
from detectors.judgement import packing
from detectors.judgement.assessment import Fold
from detectors.judgement.packing import AnyArray
from twin.compiled import numba_version
from twin.parameters import Circuit, PumpType
from twin.sources import sources_hash

_MAGIC = b"casedrain fold 4\n"
_DIGEST = 32
_QUICK = 1
"""Compression level: most of the bytes are mantissas, which no level makes much smaller."""
_GIVEN_AGAIN = ("pump", "circuit", "thresholds", "healthy", "reference", "bank")
"""Fields of the fold that are given again or follow from what is; the bank is packed apart."""
_APART = ("pump", "kinds", "learnt", "filters", "base", "regulation", "freed", "line_scatter")
"""Fields of the bank that are no plain numbers."""


def snapshot(fold: Fold) -> bytes:
    """What a fold carries now."""
    bank = fold.bank
    numbers: dict[str, int] = {}
    arrays: dict[str, AnyArray] = {}
    for name, value in _parts(bank).items():
        if isinstance(value, np.ndarray):
            arrays[name] = value[: bank.n] if name.startswith("filters.") else value
        else:
            numbers[name] = int(value)
    # what was learnt is read again only when filters are fitted anew: later it only says that there is something
    learnt = (
        bank.learnt if bank.records - bank.base.records < max(_FITTED_ANEW_AT) and bank.refits else bank.learnt[-1:]
    )
    carried = tuple(getattr(fold, name) for name in _carried_fields())
    body = zlib.compress(packing.packed((carried, numbers, arrays, learnt, bank.line_scatter)), _QUICK)
    return _MAGIC + hashlib.sha256(body).digest() + body


def fold_from(
    content: bytes,
    pump: PumpType,
    circuit: Circuit,
    thresholds: Mapping[str, float],
    healthy: HealthyCurve | None = None,
) -> Fold:
    """The fold that a snapshot was taken of; the same pump type, circuit, thresholds and curve must be given again.

    Raises
    ------
    ValueError
        when the bytes are damaged or of another format.
    """
    body = content[len(_MAGIC) + _DIGEST :]
    digest = content[len(_MAGIC) : len(_MAGIC) + _DIGEST]
    if not content.startswith(_MAGIC) or hashlib.sha256(body).digest() != digest:
        raise ValueError("these bytes are no snapshot of this format, or they are damaged")
    carried, numbers, arrays, learnt, line_scatter = packing.unpacked(_packed_type(), zlib.decompress(body))
    fold = Fold(pump, circuit, thresholds, healthy)
    bank = fold.bank
    parts = _parts(bank)
    if {*numbers, *arrays} != {*parts}:
        raise ValueError("this snapshot is of a bank with other fields")
    for name, value in zip(_carried_fields(), carried, strict=True):
        setattr(fold, name, value)
    bank.freed = Freed(*(arrays.pop(f"freed.{name}") for name in Freed._fields))
    for name, array in arrays.items():
        parts[name][: len(array)] = array
    bank.base = bank.base._replace(records=numbers.pop("base.records"))
    for name, number in numbers.items():
        setattr(bank, name, type(getattr(bank, name))(number))
    bank.learnt, bank.line_scatter = learnt, line_scatter
    return fold


@cache
def judge_version() -> str:
    """Hash of all that a fold computes with besides its input: code, fitted surfaces, numerical libraries.

    A snapshot of another version is worthless: a change of a single rounding would be carried on for ever.
    """
    return f"{sources_hash('detectors.judgement.snapshot')}-numpy{np.__version__}-numba{numba_version}"


@cache
def _carried_fields() -> tuple[str, ...]:
    return tuple(f.name for f in fields(Fold) if f.name not in _GIVEN_AGAIN)


@cache
def _packed_type() -> Any:
    """What is packed: fields of the fold, numbers and arrays of its bank by name, what was learnt, and the lines' scatter."""
    hints = get_type_hints(Fold)
    carried = tuple.__class_getitem__(tuple(hints[name] for name in _carried_fields()))
    learnt = list[tuple[Measurement, ...]]
    return tuple[carried, dict[str, int], dict[str, AnyArray], learnt, LineScatter]  # type: ignore[valid-type]


def _parts(bank: Bank) -> dict[str, Any]:
    """Every number and array of a bank by its name; what was learnt and the pump apart."""
    own = {f.name: getattr(bank, f.name) for f in fields(Bank) if f.name not in _APART}
    shapes: dict[str, Any] = {
        "filters": bank.filters,
        "base": bank.base,
        "charts": bank.regulation.charts,
        "freed": bank.freed,
    }
    return own | {f"{name}.{part}": value for name, shape in shapes.items() for part, value in shape._asdict().items()}
