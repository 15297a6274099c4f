"""Names of pumps, aircraft, positions and flights: what means nothing is taken off, what cannot be addressed is refused.

Two names that differ by case, kind of hyphen, blanks, leading zeros or letters of another script that look the same are
two names; that they look alike is pointed out.
"""

import re
import unicodedata

LONGEST_NAME = 200
_JOINERS = "\u200c\u200d"
"""Invisible, yet part of the spelling of some scripts: they stay."""
_MOST_READ = 10 * LONGEST_NAME
"""Characters of a text that are looked at: more than this stays too long however much is taken off."""
_BLANKS = re.compile(r"\s+")
_SEPARATORS = re.compile(r"[\s_\u2212\u00ad\u2010-\u2015\ufe58\ufe63\uff0d-]+")
_ZEROS = re.compile(r"(?<!\d)0+(?=\d)")
_LIKE_LATIN = str.maketrans(
    # Cyrillic and Greek letters after case folding, digits that look like letters
    "\u0430\u0432\u0435\u043a\u043c\u043d\u043e\u0440\u0441\u0442\u0443\u0445\u0456\u0458\u0455\u0501"
    "\u03b1\u03b2\u03b5\u03b6\u03b7\u03b9\u03ba\u03bc\u03bd\u03bf\u03c1\u03c4\u03c5\u03c7oil|",
    "abekmh0pctyx1jsd" + "abezh1kmn0ptyx" + "0111",
)


def clean_name(text: str) -> str:
    """A name in its one spelling: NFC, no invisible characters, one plain blank for any, none at the ends."""
    composed = unicodedata.normalize("NFC", text[:_MOST_READ])
    visible = "".join(c for c in composed if unicodedata.category(c) != "Cf" or c in _JOINERS)
    # line ends and tabs inside a name are a fault, not a blank
    return _BLANKS.sub(lambda found: found[0] if has_controls(found[0]) else " ", visible.strip())


def name_fault(name: str) -> str | None:
    """What is wrong with a clean name, None where nothing is."""
    if len(name) > LONGEST_NAME or has_controls(name):
        return f"is longer than {LONGEST_NAME} characters or holds control characters"
    if name in (".", ".."):
        return f"{name!r} means a folder in every address: no page and no call could reach it"
    if not name.strip(_JOINERS):
        return "holds nothing that can be seen"
    return None


def has_controls(text: str) -> bool:
    """Whether a text holds control characters, line ends, or halves of surrogate pairs, which no text can hold."""
    return any(unicodedata.category(c) in ("Cc", "Cs", "Zl", "Zp") for c in text)


def look_of(name: str) -> str:
    """What a name looks like to somebody in a hurry: equal for names that are easily taken for one another."""
    plain = unicodedata.normalize("NFKC", clean_name(name)).casefold()
    plain = "".join(c for c in plain if c not in _JOINERS)
    plain = _ZEROS.sub("", _SEPARATORS.sub("-", plain))
    return plain.translate(_LIKE_LATIN)
