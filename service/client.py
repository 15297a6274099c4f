"""A small client of the HTTP API: typed, with retries that cannot store anything twice."""

import time
from collections.abc import Iterator, Mapping
from types import TracebackType
from typing import Any, Self
from urllib.parse import quote

import httpx2

API_PREFIX = "/api/v1"
_RETRIED = frozenset({429, 502, 503, 504})


class RefusedError(Exception):
    """The service refused a request; ``problem`` is its problem document."""

    def __init__(self, problem: Mapping[str, Any]) -> None:
        lines = [str(problem.get("detail", "refused"))]
        lines += [f"  {e['where']}: {e['problem']}" for e in problem.get("errors", [])]
        super().__init__("\n".join(lines))
        self.problem = dict(problem)


class Client:
    """Synchronous client.

    Parameters
    ----------
    base_url
        Where the service listens, without the API prefix.
    key
        API key; None where authentication is off.
    retries
        How often a request is repeated that found no connection or was told to come back. An upload may be
        repeated safely: the same bytes with the same metadata are the same record.
    """

    def __init__(self, base_url: str, key: str | None = None, *, retries: int = 4, timeout_s: float = 120.0) -> None:
        headers = {"Authorization": f"Bearer {key}"} if key else {}
        self._http = httpx2.Client(base_url=base_url, headers=headers, timeout=timeout_s)
        self._retries = retries

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def upload(
        self,
        content: bytes,
        content_type: str = "text/csv",
        *,
        wait: bool = True,
        metadata: Mapping[str, str] | None = None,
    ) -> dict[str, Any]:
        """Upload one record and return the service's answer.

        Raises
        ------
        RefusedError
            with every fault that the service found.
        httpx2.HTTPError
            when the service cannot be reached.
        """
        params = {**(metadata or {}), **({} if wait else {"wait": "false"})}
        headers = {"Content-Type": content_type}
        return self._json("POST", "/records", content=content, params=params, headers=headers)

    def pumps(self) -> Iterator[dict[str, Any]]:
        """All pumps that the key may see."""
        cursor: str | None = None
        while True:
            page = self._json("GET", "/pumps", params={"cursor": cursor} if cursor else {})
            yield from page["items"]
            cursor = page["next"]
            if cursor is None:
                return

    def verdict(self, serial: str, operator: str | None = None) -> dict[str, Any]:
        """Verdict of one pump now; ``operator`` tells apart pumps of the same serial number."""
        return self._json(
            "GET", f"/pumps/{quote(serial, '')}/verdict", params={"operator": operator} if operator else {}
        )

    def is_ready(self) -> bool:
        """Whether the service can do its work."""
        try:
            return self._http.get("/readyz").status_code == httpx2.codes.OK
        except httpx2.TransportError:
            return False

    def _json(self, method: str, path: str, **request: Any) -> dict[str, Any]:
        for attempt in range(self._retries + 1):
            last = attempt == self._retries
            try:
                response = self._http.request(method, API_PREFIX + path, **request)
            except httpx2.TransportError:
                if last:
                    raise
                time.sleep(0.2 * 2**attempt)
                continue
            if response.status_code in _RETRIED and not last:
                wait = response.headers.get("retry-after", "")
                time.sleep(float(wait) if wait.isdigit() else 0.2 * 2**attempt)
                continue
            break
        if response.is_error:
            try:
                problem = response.json()
            except ValueError:
                problem = {"detail": f"HTTP {response.status_code}"}
            raise RefusedError(problem)
        document: dict[str, Any] = response.json()
        return document
