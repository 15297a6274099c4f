"""Clients of the HTTP API, synchronous and asynchronous: typed, with retries that cannot store anything twice."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from types import TracebackType
from typing import Any, Self
from urllib.parse import quote

import httpx2

from service.client_requests import API_PREFIX, RefusedError, Retries, document_of, upload_request

__all__ = ["API_PREFIX", "AsyncClient", "Client", "RefusedError"]
Progress = Callable[[int, int | None], None]
"""Called with the items done and their total, which is None until it is known."""
_POLLING_S = 0.5
_ENDED = frozenset({"succeeded", "failed", "cancelled"})


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
        mapping: str | None = None,
    ) -> dict[str, Any]:
        """Upload one record and return the service's answer.

        Raises
        ------
        RefusedError
            with every fault that the service found.
        httpx2.HTTPError
            when the service cannot be reached.
        """
        return self.request("POST", "/records", **upload_request(content, content_type, wait, metadata, mapping))

    def upload_many(
        self, content: bytes, content_type: str = "application/zip", *, mapping: str | None = None
    ) -> dict[str, Any]:
        """Upload a ZIP file or NDJSON of many records: the job that imports them."""
        return self.request("POST", "/records/bulk", **upload_request(content, content_type, True, None, mapping))

    def start_job(self, kind: str, parameters: Mapping[str, Any], operator: str | None = None) -> dict[str, Any]:
        """Ask for a job."""
        wanted = {"kind": kind, "parameters": dict(parameters), **({"operator": operator} if operator else {})}
        return self.request("POST", "/jobs", json=wanted)

    def job(self, job_id: str) -> dict[str, Any]:
        """A job with its first items."""
        return self.request("GET", f"/jobs/{quote(job_id, '')}")

    def finished_job(self, job_id: str, progress: Progress | None = None) -> dict[str, Any]:
        """Wait until a job has ended."""
        while True:
            job = self.job(job_id)
            if progress is not None:
                progress(job["progress"]["done"], job["progress"]["total"])
            if job["status"] in _ENDED:
                return job
            time.sleep(_POLLING_S)

    def job_items(self, job_id: str) -> Iterator[dict[str, Any]]:
        """Every item of a job in order."""
        return self.pages(f"/jobs/{quote(job_id, '')}/items")

    def pumps(self) -> Iterator[dict[str, Any]]:
        """All pumps that the key may see."""
        return self.pages("/pumps")

    def records(self, **filters: str) -> Iterator[dict[str, Any]]:
        """Records, the newest first; filters are those of ``GET /records``."""
        return self.pages("/records", **filters)

    def verdict(self, serial: str, operator: str | None = None) -> dict[str, Any]:
        """Verdict of one pump now; ``operator`` tells apart pumps of the same serial number."""
        params = {"operator": operator} if operator else {}
        return self.request("GET", f"/pumps/{quote(serial, '')}/verdict", params=params)

    def is_ready(self) -> bool:
        """Whether the service can do its work."""
        try:
            return self._http.get("/readyz").status_code == httpx2.codes.OK
        except httpx2.TransportError:
            return False

    def pages(self, path: str, **params: str) -> Iterator[dict[str, Any]]:
        """Items of a paged list, page after page."""
        cursor: str | None = None
        while True:
            page = self.request("GET", path, params={**params, **({"cursor": cursor} if cursor else {})})
            yield from page["items"]
            cursor = page["next"]
            if cursor is None:
                return

    def request(self, method: str, path: str, **request: Any) -> dict[str, Any]:
        """Any call of the API, repeated where that is safe and useful.

        Raises
        ------
        RefusedError
            with the service's problem document.
        httpx2.HTTPError
            when the service cannot be reached.
        """
        retries = Retries(self._retries)
        while True:
            try:
                response = self._http.request(method, API_PREFIX + path, **request)
            except httpx2.TransportError:
                wait = retries.wait_after_loss()
                if wait is None:
                    raise
            else:
                wait = retries.wait_after(response)
                if wait is None:
                    return document_of(response)
            time.sleep(wait)


class AsyncClient:
    """Asynchronous client; parameters and errors are those of ``Client``."""

    def __init__(self, base_url: str, key: str | None = None, *, retries: int = 4, timeout_s: float = 120.0) -> None:
        headers = {"Authorization": f"Bearer {key}"} if key else {}
        self._http = httpx2.AsyncClient(base_url=base_url, headers=headers, timeout=timeout_s)
        self._retries = retries

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Close the connections."""
        await self._http.aclose()

    async def upload(
        self,
        content: bytes,
        content_type: str = "text/csv",
        *,
        wait: bool = True,
        metadata: Mapping[str, str] | None = None,
        mapping: str | None = None,
    ) -> dict[str, Any]:
        """Upload one record and return the service's answer."""
        return await self.request("POST", "/records", **upload_request(content, content_type, wait, metadata, mapping))

    async def start_job(self, kind: str, parameters: Mapping[str, Any], operator: str | None = None) -> dict[str, Any]:
        """Ask for a job."""
        wanted = {"kind": kind, "parameters": dict(parameters), **({"operator": operator} if operator else {})}
        return await self.request("POST", "/jobs", json=wanted)

    async def finished_job(self, job_id: str, progress: Progress | None = None) -> dict[str, Any]:
        """Wait until a job has ended."""
        while True:
            job = await self.request("GET", f"/jobs/{quote(job_id, '')}")
            if progress is not None:
                progress(job["progress"]["done"], job["progress"]["total"])
            if job["status"] in _ENDED:
                return job
            await asyncio.sleep(_POLLING_S)

    async def pages(self, path: str, **params: str) -> AsyncIterator[dict[str, Any]]:
        """Items of a paged list, page after page."""
        cursor: str | None = None
        while True:
            page = await self.request("GET", path, params={**params, **({"cursor": cursor} if cursor else {})})
            for item in page["items"]:
                yield item
            cursor = page["next"]
            if cursor is None:
                return

    async def request(self, method: str, path: str, **request: Any) -> dict[str, Any]:
        """Any call of the API, repeated where that is safe and useful."""
        retries = Retries(self._retries)
        while True:
            try:
                response = await self._http.request(method, API_PREFIX + path, **request)
            except httpx2.TransportError:
                wait = retries.wait_after_loss()
                if wait is None:
                    raise
            else:
                wait = retries.wait_after(response)
                if wait is None:
                    return document_of(response)
            await asyncio.sleep(wait)
