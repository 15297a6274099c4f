"""What one key and one operator may ask of a process: requests, bytes, seconds of the parser; jobs are counted elsewhere.

A bucket fills evenly and holds a part of its period, so that a burst passes and a steady excess does not. Bytes and seconds
are known afterwards: who owes some is asked to wait until the bucket has filled over its debt. Each process keeps its own
buckets; N replicas give up to N times as much.
"""

import math
import threading
import time
from dataclasses import dataclass

from service.access.account import Account
from service.access.turns import REFUSED, Clock, TooMany
from service.settings import Settings

_BURST_S = {"requests": 20.0, "bytes": 1200.0, "parser": 1200.0}
"""How long a bucket takes to fill [s] (our choice): what may come at once."""
_WORDS = {"requests": "requests", "bytes": "bytes sent", "parser": "seconds of the parser"}
_MOST_BUCKETS = 20_000


@dataclass(slots=True)
class _Bucket:
    """What is left, and when that was so."""

    level: float
    at: float


class Quotas:
    """Buckets of every key and operator that this process has served lately."""

    def __init__(self, settings: Settings, clock: Clock = time.monotonic) -> None:
        self._rates = {
            ("key", "requests"): settings.quota_key_requests_per_minute / 60.0,
            ("operator", "requests"): settings.quota_operator_requests_per_minute / 60.0,
            ("key", "bytes"): settings.quota_key_bytes_per_hour / 3600.0,
            ("operator", "bytes"): settings.quota_operator_bytes_per_hour / 3600.0,
            ("key", "parser"): settings.quota_key_parser_seconds_per_hour / 3600.0,
            ("operator", "parser"): settings.quota_operator_parser_seconds_per_hour / 3600.0,
        }
        self._clock = clock
        self._buckets: dict[tuple[str, str, str], _Bucket] = {}
        self._lock = threading.Lock()

    def count(self, account: Account, *, brings_bytes: bool) -> None:
        """Count a request once its key is known; safe to repeat.

        Parameters
        ----------
        brings_bytes
            Whether it may bring a body: only then debts of bytes and of the parser count.

        Raises
        ------
        TooMany
            with ``Retry-After``, naming whose quota of what is used up.
        """
        if account.is_counted or not account.key:
            return
        account.is_counted = True
        with self._lock:
            self._forget()
            for whose, name in _payers(account):
                for what in ("requests", "bytes", "parser") if brings_bytes else ("requests",):
                    self._check(whose, name, what)
            for whose, name in _payers(account):
                self._take(whose, name, "requests", 1.0)

    def charge(self, account: Account, n_bytes: int) -> None:
        """Note what a request has cost when it is over."""
        if not account.key:
            return
        with self._lock:
            for whose, name in _payers(account):
                self._take(whose, name, "bytes", float(n_bytes))
                self._take(whose, name, "parser", account.parser_seconds)

    def _check(self, whose: str, name: str, what: str) -> None:
        rate = self._rates[whose, what]
        if rate <= 0.0:
            return
        needed = 1.0 if what == "requests" else 0.0
        missing = needed - self._bucket(whose, name, what).level
        if missing > 0.0 or (needed == 0.0 and missing == 0.0):
            wait = max(1, math.ceil(missing / rate))
            REFUSED.labels(f"quota_{what}").inc()
            raise TooMany(
                f"the {whose} {name if whose == 'operator' else account_name(name)} has used up its quota of "
                f"{_WORDS[what]}: try again in {wait} s",
                headers={"Retry-After": str(wait)},
            )

    def _take(self, whose: str, name: str, what: str, amount: float) -> None:
        if self._rates[whose, what] > 0.0 and amount > 0.0:
            self._bucket(whose, name, what).level -= amount

    def _bucket(self, whose: str, name: str, what: str) -> _Bucket:
        now, rate = self._clock(), self._rates[whose, what]
        most = max(1.0, rate * _BURST_S[what])
        bucket = self._buckets.setdefault((whose, name, what), _Bucket(most, now))
        bucket.level = min(most, bucket.level + rate * (now - bucket.at))
        bucket.at = now
        return bucket

    def _forget(self) -> None:
        if len(self._buckets) > _MOST_BUCKETS:
            now = self._clock()
            self._buckets = {k: b for k, b in self._buckets.items() if now - b.at < 3600.0}


def account_name(key: str) -> str:
    """A key's or user's identity as it is told to its owner."""
    return key[:8]


def _payers(account: Account) -> list[tuple[str, str]]:
    paying = [("key", account.key)]
    return paying if account.operator is None else [*paying, ("operator", account.operator)]
