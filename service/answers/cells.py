"""Cells of CSV files that people open in spreadsheets: text that a spreadsheet would run is written so that it does not.

A spreadsheet takes a cell that begins with one of a few characters for a formula, and a formula can send what stands in
other cells to somebody. An apostrophe in front makes it text (OWASP, CSV injection). Numbers stay numbers.
"""

import re
from typing import Any

_FORMULA = re.compile(r"'*[=+\-@\t\r\n\uff1d\uff0b\uff0d\uff20]")
"""Also after apostrophes of its own, so that ``read`` knows which one is ours; full-width forms are taken for them."""


def written(value: Any) -> Any:
    """A cell's value as it is safely written; only text changes."""
    return f"'{value}" if isinstance(value, str) and _FORMULA.match(value) else value


def read(text: str) -> str:
    """The text that ``written`` has made a cell of."""
    return text[1:] if text.startswith("'") and _FORMULA.match(text[1:]) else text
