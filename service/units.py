"""Units that a reader chooses: bar, L/min and degC, or psi, US gpm and degF. What is stored and what the API says stays in bar."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Context, Decimal
from fractions import Fraction
from functools import cache
from types import MappingProxyType

import pint

from detectors.drawing.svg import Scale

_BY_SUFFIX: Mapping[str, str] = {"bar": "bar", "lpm": "L/min", "degc": "degC", "k": "K"}
"""Units of ours that can be written in another, by the end of a name that says them."""
_REGISTERED: Mapping[str, str] = {"bar": "bar", "L/min": "liter / minute", "degC": "degC", "K": "kelvin"}
"""What the registry of units calls ours."""
_OWN_WORDS: Mapping[str, str] = {"degC": "°C"}
_LONGEST_NUMBER = 60
_MOST_DIGITS = 40
_WRITTEN_OUT = 15
"""Powers of ten up to which a number is written without an exponent."""


@dataclass(frozen=True, slots=True)
class UnitSystem:
    """How quantities are written for somebody; ``foreign`` holds, by our unit, the word and the registry's name of another.

    Our units are ``bar``, ``L/min``, ``degC`` and ``K`` (a difference of temperature), also as the ends of names: ``lpm``,
    ``degc``, ``k``. Every other unit is written as it is.
    """

    name: str
    label: str
    foreign: Mapping[str, tuple[str, str]] = field(default_factory=lambda: MappingProxyType({}))

    def __hash__(self) -> int:
        return hash(self.name)

    def converts(self, unit: str) -> bool:
        """Whether quantities in this unit of ours are written in another."""
        return _ours(unit) in self.foreign

    def word(self, unit: str) -> str:
        """What stands behind a number that is in ``unit`` of ours; a power or a ratio of it, ``bar^2/Hz``, keeps its shape."""
        head, mark, tail = unit.partition("^")
        ours = _ours(head)
        word = self.foreign[ours][0] if ours in self.foreign else _OWN_WORDS.get(ours, ours)
        return f"{word}{mark}{tail}"

    def value(self, value: float, unit: str) -> float:
        """A quantity in the reader's unit."""
        slope, intercept = self._line(unit)
        return (value - intercept) / slope

    def figure(self, value: float | None, unit: str, digits: int) -> str:
        """A quantity as a number of about ``digits`` decimals of ours: as fine in the reader's unit; a dash for None."""
        if value is None:
            return "–"
        shown = self.value(value, unit)
        places = digits
        if self.converts(unit):
            places = max(digits + round(math.log10(self._line(unit)[0])), 0)
        # "+ 0.0" turns a rounded minus zero into zero
        return f"{round(shown, places) + 0.0:.{places}f}"

    def size(self, value: float | None, unit: str, digits: int) -> str:
        """An amplitude or an error as ``figure`` has it: a size of temperature has no zero of its own."""
        return self.figure(value, "K" if _ours(unit) == "degC" else unit, digits)

    def plain(self, value: float, unit: str) -> str:
        """A quantity as a number of as few digits as it needs, four at most where it is converted."""
        shown = self.value(value, unit)
        if not self.converts(unit):
            return f"{value:g}"
        return f"{shown:.4g}" if abs(shown) < 1000.0 else f"{shown:.0f}"

    def said(self, value: float, unit: str, digits: int | None = None) -> str:
        """A quantity with its unit, ``1.60 L/min``; without ``digits`` as ``plain`` has it."""
        number = self.plain(value, unit) if digits is None else self.figure(value, unit, digits)
        return number if unit == "-" else f"{number} {self.word(unit)}"

    def text(self, value: float, unit: str) -> str:
        """The shortest text of a form's field that ``stored`` makes exactly ``value`` of.

        Up to 12 decimals are tried first, then as many digits as it needs; what lies nearer to 0 degC than 1e-9 K, and is not
        it, may need more than anybody can read, and comes as near as numbers of the machine do.
        """
        if not self.converts(unit) or not math.isfinite(value):
            return repr(value).removesuffix(".0")
        slope, intercept = self._exact(unit)
        exact = (Fraction(value) - intercept) / slope
        parts = Decimal(exact.numerator), Decimal(exact.denominator)
        whole = Context(prec=_MOST_DIGITS).divide(*parts)
        if whole.adjusted() < _WRITTEN_OUT:
            for places in range(_WRITTEN_OUT - 3):
                found = f"{whole:.{places}f}"
                if self.stored(found, unit) == value:
                    return found.removeprefix("-") if float(found) == 0.0 else found
        for digits in range(1, _MOST_DIGITS):
            rounded = Context(prec=digits).divide(*parts)
            found = f"{rounded:f}" if abs(rounded.adjusted()) < _WRITTEN_OUT else f"{rounded}"
            if self.stored(found, unit) == value:
                return found
        return repr(self.value(value, unit))

    def stored(self, text: str, unit: str) -> float:
        """What the text of a form's field means in our unit, rounded once.

        Raises
        ------
        ValueError
            when the text is no number.
        """
        found = float(text)
        if not self.converts(unit) or not math.isfinite(found):
            return found
        slope, intercept = self._exact(unit)
        # zero by an exponent of a million digits, or a text of that length, is no number that anybody types
        is_short = found != 0.0 and len(text) <= _LONGEST_NUMBER
        typed = Fraction(Decimal(text)) if is_short else Fraction(found)
        try:
            return float(typed * slope + intercept)
        except OverflowError:
            return math.copysign(math.inf, found)

    def scale(self, unit: str) -> Scale:
        """How a picture that is drawn in our unit writes its numbers."""
        slope, intercept = self._line(unit)
        return Scale(self.word(unit), 1.0 / slope, -intercept / slope)

    def scales(self) -> dict[str, Scale]:
        """Scales of pressures, flows and temperatures by our unit."""
        return {unit: self.scale(unit) for unit in ("bar", "L/min", "degC")}

    def _line(self, unit: str) -> tuple[float, float]:
        """``ours = slope * shown + intercept``."""
        return _rounded(*self._exact(unit)) if self.converts(unit) else (1.0, 0.0)

    def _exact(self, unit: str) -> tuple[Fraction, Fraction]:
        ours = _ours(unit)
        return _exact_line(self.foreign[ours][1], _REGISTERED[ours])


