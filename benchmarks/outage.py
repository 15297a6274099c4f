"""A database that is away for six seconds under load: whether all that was acknowledged is done, and how soon.

``python -m benchmarks.outage [ROUNDS [MINUTES]]`` writes ``benchmarks/results/outage.json``. Postgres is really stopped
(``pg_ctl stop -m immediate``) at a random moment of a round and started six seconds later; SQLite's file is locked for six
seconds by another process' transaction, and for 40 s in every fifth round, longer than anybody waits. Seconds count from the
return. Seeds are the rounds' numbers.
"""

import math
import platform
import random
import sqlite3
import sys
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from statistics import median
from typing import Any

from benchmarks import keep
from benchmarks.disturbed import ARCHIVE, Round, Server, StoppablePostgres, installation, undisturbed

N, AWAY_S, WITHIN_S = 8, 6.0, 60.0
_LONG_S = 40.0


def outage(kind: str, rounds: int, longest_s: float = math.inf) -> dict[str, Any]:
    """Rounds of load with an outage in each of them, on one kind of database, no new one begun after so long."""
    answers: Counter[int] = Counter()
    seconds: list[float] = []
    faults: list[str] = []
    with installation(kind) as (servers, postgres):
        (server,) = servers
        expected = undisturbed(server.url, N)
        end, done = time.monotonic() + longest_s, 0
        for number in range(rounds):
            if time.monotonic() > end:
                break
            done += 1
            rng = random.Random(number)  # noqa: S311 - a moment, no secret
            load = Round(f"R{number}", N)
            with ThreadPoolExecutor(8) as pool:
                futures = load.work([server.url], pool)
                time.sleep(rng.uniform(0.1, 2.5))
                _away(server, postgres, _LONG_S if postgres is None and number % 5 == 4 else AWAY_S)
                returned = time.monotonic()
                for future in futures:
                    future.result()
            if load.settled(server.url, 180.0) is None:
                faults.append(f"round {number}: not done after 180 s")
                continue
            seconds.append(time.monotonic() - returned)
            faults += [f"round {number}: {fault}" for fault in load.faults(server.url, expected)]
            answers += load.answers
            print(kind, number, round(seconds[-1], 1), dict(load.answers), faults[-3:], flush=True)
    return {
        "rounds": done,
        "records_of_a_round": ARCHIVE + 2 * N,
        "done_after_return_s": {
            "median": round(median(seconds or [0.0]), 1),
            "most": round(max(seconds, default=0.0), 1),
        },
        "done_within_60_s": sum(s <= WITHIN_S for s in seconds),
        "answers": {str(status): n for status, n in sorted(answers.items())},
        "faults": faults,
    }


def _away(server: Server, postgres: StoppablePostgres | None, seconds: float) -> None:
    if postgres is not None:
        postgres.stop()
        time.sleep(seconds)
        postgres.start()
        return
    other = sqlite3.connect(server.folder / "casedrain.sqlite", timeout=30.0, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    time.sleep(seconds)
    other.execute("ROLLBACK")
    other.close()


def main() -> None:
    """Measure and keep."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    found = {
        kind: outage(kind, rounds if kind == "postgres" else max(1, rounds // 2)) for kind in ("postgres", "sqlite")
    }
    keep("outage", {"machine": platform.processor() or platform.machine(), "away_s": AWAY_S, **found})


if __name__ == "__main__":
    main()
