"""SIGKILL of servers and of the database at random moments under load: nothing lost, nothing doubled, the same verdicts.

``python -m benchmarks.kills [MINUTES] [FIRST_SEED]`` adds its runs to ``benchmarks/results/kills.json``. On Postgres two
servers share the work: one is killed at a random moment, in every second round the database too, which comes back in
recovery; the killed server stays away until the other one, of another name, has done all of its work: that is a takeover, its
seconds count from the kill. Then it starts again, and the next round kills the other. On SQLite the one server is killed
three times in a round and started again at once.
"""

import json
import random
import sys
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from statistics import median
from typing import Any

from benchmarks import RESULTS
from benchmarks.disturbed import Round, Server, StoppablePostgres, installation, undisturbed

N, WITHIN_S = 8, 60.0


def kills(
    kind: str, minutes: float, seed: int, after_each: Callable[[dict[str, Any]], None] = lambda _: None
) -> dict[str, Any]:
    """Rounds of load and kills on one kind of database, for so long, at least one; what is found goes to ``after_each``."""
    found: dict[str, Any] = {"first_seed": seed, "rounds": 0, "kills": Counter(), "faults": [], "takeovers_s": []}
    with installation(kind, 2 if kind == "postgres" else 1) as (servers, postgres):
        expected = undisturbed(servers[0].url, N)
        end = time.monotonic() + 60.0 * minutes
        while found["rounds"] == 0 or time.monotonic() < end:
            number = seed + found["rounds"]
            load = Round(f"K{number}", N)
            rng = random.Random(number)  # noqa: S311 - a moment, no secret
            with ThreadPoolExecutor(8) as pool:
                futures = load.work([server.url for server in servers], pool)
                if postgres is None:
                    witness, done = _often(servers[0], rng, found["kills"]), _nothing
                    since = time.monotonic()
                else:
                    victim, witness = servers[number % 2], servers[1 - number % 2]
                    since = _once(victim, postgres, rng, found["kills"])
                    done = victim.start
                for future in futures:
                    future.result()
            if load.settled(witness.url, 240.0) is None:
                found["faults"].append(f"round {number}: not done after 240 s")
            else:
                found["takeovers_s"].append(round(time.monotonic() - since, 1))
                found["faults"] += [f"round {number}: {fault}" for fault in load.faults(witness.url, expected)]
            done()
            for server in servers:
                server.await_ready()
            found["rounds"] += 1
            after_each(found)
            print(kind, number, found["takeovers_s"][-1:], dict(load.answers), found["faults"][-3:], flush=True)
    return found


def _often(server: Server, rng: random.Random, count: Counter[str]) -> Server:
    for _ in range(3):
        time.sleep(rng.uniform(0.05, 2.0))
        server.kill()
        count["server"] += 1
        server.start()
        server.await_ready()
    return server


def _once(victim: Server, postgres: StoppablePostgres, rng: random.Random, count: Counter[str]) -> float:
    time.sleep(rng.uniform(0.05, 4.0))
    victim.kill()
    count["server"] += 1
    since = time.monotonic()
    if rng.random() < 0.5:
        time.sleep(rng.uniform(0.0, 3.0))
        postgres.kill()
        count["database"] += 1
    return since


def _nothing() -> None: ...


def _summed(runs: list[dict[str, Any]]) -> dict[str, Any]:
    seconds = sorted(s for run in runs for s in run["takeovers_s"])
    return {
        "rounds": sum(run["rounds"] for run in runs),
        "kills": dict(sum((Counter(run["kills"]) for run in runs), Counter())),
        "done_after_last_kill_s": {"median": median(seconds or [0.0]), "most": max(seconds, default=0.0)},
        "done_within_60_s": sum(s <= WITHIN_S for s in seconds),
        "faults": [fault for run in runs for fault in run["faults"]],
    }


def main() -> None:
    """Run, and add to what earlier runs have found; a run that is interrupted counts as far as it came."""
    minutes = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    file = RESULTS / "kills.json"
    runs: dict[str, list[dict[str, Any]]] = {"postgres": [], "sqlite": []}
    if file.exists():
        runs = json.loads(file.read_text())["runs"]
    for kind, share in (("postgres", 0.75), ("sqlite", 0.25)):
        before = list(runs[kind])

        def save(found: dict[str, Any], kind: str = kind, before: list[dict[str, Any]] = before) -> None:
            runs[kind] = [*before, found]
            text = json.dumps({**{each: _summed(runs[each]) for each in runs if runs[each]}, "runs": runs}, indent=1)
            file.write_text(text + "\n", encoding="utf-8")

        kills(kind, share * minutes, seed, save)
    print(file.read_text())


if __name__ == "__main__":
    main()
