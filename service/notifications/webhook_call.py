"""One call of one webhook: signed, to the address that was checked, without redirects, within a few seconds."""

import asyncio
import json
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import httpx2

from service import __version__
from service.notifications.guard import Blocked, Target, target_of
from service.notifications.signature import signed_headers

DEADLINE_S = 20.0
"""For one call as a whole: a receiver that sends its answer byte by byte must not hold the others up."""
_TIMEOUT = httpx2.Timeout(10.0, connect=5.0)
_GONE = 410


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a delivery went; ``gone`` when the receiver wants no more of them."""

    delivered: bool
    words: str
    gone: bool = False


def call(url: str, secret: str, message_id: str, payload: Mapping[str, Any], allowed_hosts: frozenset[str]) -> Outcome:
    """Send one message; what goes wrong is said in the outcome and never raised."""
    try:
        target = target_of(url, allowed_hosts)
    except Blocked as error:
        return Outcome(False, f"not sent: {error}")
    body = json.dumps(payload, separators=(",", ":")).encode()
    headers = {
        "host": target.host if target.port in (80, 443) else f"{target.host}:{target.port}",
        "content-type": "application/json",
        "user-agent": f"casedrain/{__version__}",
        **signed_headers(secret, message_id, int(time.time()), body),
    }
    try:
        status = asyncio.run(_posted(target, body, headers))
    except TimeoutError:
        return Outcome(False, f"no answer within {DEADLINE_S:g} s")
    except httpx2.HTTPError as error:
        return Outcome(False, f"no answer: {type(error).__name__}")
    if 200 <= status < 300:
        return Outcome(True, f"HTTP {status}")
    return Outcome(False, f"HTTP {status}", gone=status == _GONE)


async def _posted(target: Target, body: bytes, headers: Mapping[str, str]) -> int:
    """Status of the answer; asynchronous because only so a deadline holds for the call as a whole."""
    address = f"[{target.address}]" if ":" in target.address else target.address
    where = f"{target.scheme}://{address}:{target.port}{target.path}"
    # no proxy from the environment: it would resolve the name again; the certificate is checked for the name
    async with (
        asyncio.timeout(DEADLINE_S),
        httpx2.AsyncClient(timeout=_TIMEOUT, follow_redirects=False, trust_env=False) as client,
        client.stream(
            "POST", where, content=body, headers=dict(headers), extensions={"sni_hostname": target.host}
        ) as answer,
    ):
        return answer.status_code
