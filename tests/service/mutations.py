"""Requests that are wrong in every place a request has: each route's good one with a few parts replaced, by a seed.

They are handed to the application as a server hands them over (ASGI), so that every byte can be wrong.
"""

import asyncio
import json
import math
import random
from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote, quote_from_bytes, unquote, urlsplit

from starlette.types import ASGIApp, Message

from service.errors import PROBLEM_JSON
from service.web.api_document.document import operations
from service.web.problems import _pattern
from tests.service.matrix import API, ENDING, MATRIX, filled

ALLOWED_OF_PAGES = {200, 303, 400, 401, 403, 404, 405, 408, 409, 413, 415, 421, 422, 429, 503, 507}
"""Pages are no part of the API's document."""
_COSTLY = ("/twin/isolability", "/twin/simulation", "/healthz", "/metrics", "/openapi.json")
"""One in twenty of them: seconds of processor, or nothing that reads an input."""
_TEXTS = (
    "",
    " ",
    "a\0b",
    "\ud800",
    "\udfff\ud800",
    "é",
    "油圧ポンプ",
    "\U0001f681",
    "\u202edab",
    "x" * 3000,
    "../../etc/passwd",
    "=1+1",
    "-1",
    "0x10",
    "1e999",
    "NaN",
    "null",
    "true",
    "%00",
    "a/b",
    "'; drop table pumps; --",
    "0001-01-01T00:00:00+14:00",
    "9999-12-31T23:59:59-14:00",
    "2026-13-45",
    "2026-05-02T07:11:00",
    "https://a..b/x",
    "https://[::1",
    "https://" + "a" * 70 + ".org",
    "https://\ud800.org",
    "https://x:99999/",
    "9" * 5000,
)
_VALUES: tuple[Any, ...] = (
    *_TEXTS,
    None,
    True,
    0,
    -1,
    2**31,
    2**63,
    -(2**63) - 1,
    10**30,
    1e308,
    -0.0,
    math.nan,
    math.inf,
    [],
    {},
    [[]],
    [None],
    {"": {}},
    {"a\0": 1},
    {"\ud800": [1]},
)
_RAW_BODIES = (
    b"",
    b" ",
    b"\xff\xfe\x00",
    b"{",
    b"[]",
    b"null",
    b'"x"',
    b"1" * 6000,
    b"[" * 20_000,
    b'{"a":' * 900 + b"1" + b"}" * 900,
    b'{"a": 1, "a": 2}',
    b'{"x": "\xed\xa0\x80"}',
    b"\xef\xbb\xbf{}",
    b"PK\x03\x04",
    b"\x1f\x8b\x08",
    b"a,b\n1,2\n",
)
_HEADERS: Mapping[bytes, tuple[bytes, ...]] = {
    b"if-match": (b"", b"*", b'"', b'"0"', b"\xff", b'W/"1"', b'"' + b"9" * 400 + b'"'),
    b"content-type": (b"", b"application/json", b"text/plain", b"\xe9", b"application/json; charset=x", b"a/b/c", b";"),
    b"content-encoding": (b"gzip", b"br", b"\xff", b"gzip, gzip"),
    b"origin": (b"null", b"http://[", b"x", b"http://localhost", b"https://evil.example", b"\xff", b"http://a:b"),
    b"host": (b"", b"[", b"a:b", b"localhost:99999", b"\xff", b"a b", b"evil.example", b"u@h"),
    b"accept": (b"\xff", b"application/openmetrics-text; version=1.0.0", b"q=x;;"),
    b"authorization": (b"", b"Bearer", b"Bearer \xff", b"Basic YTpi", b"bearer cd_x", b"Bearer " + b"x" * 5000),
    b"cookie": (b"casedrain_session=\xff", b"casedrain_session=x; casedrain_session=y", b"=;;=", b"\xff=\xff"),
    b"sec-fetch-site": (b"cross-site", b"\xff"),
    b"content-length": (b"x", b"-1", b"99999999999999999999999", b"\xb2"),
    b"x-forwarded-for": (b"\xff, 1.2.3.4", b"::1"),
    b"range": (b"bytes=0-0", b"bytes=x"),
}
_METHODS = ("HEAD", "OPTIONS", "TRACE", "BREW", "PUT", "PATCH", "DELETE", "POST", "GET", "x" * 40)


