"""The chance of crossing the limit before the next inspection, held against lives that are run to their end.

``python -m benchmarks.crossing`` judges simulated pumps that wear out to the limit, and healthy ones, in every world of
the study (a seed that no tuning has used). Every twentieth record is asked for the chance of crossing within 50 flight
hours, as the service states it, and answered by what the pump did. Kept as ``benchmarks/results/crossing.json``.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from benchmarks import keep
from detectors.evaluation.reality import REALITIES
from detectors.evaluation.rows import HEALTHY, LIFE, LONG_LIFE, PLAIN_ROWS, Row, with_burst
from detectors.evaluation.scores import proportion
from detectors.evaluation.sensing import HOURS_PER_FLIGHT
from detectors.evaluation.study import Outcome, joined, judged
from detectors.judgement.version import twin_version
from detectors.words.numbers import Z_90
from detectors.words.thresholds import effective
from detectors.words.verdict import ESTIMATES
from service.reading.forecast import METRIC, crossing_of_trend
from service.studies.evaluation.forecasts import points_to
from twin.pumps import circuit_parameters, pump_type

SEED = 20_261_130
WITHIN_H = 50.0
"""The usual interval of inspections [flight hours]."""
EVERY = 10
"""Records between two askings: neighbours share nearly all of their errors."""
WARNED = 0.05
"""Chance from which somebody is warned (estimate: one in twenty before the next inspection is worth a look)."""
BINS = (0.0, 0.02, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0)


@dataclass(frozen=True)
class Asked:
    """One asking: what was stated, and whether it happened; ``left_h`` to the crossing, NaN without one."""

    pump: int
    stated: float | None
    happened: bool
    left_h: float


def asked(outcome: Outcome, limit: float) -> Iterator[Asked]:
    """Every asking whose 50 hours are over by the end of the history, also of pumps whose level has crossed already.

    Leaving those out would ask only the pumps that have not crossed, which nobody knows when the chance is stated.
    """
    column = list(ESTIMATES).index(METRIC)
    for pump, flights in enumerate(outcome.flight):
        n = int((flights >= 0).sum())
        above = np.flatnonzero(outcome.case_flow[pump, :n] >= limit)
        end = float(flights[above[0]]) if len(above) else np.nan
        for record in range(EVERY, n, EVERY):
            left = (end - flights[record]) * HOURS_PER_FLIGHT
            if not left <= WITHIN_H and (flights[n - 1] - flights[record]) * HOURS_PER_FLIGHT < WITHIN_H:
                break
            mean, low, high = outcome.estimates[pump, record, column]
            sd = (high - low) / (2.0 * Z_90)
            beyond = float(ndtr((mean - limit) / sd)) if sd > 0.0 else None
            chance = crossing_of_trend(points_to(outcome, pump, record), limit, WITHIN_H)
            if beyond is not None and (chance is not None or beyond > 0.5):
                chance = max(beyond, chance or 0.0)
            yield Asked(pump, chance, bool(left <= WITHIN_H), left)


def table(found: list[Asked]) -> dict[str, object]:
    """Calibration over bins of the stated chance, and crossings of which nobody was warned."""
    given = [a for a in found if a.stated is not None]
    stated, happened = np.array([a.stated for a in given]), np.array([a.happened for a in given], dtype=float)
    place = np.clip(np.searchsorted(BINS, stated, side="right") - 1, 0, len(BINS) - 2)
    rows, error = [], 0.0
    for k in range(len(BINS) - 1):
        at = place == k
        if at.any():
            said, was = float(stated[at].mean()), float(happened[at].mean())
            error += abs(said - was) * at.mean()
            rows.append({"from": BINS[k], "to": BINS[k + 1], "askings": int(at.sum()), "stated": said, "happened": was})
    ahead = [a for a in found if 0.0 < a.left_h <= WITHIN_H]
    ends = {a.pump for a in ahead}
    warned = {a.pump for a in ahead if a.stated is not None and a.stated >= WARNED}
    idle = [a for a in found if not a.happened]
    return {
        "askings": len(found),
        "answered": len(given) / max(len(found), 1),
        "calibration_error": float(error),
        "bins": rows,
        "crossings": len(ends),
        "crossings_without_a_warning": score(len(ends) - len(warned), len(ends)),
        "warned_although_none_followed_within_50_h": score(sum((a.stated or 0.0) >= WARNED for a in idle), len(idle)),
    }


def score(n: int, of: int) -> dict[str, float] | None:
    """Share with its 95 % interval."""
    if of == 0:
        return None
    found = proportion(n, of)
    return {"share": found.value, "low": found.low, "high": found.high}


def outcome_of(row: Row, n_pumps: int) -> Outcome:
    """``n_pumps`` of a row in each world."""
    kind, circuit = pump_type("h225"), circuit_parameters("shared_return")
    return joined([judged(row, r, kind, circuit, effective({}, kind), SEED, 0, n_pumps) for r in REALITIES])


def main(n_pumps: int = 12) -> None:
    """Judge, ask, count."""
    rows = {r.name: r for r in (*PLAIN_ROWS, *with_burst(PLAIN_ROWS))}
    found: dict[str, object] = {"twin": twin_version(pump_type("h225")), "seed": SEED, "pumps_per_world": n_pumps}
    names = (LIFE, LONG_LIFE, f"{LIFE}; burst", f"{LONG_LIFE}; burst", HEALTHY)
    every: list[Asked] = []
    for i, name in enumerate(names):
        limit = rows[name].limit or 1.5
        these = list(asked(outcome_of(rows[name], n_pumps), limit))
        found[name] = table(these)
        every += [Asked(a.pump + 100_000 * i, a.stated, a.happened, a.left_h) for a in these]
    found["all"] = table(every)
    keep("crossing", found)


if __name__ == "__main__":
    main(*(int(a) for a in sys.argv[1:]))
