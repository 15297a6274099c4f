"""Where the table of a text file begins and ends: encoding, preamble, names, units, and an end that was cut."""

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from service.errors import Fault, TooLarge, Undecodable
from service.ingest.csv_text import CUT, as_utf8, fields_of
from service.ingest.csv_words import KNOWN_CHANNELS, Words
from service.ingest.raw import MOST_METADATA, ForeignMetadata, TextDialect

_DELIMITERS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"}
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d+,\d+\s*")
_EMPTY_LINES = re.compile(rb"[\r\n]+")
_LINE_END = re.compile(rb"\r\n|\n|\r")
_EXCEL_MARK = re.compile(r'"?sep=.\s*"?')
_MOST_BEFORE_THE_HEADER = 10_000
_MOST_OF_A_LINE = 100_000
_LOOKED_AT = 20
"""Rows that are looked at for decimal commas."""


@dataclass(frozen=True, slots=True)
class Layout:
    """A text file before its cells are read.

    Attributes
    ----------
    metadata
        ``key: value`` before the table.
    names
        Of the columns; empty where a column has none.
    units
        By name of column, where a line of the file says them.
    content, start
        Text as UTF-8, and the byte from which on it is rows; lines that are left out are blank, so that numbers of lines
        hold.
    first_line
        Number of the rows' first line.
    dialect
        As it turned out.
    flags
        What was mended.
    """

    metadata: ForeignMetadata
    names: list[str]
    units: dict[str, str]
    content: bytes
    start: int
    first_line: int
    dialect: TextDialect
    flags: list[str]

    @property
    def body(self) -> bytes:
        """The rows; a copy of them."""
        return self.content[self.start :]

    @property
    def size(self) -> int:
        """Bytes of the rows."""
        return len(self.content) - self.start


def layout_of(content: bytes, dialect: TextDialect) -> Layout:
    """Take a text file apart.

    Raises
    ------
    Undecodable
        when the text is not in its encoding, is separated by another character, or holds no names.
    TooLarge
        when it holds too many metadata.
    """
    content, flags = as_utf8(content, dialect.encoding)
    metadata, header, comments = _preamble(content, dialect)
    if header is None:
        raise Undecodable("the CSV file holds no header line with channel names", [Fault("body", "no header")])
    dialect = _delimited(content, header, dialect)
    place, number, names = header.start, header.number, list(dialect.names)
    if not dialect.no_header:
        rows = []
        for line in _lines(content, place, number, dialect.delimiter):
            text = line.text.removeprefix(dialect.comment) if dialect.comment else line.text
            rows.append(fields_of(text, dialect.delimiter))
            place, number = line.end, line.number + line.height
            if len(rows) == dialect.header_rows:
                break
        names = names or _joined(rows)
        if not any(names):
            raise Undecodable("the CSV file has no channel names", [Fault(f"line {header.number}", "holds no names")])
    first_row = next(
        (line for line in _lines(content, place, number, dialect.delimiter) if _is_row(line, dialect)), None
    )
    width = 0 if first_row is None else len(fields_of(first_row.text, dialect.delimiter))
    names = _as_wide(names, width, first_row, dialect)
    units = _units(content, names, dialect, comments)
    content = _left_out(content, place, number, dialect)
    if not dialect.footer_rows:
        content, cut = _without_cut_end(content, place, len(names), dialect)
        flags += cut
    return Layout(metadata, names, units, content, place, number, dialect, flags)


@dataclass(frozen=True, slots=True)
class _Line:
    """One line, or several where a quoted cell goes on; ``end`` is the place behind it."""

    number: int
    start: int
    end: int
    text: str
    height: int = 1