@dataclass(frozen=True)
class Case:
    """One request; ``route`` is the one whose good request it was made of."""

    route: tuple[str, str]
    method: str
    target: bytes
    headers: tuple[tuple[bytes, bytes], ...]
    body: bytes


@dataclass(frozen=True)
class Answer:
    status: int
    headers: Mapping[str, str]
    body: bytes


class Mutations:
    """Cases in an endless row, the same for the same seed.

    ``names`` fill the routes' URLs, ``keys`` are headers of those who may ask.
    """

    def __init__(self, seed: int, names: Mapping[str, str], keys: list[bytes], document: Mapping[str, Any]) -> None:
        self._random = random.Random(seed)
        self._names, self._keys = names, keys
        self._parameters = {
            (method, path): [p["name"] for p in operation.get("parameters", ()) if p["in"] == "query"]
            for method, path, operation in operations(document)
        }
        self._routes = sorted(MATRIX)

    def __iter__(self) -> Iterator[Case]:
        draw = self._random
        while True:
            for route in self._routes:
                if any(route[1].endswith(word) for word in _COSTLY) and draw.random() < 0.95:
                    continue
                yield self._case(route)

    def _case(self, route: tuple[str, str]) -> Case:
        draw, entry = self._random, MATRIX[route]
        parts = set(draw.sample(["path", "query", "headers", "body", "method"], draw.choice([1, 1, 2, 3])))
        if route == ENDING:
            parts |= {"query"}
        address = urlsplit(filled(entry.url, self._names))
        path = address.path if "path" not in parts else self._path(route[1], address.path)
        query = address.query.encode() if "query" not in parts else self._query(route)
        headers = {b"host": b"localhost", **{k.lower().encode(): v.encode() for k, v in entry.headers.items()}}
        if draw.random() < 0.95:
            headers[b"authorization"] = draw.choice(self._keys)
        body = entry.content or b""
        if entry.body is not None:
            headers[b"content-type"] = b"application/json"
            body = json.dumps(filled(entry.body, self._names)).encode()
        if "body" in parts:
            body = self._body(body)
        if "headers" in parts:
            name = draw.choice(sorted(_HEADERS))
            headers[name] = draw.choice(_HEADERS[name])
        method = draw.choice(_METHODS) if "method" in parts else route[0]
        target = quote(path, safe="/%").encode() + (b"?" + query if query else b"")
        return Case(route, method, target, tuple(headers.items()), body)

    def _text(self) -> str:
        text = self._random.choice(_TEXTS)
        return quote_from_bytes(b"\xff\xfe\xed\xa0\x80") if self._random.random() < 0.05 else _escaped(text)

    def _path(self, template: str, path: str) -> str:
        own = template.split("/")
        given = path.split("/")
        places = [i for i, part in enumerate(own) if "{" in part]
        if not places or len(own) != len(given):
            return path + self._random.choice(["", "/", "//", "/" + self._text(), self._text()])
        i = self._random.choice(places)
        given[i] = own[i].replace(own[i][own[i].index("{") : own[i].index("}") + 1], self._text())
        return "/".join(given)

    def _query(self, route: tuple[str, str]) -> bytes:
        draw = self._random
        known = [*self._parameters.get(route, ()), "operator", "cursor", "limit"]
        pairs = [f"{draw.choice(known)}={self._text()}" for _ in range(draw.choice([1, 1, 2, 3]))]
        if draw.random() < 0.1:
            pairs.append(draw.choice(["mood=good", "=", "&&", "%ff=%ff", ";", "a=b=c"]))
        return "&".join(pairs).encode()

    def _body(self, body: bytes) -> bytes:
        draw = self._random
        if draw.random() < 0.2:
            return draw.choice(_RAW_BODIES)
        if draw.random() < 0.1 and body:
            i = draw.randrange(len(body))
            return body[:i] + bytes([draw.randrange(256)]) + body[i + draw.choice([0, 1, 20]) :]
        try:
            document = json.loads(body)
        except ValueError:
            return body[: draw.randrange(len(body) + 1)] + draw.choice(_RAW_BODIES)
        for _ in range(draw.choice([1, 1, 2])):
            document = self._changed(document)
        return json.dumps(document).encode()

    def _changed(self, document: Any) -> Any:
        """The document with one of its nodes replaced, removed or added to."""
        draw, root = self._random, [deepcopy(document)]
        holder: Any = root
        place: Any = 0
        while isinstance(holder[place], dict | list) and holder[place] and draw.random() < 0.8:
            holder = holder[place]
            place = draw.choice(sorted(holder)) if isinstance(holder, dict) else draw.randrange(len(holder))
        chance = draw.random()
        if chance < 0.1 and isinstance(holder, dict):
            del holder[place]
        elif chance < 0.2 and isinstance(holder, dict):
            holder[draw.choice(_TEXTS)] = draw.choice(_VALUES)
        else:
            holder[place] = draw.choice(_VALUES)
        return root[0]


