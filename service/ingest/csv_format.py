"""CSV: optional leading ``# key: value`` lines, a header with the channel names, then rows."""

import csv
import io
import re
from typing import Any

import numpy as np

from service.errors import Fault, Undecodable
from service.ingest.raw import MOST_FAULTS_OF_A_KIND, Limits, RawFile, Table, TextDialect, capped, check_size

_DELIMITERS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"}
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")
_MISSING = frozenset({"", "nan", "NaN", "NAN", "null", "NULL", "NA"})


def parsed(content: bytes, limits: Limits, dialect: TextDialect | None = None) -> RawFile:
    """Read a CSV record; every bad cell becomes a fault with its line and column.

    Raises
    ------
    Undecodable
        when the text is not in its encoding, is separated by another character, or holds no header.
    TooLarge
        when it is larger than the limits.
    """
    dialect = dialect or TextDialect()
    lines = _text(content, dialect.encoding).splitlines()
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
    _check_delimiter(lines[first], first + 1, dialect)
    rows = csv.reader(io.StringIO("\n".join(lines[first:])), delimiter=dialect.delimiter)
    try:
        names = [name.strip() for name in next(rows)]
        check_size(len(lines) - first - 1, len(names), limits)
        faults = [Fault(f"line {first + 1}", f"column {n!r} appears twice") for n in sorted(_repeated(names))]
        faults += [Fault(f"line {first + 1}, column {i + 1}", "has no name") for i, n in enumerate(names) if not n]
        table, cell_faults = _numbers(rows, names, first + 2, dialect.decimal)
    except csv.Error as error:
        fault = Fault(f"line {first + rows.line_num}", str(error))
        raise Undecodable("the CSV file is damaged", [fault]) from None
    channels = {name: table[:, i].copy() for i, name in enumerate(names) if name}
    return RawFile(metadata, (Table(channels),), faults + cell_faults)


def _text(content: bytes, encoding: str) -> str:
    name = "utf-8-sig" if encoding == "utf-8" else encoding
    try:
        return content.decode(name)
    except UnicodeDecodeError as error:
        shown = encoding.upper()
        if content.startswith((b"\xff\xfe", b"\xfe\xff")):
            fault = Fault("byte 0", "the mark at the start says UTF-16")
            raise Undecodable(f"the CSV file is UTF-16, not {shown}: export it as UTF-8", [fault]) from None
        faults = _foreign_lines(content, name, shown) or [Fault(f"byte {error.start}", f"not {shown} text")]
        raise Undecodable(f"the CSV file is not {shown} throughout: export it as UTF-8", faults) from None


def _foreign_lines(content: bytes, encoding: str, shown: str) -> list[Fault]:
    """Lines that are in another encoding than the rest, each by its first wrong byte."""
    faults: list[Fault] = []
    n_bad = start = 0
    for number, line in enumerate(content.split(b"\n"), start=1):
        try:
            line.decode(encoding)
        except UnicodeDecodeError as error:
            n_bad += 1
            if n_bad <= MOST_FAULTS_OF_A_KIND:
                byte = line[error.start]
                text = f"line {number} is not {shown}: byte {byte:#04x}, {bytes([byte]).decode('latin-1')!r} in Latin-1"
                faults.append(Fault(f"byte {start + error.start}", text))
        start += len(line) + 1
    return capped(faults, n_bad - MOST_FAULTS_OF_A_KIND, "lines in another encoding", "body")


def _check_delimiter(header: str, number: int, dialect: TextDialect) -> None:
    if dialect.delimiter in header:
        return
    other = [(d, name) for d, name in _DELIMITERS.items() if d in header and d != dialect.delimiter]
    if other:
        wanted = _DELIMITERS.get(dialect.delimiter, repr(dialect.delimiter))
        fault = Fault(f"line {number}", f"is separated by {other[0][1]}, not by {wanted}")
        raise Undecodable(
            f"the CSV file is not separated by {wanted}: export it so, or upload it with a channel mapping "
            "that says its delimiter and decimal mark",
            [fault],
        )


def _repeated(names: list[str]) -> set[str]:
    return {n for n in names if n and names.count(n) > 1}


def _numbers(rows: Any, names: list[str], first_line: int, decimal: str) -> tuple[Any, list[Fault]]:
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
                hint = ": are decimals written with a comma?" if decimal == "." and len(row) == 2 * width else ""
                bad.append(Fault(f"line {number}", f"has {len(row)} fields, the header has {width}{hint}"))
            continue
        values = []
        for name, cell in zip(names, row, strict=True):
            word = cell.strip() if decimal == "." else cell.strip().replace(decimal, ".")
            try:
                values.append(float("nan") if word in _MISSING else _number(word))
            except ValueError:
                values.append(float("nan"))
                bad_cells += 1
                if bad_cells <= MOST_FAULTS_OF_A_KIND:
                    hint = ": write decimals with a point" if decimal == "." and _DECIMAL_COMMA.fullmatch(word) else ""
                    bad.append(Fault(f"line {number}, {name}", f"{cell.strip()[:40]!r} is not a number{hint}"))
        table.append(values)
    bad = capped(bad, bad_rows - MOST_FAULTS_OF_A_KIND, "rows with a wrong number of fields", "rows")
    bad = capped(bad, bad_cells - MOST_FAULTS_OF_A_KIND, "cells that are not numbers", "cells")
    return np.array(table, dtype=np.float64).reshape(len(table), width), bad


def _number(word: str) -> float:
    # float() also reads 1_000, which is no number in any file
    if "_" in word:
        raise ValueError(word)
    return float(word)
