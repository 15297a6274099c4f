"""Words of a text table: what is a number, what stands for a missing sample, and what is neither."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from service.errors import Fault
from service.ingest.raw import MOST_FAULTS_OF_A_KIND, Samples, TextDialect, capped
from twin.recording import OPTIONAL_CHANNELS, REQUIRED_CHANNELS

KNOWN_CHANNELS = frozenset((*REQUIRED_CHANNELS, *OPTIONAL_CHANNELS))
MISSING = frozenset(
    ("", "nan", "-nan", "+nan", "null", "na", "n/a", "#n/a", "#na", "n.a.", "none", "nil", "-", "--", "---", "nan(ind)",
     "-nan(ind)", "1.#qnan", "-1.#qnan", "1.#snan", "1.#ind", "-1.#ind", "#value!", "#div/0!")
)  # fmt: skip
"""How exports write a missing sample, in lower case."""
_INFINITE = {"1.#inf": np.inf, "-1.#inf": -np.inf}
_MARKS_LIKE = {" ": "\u00a0\u2007\u2009\u202f", "'": "\u2019\u02bc"}
"""Marks that exports print in place of the plain one: blanks that do not break, an apostrophe that is a quote."""
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")


@dataclass(frozen=True)
class Words:
    """How one dialect writes numbers.

    Attributes
    ----------
    decimal, thousands
        Marks inside numbers.
    missing
        Words of a mapping for missing samples; those that are numbers are compared as numbers, however they are written.
    """

    decimal: str = "."
    thousands: str = ""
    missing: tuple[str, ...] = ()

    @classmethod
    def of(cls, dialect: TextDialect) -> "Words":
        """The words of a dialect."""
        return cls(dialect.decimal, dialect.thousands, dialect.missing)

    @cached_property
    def words_for_missing(self) -> frozenset[str]:
        """Words for missing samples in lower case."""
        return MISSING | {word.strip().lower() for word in self.missing}

    @cached_property
    def numbers_for_missing(self) -> tuple[float, ...]:
        """Numbers that stand for missing samples."""
        found = []
        for word in self.missing:
            try:
                found.append(self._plain_number(word.strip()))
            except ValueError:
                continue
        return tuple(found)

    def number(self, cell: str) -> float:
        """The number that a cell holds, NaN where it holds a word for a missing sample.

        Raises
        ------
        ValueError
            when it holds neither.
        """
        word = cell.strip()
        lower = word.lower()
        if lower in self.words_for_missing:
            return np.nan
        if lower in _INFINITE:
            return _INFINITE[lower]
        value = self._plain_number(word)
        return np.nan if value in self.numbers_for_missing else value

    def _plain_number(self, word: str) -> float:
        for mark in _MARKS_LIKE.get(self.thousands, ""):
            word = word.replace(mark, self.thousands)
        if self.thousands and self.thousands in word:
            if not self._grouped.fullmatch(word):
                raise ValueError(word)
            word = word.replace(self.thousands, "")
        if self.decimal != ".":
            if "." in word:
                raise ValueError(word)
            word = word.replace(self.decimal, ".")
        if "_" in word:  # float() also reads 1_000, which is no number in any file
            raise ValueError(word)
        return float(word)

    @cached_property
    def _grouped(self) -> re.Pattern[str]:
        mark, point = re.escape(self.thousands), re.escape(self.decimal)
        return re.compile(rf"[+-]?\d{{1,3}}({mark}\d{{3}})+({point}\d*)?([eE][+-]?\d+)?")

    def hint(self, cell: str) -> str:
        """What to do about a cell that looks like a number written otherwise."""
        word = cell.strip()
        if self.decimal == "." and _DECIMAL_COMMA.fullmatch(word):
            return ": write decimals with a point"
        if self.decimal != "." and "." in word and word.replace(".", "").replace(self.decimal, "").isdigit():
            return f": decimals are said to be written with {self.decimal!r}, and there is no mark for thousands"
        return ""

    def without_missing(self, samples: Samples) -> Samples:
        """Samples with NaN in place of the numbers that stand for missing ones; in place."""
        for number in self.numbers_for_missing:
            samples[samples == number] = np.nan
        return samples


def numbers_of(name: str, cells: Sequence[str | None], words: Words | None = None) -> tuple[Samples, list[Fault]]:
    """A text column as numbers, for who knows that it is a channel: shape (n,), and a fault for every other cell."""
    words = words or Words()
    samples = np.full(len(cells), np.nan)
    faults: list[Fault] = []
    n_bad = 0
    for i, cell in enumerate(cells):
        try:
            samples[i] = np.nan if cell is None else words.number(cell)
        except ValueError:
            n_bad += 1
            if n_bad <= MOST_FAULTS_OF_A_KIND and cell is not None:
                text = f"{cell.strip()[:40]!r} is not a number{words.hint(cell)}"
                faults.append(Fault(f"channels.{name}[{i}]", text))
    return samples, capped(faults, n_bad - MOST_FAULTS_OF_A_KIND, "samples that are not numbers", f"channels.{name}")
