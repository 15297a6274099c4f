"""Errors as answers: every one of them is a problem document, and what cannot be written in it is replaced."""

import json
import re
from collections.abc import Iterable
from functools import lru_cache
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.routing import BaseRoute, compile_path

from service.errors import PROBLEM_JSON, Fault, Invalid, Problem, Undecodable, UnknownType
from service.web.answer_route import unknown_parameters
from service.web.dashboard.frame import NOTHING_HERE, problem_page, wants_page

_HALVES = re.compile("[\ud800-\udfff]")
_JSON_TYPE = re.compile(r"application/([\w.-]+\+)?json")


class ProblemResponse(Response):
    """A problem document; half a surrogate pair that an input brought along becomes the replacement character."""

    media_type = PROBLEM_JSON

    def __init__(self, problem: Problem) -> None:
        super().__init__(_text(problem.body()), status_code=int(problem.status), headers=problem.headers)


def handle_problems(app: FastAPI) -> None:
    """Let an application answer what goes wrong inside its routes with problem documents."""
    app.add_exception_handler(Problem, _on_problem)
    app.add_exception_handler(RequestValidationError, _on_validation)
    app.add_exception_handler(HTTPException, _on_http)


def _text(body: Any) -> str:
    return _HALVES.sub("\ufffd", json.dumps(body, ensure_ascii=False, separators=(",", ":"), default=str))


async def _told(request: Request, problem: Problem) -> Response:
    """A problem as a page where a browser asks for one, else as a document."""
    if wants_page(request):
        return await run_in_threadpool(problem_page, request, json.loads(_text(problem.body())), problem.headers or {})
    return ProblemResponse(problem)


async def _on_problem(request: Request, error: Exception) -> Response:
    if not isinstance(error, Problem):
        raise TypeError("only problems come here")
    return await _told(request, error)


async def _on_validation(request: Request, error: Exception) -> Response:
    if not isinstance(error, RequestValidationError):
        raise TypeError("only validation errors come here")
    found = error.errors()
    broken = next((e for e in found if e["type"] == "json_invalid"), None)
    if broken is not None:
        place = f"character {broken['loc'][-1]}"
        words = str(broken.get("ctx", {}).get("error", "is no JSON")).lower()
        return await _told(
            request, Undecodable(f"the body is no JSON document: {words} ({place})", [Fault("body", words)])
        )
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if any(e["loc"] == ("body",) and e["type"] != "missing" for e in found) and not _JSON_TYPE.fullmatch(kind):
        fault = Fault("content-type", f"{kind or 'none'} is not application/json")
        return await _told(
            request, UnknownType(f"content type {kind or '(none)'} is not understood here: send JSON", [fault])
        )
    faults = [Fault(".".join(str(p) for p in e["loc"]), e["msg"]) for e in found]
    faults += unknown_parameters(request)
    return await _told(request, Invalid(f"the request has {len(faults)} fault(s)", faults))


async def _on_http(request: Request, error: Exception) -> Response:
    if not isinstance(error, HTTPException):
        raise TypeError("only HTTP errors come here")
    headers = dict(error.headers or {})
    detail = str(error.detail)
    if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
        methods = allowed_methods(request.app.router.routes, request.scope["path"])
        headers["Allow"] = ", ".join(methods)
        detail = f"this address knows {', '.join(methods)}"
    elif error.status_code == HTTPStatus.BAD_REQUEST:
        # the reading of a body stopped: too deep, a number with thousands of digits, bytes that are no text
        return await _told(request, Undecodable("the body is no JSON document", [Fault("body", "cannot be decoded")]))
    elif error.status_code == HTTPStatus.NOT_FOUND:
        detail = NOTHING_HERE
    answer = Problem(detail, headers=headers)
    answer.status = HTTPStatus(error.status_code)
    answer.title = answer.status.phrase
    return await _told(request, answer)


def allowed_methods(routes: Iterable[BaseRoute], path: str) -> list[str]:
    """Methods of every route at an address, in alphabetical order; HEAD goes with GET."""
    found: set[str] = set()
    for route in routes:
        # a router that was taken in gives its routes as they stand in the application
        parts: Iterable[Any] = getattr(route, "effective_route_contexts", lambda route=route: [route])()
        for part in parts:
            methods = getattr(part, "methods", None)
            if methods and _pattern(part.path).match(path):
                found |= methods
    return sorted(found | ({"HEAD"} if "GET" in found else set()))


@lru_cache(maxsize=1000)
def _pattern(path: str) -> re.Pattern[str]:
    return compile_path(path)[0]
