"""Signing in by an OpenID provider: away to it, and back with its answer, once."""

import secrets
from typing import Annotated

from fastapi import APIRouter, Query, Request
from fastapi.responses import RedirectResponse, Response

from service.access.pending import PENDING_S, keep_pending, taken_pending, with_subject
from service.access.sessions import check_pace, cookie_name, note_failure
from service.errors import NotFound, Problem, Unauthenticated
from service.web.dashboard.frame import NOTHING_HERE, PageRoute
from service.web.dashboard.links import local_address
from service.web.dashboard.sign_in import asked_again, signed_in
from service.web.dependencies import context_of, is_secure

oidc_router = APIRouter(include_in_schema=False, route_class=PageRoute)
_COOKIE = "casedrain_oidc"
_PATH = "/sign-in/oidc"
_LONGEST_FIELD = 2000
_Given = Annotated[str, Query(max_length=_LONGEST_FIELD)]


@oidc_router.get(_PATH)
def go(request: Request, wanted: Annotated[str, Query(alias="next", max_length=_LONGEST_FIELD)] = "/") -> Response:
    """Send the browser to the provider; what must come back is kept, and bound to this browser by a cookie."""
    context, wanted = context_of(request), local_address(wanted)
    if context.issuer is None:
        raise NotFound(NOTHING_HERE)
    try:
        asked = context.issuer.asked(_return_address(request))
    except Problem as problem:
        return asked_again(request, int(problem.status), _sentence(problem), wanted, problem.headers)
    browser = secrets.token_urlsafe(32)
    with context.database.writing() as session:
        keep_pending(session, asked, browser, wanted)
    response = RedirectResponse(asked.address, status_code=303)
    response.set_cookie(
        _cookie(request), browser, max_age=PENDING_S, httponly=True, samesite="lax", secure=is_secure(request)
    )
    return response


@oidc_router.get(f"{_PATH}/callback")
def come_back(
    request: Request,
    code: _Given = "",
    state: _Given = "",
    error: _Given = "",
    _description: Annotated[str, Query(alias="error_description", max_length=_LONGEST_FIELD)] = "",
    _session_state: Annotated[str, Query(alias="session_state", max_length=_LONGEST_FIELD)] = "",
    _issuer: Annotated[str, Query(alias="iss", max_length=_LONGEST_FIELD)] = "",
) -> Response:
    """Take the provider's answer: of this browser, to a sign-in that began here, and not for a second time."""
    context = context_of(request)
    if context.issuer is None:
        raise NotFound(NOTHING_HERE)
    address = request.client.host if request.client else "unknown"
    # by address: whoever fails on purpose must keep nobody else out
    who, wanted = f"(oidc) {address}", "/"
    try:
        with context.database.writing() as session:
            check_pace(session, who, address)
            pending = taken_pending(session, state, request.cookies.get(_cookie(request), ""))
        if pending is None:
            raise Unauthenticated("this sign-in did not begin here, is too old or was used already: begin again")
        wanted = pending.wanted
        if error or not code:
            raise Unauthenticated("the sign-in was not completed there: begin again")
        subject = context.issuer.subject(code, _return_address(request), pending.nonce, pending.verifier)
        with context.database.reading() as session:
            user = with_subject(session, subject)
        if user is None:
            raise Unauthenticated("nobody here is known by that account: an admin links it to a user")
    except Problem as problem:
        if isinstance(problem, Unauthenticated):
            with context.database.writing() as session:
                note_failure(session, who, address)
        response = asked_again(request, int(problem.status), _sentence(problem), wanted, problem.headers)
    else:
        response = signed_in(request, user, wanted, who, address)
    response.delete_cookie(_cookie(request), secure=is_secure(request), httponly=True)
    return response


def _return_address(request: Request) -> str:
    base = context_of(request).settings.public_url or str(request.base_url)
    return f"{base.rstrip('/')}{_PATH}/callback"


def _sentence(problem: Problem) -> str:
    return f"{problem.detail[:1].upper()}{problem.detail[1:]}."


def _cookie(request: Request) -> str:
    return cookie_name(_COOKIE, is_secure(request))
