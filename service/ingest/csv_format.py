"""CSV and its relations: optional leading ``# key: value`` lines, a header with the channel names, then rows."""

import csv
from collections import Counter

import numpy as np

from service.errors import Fault, Undecodable
from service.ingest.csv_cells import Columns, columns_by_cell
from service.ingest.csv_columnar import columns_at_once
from service.ingest.csv_layout import Layout, layout_of
from service.ingest.csv_words import KNOWN_CHANNELS
from service.ingest.raw import Limits, RawFile, Table, TextDialect, check_columns, check_size

_SHORTEST_ROW = 2
"""Bytes of the shortest row."""


def parsed(content: bytes, limits: Limits, dialect: TextDialect | None = None) -> RawFile:
    """Read a text table; every bad cell of a known channel becomes a fault with its line and column.

    Columns of other names refuse nothing: one that holds words is among ``texts`` of the table. A last line without its
    end, with too few fields, is left out and flagged.

    Raises
    ------
    Undecodable
        when the text is not in its encoding, is separated by another character, or holds no header.
    TooLarge
        when it is larger than the limits.
    """
    try:
        layout = layout_of(content, dialect or TextDialect())
        _check_size(layout, limits)
        return _file(layout, columns_at_once(layout) or columns_by_cell(layout))
    except csv.Error as error:
        raise Undecodable("the CSV file is damaged", [Fault("body", str(error))]) from None


def _check_size(layout: Layout, limits: Limits) -> None:
    width = len(layout.names)
    check_columns(width)
    n_rows = layout.size // max(_SHORTEST_ROW, width)
    # counted only where there may be too many
    if n_rows > limits.rows or n_rows * width * 8 > limits.inflated_bytes:
        n_rows = max(layout.content.count(b"\n", layout.start), layout.content.count(b"\r", layout.start))
    check_size(n_rows, width, limits)


def _file(layout: Layout, columns: Columns) -> RawFile:
    """Columns under their names; those without a name or with another's are kept where they can be told apart."""
    names, line = layout.names, f"line {layout.first_line - 1}"
    n_of_name = Counter(name for name in names if name)
    faults, flags = [], []
    for name, n in sorted(n_of_name.items()):
        if n > 1 and name in KNOWN_CHANNELS:
            faults.append(Fault(line, f"column {name!r} appears twice"))
        elif n > 1:
            flags.append(f"column {name!r} appears {n} times: the later ones are called '{name} (2)' and so on")
    not_kept: dict[str, str] = {}
    table = Table({}, units=layout.units)
    n_seen: Counter[str] = Counter()
    for i, name in enumerate(names):
        n_seen[name] += 1
        numbers, texts = columns.numbers.get(i), columns.texts.get(i, [])
        if not name:
            if any(texts) or (numbers is not None and not np.isnan(numbers).all()):
                not_kept[f"column {i + 1}"] = "has no name"
            continue
        called = name if n_seen[name] == 1 else f"{name} ({n_seen[name]})"
        if n_seen[name] > 1 and called in n_of_name:
            not_kept[f"column {i + 1}"] = f"is another {name!r}"
        elif numbers is not None:
            table.channels[called] = numbers
        else:
            table.texts[called] = texts
    return RawFile(layout.metadata, (table,), faults + columns.faults, not_kept, layout.flags + flags + columns.flags)
