"""Everybody who is being served: how many requests each and all have in hand, before a thread is spent on any."""

import hashlib
import time
from collections import Counter, OrderedDict

from service.access.account import Account
from service.access.quotas import Quotas
from service.access.turns import ALONE_AFTER_S, REFUSED, Clock, Gate, TooMany
from service.errors import Unavailable
from service.settings import Settings

_MOST_KNOWN = 10_000
"""Credentials whose owner is remembered, so that a request counts for them before its key is looked up."""


class Crowd:
    """Requests in hand by tenant, quotas, and the turns of uploads and reads. Its methods run on the event loop but for ``learn``."""

    def __init__(self, settings: Settings, clock: Clock = time.monotonic) -> None:
        self.quotas = Quotas(settings, clock)
        self.uploads = Gate(
            settings.upload_workers,
            settings.max_waiting_uploads,
            settings.max_wait_seconds,
            "their upload's turn",
            clock,
        )
        most, patience = settings.max_requests_in_hand, settings.max_wait_seconds
        self.reads = Gate(settings.read_workers, most, patience, "their read's turn", clock)
        self._most, self._most_each, self._clock = settings.max_requests_in_hand, settings.max_requests_each, clock
        self._known: OrderedDict[str, Account] = OrderedDict()
        self._in_hand: Counter[str] = Counter()
        self._seen: dict[str, float] = {}

    @property
    def in_hand(self) -> int:
        """Requests that are being answered now."""
        return self._in_hand.total()

    def came(self, credential: str, address: str, *, brings_bytes: bool) -> Account:
        """Let a request in: the account that it works for, as far as it is known.

        Raises
        ------
        TooMany, Unavailable
            with ``Retry-After``: its tenant, or everybody, has too many in hand; its key's or operator's quota is used up.
        """
        known = self._known.get(_hashed(credential)) if credential else None
        if known is None:
            account = Account(tenant=f"address {address}")
        else:
            account = Account(tenant=known.tenant, key=known.key, operator=known.operator, owner=known.owner)
        now, tenant = self._clock(), account.tenant
        others = any(n != tenant and now - at <= ALONE_AFTER_S for n, at in self._seen.items())
        self._note(tenant, now)
        if others and self._in_hand[tenant] >= self._most_each:
            REFUSED.labels("in_hand").inc()
            raise TooMany(
                f"{self._in_hand[tenant]} of your requests are being answered already: try again in 1 s",
                headers={"Retry-After": "1"},
            )
        # whoever has nothing in hand is let in over the limit: nobody is shut out by others
        if self.in_hand >= self._most and (self._in_hand[tenant] or self.in_hand >= 2 * self._most):
            REFUSED.labels("busy").inc()
            raise Unavailable("too many requests are being answered: try again in 1 s", headers={"Retry-After": "1"})
        self.quotas.count(account, brings_bytes=brings_bytes)
        return account

    def enter(self, tenant: str) -> None:
        """A request of a tenant is in hand."""
        self._in_hand[tenant] += 1

    def leave(self, tenant: str) -> None:
        """It has been answered."""
        self._in_hand[tenant] -= 1
        if self._in_hand[tenant] <= 0:
            del self._in_hand[tenant]

    def learn(self, account: Account, credential: str, key: str, operator: str | None, owner: str) -> None:
        """Note whose a request is, now that its key has been looked up."""
        account.key, account.operator, account.owner = key, operator, owner
        account.tenant = f"operator {operator}" if operator is not None else f"key {key}"
        self._known[_hashed(credential)] = Account(account.tenant, key, operator, owner)
        while len(self._known) > _MOST_KNOWN:
            self._known.popitem(last=False)

    def _note(self, tenant: str, now: float) -> None:
        self._seen[tenant] = now
        if len(self._seen) > _MOST_KNOWN:
            self._seen = {n: at for n, at in self._seen.items() if now - at <= ALONE_AFTER_S}


def _hashed(credential: str) -> str:
    return hashlib.sha256(credential.encode("utf-8", "replace")).hexdigest()
