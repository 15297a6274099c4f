"""Pumps that change places, judged each by itself and together with the pump that sat there before.

``python -m benchmarks.exchanges [--pairs N] [--seed S] [--row NAME] [--bursts]`` writes ``benchmarks/results/exchanges.json``. In each pair
two pumps of different aircraft, all of it drawn as in ``detectors.evaluation.reality``, change places at flight 60 of 110. What
is wrong with the first pump goes with it; what is wrong with its aircraft awaits the second.
"""

import argparse
import json
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from benchmarks import RESULTS
from detectors.evaluation.reality import REALITIES, Course, Reality, fleet
from detectors.evaluation.sensing import Sensing, histories
from detectors.evaluation.study import seed_of
from detectors.judgement.assessment import assess
from detectors.judgement.succession import assess_together
from detectors.words.states import Side, State
from detectors.words.thresholds import effective
from detectors.words.verdict import Assessment, Verdict
from twin.pumps import circuit_parameters, pump_type

PUMP, CIRCUIT = pump_type("h225"), circuit_parameters("shared_return")
AT, FLIGHTS = 60, 110
CHUNK = 5


class Row(NamedTuple):
    """A kind of fault that grows to ``amount`` in ``flights`` from flight 10 (pump) or is there from flight 30 (aircraft)."""

    name: str
    kind: str | None
    amount: float
    of_pump: bool


ROWS = (
    Row("nothing wrong", None, 0.0, True),
    Row("wear of 1 L/min", "slippers", 1.0, True),
    Row("wear of 0.6 L/min", "slippers", 0.6, True),
    Row("drain +100 %", "drain", 1.0, False),
    Row("drain x3", "drain", 2.0, False),
    Row("drain +30 %", "drain", 0.3, False),
    Row("system leakage 3 L/min", "system", 3.0, False),
)