def _lines(content: bytes, place: int = 0, number: int = 1, delimiter: str = "") -> Iterator[_Line]:
    """Lines from a place on that are not empty; with a delimiter, a row whose quoted cell goes on is one."""
    while True:
        if empty := _EMPTY_LINES.match(content, place):
            number += content.count(b"\n", place, empty.end()) + content.count(b"\r", place, empty.end())
            number -= content.count(b"\r\n", place, empty.end())
            place = empty.end()
        if place >= len(content):
            return
        start, height, text = place, 0, ""
        while place < len(content):
            found = _LINE_END.search(content, place)
            stop, after = found.span() if found else (len(content), len(content))
            text += content[place:stop].decode()
            place, height = after, height + 1
            if '"' not in text or height == _LOOKED_AT or not _is_open(text, delimiter):
                break
            text += " "
        yield _Line(number, start, place, text, height)
        number += height


def _is_open(text: str, delimiter: str) -> bool:
    """Whether a quoted cell goes on behind the end of this text."""
    if not delimiter:
        return False
    try:
        list(csv.reader([text], delimiter=delimiter, strict=True))
    except csv.Error as error:
        return "unexpected end" in str(error)
    return False


def _preamble(content: bytes, dialect: TextDialect) -> tuple[ForeignMetadata, _Line | None, dict[int, str]]:
    """Metadata before the header, its line (or the first row's, where there is none), and comments by line number."""
    metadata: ForeignMetadata = {}
    comments: dict[int, str] = {}
    for n, line in enumerate(_lines(content)):
        if n == _MOST_BEFORE_THE_HEADER:
            raise TooLarge(f"the file begins with more than {n} lines that are no table")
        is_comment = bool(dialect.comment) and line.text.startswith(dialect.comment)
        text = line.text.removeprefix(dialect.comment) if is_comment else line.text
        if dialect.header_row is not None and line.number >= dialect.header_row:
            return metadata, replace(line, text=text), comments
        if line.number in dialect.skip_rows or _EXCEL_MARK.fullmatch(text):
            continue
        if is_comment or dialect.header_row is not None:
            comments[line.number] = text
            _note(metadata, text, dialect, is_comment)
        elif text.strip() and line.number != dialect.units_row:
            return metadata, line, comments
    return metadata, None, comments


def _note(metadata: ForeignMetadata, text: str, dialect: TextDialect, is_comment: bool) -> None:
    key, mark, value = text.partition(":")
    if not is_comment and (not mark or dialect.delimiter in key):
        cells = [cell for cell in fields_of(text, dialect.delimiter) if cell]
        if len(cells) != 2:
            return
        key, value = cells
        key, mark = key.removesuffix(":"), ":"
    if mark:
        metadata[key.strip()] = value.strip()
        if len(metadata) > MOST_METADATA:
            raise TooLarge(f"the file begins with more than {MOST_METADATA} lines of metadata")


def _delimited(content: bytes, header: _Line, dialect: TextDialect) -> TextDialect:
    """The dialect that the header shows: another delimiter is taken where our own names stand between its marks.

    Raises
    ------
    Undecodable
        when it is separated by another character and our names are not in it.
    """
    if dialect.delimiter in header.text or dialect.delimiter == " ":
        return dialect
    other = [d for d in _DELIMITERS if d in header.text and d != dialect.delimiter]
    if not other:
        return dialect
    if dialect == TextDialect() and KNOWN_CHANNELS & set(fields_of(header.text, other[0])):
        decimal = "," if other[0] != "," and _has_decimal_commas(content, header, other[0]) else "."
        return replace(dialect, delimiter=other[0], decimal=decimal)
    wanted = _DELIMITERS.get(dialect.delimiter, repr(dialect.delimiter))
    fault = Fault(f"line {header.number}", f"is separated by {_DELIMITERS[other[0]]}, not by {wanted}")
    raise Undecodable(
        f"the CSV file is not separated by {wanted}: export it so, or upload it with a channel mapping "
        "that says its delimiter and decimal mark",
        [fault],
    )


def _has_decimal_commas(content: bytes, header: _Line, delimiter: str) -> bool:
    for n, line in enumerate(_lines(content, header.end, header.number + 1)):
        if any(_DECIMAL_COMMA.fullmatch(cell) for cell in fields_of(line.text, delimiter)):
            return True
        if n == _LOOKED_AT:
            break
    return False


