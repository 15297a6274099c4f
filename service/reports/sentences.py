"""Sentences that are stored with a verdict or a record, said in the reader's units; what is stored keeps its words.

A sentence is ours, names in it are not: a number is converted only where it stands in a turn of phrase of the judge, behind
one of the words below and before the unit. A reading without such a word stays as it was written.
"""

import re
from decimal import Decimal
from functools import partial

from service.units import UnitSystem

_NUMBER = r"[+-]?\d+(?:\.\d+)?(?:e[+-]?\d+)?"
_BEFORE = {
    "bar": r"a sensor of|by|full scale of|limit|makes|reaches|reads|reference|stands",
    "L/min": r"about|above|by|estimate,|estimated at|level,|limit of|limit,|worn by|zero,",
    "degC": r"flow,|span",
    "K": r"drifts|limit|within",
}
"""By unit the words that a number of ours stands behind; a temperature is a level in degC and a difference in K."""
_IN_BRACKETS = ("bar", "K")
"""Units of numbers that may follow an opening bracket."""
_PLAIN = ("limit", "limit of", "limit,", "full scale of", "a sensor of")
"""Words before numbers that are exact: they are not rounded to the digits that they had."""
_INTERVAL = rf" \((?P<low>{_NUMBER}) to (?P<high>{_NUMBER})(?:, limit (?P<limit>{_NUMBER}))?\)"
"""What may follow a flow: an interval, and a limit, in the same unit."""


def _turn(unit: str) -> re.Pattern[str]:
    opening = r"|(?P<bracket>(?<=\())" if unit in _IN_BRACKETS else ""
    interval = f"(?:{_INTERVAL})?" if unit == "L/min" else ""
    numbers = rf"(?P<first>{_NUMBER})(?:(?P<between> to | and )(?P<second>{_NUMBER}))?"
    return re.compile(
        rf"(?:(?<!\w)(?P<word>{_BEFORE[unit]}) {opening}){numbers} {re.escape(unit)}(?![\w/^·*]){interval}"
    )


_TURNS = {unit: _turn(unit) for unit in _BEFORE}


def in_units(text: str, system: UnitSystem) -> str:
    """A sentence of a verdict or a record with its numbers in the reader's units; as it is where these are ours."""
    if not system.foreign:
        return text
    for unit, turn in _TURNS.items():
        text = turn.sub(partial(_said, unit=unit, system=system), text)
    return text


def _said(found: re.Match[str], unit: str, system: UnitSystem) -> str:
    parts, word = found.groupdict(), found["word"] or ""
    exact = word in _PLAIN
    said = f"{word} " if word else ""
    said += _number(found["first"], unit, system, exact)
    if found["second"] is not None:
        said += found["between"] + _number(found["second"], unit, system, exact)
    said += f" {system.word(unit)}"
    if parts.get("low") is not None:
        low, high = (_number(parts[end], unit, system, False) for end in ("low", "high"))
        limit = "" if parts["limit"] is None else f", limit {_number(parts['limit'], unit, system, True)}"
        said += f" ({low} to {high}{limit})"
    return said


def _number(text: str, unit: str, system: UnitSystem, exact: bool) -> str:
    """A number as fine as it was written, with its sign where one stood before it."""
    value, exponent = float(text), Decimal(text).as_tuple().exponent
    digits = max(-exponent, 0) if isinstance(exponent, int) else 0
    shown = system.plain(value, unit) if exact else system.figure(value, unit, digits)
    return f"+{shown}" if text.startswith("+") and not shown.startswith("-") else shown
