"""Requests that are wrong in any place, by the hundred thousand, on both databases: what is answered, and what it costs.

``python -m benchmarks.wrong_requests [CASES [SEED [sqlite|postgres]]]`` adds its runs to ``benchmarks/results/wrong_requests.json``;
each 2,500 cases have a fresh database and the next seed. Every case is a
route's good request with a few parts replaced (``tests/service/mutations.py``); a fault is an answer of 500, a status
that the API's document does not have, a problem that is no problem document, a 405 without its ``Allow``.
"""

import asyncio
import json
import resource
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest import mock

import structlog

from benchmarks import RESULTS, keep
from service.storage.database import upgrade
from service.web.api_document.document import openapi_document
from tests.postgres import cluster, create_database
from tests.service import lent_application
from tests.service.guarded import guarded_client, key
from tests.service.matrix import seeded
from tests.service.mutations import Mutations, Referee, answered

N_CASES, SEED = 5000, 1
_LONGEST_S = 60.0
_ROUND = 2500
"""Cases on one database: what they leave behind makes lists longer and later ones slower."""


@contextmanager
def databases(kind: str, n: int) -> Iterator[list[str]]:
    """URLs of fresh databases."""
    with TemporaryDirectory() as folder:
        if kind == "sqlite":
            yield [f"sqlite:///{folder}/{i}.sqlite" for i in range(n)]
            return
        with cluster() as server:
            yield [create_database(server, f"wrong{i}") for i in range(n)]


def measured(kind: str, n_cases: int, seed: int) -> dict[str, Any]:
    """Statuses and faults of a number of cases on one kind of database."""
    statuses: Counter[int] = Counter()
    faults: Counter[str] = Counter()
    seconds, before = time.perf_counter(), _memory_mb()
    rounds = -(-n_cases // _ROUND)
    with databases(kind, rounds) as urls:
        for i, url in enumerate(urls):
            upgrade(url)
            _asked(url, min(_ROUND, n_cases - i * _ROUND), seed + i, statuses, faults)
    return {
        "cases": statuses.total(),
        "statuses": {str(s): n for s, n in sorted(statuses.items())},
        "faults": dict(sorted(faults.items())),
        "seconds": round(time.perf_counter() - seconds, 1),
        "memory_mb": {"before": before, "highest": _memory_mb()},
    }


def _asked(url: str, n: int, seed: int, statuses: Counter[int], faults: Counter[str]) -> None:
    with (
        TemporaryDirectory() as folder,
        mock.patch("service.notifications.guard._resolved", return_value=["93.184.215.14"]),
        guarded_client(url, Path(folder)) as client,
        mock.patch("service.jobs.engine.submit"),
    ):
        names = seeded(client, "north", "P-1")
        document = openapi_document(client.app)  # type: ignore[arg-type]
        keys = [key(client, "admin", operator)["Authorization"].encode() for operator in (None, "north")]
        referee = Referee(document)

        async def asked() -> None:
            for case in islice(Mutations(seed, names, keys, document), n):
                answer = await asyncio.wait_for(answered(client.app, case), _LONGEST_S)
                statuses[answer.status] += 1
                fault = referee.fault(case, answer)
                if fault is not None:
                    faults[f"{case.method} {case.route[1]}: {fault}"[:300]] += 1

        client.portal.call(asked)  # type: ignore[union-attr]


def _memory_mb() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024


def main() -> None:
    """Run, and add to what earlier runs have seen; a run of the same seed takes the other's place."""
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(50))
    n_cases, seed = (int(word) for word in (sys.argv[1:3] + [str(N_CASES), str(SEED)][len(sys.argv[1:3]) :]))
    place = RESULTS / "wrong_requests.json"
    for kind in sys.argv[3:] or ("sqlite", "postgres"):
        runs = json.loads(place.read_text())["runs"] if place.exists() else []
        found = {"seed": seed, "database": kind, **measured(kind, n_cases, seed)}
        runs = [r for r in runs if (r["seed"], r["database"]) != (seed, kind)] + [found]
        faults = sum((Counter(r["faults"]) for r in runs), Counter())
        keep("wrong_requests", {"cases": sum(r["cases"] for r in runs), "faults": faults, "runs": runs})


if __name__ == "__main__":
    try:
        main()
    finally:
        lent_application.close()  # its thread would keep the process
