"""The quick reader of a text table: whole columns at once; it gives up at the first thing that it does not understand."""

import re
from typing import Any

import numpy as np

from service.ingest.csv_cells import Columns
from service.ingest.csv_layout import Layout
from service.ingest.csv_text import fields_of
from service.ingest.csv_words import KNOWN_CHANNELS, MISSING, Words
from service.ingest.raw import Samples

_BLOCK = 1 << 26
_FIRST_ROWS = 4096
"""Bytes in which the first row is looked for."""
_TEXT = re.compile(rb"\S")
_NULLS = sorted({form for word in MISSING for form in (word, word.upper(), word.capitalize(), word.title())} | {"NaN"})


def columns_at_once(layout: Layout) -> Columns | None:
    """Columns as ``columns_by_cell`` gives them, bit for bit, for a file without a fault; None where it finds any."""
    import pyarrow as pa  # noqa: PLC0415 - heavy, and only where files are read

    dialect = layout.dialect
    if dialect.thousands or dialect.delimiter == " " or not _TEXT.search(layout.content, layout.start):
        return None
    try:
        texts = _texts_of_first_row(layout)
        try:
            return _columns(layout, texts, is_sure=True)
        except pa.ArrowInvalid as error:
            if "conversion error" not in str(error):
                return None
        foreign = {i for i, name in enumerate(layout.names) if name not in KNOWN_CHANNELS}
        return _columns(layout, foreign, is_sure=False) if foreign - texts else None
    except (pa.ArrowException, _UnlikeError):
        return None


class _UnlikeError(Exception):
    """The careful reader would read this otherwise."""


def _texts_of_first_row(layout: Layout) -> set[int]:
    """Foreign columns whose first cell is a word."""
    head = layout.content[layout.start : layout.start + _FIRST_ROWS].lstrip(b"\r\n").splitlines()
    row = fields_of(head[0].decode(errors="replace"), layout.dialect.delimiter) if head else []
    words = Words.of(layout.dialect)
    found = set()
    for i, (name, cell) in enumerate(zip(layout.names, row, strict=False)):
        if name not in KNOWN_CHANNELS:
            try:
                words.number(cell)
            except ValueError:
                found.add(i)
    return found


def _columns(layout: Layout, texts: set[int], is_sure: bool) -> Columns:
    """Columns with those at ``texts`` read as words; where that is not sure, as numbers if all of them are."""
    import pyarrow as pa  # noqa: PLC0415
    from pyarrow import csv as arrow_csv  # noqa: PLC0415

    names = [str(i) for i in range(len(layout.names))]
    has_quotes = layout.content.find(b'"', layout.start) >= 0
    table = arrow_csv.read_csv(
        pa.BufferReader(pa.py_buffer(layout.content).slice(layout.start)),
        read_options=arrow_csv.ReadOptions(
            use_threads=False, block_size=min(layout.size + 1, _BLOCK), column_names=names
        ),
        parse_options=arrow_csv.ParseOptions(
            delimiter=layout.dialect.delimiter, quote_char='"' if has_quotes else False, newlines_in_values=has_quotes
        ),
        convert_options=arrow_csv.ConvertOptions(
            column_types={name: pa.string() if i in texts else pa.float64() for i, name in enumerate(names)},
            null_values=[*_NULLS, *layout.dialect.missing],
            decimal_point=layout.dialect.decimal,
            strings_can_be_null=False,
        ),
    )
    numbers: dict[int, Samples] = {}
    words: dict[int, list[str | None]] = {}
    spelling = Words.of(layout.dialect)
    for i in range(len(names)):
        column = table.column(i)
        if i not in texts:
            numbers[i] = spelling.without_missing(_samples(column))
            continue
        cells = [cell.strip() or None for cell in column.to_pylist()]
        as_numbers = _as_numbers(cells, spelling) if not is_sure else None
        if as_numbers is None:
            words[i] = cells
        else:
            numbers[i] = as_numbers
    return Columns(numbers, words, [])


def _samples(column: Any) -> Samples:
    """A column as numbers; a word that the library alone takes for NaN is none of ours."""
    samples: Samples = column.to_numpy()
    if not samples.flags.writeable:
        samples = samples.copy()
    if int(np.count_nonzero(np.isnan(samples))) != column.null_count:
        raise _UnlikeError
    return samples


def _as_numbers(cells: list[str | None], words: Words) -> Samples | None:
    samples = np.empty(len(cells))
    try:
        for i, cell in enumerate(cells):
            samples[i] = np.nan if cell is None else words.number(cell)
    except ValueError:
        return None
    return samples
