"""How a text file seems to be written: encoding, separators, where its header, units, samples and footer stand."""

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypedDict

from service.bodies import is_storable
from service.ingest.csv_rule import CsvRule
from service.ingest.unit_words import WORDS, word

HEAD_BYTES = 1 << 18
TAIL_BYTES = 1 << 14
_MOST_LINES = 600
_DELIMITERS = (",", ";", "\t", "|", " ")
_COMMENTS = ("#", "%", "//", "!")
_PLAIN = {
    ".": re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?"),
    ",": re.compile(r"[+-]?(\d+,?\d*|,\d+)([eE][+-]?\d+)?"),
}
_GROUPED = {mark: re.compile(rf"[+-]?\d{{1,3}}({re.escape(mark)}\d{{3}})+([.,]\d+)?") for mark in (",", ".", " ", "'")}
_MISSING = frozenset(("", "nan", "null", "na", "n/a", "#n/a", "-", "--", "---", "none", "inf", "1.#qnan", "-1.#ind"))
_SENTINELS = frozenset(
    ("-9999", "-999", "9999", "-99999", "99999", "-32768", "32767", "1e30", "-9999.0", "-999.0", "9.9e37")
)
_KINDS_OF_UNIT = [f"x_{suffix}" if suffix else "x" for suffix in WORDS]
_OF_NO_CHANNEL = re.compile(
    r"#?[ymdhs]{1,4}([-/:. ][ymdhs]{1,4})+|hh:mm|utc|enum|ident|text|bool|deg|lat|lon|m|ft|kt|kts|v|a|g|hz",
    re.IGNORECASE,
)
"""What stands in a row of units for columns that are no channels of ours."""
_FEWEST_ROWS = 3
_MOST_FOOTER = 20
_LONGEST_WORD = 40


class _Written(TypedDict, total=False):
    """Fields of a ``CsvRule`` as far as they were found; lines are counted from 1."""

    delimiter: str
    decimal: str
    encoding: str
    comment: str
    no_header: bool
    header_rows: int
    header_row: int
    skip_rows: list[int]
    units_row: int
    footer_rows: int
    missing: list[str]
    thousands: str


@dataclass(slots=True)
class Look:
    """What a text file seems to be.

    Attributes
    ----------
    rule
        How it is written.
    notes
        The same in sentences.
    could_not_tell
        What a person has to say.
    preamble
        Lines before the header that a reader passes over.
    """

    rule: CsvRule
    notes: list[str] = field(default_factory=list)
    could_not_tell: list[str] = field(default_factory=list)
    preamble: list[str] = field(default_factory=list)


def look(head: bytes, tail: bytes | None = None) -> Look:
    """Look at the first bytes of a file, and at its last where these are not among the first."""
    encoding = _encoding(head)
    lines = head.decode(encoding if encoding != "utf-8" else "utf-8-sig", errors="replace").splitlines()
    if tail is not None and lines:
        lines.pop()  # it may be cut
    lines = lines[:_MOST_LINES]
    last = (tail or head).decode(encoding, errors="replace").splitlines()[-_MOST_FOOTER * 2 :]
    scored = [(_score(lines, d, m), d, m) for d in _DELIMITERS for m in (".", ",") if d != m]
    best, delimiter, decimal = max(scored, key=lambda found: found[0])
    if best <= 0.0:
        rule = CsvRule(encoding=encoding)
        return Look(rule, [], ["the text holds no table of numbers that could be recognised"])
    found = Look(
        CsvRule(), [f"fields are separated by {_NAMES[delimiter]}, decimals by {decimal!r}, text is {encoding}"]
    )
    rows = [_fields(line, delimiter) for line in lines]
    start, placed = _layout(lines, rows, decimal, found)
    width = _width(rows)
    ends = _footer([_fields(line, delimiter) for line in last], width, decimal)
    n_footer = sum(bool(line.strip()) for line in last[len(last) - ends :])
    body = rows[start : len(rows) - ends if tail is None and len(rows) < _MOST_LINES else None]
    values: _Written = {"delimiter": delimiter, "decimal": decimal, "encoding": encoding}
    values |= placed | _words(body, width, decimal, delimiter, found)
    if n_footer:
        values["footer_rows"] = n_footer
        found.notes.append(f"the last {n_footer} line(s) are no samples")
    found.rule = CsvRule.model_validate(values)
    return found


_NAMES = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars", " ": "blanks"}


def _encoding(head: bytes) -> str:
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    try:
        head.decode("utf-8")
    except UnicodeDecodeError as error:
        return "utf-8" if error.start > len(head) - 4 else "cp1252"
    return "utf-8"


def _fields(line: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]
    except csv.Error:
        return []


def _is_number(cell: str, decimal: str) -> bool:
    if _PLAIN[decimal].fullmatch(cell):
        return True
    return any(mark != decimal and _GROUPED[mark].fullmatch(cell) for mark in _GROUPED)


