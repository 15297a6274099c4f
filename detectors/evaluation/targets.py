"""What we ask of the judge, as data: our own targets, met or not by the point estimate, its interval beside it."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from detectors.evaluation.delays import ALARM, CHART, excess
from detectors.evaluation.lives import covered_at, near_at
from detectors.evaluation.rows import BURST, GROUND_RUNS, HEALTHY, LIFE, LONG_LIFE, SMALL_STEP, SMALL_STEP_KINDS
from detectors.evaluation.scores import Score
from detectors.evaluation.scoring import (
    ACCUSED,
    COVERED,
    FALSE_ALARMS,
    PUMP_FROM_30,
    PUMP_WITHIN_20,
    RIGHT_OR_CANDIDATE,
    RIGHT_SIDE_OR_OPEN,
    SIZE_95,
    SIZE_MEDIAN,
    at_end,
    ever,
)
from detectors.evaluation.summary import (
    ALL_REALITIES,
    CONFIDENCE_ERROR,
    CONFIDENCE_ERROR_FROM_ONSET,
    EACH_ERROR,
    EACH_ERROR_FROM_ONSET,
    POOLED,
    Pooled,
    RowResult,
    scope_of_leak,
)
from detectors.words.verdict import Side, State


class Scope(StrEnum):
    """Over which realities a target is asked."""

    ALL = "all realities together"
    EACH = "in each reality"
    ORIFICE = "orifice law of the system leakage"
    LAMINAR = "laminar law of the system leakage"


@dataclass(frozen=True, slots=True)
class Target:
    """One wish: ``low`` <= value <= ``high``, of a row with or without a burst in each window.

    ``note`` says how the quantity stands for the words of the wish, where they are not the same.
    """

    row: str
    burst: bool
    quantity: str
    low: float = -math.inf
    high: float = math.inf
    scope: Scope = Scope.ALL
    note: str = ""

    @property
    def full_row(self) -> str:
        """Name of the study's row."""
        return self.row + (BURST if self.burst else "")


@dataclass(frozen=True, slots=True)
class Finding:
    """A target beside what was found; ``met`` is None where nothing was counted."""

    target: Target
    scope: str
    score: Score
    met: bool | None


UNEVEN_AT_50_LPM = 0.013
"""What three of nine pistons with 50 % more clearance add at the reference: (1.5^3 - 1) / 3 of the pistons' leakage."""
NOT_SIMULATED: tuple[str, ...] = ("real rig: its own benchmark",)
"""Targets that this study does not ask, and why."""


def _pair(row: str, quantity: str, plain: tuple[float, float], burst: tuple[float, float], note: str) -> list[Target]:
    return [Target(row, b, quantity, *ends, note=note) for b, ends in ((False, plain), (True, burst))]


def _least(row: str, quantity: str, plain: float, burst: float | None = None, note: str = "") -> list[Target]:
    """At least so much, without and with a burst."""
    return _pair(row, quantity, (plain, math.inf), (plain if burst is None else burst, math.inf), note)


def _most(row: str, quantity: str, plain: float, burst: float | None = None, note: str = "") -> list[Target]:
    """At most so much, without and with a burst."""
    return _pair(row, quantity, (-math.inf, plain), (-math.inf, plain if burst is None else burst), note)


def _leaking_circuit(row: str, *, burst: bool, note: str = "") -> list[Target]:
    """The circuit named and the pump hardly ever, by either law of the leak."""
    return [
        target
        for scope in (Scope.ORIFICE, Scope.LAMINAR)
        for target in (
            Target(row, burst, at_end(Side.SYSTEM), low=0.90, scope=scope, note=note),
            Target(row, burst, at_end(Side.PUMP), high=0.03, scope=scope, note=note),
        )
    ]


def _clogged_drain(row: str, note: str = "") -> list[Target]:
    """The pump hardly ever accused and the drain among what is left, without a burst."""
    return [
        Target(row, False, PUMP_FROM_30, high=0.02, note=note),
        Target(row, False, ever(Side.PUMP), high=0.05, note=note),
        Target(row, False, RIGHT_OR_CANDIDATE, low=0.98, note=note),
    ]


