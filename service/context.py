"""What a request works with: the application's parts and the one who asks."""

from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, Request

from service.database import Database
from service.errors import Unauthenticated
from service.ingest.parser_pool import ParserPool
from service.ingest.raw import Limits
from service.monitoring.acceptance import Acceptance
from service.monitoring.archive import Archive
from service.raw_store import RawStore
from service.security import EVERYBODY, Principal, principal_of, touch_key
from service.sessions import SESSION_COOKIE, Visitor, find_session
from service.settings import Settings
from service.spool import Spool


@dataclass(frozen=True, slots=True)
class Context:
    """Parts of a running service, made once at its start."""

    settings: Settings
    database: Database
    archive: Archive
    acceptance: Acceptance

    @property
    def raw_store(self) -> RawStore:
        """Bytes as they were uploaded."""
        return self.archive.raw_store

    @property
    def spool(self) -> Spool:
        """Uploads on their way in."""
        return self.archive.spool

    @property
    def parser(self) -> ParserPool:
        """Processes that read files from outside."""
        return self.archive.parser

    @property
    def limits(self) -> Limits:
        """Bounds on inflation and rows."""
        return self.archive.limits

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
    """Who is signed in to the pages; None without a living session."""
    context = context_of(request)
    token = request.cookies.get(SESSION_COOKIE, "")
    return find_session(context.database, token, context.settings) if token else None


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
