"""What a request works with: the parts of the running service, and the one who asks."""

from typing import Annotated

from fastapi import Depends, Request

from service.access.security import EVERYBODY, Principal, principal_of, touch_key
from service.access.sessions import SESSION_COOKIE, Visitor, find_session
from service.context import Context
from service.errors import Unauthenticated
from service.storage.database import Database


def context_of(request: Request) -> Context:
    """The service's parts."""
    context: Context = request.app.state.context
    return context


def principal(request: Request) -> Principal:
    """Who asks: by bearer key, or by the pages' session cookie.

    Raises
    ------
    Unauthenticated
        when authentication is on and neither a valid key nor, for reading, a living session came along.
    """
    context = context_of(request)
    if not context.settings.auth_is_on:
        return EVERYBODY
    scheme, _, key = request.headers.get("authorization", "").partition(" ")
    if scheme.lower() == "bearer" and key.strip():
        return known_principal(context.database, key.strip())
    # the cookie serves the pages' own reading only: a foreign page must not write through it
    visitor = visitor_of(request) if request.method in ("GET", "HEAD") else None
    if visitor is None:
        raise Unauthenticated("send a key: Authorization: Bearer <key>", headers={"WWW-Authenticate": "Bearer"})
    return visitor.principal


def visitor_of(request: Request) -> Visitor | None:
    """Who is signed in to the pages; None without a living session. Looked up once for a request."""
    if not hasattr(request.state, "visitor"):
        context, token = context_of(request), request.cookies.get(SESSION_COOKIE, "")
        request.state.visitor = find_session(context.database, token, context.settings) if token else None
    visitor: Visitor | None = request.state.visitor
    return visitor


def known_principal(database: Database, key: str) -> Principal:
    """Who a key belongs to; its time of last use is noted.

    Raises
    ------
    Unauthenticated
        when there is no such key or it has expired.
    """
    with database.reading() as session:
        found, stale = principal_of(session, key)
    if stale:
        with database.writing() as session:
            touch_key(session, key)
    return found


ContextOf = Annotated[Context, Depends(context_of)]


Asker = Annotated[Principal, Depends(principal)]
