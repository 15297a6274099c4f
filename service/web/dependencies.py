"""What a request works with: the parts of the running service, and the one who asks."""

from typing import Annotated

from fastapi import Depends, Request
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers

from service.access.account import current_account
from service.access.last_use import note_use
from service.access.scopes import scope_of
from service.access.security import EVERYBODY, Principal, principal_of, touch_key
from service.access.sessions import Visitor, find_session, session_cookie
from service.context import Context
from service.errors import Unauthenticated
from service.settings import is_loopback
from service.storage.database import Database
from service.web.addresses import API_PREFIX
from service.web.admission import READING


def context_of(request: Request) -> Context:
    """The service's parts."""
    context: Context = request.app.state.context
    return context


async def settled(request: Request) -> None:
    """Let no request but an upload see a history in which a late record's followers still have the verdicts of before.

    Where it is known whose a request is, it waits for nobody else's.
    """
    settling = context_of(request).acceptance.settling
    is_upload = request.method == "POST" and request.url.path == f"{API_PREFIX}/records"
    if settling.is_due and not is_upload and request.url.path not in _OF_NO_PUMP:
        await run_in_threadpool(settling.settle, current_account().operator)


def principal(request: Request) -> Principal:
    """Who asks: by bearer key, or by the pages' session cookie.

    Raises
    ------
    Unauthenticated
        when authentication is on and neither a valid key nor, for reading, a living session came along.
    Forbidden
        when the key's scopes are for other calls.
    """
    context = context_of(request)
    if not context.settings.auth_is_on:
        return EVERYBODY
    scheme, _, key = request.headers.get("authorization", "").partition(" ")
    if scheme.lower() == "bearer" and key.strip():
        found = known_principal(context.database, key.strip())
        _learn(request, context, found)
        found.require_scope(scope_of(request.method, request.url.path.removeprefix(API_PREFIX)))
        return found
    # the cookie serves the pages' own reading only: a foreign page must not write through it
    visitor = visitor_of(request) if request.method in ("GET", "HEAD") else None
    if visitor is None:
        raise Unauthenticated("send a key: Authorization: Bearer <key>", headers={"WWW-Authenticate": "Bearer"})
    return visitor.principal


def visitor_of(request: Request) -> Visitor | None:
    """Who is signed in to the pages; None without a living session. Looked up once for a request."""
    if not hasattr(request.state, "visitor"):
        context, token = context_of(request), request.cookies.get(session_cookie(is_secure(request)), "")
        request.state.visitor = find_session(context.database, token, context.settings) if token else None
        if request.state.visitor is not None:
            _learn(request, context, request.state.visitor.principal)
    visitor: Visitor | None = request.state.visitor
    return visitor


def credential_of(headers: Headers) -> str:
    """What a request shows of whose it is, as it stands in its head; empty without anything."""
    return headers.get("authorization") or headers.get("cookie") or ""


def _learn(request: Request, context: Context, who: Principal) -> None:
    """Note who asks, and count the request for them.

    Raises
    ------
    TooMany
        when a quota is used up.
    """
    account = current_account()
    context.crowd.learn(account, credential_of(request.headers), who.key, who.operator, who.owner)
    context.crowd.quotas.count(account, brings_bytes=request.method not in READING)


def is_secure(request: Request) -> bool:
    """True where a cookie needs an encrypted way: everywhere but on this machine."""
    return not is_loopback(request.url.hostname or "")


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
        note_use(database, f"key {found.key}", lambda session: touch_key(session, key))
    return found


async def _context(request: Request) -> Context:
    # a coroutine costs no thread: who waits for one of forty would not be told that the database hangs
    return context_of(request)


_OF_NO_PUMP = ("/healthz", "/readyz", "/metrics")
ContextOf = Annotated[Context, Depends(_context)]


Asker = Annotated[Principal, Depends(principal)]
