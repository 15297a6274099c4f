"""Errors that carry their HTTP answer: every one becomes ``application/problem+json`` (RFC 9457)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any, cast

from service.answers import problems as answers

PROBLEM_JSON = "application/problem+json"


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing wrong with an input, and where it stands."""

    where: str
    problem: str


class Problem(Exception):
    """An error with its HTTP status; subclasses fix status and title.

    Parameters
    ----------
    detail
        One sentence that names what to do next.
    errors
        Every fault found in a bad input.
    headers, extra
        Response headers and further members of the body.
    """

    status = HTTPStatus.INTERNAL_SERVER_ERROR
    title = "Internal error"

    def __init__(
        self,
        detail: str,
        errors: Sequence[Fault] = (),
        *,
        headers: Mapping[str, str] | None = None,
        extra: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(detail)
        self.detail = detail
        self.errors = tuple(errors)
        self.headers = dict(headers or {})
        self.extra = dict(extra or {})

    def body(self) -> answers.Problem:
        """Members of the problem document."""
        slug = self.title.lower().replace(" ", "-")
        body: answers.Problem = {
            "type": f"urn:casedrain:problem:{slug}",
            "title": self.title,
            "status": int(self.status),
            "detail": self.detail,
        }
        if self.errors:
            body["errors"] = [{"where": f.where, "problem": f.problem} for f in self.errors]
        return cast("answers.Problem", {**body, **self.extra})


class Undecodable(Problem):
    """The bytes are not what they say they are."""

    status, title = HTTPStatus.BAD_REQUEST, "Undecodable input"


class Unauthenticated(Problem):
    """No key, or one that does not exist or has expired."""

    status, title = HTTPStatus.UNAUTHORIZED, "Not authenticated"


class Forbidden(Problem):
    """The key may not do this."""

    status, title = HTTPStatus.FORBIDDEN, "Not allowed"


class NotFound(Problem):
    """Nothing of that name is visible to this key."""

    status, title = HTTPStatus.NOT_FOUND, "Not found"


class Conflict(Problem):
    """It contradicts what is stored."""

    status, title = HTTPStatus.CONFLICT, "Conflict"


class StaleVersion(Problem):
    """``If-Match`` names a version that is no longer the latest."""

    status, title = HTTPStatus.PRECONDITION_FAILED, "Stale version"


class TooLarge(Problem):
    """More bytes, rows or inflation than the limits allow."""

    status, title = HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "Too large"


class UnknownType(Problem):
    """A content type that no adapter reads."""

    status, title = HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "Unknown content type"


class Invalid(Problem):
    """Decoded, but wrong."""

    status, title = HTTPStatus.UNPROCESSABLE_ENTITY, "Invalid input"


class PreconditionRequired(Problem):
    """A change that needs ``If-Match``."""

    status, title = HTTPStatus.PRECONDITION_REQUIRED, "Precondition required"


class TooSlow(Problem):
    """A body that does not arrive."""

    status, title = HTTPStatus.REQUEST_TIMEOUT, "Request timeout"


class Misdirected(Problem):
    """A host name that this service does not answer for."""

    status, title = HTTPStatus.MISDIRECTED_REQUEST, "Misdirected request"


class Unavailable(Problem):
    """A part that is needed does not answer."""

    status, title = HTTPStatus.SERVICE_UNAVAILABLE, "Unavailable"


class StorageFull(Problem):
    """No room is left on a disk."""

    status, title = HTTPStatus.INSUFFICIENT_STORAGE, "Insufficient storage"


def is_ours(problem: Problem) -> bool:
    """True for what says nothing about the input: the same one may be good a moment later."""
    return problem.status >= HTTPStatus.INTERNAL_SERVER_ERROR