def _joined(rows: Sequence[Sequence[str]]) -> list[str]:
    """Names of columns whose header takes up several lines."""
    if len(rows) == 1:
        return list(rows[0])
    width = max((len(row) for row in rows), default=0)
    return [" ".join(row[i] for row in rows if i < len(row) and row[i]) for i in range(width)]


def _is_row(line: _Line, dialect: TextDialect) -> bool:
    is_left_out = line.number in dialect.skip_rows or line.number == dialect.units_row
    is_comment = bool(dialect.comment) and line.text.startswith(dialect.comment)
    return bool(line.text.strip()) and not is_left_out and not is_comment


def _as_wide(names: list[str], width: int, first_row: _Line | None, dialect: TextDialect) -> list[str]:
    """Names where the header or the rows end in a delimiter and the others do not; numbered where there are none."""
    if not names:
        return [str(i + 1) for i in range(width)]
    if first_row is None:
        return names
    if width == len(names) + 1 and not fields_of(first_row.text, dialect.delimiter)[-1]:
        return [*names, ""]
    if width == len(names) - 1 and not names[-1]:
        return names[:-1]
    return names


def _units(content: bytes, names: Sequence[str], dialect: TextDialect, comments: dict[int, str]) -> dict[str, str]:
    if dialect.units_row is None:
        return {}
    text = comments.get(dialect.units_row)
    if text is None:
        text = next((line.text for line in _lines(content) if line.number >= dialect.units_row), "")
    cells = fields_of(text.removeprefix(dialect.comment), dialect.delimiter)
    return {name: unit.strip("[]() ") for name, unit in zip(names, cells, strict=False) if name and unit}


def _left_out(content: bytes, start: int, first_line: int, dialect: TextDialect) -> bytes:
    """The text with lines that are left out made blank, and without its footer."""
    mark = dialect.comment.encode()
    lines = {n for n in (*dialect.skip_rows, dialect.units_row or 0) if n >= first_line}
    has_comments = bool(mark) and content.find(mark, start) >= 0
    if not lines and not has_comments and not dialect.footer_rows:
        return content
    body = content[start:]
    if lines:
        body = _blanked(body, lines, first_line)
    if has_comments:
        body = re.sub(rb"(?m)(?:^|(?<=\r))" + re.escape(mark) + rb"[^\r\n]*", b"", body)
    for _ in range(dialect.footer_rows):
        body = body.rstrip()
        body = body[: max(body.rfind(b"\n"), body.rfind(b"\r")) + 1]
    return content[:start] + body


def _blanked(body: bytes, left_out: set[int], first_line: int) -> bytes:
    parts, place, number = [], 0, first_line
    for found in _LINE_END.finditer(body):
        if number in left_out:
            parts.append(body[place : found.end()][found.start() - place :])
            place = found.end()
            left_out.discard(number)
            if not left_out:
                break
        else:
            parts.append(body[place : found.end()])
            place = found.end()
        number += 1
    rest = body[place:]
    return b"".join(parts) + (b"" if number in left_out else rest)


def _without_cut_end(content: bytes, start: int, width: int, dialect: TextDialect) -> tuple[bytes, list[str]]:
    """The text without a last line that was cut: no line end, and too few fields or a last one that is no number."""
    if content.endswith((b"\n", b"\r")):
        return content, []
    place = max(content.rfind(b"\n", start), content.rfind(b"\r", start)) + 1
    if place <= start:
        return content, []
    last = content[place:].decode()
    if not last.strip():
        return content[:place], []
    before = content[max(start, place - _MOST_OF_A_LINE) : place].decode(errors="replace").splitlines()[-1]
    try:
        fields, earlier = fields_of(last, dialect.delimiter), fields_of(before, dialect.delimiter)
    except csv.Error:
        return content, []
    is_cut = len(fields) < width or (
        len(fields) == width
        and bool(fields[-1])
        and not _is_number(fields[-1], dialect)
        and bool(earlier)
        and _is_number(earlier[-1], dialect)
    )
    return (content[:place], [CUT]) if is_cut else (content, [])


def _is_number(cell: str, dialect: TextDialect) -> bool:
    try:
        Words.of(dialect).number(cell)
    except ValueError:
        return False
    return True
