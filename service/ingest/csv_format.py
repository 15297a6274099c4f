"""CSV: optional leading ``# key: value`` lines, a header with the channel names, then rows."""

import csv
import io
from typing import Any

import numpy as np

from service.errors import Fault, TooLarge, Undecodable
from service.ingest.raw import MOST_FAULTS_OF_A_KIND, RawRecord, capped

CONTENT_TYPES = ("text/csv",)
_MISSING = frozenset({"", "nan", "NaN", "NAN", "null", "NULL", "NA"})


def recognises(_content: bytes) -> bool:
    """Text has no mark at its start: CSV is what nothing else recognises."""
    return True


def parsed(content: bytes, max_rows: int) -> RawRecord:
    """Read a CSV record; every bad cell becomes a fault with its line and column.

    Raises
    ------
    Undecodable
        when the text is not UTF-8 or holds no header.
    TooLarge
        when it has more than ``max_rows`` rows.
    """
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        fault = Fault(f"byte {error.start}", "not UTF-8 text")
        raise Undecodable("the CSV file is not UTF-8: export it as UTF-8", [fault]) from None
    lines = text.splitlines()
    metadata: dict[str, Any] = {}
    first = 0
    for first, line in enumerate(lines):  # noqa: B007 - the header's place is wanted after the loop
        if line.startswith("#"):
            key, colon, value = line[1:].partition(":")
            if colon:
                metadata[key.strip()] = value.strip()
        elif line.strip():
            break
    else:
        raise Undecodable("the CSV file holds no header line with channel names", [Fault("body", "no header")])
    if len(lines) - first - 1 > max_rows:
        raise TooLarge(f"the file has more than {max_rows} rows")
    rows = csv.reader(io.StringIO("\n".join(lines[first:])))
    names = [name.strip() for name in next(rows)]
    faults = [Fault(f"line {first + 1}", f"column {n!r} appears twice") for n in sorted(_repeated(names))]
    faults += [Fault(f"line {first + 1}, column {i + 1}", "has no name") for i, n in enumerate(names) if not n]
    table, cell_faults = _numbers(rows, names, first + 2)
    channels = {name: table[:, i].copy() for i, name in enumerate(names) if name}
    return RawRecord(metadata, channels, faults + cell_faults)


def _repeated(names: list[str]) -> set[str]:
    return {n for n in names if n and names.count(n) > 1}


def _numbers(rows: Any, names: list[str], first_line: int) -> tuple[Any, list[Fault]]:
    """Table of shape (n, columns) and the faults of its cells and rows."""
    table: list[list[float]] = []
    bad: list[Fault] = []
    bad_cells = bad_rows = 0
    width = len(names)
    for number, row in enumerate(rows, start=first_line):
        if not row or (len(row) == 1 and not row[0].strip()):
            continue
        if len(row) != width:
            bad_rows += 1
            if bad_rows <= MOST_FAULTS_OF_A_KIND:
                bad.append(Fault(f"line {number}", f"has {len(row)} fields, the header has {width}"))
            continue
        values = []
        for name, cell in zip(names, row, strict=True):
            word = cell.strip()
            try:
                values.append(float("nan") if word in _MISSING else float(word))
            except ValueError:
                values.append(float("nan"))
                bad_cells += 1
                if bad_cells <= MOST_FAULTS_OF_A_KIND:
                    bad.append(Fault(f"line {number}, {name}", f"{word[:40]!r} is not a number"))
        table.append(values)
    bad = capped(bad, bad_rows - MOST_FAULTS_OF_A_KIND, "rows with a wrong number of fields", "rows")
    bad = capped(bad, bad_cells - MOST_FAULTS_OF_A_KIND, "cells that are not numbers", "cells")
    return np.array(table, dtype=np.float64).reshape(len(table), width), bad
