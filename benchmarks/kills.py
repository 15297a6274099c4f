"""SIGKILL of servers, parsers and the database at random moments under load: nothing lost, nothing doubled, the same verdicts.

``python -m benchmarks.kills [MINUTES [FIRST_SEED [postgres|sqlite]]]`` adds its runs to ``benchmarks/results/kills.json``; a seed
fixes the order of kills and the pauses between them. In a round loads follow one another without end while a dozen kills
come: of the servers in turn (two on Postgres, one on SQLite), which start again at once, every fourth time without being
waited for, so that the next kill may fall into a start; of the process that parses for one; on Postgres of the database,
which comes back in recovery. Then all that was sent is compared: every record and item there, once, every verdict that of an
undisturbed load. On Postgres the last server killed stays away until the other one, of another name, has done all of the
work: that is a takeover, its seconds count from the kill. Servers are copies of one process (``benchmarks.mould``).
"""

import json
import random
import sys
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from statistics import median
from threading import Event, Thread
from typing import Any

from benchmarks import RESULTS
from benchmarks.disturbed import Round, Server, StoppablePostgres, installation, undisturbed
from benchmarks.mould import mould

N, WITHIN_S, KILLS = 8, 60.0, 12
"""Uploads of a kind in a load; what a takeover may take [s]; kills of servers in a round."""
_PAUSE_S = 2.0
_STARTS = 10
_OF_PARSER, _OF_DATABASE, _UNAWAITED = 0.2, 0.15, 0.25
"""How often a kill of a server has one of a parser or of the database with it, and how often nobody waits for the start."""


def kills(
    kind: str,
    minutes: float,
    seed: int,
    after_each: Callable[[dict[str, Any]], None] = lambda _: None,
    n_kills: int = KILLS,
) -> dict[str, Any]:
    """Rounds of load and kills on one kind of database, for so long, at least one; what is found goes to ``after_each``."""
    found: dict[str, Any] = {"first_seed": seed, "rounds": 0, "loads": 0, "kills": Counter(), "faults": []}
    found |= {"takeovers_s": [], "settled_s": []}
    with mould() as made, installation(kind, 2 if kind == "postgres" else 1, made) as (servers, postgres):
        expected = undisturbed(servers[0].url, N)
        end = time.monotonic() + 60.0 * minutes
        while found["rounds"] == 0 or time.monotonic() < end:
            number = seed + found["rounds"]
            stream = _Stream(f"K{number}", [server.url for server in servers])
            faults, answers = found["faults"], Counter[int]()
            try:
                away = _killed(servers, postgres, random.Random(number), found["kills"], n_kills)  # noqa: S311
                since = time.monotonic()
            finally:
                stream.end()
            witness = servers[1 - servers.index(away)] if away else servers[0]
            late = [load for load in stream.loads if load.settled(witness.url, 240.0) is None]
            found["takeovers_s" if away else "settled_s"].append(round(time.monotonic() - since, 1))
            for load in stream.loads:
                answers += load.answers
                wrong = ["not done after 240 s"] if load in late else load.faults(witness.url, expected)
                faults += [f"round {number}, load {load.pumps[0]}: {fault}" for fault in wrong]
            faults += [f"round {number}: {fault}" for fault in stream.failures]
            found["rounds"] += 1
            found["loads"] += len(stream.loads)
            if away:
                away.start()
                _back(away)
            after_each(found)
            print(kind, number, len(stream.loads), dict(found["kills"]), dict(answers), faults[-3:], flush=True)
    return found


class _Stream:
    """Loads one after another, until its end is asked for."""

    def __init__(self, name: str, urls: list[str]) -> None:
        self.loads: list[Round] = []
        self.failures: list[str] = []
        self._name, self._urls, self._over = name, urls, Event()
        self._thread = Thread(target=self._run)
        self._thread.start()

    def end(self) -> None:
        """No further load; those begun are answered when this returns."""
        self._over.set()
        self._thread.join()

    def _run(self) -> None:
        with ThreadPoolExecutor(8) as pool:
            while not self._over.is_set():
                load = Round(f"{self._name}-{len(self.loads)}", N)
                self.loads.append(load)
                for future in load.work(self._urls, pool):
                    error = future.exception()
                    if error is not None:
                        self.failures.append(str(error)[:300])


def _killed(
    servers: list[Server], postgres: StoppablePostgres | None, rng: random.Random, count: Counter[str], n_kills: int
) -> Server | None:
    """Kill again and again; the server that is left away, where another one can do its work."""
    first = rng.randrange(len(servers))
    for i in range(n_kills):
        victim = servers[(first + i) % len(servers)]
        time.sleep(rng.uniform(0.05, _PAUSE_S))
        if rng.random() < _OF_PARSER:
            count["parser"] += victim.kill_parser()
            time.sleep(rng.uniform(0.0, _PAUSE_S))
        victim.kill()
        count["server"] += 1
        if postgres and rng.random() < _OF_DATABASE:
            time.sleep(rng.uniform(0.0, _PAUSE_S))
            postgres.kill()
            count["database"] += 1
        if postgres and i == n_kills - 1:
            _back(servers[(first + i + 1) % len(servers)])
            return victim
        victim.start()
        if rng.random() >= _UNAWAITED:
            _back(victim)
    _back(servers[0])
    return None


def _back(server: Server) -> None:
    """Wait for a server; one that ended because its database was away is started again, as a supervisor does."""
    for _ in range(_STARTS):
        try:
            server.await_ready()
        except RuntimeError:
            server.kill()
            server.start()
        else:
            return
    raise RuntimeError("a server does not come back")


def _summed(runs: list[dict[str, Any]]) -> dict[str, Any]:
    seconds = sorted(s for run in runs for s in run["takeovers_s"])
    alone = sorted(s for run in runs for s in run.get("settled_s", []))
    return {
        "rounds": sum(run["rounds"] for run in runs),
        "kills": dict(sum((Counter(run["kills"]) for run in runs), Counter())),
        "loads": sum(run.get("loads", run["rounds"]) for run in runs),
        "takeovers": len(seconds),
        "takeovers_within_60_s": sum(s <= WITHIN_S for s in seconds),
        "taken_over_and_done_s": {"median": median(seconds), "most": seconds[-1]} if seconds else None,
        "done_after_last_start_s": {"median": median(alone), "most": alone[-1]} if alone else None,
        "faults": [fault for run in runs for fault in run["faults"]],
    }


def main() -> None:
    """Run, and add to what earlier runs have found; a run that is interrupted counts as far as it came."""
    minutes = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    shares = {"postgres": 0.75, "sqlite": 0.25} if len(sys.argv) <= 3 else {sys.argv[3]: 1.0}
    file = RESULTS / "kills.json"
    runs: dict[str, list[dict[str, Any]]] = {"postgres": [], "sqlite": []}
    if file.exists():
        runs = json.loads(file.read_text())["runs"]
    for kind, share in shares.items():
        before = list(runs[kind])

        def save(found: dict[str, Any], kind: str = kind, before: list[dict[str, Any]] = before) -> None:
            runs[kind] = [*before, found]
            text = json.dumps({**{each: _summed(runs[each]) for each in runs if runs[each]}, "runs": runs}, indent=1)
            file.write_text(text + "\n", encoding="utf-8")

        kills(kind, share * minutes, seed, save)
    print(file.read_text())


if __name__ == "__main__":
    main()
