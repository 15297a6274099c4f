"""The careful reader of a text table: cell by cell, every fault with its line and column."""

from array import array
from collections.abc import Iterator, Sequence

import numpy as np

from service.errors import Fault
from service.ingest.csv_layout import Layout
from service.ingest.csv_text import rows_of
from service.ingest.csv_words import KNOWN_CHANNELS, Words
from service.ingest.raw import MOST_FAULTS_OF_A_KIND, Samples, capped


class Columns:
    """What the columns of a text table hold, by position: numbers, or texts where a foreign column holds any word."""

    def __init__(
        self,
        numbers: dict[int, Samples],
        texts: dict[int, list[str | None]],
        faults: list[Fault],
        flags: Sequence[str] = (),
    ) -> None:
        self.numbers, self.texts, self.faults, self.flags = numbers, texts, faults, list(flags)


def columns_by_cell(layout: Layout) -> Columns:
    """Read every cell by itself.

    A column of a known channel is numbers, and every other cell of it a fault; any other column is numbers where all
    its cells are, and texts otherwise. The header again, as a recorder writes it that starts anew, is left out and flagged.

    Raises
    ------
    csv.Error
        when a quoted cell never ends.
    """
    names, words = layout.names, Words.of(layout.dialect)
    width = len(names)
    number = words.number if words != Words() else _plain_number
    found = [array("d") for _ in names]
    foreign = {i for i, name in enumerate(names) if name not in KNOWN_CHANNELS}
    texts: set[int] = set()
    faults, repeated = _Faults(layout), _Repeated(layout)
    for line, row in repeated.left_out_of(rows_of(layout.body, layout.dialect.delimiter)):
        if len(row) != width and not _is_wide_enough(row, width):
            faults.width(line, row)
            continue
        n_bad = 0
        for i in range(width):
            try:
                value = number(row[i])
            except ValueError:
                value = np.nan
                if i in foreign:
                    texts.add(i)
                else:
                    n_bad += 1
                    faults.cell(line, names[i], row[i], words)
            found[i].append(value)
        faults.row(line, n_bad, sum(name in KNOWN_CHANNELS for name in names) if n_bad else 0)
    numbers = {i: np.array(samples, dtype=np.float64) for i, samples in enumerate(found) if i not in texts}
    return Columns(numbers, _texts(layout, sorted(texts), width), faults.all(), repeated.flags)


def _plain_number(cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        return Words().number(cell)
    if "_" in cell:
        raise ValueError(cell)
    return value


def _is_wide_enough(row: list[str], width: int) -> bool:
    """Whether a row only ends in a delimiter more than the header."""
    return len(row) == width + 1 and not row[-1].strip()


def _texts(layout: Layout, places: Sequence[int], width: int) -> dict[int, list[str | None]]:
    texts: dict[int, list[str | None]] = {i: [] for i in places}
    if places:
        for _, row in _Repeated(layout).left_out_of(rows_of(layout.body, layout.dialect.delimiter)):
            if len(row) == width or _is_wide_enough(row, width):
                for i in places:
                    texts[i].append(row[i].strip() or None)
    return texts


class _Repeated:
    """Lines that are the header again."""

    def __init__(self, layout: Layout) -> None:
        self._header, self._first_line = list(layout.names), layout.first_line
        self._n, self._first = 0, 0

    def left_out_of(self, rows: Iterator[tuple[int, list[str]]]) -> Iterator[tuple[int, list[str]]]:
        known = any(name in KNOWN_CHANNELS for name in self._header)
        for line, row in rows:
            if known and row[0].strip() == self._header[0] and [cell.strip() for cell in row] == self._header:
                self._n += 1
                self._first = self._first or self._first_line + line
            else:
                yield line, row

    @property
    def flags(self) -> list[str]:
        """What is said of them."""
        return [f"the header again on {self._n} line(s), first on line {self._first}: left out"] if self._n else []


class _Faults:
    """Faults of rows and cells, the first few of each kind by name."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._named: list[Fault] = []
        self._rows = self._cells = self._first = 0
        self._units_line: int | None = None

    def width(self, line: int, row: list[str]) -> None:
        self._rows += 1
        if self._rows <= MOST_FAULTS_OF_A_KIND:
            width = len(self._layout.names)
            is_comma = self._layout.dialect.decimal == "." and len(row) == 2 * width
            hint = ": are decimals written with a comma?" if is_comma else ""
            text = f"has {len(row)} fields, the header has {width}{hint}"
            self._named.append(Fault(f"line {self._layout.first_line + line}", text))

    def cell(self, line: int, name: str, cell: str, words: Words) -> None:
        self._cells += 1
        if self._cells <= MOST_FAULTS_OF_A_KIND:
            text = f"{cell.strip()[:40]!r} is not a number{words.hint(cell)}"
            self._named.append(Fault(f"line {self._layout.first_line + line}, {name}", text))

    def row(self, line: int, n_bad: int, n_known: int) -> None:
        """Note whether the first row holds nothing but words: it is then one of units, or of names."""
        if self._first == 0 and n_bad and n_bad >= n_known - 1 and n_bad > 1:
            self._units_line = self._layout.first_line + line
        self._first += 1

    def all(self) -> list[Fault]:
        faults = self._named
        if self._units_line is not None:
            text = (
                "holds words alone: a row of units is named by a channel mapping (units_row), or left out (skip_rows)"
            )
            faults = [*faults, Fault(f"line {self._units_line}", text)]
        faults = capped(faults, self._rows - MOST_FAULTS_OF_A_KIND, "rows with a wrong number of fields", "rows")
        return capped(faults, self._cells - MOST_FAULTS_OF_A_KIND, "cells that are not numbers", "cells")
