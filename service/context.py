"""What a request works with: the application's parts and the one who asks."""

from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, Request

from service.database import Database
from service.errors import Unauthenticated
from service.ingest.parser_pool import ParserPool
from service.ingest.raw import Limits
from service.monitoring.acceptance import Acceptance
from service.raw_store import RawStore
from service.security import EVERYBODY, Principal, principal_of, touch_key
from service.settings import Settings
from service.spool import Spool

SESSION_COOKIE = "casedrain_session"


@dataclass(frozen=True, slots=True)
class Context:
    """Parts of a running service, made once at its start."""

    settings: Settings
    database: Database
    raw_store: RawStore
    acceptance: Acceptance
    spool: Spool
    parser: ParserPool
    limits: Limits

    def close(self) -> None:
        """Close connections and end the parsing processes."""
        self.parser.close()
        self.database.close()


def context_of(request: Request) -> Context:
    """The service's parts."""
    context: Context = request.app.state.context
    return context


def principal(request: Request) -> Principal:
    """Who asks: by bearer key, or by the pages' session cookie.

    Raises
    ------
    Unauthenticated
        when authentication is on and no valid key came along.
    """
    context = context_of(request)
    if not context.settings.auth_is_on:
        return EVERYBODY
    scheme, _, key = request.headers.get("authorization", "").partition(" ")
    if scheme.lower() != "bearer" or not key.strip():
        # the cookie serves the pages' own reading only: a foreign page must not write through it
        key = request.cookies.get(SESSION_COOKIE, "") if request.method in ("GET", "HEAD") else ""
    if not key.strip():
        raise Unauthenticated("send a key: Authorization: Bearer <key>", headers={"WWW-Authenticate": "Bearer"})
    return known_principal(context.database, key.strip())


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
