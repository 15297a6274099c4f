"""Metadata out of a file's name by a pattern: ``{aircraft}_{started_at:%Y%m%d-%H%M}_{pump_serial}.csv``."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from functools import cache
from pathlib import PureWindowsPath

from service.errors import Fault, Invalid
from service.ingest.zones import zone_of

_FIELD = re.compile(r"\{([a-z_]+|\*)(?::([^{}]+))?\}")
_SUFFIX = re.compile(r"(?<=.)(\.[A-Za-z][A-Za-z0-9]{0,7})?(\.gz)?$")
_LONGEST = 255
_MOST_FIELDS = 12


@dataclass(frozen=True, slots=True)
class _Piece:
    """Fixed text where ``name`` is None, else a field; ``*`` is anything that means nothing, also nothing at all."""

    text: str
    name: str | None = None
    wanted: str = ""


class NamePattern:
    """A pattern of file names.

    Parameters
    ----------
    text
        Fields in braces are metadata, or ``{*}`` for anything; ``{name:8}`` is eight characters long and
        ``{started_at:%Y%m%d}`` an instant as strptime reads it. A field reaches as short as what follows allows. The
        suffix may be left out; case does not matter.
    zone
        Zone of instants without one.

    Raises
    ------
    ValueError
        when it is no pattern.
    """

    def __init__(self, text: str, zone: str | None = None) -> None:
        self.text = text
        self._zone = zone
        pieces: list[_Piece] = []
        end = 0
        for found in _FIELD.finditer(text):
            if found.start() > end:
                pieces.append(_Piece(text[end : found.start()]))
            pieces.append(_Piece("", found.group(1), found.group(2) or ""))
            end = found.end()
        if end < len(text):
            pieces.append(_Piece(text[end:]))
        self._pieces = tuple(pieces)
        fields = [piece.name for piece in pieces if piece.name is not None]
        self.fields = tuple(dict.fromkeys(name for name in fields if name != "*"))
        if any(c in piece.text for piece in pieces for c in "{}"):
            raise ValueError(f"{text!r}: a field is a name of metadata in braces, as in {{pump_serial}}_{{flight_id}}")
        if not self.fields or len(fields) > _MOST_FIELDS or len(fields) - fields.count("*") != len(self.fields):
            raise ValueError(f"{text!r} holds no field, one of them twice, or more than {_MOST_FIELDS}")
        for piece in pieces:
            if piece.wanted and not piece.wanted.isdigit() and not (piece.name == "started_at" and "%" in piece.wanted):
                raise ValueError(f"{piece.name}:{piece.wanted} is neither a number of characters nor an instant")

    def read(self, file_name: str) -> dict[str, str] | None:
        """Metadata in a name; None where it does not match."""
        name = PureWindowsPath(file_name).name[:_LONGEST]  # its separators are / and \
        stem = _SUFFIX.sub("", name)
        return next((found for text in (stem, name) if (found := self._matched(text)) is not None), None)

    def _matched(self, name: str) -> dict[str, str] | None:
        pieces = self._pieces

        @cache  # a place is tried once from each piece: the cost is bounded, whatever the pattern
        def rest(k: int, start: int) -> tuple[str, ...] | None:
            if k == len(pieces):
                return () if start == len(name) else None
            piece = pieces[k]
            if piece.name is None:
                end = start + len(piece.text)
                return rest(k + 1, end) if name[start:end].casefold() == piece.text.casefold() else None
            ends = range(start if piece.name == "*" else start + 1, len(name) + 1)
            if piece.wanted.isdigit():
                ends = range(start + int(piece.wanted), min(start + int(piece.wanted), len(name)) + 1)
            return next(
                (
                    (value, *after)
                    for end in ends
                    if (value := self._value(piece, name[start:end])) is not None
                    and (after := rest(k + 1, end)) is not None
                ),
                None,
            )

        values = rest(0, 0)
        if values is None:
            return None
        named = [piece.name for piece in pieces if piece.name is not None]
        return {key: value.strip() for key, value in zip(named, values, strict=True) if key != "*"}

    def _value(self, piece: _Piece, text: str) -> str | None:
        """What a part of the name says for a field; None where it cannot stand there."""
        if "%" not in piece.wanted:
            return text if piece.name == "*" or text.strip() else None
        try:
            instant = datetime.strptime(text, piece.wanted)  # noqa: DTZ007 - its zone follows
        except ValueError:
            return None
        if instant.tzinfo is None and self._zone is not None:
            instant = instant.replace(tzinfo=zone_of(self._zone))
        return instant.isoformat().replace("+00:00", "Z")


def named_by(
    pattern: NamePattern | None, file_name: str | None, given: Mapping[str, str], where: str = "file_name"
) -> dict[str, str]:
    """Metadata of a request together with those in the file's name; what the request says wins.

    Raises
    ------
    Invalid
        when the name is missing or does not match, and the request does not say all that it would.
    """
    if pattern is None:
        return dict(given)
    found = pattern.read(file_name) if file_name else None
    if found is None and not set(pattern.fields) <= set(given):
        what = f"{file_name!r} does not match" if file_name else "is missing: the metadata are read from it by"
        fault = Fault(where, f"{what} the pattern {pattern.text}")
        raise Invalid("the file's name does not say what the mapping reads from it; nothing was stored", [fault])
    return {**(found or {}), **given}