def _escaped(text: str) -> str:
    return quote(text, safe="", errors="surrogatepass")


async def answered(app: ASGIApp, case: Case) -> Answer:
    """What an application says to a case, asked as a server asks."""
    raw, _, query = case.target.partition(b"?")
    scope = {
        "type": "http",
        "asgi": {"version": "3.0", "spec_version": "2.3"},
        "http_version": "1.1",
        "method": case.method,
        "scheme": "http",
        "path": unquote(raw.decode("ascii")),
        "raw_path": raw,
        "query_string": query,
        "root_path": "",
        "headers": list(case.headers),
        "client": ("127.0.0.1", 5),
        "server": ("127.0.0.1", 80),
        "state": {},
    }
    asked = False
    start: dict[str, Any] = {}
    body = bytearray()

    async def receive() -> Message:
        nonlocal asked
        if asked:
            await asyncio.sleep(3600)
        asked = True
        return {"type": "http.request", "body": case.body, "more_body": False}

    async def send(message: Message) -> None:
        if message["type"] == "http.response.start":
            start.update(message)
        else:
            body.extend(message.get("body", b""))

    await app(scope, receive, send)
    headers = {k.decode("latin-1").lower(): v.decode("latin-1") for k, v in start["headers"]}
    return Answer(start["status"], headers, bytes(body))


class Referee:
    """Says what is wrong with an answer: by the API's document and by what every answer has."""

    def __init__(self, document: Mapping[str, Any]) -> None:
        self._statuses = {
            (method, path): {int(s) for s in operation["responses"]} for method, path, operation in operations(document)
        }

    def fault(self, case: Case, answer: Answer) -> str | None:
        """One sentence; None for an answer as it should be."""
        if answer.status >= 500 and answer.status not in (503, 507):
            return f"{answer.status}: {answer.body[:300]!r}"
        if "x-request-id" not in answer.headers or answer.headers.get("x-content-type-options") != "nosniff":
            return "a header that every answer has is missing"
        is_api = case.target.startswith(API.encode())
        if answer.status >= 400 and is_api and case.method != "HEAD":
            problem = self._problem_fault(answer)
            if problem:
                return problem
        if answer.status == 405:
            allowed = answer.headers.get("allow", "").split(", ")
            return None if case.method not in allowed and allowed != [""] else f"405 with Allow: {allowed}"
        method = "GET" if case.method == "HEAD" else case.method
        known = self._statuses.get((method, case.route[1]))
        if known is None or method != case.route[0]:
            return None if answer.status in ALLOWED_OF_PAGES | {201, 202, 204, 307} else f"{answer.status} of a page"
        # an address may be another than the route's own: with a segment that is empty, or has a slash
        if answer.status in known or not _pattern(case.route[1]).match(
            unquote(case.target.partition(b"?")[0].decode())
        ):
            return None
        return f"{answer.status} is not documented"

    def _problem_fault(self, answer: Answer) -> str | None:
        if answer.headers.get("content-type") != PROBLEM_JSON:
            return f"{answer.status} is no problem document: {answer.headers.get('content-type')}"
        try:
            found = json.loads(answer.body.decode("utf-8"))
        except ValueError as error:
            return f"the problem document cannot be read: {error}"
        whole = {"type", "title", "status", "detail"} <= found.keys() and found["status"] == answer.status
        return None if whole else f"the problem document is not whole: {found}"
