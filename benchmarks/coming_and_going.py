"""Faults on half of the flights: how soon the verdict says that they come and go, and whether they are forgotten.

``python -m benchmarks.coming_and_going [--pumps N] [--seed S]`` writes ``benchmarks/results/coming_and_going.json``. The fault sets in at
flight 40 of 85 and shows on flights drawn one by one; ``detectors.evaluation.reality`` draws everything else.
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks import RESULTS
from detectors.evaluation.reality import REALITIES, fleet
from detectors.evaluation.rows import OnSomeFlights
from detectors.evaluation.sensing import Sensing, histories
from detectors.evaluation.study import seed_of
from detectors.judgement.assessment import assess
from detectors.words.states import State
from detectors.words.thresholds import effective
from detectors.words.verdict import Assessment
from twin.pumps import circuit_parameters, pump_type

PUMP, CIRCUIT = pump_type("h225"), circuit_parameters("shared_return")
ONSET, WITHIN, FLIGHTS, CHUNK = 40, 30, 85, 5
ROWS = (
    ("pump leakage 0.6 L/min", ("slippers", "port plate"), 0.6, State.PUMP_DEGRADATION),
    ("system leakage 3 L/min", ("system",), 3.0, State.SYSTEM_LEAKAGE),
    ("drain +100 %", ("drain",), 1.0, State.DRAIN_RESTRICTION),
)


def main(options: Sequence[str] | None = None) -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pumps", type=int, default=25, help="pumps a row and reality")
    parser.add_argument("--seed", type=int, default=23)
    given = parser.parse_args(options)
    found = []
    for name, kinds, amount, state in ROWS:
        faults, pumps = OnSomeFlights(kinds, amount, onset=ONSET), []
        for k, reality in enumerate(REALITIES):
            for chunk in range(given.pumps // CHUNK):
                rng = seed_of(given.seed, "coming and going", name, reality.name, chunk)
                courses = faults.courses(CHUNK, FLIGHTS, chunk + k)
                flown = fleet(reality, PUMP, CIRCUIT, rng, CHUNK, FLIGHTS, courses)
                seen = histories(flown, PUMP, Sensing(), rng)
                pumps += [_said(assess(h, PUMP, CIRCUIT, effective({})), state) for h in seen]
        shares = {key: round(100.0 * sum(p[key] for p in pumps) / len(pumps), 1) for key in pumps[0]}
        found.append({"row": name, "pumps": len(pumps), "percent": shares})
        print(json.dumps(found[-1]), flush=True)
    document = {"seed": given.seed, "onset": ONSET, "flights": FLIGHTS, "rows": found}
    Path(RESULTS / "coming_and_going.json").write_text(json.dumps(document, indent=1) + "\n")


def _said(assessed: Sequence[Assessment], state: State) -> dict[str, Any]:
    """What is said of one pump, as truth values."""
    of = [(int(a.record_id), a.verdict) for a in assessed]
    early = [v for flight, v in of if ONSET <= flight < ONSET + WITHIN]
    last = of[-1][1]
    return {
        "said to come and go within 30 flights": any(v.intermittent is not None for v in early),
        "said at the end": last.intermittent is not None,
        "said at the end, of the right state": last.intermittent is not None and last.intermittent.state is state,
        "right state or among the candidates at the end": state in (last.state, *last.candidates),
        "healthy without memory from flight 30 on": any(
            v.state is State.HEALTHY and v.intermittent is None for flight, v in of if flight >= ONSET + WITHIN
        ),
    }


if __name__ == "__main__":
    main()
