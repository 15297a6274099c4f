"""Signing in to the pages and out again."""

import secrets
from typing import Annotated

from fastapi import APIRouter, Form, Query, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response

from service.access import audit
from service.access.security import Principal
from service.access.sessions import (
    check_pace,
    cookie_name,
    end_session,
    forget_failures,
    key_of,
    note_failure,
    session_cookie,
    start_session,
)
from service.access.users import with_password
from service.errors import Forbidden, Problem
from service.storage.tables import ApiKey, User
from service.web.dashboard.frame import PageRoute, html_page, problem_page
from service.web.dashboard.links import local_address
from service.web.dependencies import context_of, is_secure, visitor_of

sign_in_router = APIRouter(include_in_schema=False, route_class=PageRoute)
_FORM_COOKIE = "casedrain_sign_in"
_LONGEST_FIELD = 2000
_Field = Annotated[str, Form(max_length=_LONGEST_FIELD)]


@sign_in_router.get("/sign-in", response_class=HTMLResponse)
def sign_in_page(
    request: Request, wanted: Annotated[str, Query(alias="next", max_length=_LONGEST_FIELD)] = "/"
) -> Response:
    """Ask for name and password, or for a key; then lead on to the page that was wanted."""
    return asked_again(request, 200, None, local_address(wanted))


@sign_in_router.post("/sign-in")
def sign_in(
    request: Request,
    csrf_token: _Field = "",
    name: _Field = "",
    password: _Field = "",
    key: _Field = "",
    wanted: Annotated[str, Form(alias="next", max_length=_LONGEST_FIELD)] = "/",
) -> Response:
    """Start a session; its cookie cannot be read by scripts nor sent by forms of other sites."""
    context, wanted = context_of(request), local_address(wanted)
    held = request.cookies.get(_form_cookie(request), "")
    if not held or not secrets.compare_digest(held.encode(), csrf_token.encode()):
        return asked_again(request, 403, "The form has expired. Please try again.", wanted)
    address = request.client.host if request.client else "unknown"
    who = name or f"(key) {address}"  # whoever fails on purpose must keep nobody else out
    try:
        with context.database.reading() as session:
            check_pace(session, who, address)
            user = with_password(session, name, password) if name else None
            row = key_of(session, key.strip()) if key and not name else None
    except Problem as problem:
        words = f"{problem.detail[:1].upper()}{problem.detail[1:]}."
        return asked_again(request, int(problem.status), words, wanted, problem.headers)
    found = user or row
    if found is None:
        with context.database.writing() as session:
            note_failure(session, who, address)
        what = (
            "That key is not known, has expired, was revoked or is for single calls only."
            if key
            else "Name or password is wrong."
        )
        return asked_again(request, 401, what, wanted)
    response = signed_in(request, found, wanted, who, address)
    response.delete_cookie(_form_cookie(request), secure=is_secure(request), httponly=True)
    return response


def signed_in(request: Request, found: User | ApiKey, wanted: str, who: str, address: str) -> Response:
    """Start a session for somebody who has shown who they are, and lead on to the page that was wanted."""
    context = context_of(request)
    with context.database.writing() as session:
        forget_failures(session, who, address)
        user_id, key_id = (found.id, None) if isinstance(found, User) else (None, found.id)
        token = start_session(session, context.settings, user_id=user_id, key_id=key_id)
        owner = found.name if isinstance(found, User) else found.owner
        come = Principal(owner, found.role, found.operator)
        audit.note(session, come, "session.start", f"user/{owner}", found.operator)
    response = RedirectResponse(wanted, status_code=303)
    response.set_cookie(
        session_cookie(is_secure(request)),
        token,
        max_age=int(context.settings.session_hours * 3600),
        httponly=True,
        samesite="lax",
        secure=is_secure(request),
    )
    return response


@sign_in_router.post("/sign-out")
def sign_out(request: Request, csrf_token: _Field = "") -> Response:
    """End the session, here and on the server."""
    context = context_of(request)
    visitor = visitor_of(request)
    if visitor is not None:
        try:
            visitor.check_form(csrf_token)
        except Forbidden as problem:
            return problem_page(request, problem.body(), problem.headers)
        with context.database.writing() as session:
            end_session(session, visitor.session_id)
            who = visitor.principal
            audit.note(session, who, "session.end", f"user/{who.owner}", who.operator)
    response = RedirectResponse("/sign-in", status_code=303)
    response.delete_cookie(session_cookie(is_secure(request)), secure=is_secure(request), httponly=True)
    return response


def asked_again(
    request: Request, status: int, problem: str | None, wanted: str, headers: dict[str, str] | None = None
) -> Response:
    """The sign-in page with what went wrong."""
    token = secrets.token_urlsafe(32)
    settings = context_of(request).settings
    values = {"request": request, "problem": problem, "csrf_token": token, "wanted": wanted}
    values["elsewhere"] = settings.oidc_name if settings.oidc_issuer else None
    response = html_page("sign_in.html", status, values)
    response.headers.update(headers or {})
    response.set_cookie(
        _form_cookie(request), token, max_age=3600, httponly=True, samesite="strict", secure=is_secure(request)
    )
    return response


def _form_cookie(request: Request) -> str:
    return cookie_name(_FORM_COOKIE, is_secure(request))
