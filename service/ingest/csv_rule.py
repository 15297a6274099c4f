"""How an operator's CSV is written, as a part of a channel mapping."""

import codecs
from typing import Annotated, Literal

from pydantic import ConfigDict, Field, field_validator, model_validator

from service.bodies import Body
from service.ingest.raw import TextDialect

_MOST_NAMES = 2000
_FURTHEST_LINE = 10_000
Line = Annotated[int, Field(ge=1, le=_FURTHEST_LINE)]
Word = Annotated[str, Field(min_length=1, max_length=40)]


class CsvRule(Body):
    """How the operator's CSV is written; lines are counted from 1, as an editor shows them."""

    model_config = ConfigDict(frozen=True)
    delimiter: Literal[",", ";", "\t", "|", " "] = Field(
        default=",", description="Between fields; a blank: runs of blanks"
    )
    decimal: Literal[".", ","] = "."
    encoding: str = Field(default="utf-8", max_length=40)
    thousands: Literal["", ",", ".", " ", "'"] = Field(default="", description="Between groups of three digits")
    header_row: Line | None = Field(default=None, description="Line of the names; none: the first that is no comment")
    header_rows: int = Field(default=1, ge=1, le=5, description="Lines of the header, joined column by column")
    no_header: bool = Field(default=False, description="There are no names: columns are 1, 2, … or `names`")
    names: tuple[str, ...] = Field(default=(), max_length=_MOST_NAMES, description="Names instead of the header's")
    units_row: Line | None = Field(default=None, description="Line whose cells are the columns' units")
    skip_rows: tuple[Line, ...] = Field(default=(), max_length=1000, description="Lines that say nothing")
    comment: str = Field(default="#", max_length=5, description="What a comment begins with; empty: nothing does")
    footer_rows: int = Field(default=0, ge=0, le=1000, description="Lines at the end that are no samples")
    missing: tuple[Word, ...] = Field(default=(), max_length=50, description="Words for a missing sample, as in -9999")

    @model_validator(mode="after")
    def _tells_apart(self) -> "CsvRule":
        if self.delimiter == self.decimal:
            raise ValueError("fields and decimals cannot both be separated by a comma")
        if self.thousands and self.thousands in (self.delimiter, self.decimal):
            raise ValueError("the mark of thousands is that of fields or decimals as well")
        if self.no_header and self.header_row is not None:
            raise ValueError("there is either no header or a line of it")
        if self.units_row is not None and self.units_row == self.header_row:
            raise ValueError("names and units stand in different lines")
        twice = sorted({n for n in self.names if n and self.names.count(n) > 1})
        if twice:
            raise ValueError(f"the names hold {', '.join(twice)} twice")
        return self

    @field_validator("encoding")
    @classmethod
    def _is_a_text_encoding(cls, value: str) -> str:
        try:
            info = codecs.lookup(value)
            b"".decode(value)
        except LookupError:
            raise ValueError(f"there is no text encoding {value!r}: try utf-8, cp1252 or utf-16") from None
        return info.name

    @property
    def dialect(self) -> TextDialect:
        """The same for the reader."""
        return TextDialect(**{name: getattr(self, name) for name in TextDialect.__slots__})
