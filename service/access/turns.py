"""Places that tenants share: who holds the fewest is next, then who has used least; queues are refused before they are long."""

import asyncio
import math
import threading
import time
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from http import HTTPStatus

from prometheus_client import Counter

from service.access.account import Account
from service.errors import Problem, Unavailable

REFUSED = Counter("casedrain_refused_total", "Requests that were refused because too much was asked", ["why"])
"""Reasons are words of ours: quota_requests, quota_bytes, quota_parser, quota_jobs, in_hand, busy, waiting."""
ALONE_AFTER_S = 600.0
"""Whoever shares with nobody for so long may hold every place and fill the queue (our choice)."""
_FADES_S = 60.0
"""Time in which what a tenant has used counts for a third (our choice)."""
_RETRY_S = 2
_BACKGROUND = "\nbackground"
"""Behind a tenant's name; no name holds a line's end."""
Clock = Callable[[], float]


class TooMany(Problem):
    """One tenant asks for more than its share."""

    status, title = HTTPStatus.TOO_MANY_REQUESTS, "Too many requests"


class _Tenant:
    """What one tenant holds, waits for, and has used [s of places]."""

    def __init__(self) -> None:
        self.held = 0
        self.waiting: deque[_Turn] = deque()
        self.seen_at = -math.inf
        self._used, self._used_at = 0.0, 0.0

    def used(self, now: float) -> float:
        return self._used * math.exp((self._used_at - now) / _FADES_S)

    def use(self, seconds: float, now: float) -> None:
        self._used, self._used_at = self.used(now) + seconds, now


class _Turn:
    """One who waits, and how to tell them."""

    def __init__(self, tenant: str, tell: Callable[[], None]) -> None:
        self.tenant, self.tell = tenant, tell
        self.is_given = False
        self.given_at = 0.0