def _width(rows: Sequence[Sequence[str]]) -> int:
    counts = Counter(len(row) for row in rows[len(rows) // 3 :] if len(row) > 1)
    return counts.most_common(1)[0][0] if counts else 0


def _score(lines: Sequence[str], delimiter: str, decimal: str) -> float:
    """Numbers in rows of the usual width, as a share of all cells, times a word for their count."""
    middle = [line for line in lines[len(lines) // 3 :] if line.strip()]
    rows = [_fields(line, delimiter) for line in middle]
    width = _width(rows)
    if width < 2 or not rows:
        return 0.0
    same = [row for row in rows if len(row) == width]
    cells = [cell for row in same for cell in row]
    plain = sum(bool(_PLAIN[decimal].fullmatch(cell)) for cell in cells)
    fair = sum(_is_number(cell, decimal) or cell.lower() in _MISSING for cell in cells)
    # a mark inside a cell that is no number speaks against it; more columns that are all numbers speak for it
    return (len(same) / len(rows)) ** 2 * (0.6 * plain + 0.4 * fair) / max(len(cells), 1) + 0.001 * min(width, 50)


def _layout(lines: Sequence[str], rows: Sequence[Sequence[str]], decimal: str, found: Look) -> tuple[int, _Written]:
    """Row of the first sample, from 0, and where header and units stand."""
    width = _width(rows)
    numeric = _numeric_columns(rows, width, decimal)
    start = next((i for i, row in enumerate(rows) if _is_sample(row, width, numeric, decimal)), 0)
    values: _Written = {}
    comment = next((mark for mark in _COMMENTS if any(line.startswith(mark) for line in lines[:start])), "#")
    if comment != "#":
        values["comment"] = comment
    above = [i for i in range(start) if len(rows[i]) == width]
    units = next((i for i in reversed(above) if _is_units(rows[i])), None)
    names = next((i for i in reversed(above) if i != units and not lines[i].startswith(comment)), None)
    if names is None:
        names = next((i for i in reversed(above) if i != units), None)
    if names is None:
        values["no_header"] = True
        found.notes.append(f"there is no header: samples begin in line {start + 1}")
        found.could_not_tell.append("the columns have no names: say what each number is")
    else:
        plain = next((i for i, line in enumerate(lines) if line.strip() and not line.startswith(comment)), None)
        twice = len(set(rows[names])) < width
        upper = names - 1
        if twice and upper in above and upper != units:
            values["header_rows"] = 2
            names = upper
        if names != plain:
            values["header_row"] = names + 1
        found.notes.append(f"names of columns stand in line {names + 1}")
        last = names + values.get("header_rows", 1) - 1
        skipped = [
            i + 1
            for i in range(last + 1, start)
            if i != units and lines[i].strip() and not lines[i].startswith(comment)
        ]
        if skipped:
            values["skip_rows"] = skipped
            found.notes.append(f"line(s) {', '.join(map(str, skipped))} between header and samples say nothing")
        found.preamble = [
            line for i, line in enumerate(lines[:names]) if i != units and line.strip() and not line.startswith(comment)
        ]
    if units is not None:
        values["units_row"] = units + 1
        found.notes.append(f"units stand in line {units + 1}")
    return start, values


def _numeric_columns(rows: Sequence[Sequence[str]], width: int, decimal: str) -> list[int]:
    body = [row for row in rows[len(rows) // 3 :] if len(row) == width]
    share = [sum(_is_number(row[k], decimal) for row in body) / max(len(body), 1) for k in range(width)]
    return [k for k in range(width) if share[k] > 0.5] or [k for k in range(width) if share[k] == max(share) > 0.0]


def _is_sample(row: Sequence[str], width: int, numeric: Sequence[int], decimal: str) -> bool:
    if len(row) != width:
        return False
    cells = [row[k] for k in numeric]
    known = sum(_is_number(cell, decimal) for cell in cells)
    return known > 0 and known + sum(cell.lower() in _MISSING for cell in cells) == len(cells)


def _is_unit(cell: str) -> bool:
    text = cell.lstrip("#%! ")
    if text in ("", "-", "--") or _OF_NO_CHANNEL.fullmatch(text):
        return True
    before = re.split(r"[\[(]", text)[0].strip()  # of ``T [degC]`` a name, of ``bar (g)`` a unit
    try:
        return any(word(before or text, kind) is not None for kind in _KINDS_OF_UNIT)
    except ValueError:
        return True


def _is_units(row: Sequence[str]) -> bool:
    stated = [cell for cell in row if cell.strip("#%! -")]
    return len(stated) >= len(row) / 3 and sum(map(_is_unit, stated)) > 0.7 * len(stated)


def _words(rows: Sequence[Sequence[str]], width: int, decimal: str, delimiter: str, found: Look) -> _Written:
    """Words for missing samples and the mark of thousands."""
    numeric = _numeric_columns(rows, width, decimal)
    body = [row for row in rows if len(row) == width]
    other: Counter[str] = Counter()
    marks: Counter[str] = Counter()
    for row in body[:-1] if len(body) > _FEWEST_ROWS else body:
        for k in numeric:
            cell = row[k]
            if _PLAIN[decimal].fullmatch(cell):
                other[cell] += cell.lower() in _SENTINELS
                continue
            grouped = [m for m in _GROUPED if m not in (decimal, delimiter) or (m == delimiter and m != decimal)]
            mark = next((m for m in grouped if m != decimal and _GROUPED[m].fullmatch(cell)), None)
            if mark is not None:
                marks[mark] += 1
            elif cell.lower() not in _MISSING:
                other[cell] += 1
    values: _Written = {}
    words = [
        cell for cell, n in other.most_common(10) if n >= 1 and 0 < len(cell) <= _LONGEST_WORD and is_storable(cell)
    ]
    if words:
        values["missing"] = words
        found.notes.append(f"missing samples seem to be written as {', '.join(words)}")
    if marks:
        mark = marks.most_common(1)[0][0]
        values["thousands"] = mark
        found.notes.append(f"thousands are grouped by {mark!r}")
    return values


def _footer(rows: Sequence[Sequence[str]], width: int, decimal: str) -> int:
    """Lines after the last that has the look of a sample."""
    numeric = _numeric_columns(rows, width, decimal)
    for n, row in enumerate(reversed(rows)):
        if _is_sample(row, width, numeric, decimal):
            return n if n <= _MOST_FOOTER else 0
    return 0