def main(options: Sequence[str] | None = None) -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=40, help="pairs a row and reality")
    parser.add_argument("--seed", type=int, default=17)
    parser.add_argument("--row", action="append", help="rows by name; all without")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--out", default=str(RESULTS / "exchanges.json"))
    given = parser.parse_args(options)
    rows = [r for r in ROWS if given.row is None or r.name in given.row]
    found = []
    with ProcessPoolExecutor(given.workers) as pool:
        for row in rows:
            for burst in (False, True):
                tasks = [
                    (row, reality, burst, given.seed, k) for reality in REALITIES for k in range(given.pairs // CHUNK)
                ]
                pairs = [pair for chunk in pool.map(_chunk, tasks) for pair in chunk]
                found.append({"row": row.name, "bursts": burst, "pairs": len(pairs), **_summary(row, pairs)})
                print(json.dumps(found[-1], indent=1), flush=True)
                with open(given.out, "w", encoding="utf-8") as file:
                    json.dump(
                        {"seed": given.seed, "flights": FLIGHTS, "exchanged_at": AT, "rows": found}, file, indent=1
                    )


def _chunk(task: tuple[Row, Reality, bool, int, int]) -> list[dict[str, dict[str, Any]]]:
    row, reality, burst, seed, chunk = task
    rng = seed_of(seed, "exchanges", row.name, reality.name, str(burst), chunk)
    flight, first = np.arange(FLIGHTS), np.arange(2 * CHUNK)[:, None] < CHUNK
    courses: tuple[Course, ...] = ()
    if row.kind is not None and row.of_pump:
        courses = (Course(row.kind, row.amount * np.clip((flight - 9) / 40, 0.0, 1.0) * first),)
    elif row.kind is not None:
        courses = (Course(row.kind, row.amount * np.where(first, (flight >= 30) & (flight < AT), flight >= AT)),)
    flown = fleet(reality, PUMP, CIRCUIT, rng, 2 * CHUNK, FLIGHTS, courses, moved_at=AT, exchanged=True)
    seen = histories(flown, PUMP, Sensing(burst=burst), rng, AT, exchanged=True)
    thresholds = effective({})
    ways = {
        "alone": [assess(h, PUMP, CIRCUIT, thresholds) for h in seen],
        "together": [
            j.assessments
            for i in range(CHUNK)
            for j in assess_together([seen[i], seen[i + CHUNK]], PUMP, CIRCUIT, thresholds)
        ],
    }
    # one pair after the other, as they were judged
    ways["alone"] = [a for i in range(CHUNK) for a in (ways["alone"][i], ways["alone"][i + CHUNK])]
    truth = flown.case_flow_at_reference
    return [
        {
            way: {
                "goes": _said(assessed[2 * i], truth[i]),
                "comes": _said(assessed[2 * i + 1], truth[i + CHUNK]),
            }
            for way, assessed in ways.items()
        }
        for i in range(CHUNK)
    ]


def _said(assessed: Sequence[Assessment], truth: Any) -> dict[str, Any]:
    """What is said of one pump behind the exchange."""
    behind = [(int(a.record_id[:5]), a.verdict) for a in assessed if int(a.record_id[:5]) >= AT]
    flight, last = behind[-1]
    before = [a.verdict for a in assessed if int(a.record_id[:5]) < AT][-1]
    flow = last.estimates["case_flow_at_reference_lpm"]
    return {
        "before": before.state.value,
        "state": last.state.value,
        "side": last.side.value,
        "candidates": [c.value for c in last.candidates],
        "accused": any(v.side is Side.PUMP for _, v in behind),
        "alarmed": any(_is_alarm(v) for _, v in behind),
        "level_error": flow.mean - float(truth[flight]),
        "level_within": bool(flow.low <= truth[flight] <= flow.high),
        "beyond": last.probability_beyond_limit,
        "resolved": None if last.resolved_by is None else [last.resolved_by.state.value, last.resolved_by.action],
        "system_after": next((f - AT for f, v in behind if v.side is Side.SYSTEM), None),
    }


def _is_alarm(verdict: Verdict) -> bool:
    return verdict.state not in (State.HEALTHY, State.INSUFFICIENT_DATA)


def _summary(row: Row, pairs: Sequence[dict[str, dict[str, Any]]]) -> dict[str, Any]:
    return {way: dict(_figures(row, [p[way] for p in pairs])) for way in ("alone", "together")}


def _figures(row: Row, pairs: Sequence[dict[str, Any]]) -> Iterator[tuple[str, Any]]:
    """Shares of the pairs in percent."""

    def share(name: str, which: str, rule: Any) -> tuple[str, float]:
        return name, round(100.0 * sum(bool(rule(p[which])) for p in pairs) / len(pairs), 1)

    def errors(which: str) -> list[float]:
        return sorted(abs(p[which]["level_error"]) for p in pairs)

    for which in ("goes", "comes"):
        yield share(f"{which}: side pump at the end", which, lambda v: v["side"] == "pump")
        yield share(f"{which}: side system at the end", which, lambda v: v["side"] == "system")
        yield share(f"{which}: healthy at the end", which, lambda v: v["state"] == "healthy")
        yield share(f"{which}: ever on the pump's side", which, lambda v: v["accused"])
        yield share(f"{which}: ever an alarm", which, lambda v: v["alarmed"])
        yield share(f"{which}: resolved by the exchange", which, lambda v: v["resolved"] is not None)
        yield share(f"{which}: level within 0.15 L/min", which, lambda v: abs(v["level_error"]) <= 0.15)
        yield share(f"{which}: interval holds the level", which, lambda v: v["level_within"])
        error = errors(which)
        yield f"{which}: error of the level, median", round(error[len(error) // 2], 3)
        yield f"{which}: error of the level, mean", round(float(np.mean([p[which]["level_error"] for p in pairs])), 3)
    yield share("goes: pump or undecided with pump", "goes", lambda v: _with(v, "pump_degradation"))
    for state in ("drain_restriction", "system_leakage"):
        yield share(f"comes: {state} or undecided with it", "comes", lambda v, s=state: _with(v, s))


def _with(said: dict[str, Any], state: str) -> bool:
    return said["state"] == state or state in said["candidates"]


if __name__ == "__main__":
    main()