METRIC = UnitSystem("metric", "bar, L/min, °C")
US = UnitSystem(
    "us",
    "psi, gpm (US gallons), °F",
    MappingProxyType(
        {
            "bar": ("psi", "psi"),
            "L/min": ("gpm", "gallon / minute"),
            "degC": ("°F", "degF"),
            "K": ("°F", "delta_degF"),
        }
    ),
)
SYSTEMS: Mapping[str, UnitSystem] = {system.name: system for system in (METRIC, US)}
"""What can be chosen, the usual one first."""


def unit_of(name: str) -> str:
    """Our unit by the end of a name, ``case_pressure_bar``; ``-`` where it says none that is ever converted."""
    return _BY_SUFFIX.get(name.rsplit("_", 1)[-1], "-")


def _ours(unit: str) -> str:
    return _BY_SUFFIX.get(unit, unit)


@cache
def _rounded(slope: Fraction, intercept: Fraction) -> tuple[float, float]:
    return float(slope), float(intercept)


@cache
def _exact_line(foreign: str, ours: str) -> tuple[Fraction, Fraction]:
    """Slope and intercept from one unit to another without any rounding: 140 degF is 60 degC and nothing beside it."""
    registry = pint.UnitRegistry(non_int_type=Fraction, autoconvert_offset_to_baseunit=False, cache_folder=None)
    units = registry.Unit(foreign), registry.Unit(ours)
    zero, one = (Fraction(registry.Quantity(Fraction(x), units[0]).to(units[1]).magnitude) for x in (0, 1))
    return one - zero, zero
