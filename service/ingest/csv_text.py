"""Text of a file as UTF-8, and one line of it as fields."""

import csv
import io
import re
from collections.abc import Iterator

from service.errors import Fault, Undecodable
from service.ingest.raw import MOST_FAULTS_OF_A_KIND, capped

CUT = "the last line is cut: left out"
_BOM = b"\xef\xbb\xbf"
_UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")
MOST_OF_A_FIELD = 10_000_000
"""Characters of one cell; the csv module's own bound would refuse what another reader takes."""


def as_utf8(content: bytes, encoding: str) -> tuple[bytes, list[str]]:
    """A file's text in UTF-8 without a mark of byte order, and what was mended.

    Raises
    ------
    Undecodable
        naming every line that is in another encoding.
    """
    flags = []
    if encoding == "utf-8" and content.endswith(b"\0") and not content.startswith(_UTF16_MARKS):
        whole = content.rstrip(b"\0")
        flags.append(f"{len(content) - len(whole)} zero bytes at the end of the file left out")
        content = whole
    if encoding == "utf-8":
        content = content.removeprefix(_BOM)
        if content.isascii():
            return content, flags
    name = "utf-8-sig" if encoding == "utf-8" else encoding
    try:
        text = content.decode(name)
    except UnicodeDecodeError as error:
        start = max(content.rfind(b"\n"), content.rfind(b"\r")) + 1
        # the last character of a file that was cut may be half
        if encoding == "utf-8" and error.start >= start > 0 and "unexpected end" in error.reason:
            return content[:start], [*flags, CUT]
        raise _wrong_encoding(content, error, encoding) from None
    return (content if encoding == "utf-8" else text.encode("utf-8", "replace")), flags


def _wrong_encoding(content: bytes, error: UnicodeDecodeError, encoding: str) -> Undecodable:
    shown = encoding.upper()
    if content.startswith(_UTF16_MARKS):
        fault = Fault("byte 0", "the mark at the start says UTF-16")
        return Undecodable(f"the CSV file is UTF-16, not {shown}: export it as UTF-8", [fault])
    faults = _foreign_lines(content, encoding, shown) or [Fault(f"byte {error.start}", f"not {shown} text")]
    return Undecodable(f"the CSV file is not {shown} throughout: export it as UTF-8", faults)


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


def rows_of(body: bytes, delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """Number of the line, counted from 0, on which a row ends, and its fields; blank lines are passed over.

    Raises
    ------
    csv.Error
        when a quoted cell never ends.
    """
    csv.field_size_limit(MOST_OF_A_FIELD)
    lines = io.TextIOWrapper(io.BytesIO(body), encoding="utf-8", newline=None)
    if delimiter == " ":
        reader = csv.reader((re.sub(r"[ \t]+", " ", line.strip()) for line in lines), delimiter=" ")
    else:
        reader = csv.reader(lines, delimiter=delimiter)
    for row in reader:
        if row and (len(row) > 1 or row[0].strip()):
            yield reader.line_num - 1, row


def fields_of(line: str, delimiter: str) -> list[str]:
    """Fields of one line, without the blanks around them."""
    if not line:
        return []
    text = re.sub(r"[ \t]+", " ", line.strip()) if delimiter == " " else line
    csv.field_size_limit(MOST_OF_A_FIELD)
    row = next(csv.reader([text.replace("\n", " ")], delimiter=delimiter), [])
    return [cell.strip() for cell in row]