class Gate:
    """A number of places that threads and coroutines enter in turn.

    Where several tenants come, one place is kept from whoever holds all others, so that a tenant's slow work is never the
    whole of it. Background work is a tenant beside its operator's requests.

    Parameters
    ----------
    places
        How many may be inside.
    most_waiting
        How many may wait with somebody waiting for their answer; one tenant beside others may fill half of it.
    patience_s
        Longest wait of these [s].
    what
        What is waited for, in the words of a refusal.
    """

    def __init__(
        self, places: int, most_waiting: int, patience_s: float, what: str, clock: Clock = time.monotonic
    ) -> None:
        self._free, self._places = places, places
        self._most_waiting, self._patience_s, self._what, self._clock = most_waiting, patience_s, what, clock
        self._tenants: dict[str, _Tenant] = {}
        self._lock = threading.Lock()

    @property
    def waiting(self) -> int:
        """How many wait now."""
        with self._lock:
            return sum(len(t.waiting) for t in self._tenants.values())

    def check(self, account: Account) -> None:
        """Refuse before anything is spent what would be refused at the gate; raises as ``entered``."""
        with self._lock:
            name, now = _name(account), self._clock()
            self._check_queue(name, self._tenants.get(name) or _Tenant(), now)

    @contextmanager
    def entered(self, account: Account) -> Iterator[None]:
        """Hold a place while the block runs; the thread waits for it.

        Raises
        ------
        TooMany, Unavailable
            with ``Retry-After``: the tenant's part of the queue or all of it is full, or the wait was too long.
        """
        given = threading.Event()
        turn = self._ask(account, given.set)
        try:
            if not given.wait(None if account.is_background else self._patience_s) and not self._give_up(turn):
                raise self._too_long()
            yield
        finally:
            self._leave(turn)

    @asynccontextmanager
    async def entered_by_task(self, account: Account) -> AsyncIterator[None]:
        """The same for a coroutine, which costs no thread while it waits."""
        loop = asyncio.get_running_loop()
        given = asyncio.Event()

        def tell() -> None:
            loop.call_soon_threadsafe(given.set)

        turn = self._ask(account, tell)
        try:
            try:
                async with asyncio.timeout(None if account.is_background else self._patience_s):
                    await given.wait()
            except TimeoutError:
                if not self._give_up(turn):
                    raise self._too_long() from None
            yield
        finally:
            self._leave(turn)

    def _ask(self, account: Account, tell: Callable[[], None]) -> _Turn:
        with self._lock:
            name, now = _name(account), self._clock()
            self._forget(now)
            tenant = self._tenants.setdefault(name, _Tenant())
            tenant.seen_at = now
            if not account.is_background:
                self._check_queue(name, tenant, now)
            turn = _Turn(name, tell)
            tenant.waiting.append(turn)
            self._hand_out(now)
        return turn

    def _check_queue(self, name: str, tenant: _Tenant, now: float) -> None:
        if self._free and not tenant.waiting:
            return
        waiting = sum(len(t.waiting) for n, t in self._tenants.items() if not _is_background(n))
        own = self._most_waiting if self._is_alone(name, now) else max(1, self._most_waiting // 2)
        retry = {"Retry-After": str(_RETRY_S)}
        if waiting >= self._most_waiting and (tenant.waiting or waiting >= 2 * self._most_waiting):
            REFUSED.labels("waiting").inc()
            raise Unavailable(f"{waiting} wait for {self._what} already: try again in {_RETRY_S} s", headers=retry)
        if len(tenant.waiting) >= own:
            REFUSED.labels("waiting").inc()
            raise TooMany(
                f"{len(tenant.waiting)} of yours wait for {self._what} already: try again in {_RETRY_S} s",
                headers=retry,
            )

    def _hand_out(self, now: float) -> None:
        while self._free:
            held = {n: t for n, t in self._tenants.items() if t.waiting}
            if self._free == 1 and self._places > 1:
                # the last place is for others than whoever holds the rest
                held = {n: t for n, t in held.items() if t.held < self._places - 1 or self._is_alone(n, now)}
            if not held:
                return
            chosen = min(held.values(), key=lambda t: (t.held, t.used(now)))
            turn = chosen.waiting.popleft()
            turn.is_given, turn.given_at = True, now
            chosen.held += 1
            self._free -= 1
            turn.tell()

    def _give_up(self, turn: _Turn) -> bool:
        """End a wait; True when the place was given at the last moment."""
        with self._lock:
            if not turn.is_given:
                self._tenants[turn.tenant].waiting.remove(turn)
            return turn.is_given

    def _leave(self, turn: _Turn) -> None:
        with self._lock:
            tenant, now = self._tenants[turn.tenant], self._clock()
            if turn.is_given:
                tenant.held -= 1
                tenant.use(now - turn.given_at, now)
                self._free += 1
            elif turn in tenant.waiting:  # cancelled while it waited
                tenant.waiting.remove(turn)
            self._hand_out(now)

    def _is_alone(self, name: str, now: float) -> bool:
        """Whether nobody else has come lately; to those who wait for an answer background work is nobody."""
        others = {n: t for n, t in self._tenants.items() if n != name}
        if not _is_background(name):
            others = {n: t for n, t in others.items() if not _is_background(n)}
        return all(now - t.seen_at > ALONE_AFTER_S and not t.held for t in others.values())

    def _forget(self, now: float) -> None:
        if len(self._tenants) < 100:
            return
        idle = [n for n, t in self._tenants.items() if not t.held and not t.waiting and now - t.seen_at > ALONE_AFTER_S]
        for name in idle:
            del self._tenants[name]

    def _too_long(self) -> Problem:
        REFUSED.labels("waiting").inc()
        return Unavailable(
            f"no turn came for {self._what} within {self._patience_s:g} s: try again",
            headers={"Retry-After": str(_RETRY_S)},
        )


def _name(account: Account) -> str:
    return account.tenant + _BACKGROUND if account.is_background else account.tenant


def _is_background(name: str) -> bool:
    return name.endswith(_BACKGROUND)
