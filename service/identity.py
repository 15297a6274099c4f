"""Which software this is: release, commit, and one hash over the sources of twin and detectors.

It names who made an answer and is no part of two answers being equal.
"""

import os
import re
import subprocess
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from service import __version__

if TYPE_CHECKING:  # the version is told at once
    from service.answers import verdicts as answers

COMMIT_VARIABLE = "CASEDRAIN_COMMIT"
"""Set when an image is built; a checkout asks git."""
_ROOT = Path(__file__).resolve().parent.parent
_GIT_TIMEOUT_S = 5.0
_STEP = 1000


class Software(NamedTuple):
    """Identity of the software; ``commit`` is None where neither a build nor a checkout tells."""

    release: str
    commit: str | None
    sources: str

    def to_json(self) -> "answers.Software":
        """As verdicts, ``/readyz`` and the command line say it."""
        return {"release": self.release, "commit": self.commit, "sources": self.sources}


@cache
def software() -> Software:
    """The software that this process runs."""
    from twin.sources import package_hash  # noqa: PLC0415 - the command line's version needs no hash

    return Software(__version__, commit(), package_hash("twin", "detectors"))


@cache
def commit() -> str | None:
    """Commit that this software was built from: of the image, or of the checkout that it runs from; else None."""
    built = os.environ.get(COMMIT_VARIABLE, "").strip()
    if built or not (_ROOT / ".git").exists():
        return built or None
    words = ("git", "-C", str(_ROOT), "rev-parse", "HEAD")
    try:
        asked = subprocess.run(words, capture_output=True, text=True, timeout=_GIT_TIMEOUT_S, check=True)  # noqa: S603
    except (OSError, subprocess.SubprocessError):
        return None
    return asked.stdout.strip() or None


def in_words() -> str:
    """Release and commit in one line."""
    made_from = commit()
    return f"casedrain {__version__}" + (f" (commit {made_from[:12]})" if made_from else "")


def sentence() -> str:
    """All three in one line, for printed reports."""
    _, made_from, sources = software()
    return f"casedrain {__version__}, commit {made_from or 'unknown'}, sources {sources}"


def release_number(release: str = __version__) -> int:
    """A release as a number that sorts: 1.12.3 is 1 012 003; what follows the third number does not count.

    Raises
    ------
    ValueError
        for a text that is no release of three numbers below 1000.
    """
    found = re.match(r"(\d{1,3})\.(\d{1,3})\.(\d{1,3})(?!\d)", release)
    if found is None:
        raise ValueError(f"{release!r} is no release: three numbers below 1000 with points between them")
    major, minor, patch = map(int, found.groups())
    return (major * _STEP + minor) * _STEP + patch


def release_of(number: int) -> str:
    """Inverse of ``release_number``."""
    return f"{number // _STEP**2}.{number // _STEP % _STEP}.{number % _STEP}"
