"""What a comparison with published evidence is: rows of value beside reference, tables, and curves that show it."""

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

Class = Literal["independent", "fitted", "plausible"]
CLASSES: tuple[Class, ...] = ("independent", "fitted", "plausible")
"""What a row weighs: a printed value that nothing was fitted to; a value that a parameter was chosen for, or that follows
from one; a sign, an order of events, a baseline of our own."""
INDEPENDENT, FITTED, PLAUSIBLE = CLASSES


@dataclass(frozen=True, slots=True)
class Row:
    """One quantity beside what is published for it.

    Attributes
    ----------
    evidence
        Table, figure or section of the thesis, or annex, in words.
    quantity, unit
        What is compared.
    reference
        The published value; of a specification its limit, NaN where there is only a value to state.
    value
        What the twin gives.
    tolerance
        Largest difference that counts as met [unit]; of a limit 0; NaN for a row that only states.
    evidence_class
        One of ``CLASSES``. A row that only states says nothing of weight and is ``plausible``.
    limit
        -1: the value must not exceed the reference; +1: must not fall below it; 0: must lie within the tolerance.
    note
        What has to be known to read the row.
    known_miss
        True where the row is known not to be met and ``note`` says why: it counts as not met, but is no news.
    """

    evidence: str
    quantity: str
    unit: str
    reference: float
    value: float
    tolerance: float
    evidence_class: Class = PLAUSIBLE
    limit: int = 0
    note: str = ""
    known_miss: bool = False

    @property
    def fitted(self) -> bool:
        """True where a parameter was chosen to meet this row: it validates nothing."""
        return self.evidence_class == FITTED

    @property
    def within(self) -> bool | None:
        """True when met, False when not, None for a row that only states."""
        if math.isnan(self.tolerance):
            return None
        if self.limit < 0:
            return self.value <= self.reference + self.tolerance
        if self.limit > 0:
            return self.value >= self.reference - self.tolerance
        return abs(self.value - self.reference) <= self.tolerance


@dataclass(frozen=True, slots=True)
class Curve:
    """One line of a plot, x and y of shape (m,)."""

    label: str
    x: Vector
    y: Vector


@dataclass(frozen=True, slots=True)
class Plot:
    """Curves over one axis, with the sentence that says what to see in them."""

    title: str
    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    caption: str = ""


@dataclass(frozen=True, slots=True)
class Table:
    """Published numbers and ours side by side, cells as text; the first column heads each row."""

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""


@dataclass(frozen=True, slots=True)
class Evidence:
    """All rows, plots and tables of one rig, with what was assumed and what is not explained."""

    title: str
    rows: tuple[Row, ...]
    plots: tuple[Plot, ...] = ()
    remarks: tuple[str, ...] = field(default_factory=tuple)
    tables: tuple[Table, ...] = ()
