"""What stops a command before it has begun, in one sentence that names the setting to look at."""

from typing import Any

_PREFIX = "CASEDRAIN_"
WRONG_SETTING = 2
"""Exit code of a command that cannot work as it is set up or called."""


def words_of(error: Exception) -> str | None:
    """The sentence for an error of settings, database or disk; None for any other."""
    from pydantic import ValidationError  # noqa: PLC0415 - heavy, and only here
    from sqlalchemy.exc import SQLAlchemyError  # noqa: PLC0415

    if isinstance(error, ValidationError):
        return _of_settings(error) if error.title == "Settings" else None
    if isinstance(error, SQLAlchemyError):
        return _of_database(error)
    return None


def _of_settings(error: Any) -> str:
    faults = []
    for fault in error.errors():
        words = fault["msg"].removeprefix("Value error, ")
        if not fault["loc"]:  # of several together: the words name them, and the input would show their secrets
            faults.append(words)
            continue
        name = _PREFIX + str(fault["loc"][0]).upper()
        secret = name.endswith(("_URL", "_PASSWORD", "_SECRET", "_KEY"))
        shown = "" if secret else f", not {str(fault['input'])[:80]!r}"
        faults.append(f"{name}: {words[:1].lower()}{words[1:]}{shown}")
    return "; ".join(faults)


def _of_database(error: Any) -> str | None:
    from service.storage.failures import problem_of  # noqa: PLC0415 - heavy, and only here

    problem = problem_of(error)
    original = getattr(error, "orig", None)
    reason = str(original or error).strip().partition("\n")[0]
    if problem is None or not int(problem.status) >= 500:
        return None
    return f"the database of {_PREFIX}DATABASE_URL cannot be used: {reason}"
