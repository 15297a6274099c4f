"""What both clients share on the wire: uploads, answers, and when to try again."""

import random
from collections.abc import Mapping
from typing import Any, TypedDict, cast

import httpx2

from service.answers.problems import Problem

API_PREFIX = "/api/v1"
_RETRIED = frozenset({429, 502, 503, 504})
_FIRST_WAIT_S = 0.2
_LONGEST_WAIT_S = 30.0


class RefusedError(Exception):
    """The service refused a request; ``problem`` is its problem document."""

    def __init__(self, problem: Problem) -> None:
        lines = [str(problem.get("detail", "refused"))]
        lines += [f"  {e['where']}: {e['problem']}" for e in problem.get("errors", [])]
        super().__init__("\n".join(lines))
        self.problem = problem


class Retries:
    """Counts the attempts of one request; waits double, with chance in them, and follow ``Retry-After``."""

    def __init__(self, most: int) -> None:
        self._left = most
        self._next_s = _FIRST_WAIT_S
        self._told = False

    def wait_after_loss(self) -> float | None:
        """Seconds to wait after a lost connection; None: give up."""
        if self._left == 0:
            return None
        self._left -= 1
        wait, self._next_s = self._next_s, min(2.0 * self._next_s, _LONGEST_WAIT_S)
        return wait * random.uniform(0.75, 1.25)  # noqa: S311 - spreads clients over time, no secret

    def wait_after(self, response: httpx2.Response) -> float | None:
        """Seconds to wait after an answer that asks to come back; None: it stands."""
        if response.status_code not in _RETRIED:
            return None
        wait, asked = self.wait_after_loss(), response.headers.get("retry-after", "")
        told, self._told = self._told, True
        if wait is None or not (asked.isascii() and asked.isdigit()):
            return wait
        # whoever is told the same again waits longer: many who come back together would keep a service down
        return min(max(float(asked[:9]), wait if told else 0.0), _LONGEST_WAIT_S)


class UploadRequest(TypedDict):
    """Arguments of a POST."""

    content: bytes
    params: dict[str, str]
    headers: dict[str, str]


def upload_request(
    content: bytes,
    content_type: str,
    wait: bool,
    metadata: Mapping[str, str] | None,
    mapping: str | None,
    file_name: str | None = None,
) -> UploadRequest:
    """Arguments of the request that uploads."""
    params = dict(metadata or {})
    if not wait:
        params["wait"] = "false"
    if mapping is not None:
        params["mapping"] = mapping
    if file_name is not None:
        params["file_name"] = file_name
    return {"content": content, "params": params, "headers": {"Content-Type": content_type}}


def document_of(response: httpx2.Response) -> Any:
    """Body of a good answer.

    Raises
    ------
    RefusedError
        for any other.
    """
    if response.is_error:
        try:
            problem = cast("Problem", response.json())
        except ValueError:
            problem = cast("Problem", {"detail": f"HTTP {response.status_code}"})
        raise RefusedError(problem)
    return response.json() if response.content else {}
