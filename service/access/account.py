"""For whom a piece of work is done: a request's credential, key and operator; threads that work for it inherit it."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

NOBODY = ""
"""Tenant of what the service does by itself."""


@dataclass(slots=True)
class Account:
    """Who is served and what it costs. It fills as a request is understood: first its address, then its key.

    Attributes
    ----------
    tenant
        Who shares with others: an operator, else a key, else an address.
    key
        Key or user that pays; empty until it is known, and where authentication is off.
    operator
        Operator that pays; None for those who see every operator.
    owner
        Who asks, in words, for logs.
    is_background
        Nobody waits for the answer: it may wait for as long as others are served.
    is_counted
        Its request has been counted.
    parser_seconds
        Time that the parser took for it [s].
    """

    tenant: str = NOBODY
    key: str = ""
    operator: str | None = None
    owner: str | None = None
    is_background: bool = False
    is_counted: bool = False
    parser_seconds: float = 0.0


_current: ContextVar[Account | None] = ContextVar("casedrain_account", default=None)


def current_account() -> Account:
    """Account of what runs now; what nobody asked for is the service's own, in the background."""
    return _current.get() or Account(is_background=True)


@contextmanager
def working_for(account: Account) -> Iterator[Account]:
    """Whatever runs in the block, and in threads that it starts a request's way, is for this account."""
    token = _current.set(account)
    try:
        yield account
    finally:
        _current.reset(token)


@contextmanager
def in_background(operator: str | None = None) -> Iterator[Account]:
    """Work that outlasts its request, or of a job: for the operator, or whoever asked, and nobody waits for it."""
    asked = current_account()
    tenant = f"operator {operator}" if operator else asked.tenant
    with working_for(Account(tenant=tenant, operator=operator or asked.operator, is_background=True)) as account:
        yield account