_LEAK, _SYSTEM, _DRAIN, _WORN = "pump leakage 0.6 L/min", "system leakage 3 L/min", "drain +30 %", "worn on arrival"
_UNEVEN, _EDGE = "uneven wear", "edge radius x10"
_REST = "what is not `pump` is `indeterminate` with pump among the candidates, but for the share allowed to `system`"
_CALIBRATED = (
    "a fault is true where it exceeds its floor; rows in the judge's own prior proportion of faults, every judged record, "
    "bins of equal mass"
)
_FROM_ONSET = "older reading: a fault is true from its onset on, seen or not; every row with the same weight"
_OWN = "of ours beside the table that was asked: the burst's figures where there are any, else the window's"
_FADES = (
    "steps not found count up to the end of the row; what is unknown wanders, so that a step fades: see beside it what a "
    "detector reaches that knows size and course"
)
_FROM_INSTALLATION = (
    "life from the installation to the first flight at the limit; no forecast is a miss of alpha-lambda"
)
TARGETS: tuple[Target, ...] = (
    *(Target(HEALTHY, burst, FALSE_ALARMS, high=1.0, scope=Scope.EACH) for burst in (False, True)),
    *_most(_LEAK, SIZE_MEDIAN, 0.12, 0.10),
    *_most(_LEAK, SIZE_95, 0.22, 0.18),
    *_least(_LEAK, at_end(Side.PUMP), 0.80, 0.90),
    *_most(_LEAK, at_end(Side.SYSTEM), 0.02, 0.01),
    *_least(_LEAK, RIGHT_OR_CANDIDATE, 0.98, 0.99, note=_REST),
    Target(_UNEVEN, True, at_end(Side.PUMP), low=0.98),
    Target(_UNEVEN, True, SIZE_MEDIAN, high=UNEVEN_AT_50_LPM, note="leakage of three pistons with +50 % clearance"),
    Target(_SYSTEM, False, at_end(Side.SYSTEM), low=0.85, scope=Scope.ORIFICE),
    Target(_SYSTEM, False, at_end(Side.PUMP), high=0.01, scope=Scope.ORIFICE),
    Target(_SYSTEM, False, at_end(Side.PUMP), high=0.10, scope=Scope.LAMINAR),
    *_leaking_circuit(_SYSTEM, burst=True),
    *_clogged_drain(_DRAIN),
    Target(_DRAIN, True, at_end(State.DRAIN_RESTRICTION), low=0.90),
    Target(HEALTHY + GROUND_RUNS, False, FALSE_ALARMS, high=1.0, scope=Scope.EACH, note=_OWN),
    Target(_LEAK + GROUND_RUNS, False, at_end(Side.PUMP), low=0.80, note=_OWN),
    Target(_LEAK + GROUND_RUNS, False, at_end(Side.SYSTEM), high=0.02, note=_OWN),
    *_leaking_circuit(_SYSTEM + GROUND_RUNS, burst=False, note=_OWN),
    *_clogged_drain(_DRAIN + GROUND_RUNS, _OWN),
    *_least("setting 1.5 bar", at_end(State.COMPENSATOR_FAULT), 0.95),
    *_least("setting 3 bar", at_end(State.COMPENSATOR_FAULT), 0.99),
    *(
        target
        for row in (_EDGE, f"{_EDGE}, closed-centre valve")
        for target in _least(row, at_end(State.COMPENSATOR_FAULT), 0.65, 0.90)
    ),
    *(
        target
        for row in ("jamming, sticking spool", "jamming, stuck spool")
        for target in _least(row, at_end(State.COMPENSATOR_FAULT), 0.65, 0.95)
    ),
    *_most("case zero +0.06 bar", ACCUSED, 0.01),
    *_most("reservoir +1 bar", ACCUSED, 0.01),
    *_most("case zero +0.06 bar, zero not measured", ACCUSED, 0.03),
    *_most("reservoir +1 bar, reservoir not measured", ACCUSED, 0.03),
    *_most("reservoir not measured", ACCUSED, 0.03),
    *_least(_WORN, PUMP_WITHIN_20, 0.85, 0.90),
    *_most(HEALTHY, PUMP_WITHIN_20, 0.005, note="healthy pumps taken for worn on arrival"),
    *_least("two faults: pump 0.6, system 1 L/min", RIGHT_SIDE_OR_OPEN, 0.92, 0.95),
    *_least("two faults: setting 3 bar, drain +30 %", RIGHT_SIDE_OR_OPEN, 0.92, 0.95),
    *(
        Target(SMALL_STEP + kind, burst, excess(of), high=1.5, note=_FADES)
        for kind in SMALL_STEP_KINDS
        for burst in (False, True)
        for of in (CHART, ALARM)
    ),
    *(
        target
        for life in (LIFE, LONG_LIFE)
        for target in (
            *_pair(life, covered_at(0.5), (0.75, 0.90), (0.75, 0.90), _FROM_INSTALLATION),
            *_least(life, near_at(0.5), 0.70, note=_FROM_INSTALLATION),
        )
    ),
    Target(POOLED, False, CONFIDENCE_ERROR, high=0.05, note="of the largest probability; " + _CALIBRATED),
    Target(POOLED, False, EACH_ERROR, high=0.05, note="of all six probabilities, one by one; " + _CALIBRATED),
    Target(POOLED, False, CONFIDENCE_ERROR_FROM_ONSET, high=0.05, note=_FROM_ONSET),
    Target(POOLED, False, EACH_ERROR_FROM_ONSET, high=0.05, note=_FROM_ONSET),
    *(Target(POOLED, False, name, low=0.85, high=0.95) for name in COVERED.values()),
)


def findings(
    results: Sequence[RowResult], pools: Sequence[Pooled] = (), targets: Iterable[Target] = TARGETS
) -> list[Finding]:
    """Each target beside what the study found; rows that were not run are left out."""
    by_name = {r.row.name: r for r in results}
    found = []
    for target in targets:
        pool = next((p for p in pools if target.row == POOLED and p.burst is target.burst), None)
        result = by_name.get(target.full_row)
        if pool is not None:
            found.append(_finding(target, ALL_REALITIES, pool.scores))
        elif result is not None:
            scopes = _scopes(target.scope, result)
            found.extend(_finding(target, scope, result.scopes[scope].scores) for scope in scopes)
    return found


def _finding(target: Target, scope: str, scores: Mapping[str, Score]) -> Finding:
    score = scores.get(target.quantity, Score(math.nan, math.nan, math.nan))
    met = None if math.isnan(score.value) else target.low <= score.value <= target.high
    return Finding(target, scope, score, met)


def _scopes(scope: Scope, result: RowResult) -> tuple[str, ...]:
    if scope is Scope.EACH:
        return result.realities
    leaks = {Scope.ORIFICE: "orifice", Scope.LAMINAR: "laminar"}
    wanted = scope_of_leak(leaks[scope]) if scope in leaks else ALL_REALITIES
    return (wanted,) if wanted in result.scopes else ()
