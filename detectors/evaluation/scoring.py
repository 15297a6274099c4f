"""What a row of a study shows: shares, sizes, delays and rates from the judged pumps, each with its interval.

An alarm is every state but ``healthy`` and ``insufficient_data``; an episode is an unbroken run of alarms. Pumps are
independent of each other, records of one pump are not: what is counted per record is resampled by pumps.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from detectors.evaluation.rows import Row
from detectors.evaluation.scores import (
    Score,
    bootstrap,
    detection_delay,
    episodes,
    proportion,
    time_between_false_alarms,
)
from detectors.evaluation.study import STATES, Outcome
from detectors.words.states import QUIET
from detectors.words.verdict import ESTIMATES, FAULTS, SIDE_OF, Side, State

Array = NDArray[np.float64]
Truths = NDArray[np.bool_]

SIDES: tuple[Side, ...] = tuple(Side)
FALSE_ALARMS = "false alarms per 10,000 records"
DETECTED = "alarm after the onset"
SIZE_MEDIAN, SIZE_95 = "size at the alarm, median", "size at the alarm, 95 %"
DELAY_MEDIAN, DELAY_95 = "delay, median", "delay, 95 %"
RIGHT_OR_CANDIDATE = "at the end: right state, or among the candidates"
RIGHT_SIDE_OR_OPEN = "at the end: right side or indeterminate"
ACCUSED = "ever: pump or system accused"
PUMP_WITHIN_20 = "within 20 flights: pump_degradation"
PUMP_FROM_30 = "from 30 flights after the onset on: side pump"
COVERED: Mapping[str, str] = {
    name: f"90 % intervals of {name} hold the truth"
    for name in ("pump_leakage_change_lpm", "case_flow_at_reference_lpm")
}
_N_DRAWS = 1000
_OUTSIDE = 1.0e12
"""Stands for a size or a delay that was never reached: sorts behind all others without being infinite."""
_ACCUSING = tuple(s for s in STATES if SIDE_OF[s] in (Side.PUMP, Side.SYSTEM))


def at_end(of: State | Side) -> str:
    """Name of the share of pumps that are in a state, or have it on a side, at their last record."""
    return f"at the end: {_word(of)}"


def ever(of: State | Side) -> str:
    """Name of the share of pumps that are in a state or on a side at any record after the onset."""
    return f"ever: {_word(of)}"


def first_call(of: State | Side) -> str:
    """Name of the share of pumps whose first named fault after the onset is this one, or on this side."""
    return f"first call: {_word(of)}"


def _word(of: State | Side) -> str:
    return f"side {of.value}" if isinstance(of, Side) else of.value


@dataclass(frozen=True)
class Seen:
    """Outcomes of a row with what every score asks of them, arrays of shape (n_pumps, n_records)."""

    row: Row
    outcome: Outcome
    judged: Truths
    """A verdict was possible: a record, and more than ``insufficient_data``."""
    alarmed: Truths
    after: Truths
    """Judged records from the onset on; all of them in a row without one."""
    side: NDArray[np.int64]
    """Index into ``SIDES``; of ``indeterminate`` the side that its candidates share."""
    last: NDArray[np.int64]
    """Last record of each pump, shape (n_pumps,)."""


def seen(row: Row, outcome: Outcome) -> Seen:
    """Prepare outcomes for scoring."""
    there = outcome.state >= 0
    quiet = [STATES.index(s) for s in QUIET]
    judged = there & (outcome.state != STATES.index(State.INSUFFICIENT_DATA))
    alarmed = there & ~np.isin(outcome.state, quiet)
    after = judged & (outcome.flight >= (row.onset or 0))
    last = there.shape[1] - 1 - np.argmax(there[:, ::-1], axis=1)
    return Seen(row, outcome, judged, alarmed, after, _sides(outcome), last)


def scores(found: Seen, seed: int) -> dict[str, Score]:
    """Every score that makes sense for the row, by its name above.

    Parameters
    ----------
    found
        Pumps of the row, of one reality or of several.
    seed
        Of the resampling.
    """
    result = {FALSE_ALARMS: false_alarms(found)}
    if found.row.truth is not State.HEALTHY:
        result |= _detection(found, seed)
    return result | _ending(found) | _calls(found) | _accusations(found) | _coverage(found, seed)


@dataclass(frozen=True, slots=True)
class FalseAlarm:
    """An episode on a healthy pump: which pump, first flight, records that it lasted, and what it said at its end."""

    pump: int
    flight: int
    records: int
    state: State


def false_alarm_episodes(found: Seen) -> list[FalseAlarm]:
    """Episodes that begin on healthy records."""
    healthy = _healthy(found)
    outcome = found.outcome
    return [
        FalseAlarm(i, int(outcome.flight[i, first]), last - first + 1, STATES[outcome.state[i, last]])
        for i, (alarmed, allowed) in enumerate(zip(found.alarmed, healthy, strict=True))
        for first, last in episodes(alarmed)
        if allowed[first]
    ]


def false_alarms(found: Seen) -> Score:
    """Episodes that begin on healthy records, per 10,000 of them, with the exact Poisson interval."""
    n, records = len(false_alarm_episodes(found)), int(_healthy(found).sum())
    if not records:
        return Score(math.nan, 0.0, math.inf)
    between = time_between_false_alarms(n, records)
    low = 1.0e4 / between.high if math.isfinite(between.high) else 0.0
    return Score(1.0e4 * n / records, low, 1.0e4 / between.low)


def _healthy(found: Seen) -> Truths:
    return found.judged if found.row.truth is State.HEALTHY else found.judged & ~found.after


def confusion(found: Seen) -> dict[Side, int]:
    """Pumps by the side that their last verdict names."""
    final = found.side[np.arange(len(found.last)), found.last]
    return {side: int((final == k).sum()) for k, side in enumerate(SIDES)}


def suspicion(found: Seen, first: int, last: int) -> Array:
    """Largest probability of any fault on flights ``first`` to ``last`` (not included) of each pump, (n_pumps,)."""
    inside = found.judged & (found.outcome.flight >= first) & (found.outcome.flight < last)
    faulty = np.where(inside, 1.0 - found.outcome.probabilities[..., 0], -np.inf).max(axis=1)
    return np.asarray(faulty[np.isfinite(faulty)])


def alarm_records(found: Seen) -> NDArray[np.int64]:
    """Record of the first episode that begins after the onset, -1 where none does, shape (n_pumps,)."""
    result = np.full(len(found.last), -1)
    for i, (alarmed, after) in enumerate(zip(found.alarmed, found.after, strict=True)):
        if after.any():
            onset = int(np.argmax(after))
            delay = detection_delay(alarmed, onset)
            result[i] = -1 if delay is None else onset + delay
    return result


def has_size(found: Seen) -> bool:
    """Whether the row's fault has a size that runs over the flights."""
    return bool(np.any(found.outcome.size[found.after] != 0.0))


def alarm_sizes(found: Seen) -> Array:
    """True size of the fault at its alarm, without sign; infinite where missed, shape (n_pumps,)."""
    return _at_alarm(found, np.abs(found.outcome.size))


def alarm_delays(found: Seen) -> Array:
    """Flights from the onset to the alarm, infinite where missed, shape (n_pumps,)."""
    return _at_alarm(found, (found.outcome.flight - (found.row.onset or 0)).astype(np.float64))


def _at_alarm(found: Seen, values: Array) -> Array:
    at = alarm_records(found)
    return np.where(at >= 0, values[np.arange(len(at)), np.maximum(at, 0)], np.inf)


def _sides(outcome: Outcome) -> NDArray[np.int64]:
    side = np.full(outcome.state.shape, SIDES.index(Side.UNKNOWN))
    for k, state in enumerate(STATES):
        side[outcome.state == k] = SIDES.index(SIDE_OF[state])
    is_open = outcome.state == STATES.index(State.INDETERMINATE)
    for one in (Side.PUMP, Side.SYSTEM, Side.SENSOR):
        bits = sum(1 << k for k, fault in enumerate(FAULTS) if SIDE_OF[fault] is one)
        shared = (outcome.candidates != 0) & (outcome.candidates & ~bits == 0)
        side[is_open & shared] = SIDES.index(one)
    return side


def _detection(found: Seen, seed: int) -> dict[str, Score]:
    sizes, delays = alarm_sizes(found), alarm_delays(found)
    result = {DETECTED: proportion(int(np.isfinite(delays).sum()), len(delays))}
    if has_size(found):
        result |= {SIZE_MEDIAN: _quantile(sizes, 0.5, seed), SIZE_95: _quantile(sizes, 0.95, seed)}
    return result | {DELAY_MEDIAN: _quantile(delays, 0.5, seed), DELAY_95: _quantile(delays, 0.95, seed)}


def _quantile(values: Array, level: float, seed: int) -> Score:
    """Quantile over pumps, those that never alarmed behind all others."""
    finite = np.where(np.isfinite(values), values, _OUTSIDE)
    rank = math.ceil(level * len(finite)) - 1
    found = bootstrap(lambda x: float(np.sort(x)[rank]), finite, seed=seed, n_draws=_N_DRAWS)
    ends = (math.inf if v > 0.01 * _OUTSIDE else v for v in (found.value, found.low, found.high))
    return Score(*ends)


def _ending(found: Seen) -> dict[str, Score]:
    n = len(found.last)
    pumps = np.arange(n)
    state, side = found.outcome.state[pumps, found.last], found.side[pumps, found.last]
    result = {at_end(s): proportion(int((state == k).sum()), n) for k, s in enumerate(STATES)}
    result |= {at_end(s): proportion(int((side == k).sum()), n) for k, s in enumerate(SIDES)}
    truth = found.row.truth
    right = state == STATES.index(truth)
    is_open = state == STATES.index(State.INDETERMINATE)
    if truth in FAULTS:
        named = found.outcome.candidates[pumps, found.last] & (1 << FAULTS.index(truth)) != 0
        result[RIGHT_OR_CANDIDATE] = proportion(int((right | (is_open & named)).sum()), n)
        sided = side == SIDES.index(SIDE_OF[truth])
        result[RIGHT_SIDE_OR_OPEN] = proportion(int((sided | is_open).sum()), n)
    return result


def _calls(found: Seen) -> dict[str, Score]:
    """Ever, and first call, per state and per side; a call names a fault, which ``indeterminate`` does not."""
    n = len(found.last)
    named = found.after & np.isin(found.outcome.state, [STATES.index(s) for s in FAULTS])
    called = named.any(axis=1)
    first = np.argmax(named, axis=1)
    result = {}
    values: tuple[tuple[NDArray[np.int64], tuple[State | Side, ...]], ...] = (
        (found.outcome.state, STATES),
        (found.side, SIDES),
    )
    for value, names in values:
        at_first = value[np.arange(n), first]
        for k, name in enumerate(names):
            result[ever(name)] = proportion(int(((value == k) & found.after).any(axis=1).sum()), n)
            if name in FAULTS or name in (Side.PUMP, Side.SYSTEM, Side.SENSOR):
                result[first_call(name)] = proportion(int((called & (at_first == k)).sum()), n)
    return result


def _accusations(found: Seen) -> dict[str, Score]:
    n = len(found.last)
    flight, onset = found.outcome.flight, found.row.onset or 0
    accusing = found.after & np.isin(found.outcome.state, [STATES.index(s) for s in _ACCUSING])
    pump = found.after & (found.side == SIDES.index(Side.PUMP)) & (flight >= onset + 30)
    early = found.judged & (found.outcome.state == STATES.index(State.PUMP_DEGRADATION)) & (flight < 20)
    return {
        ACCUSED: proportion(int(accusing.any(axis=1).sum()), n),
        PUMP_FROM_30: proportion(int(pump.any(axis=1).sum()), n),
        PUMP_WITHIN_20: proportion(int(early.any(axis=1).sum()), n),
    }


def _coverage(found: Seen, seed: int) -> dict[str, Score]:
    """Share of judged records whose interval holds the truth; pumps are resampled."""
    truths = {
        "pump_leakage_change_lpm": found.outcome.leakage,
        "case_flow_at_reference_lpm": found.outcome.case_flow,
    }
    names = list(ESTIMATES)
    result = {}
    for name, truth in truths.items():
        low, high = (found.outcome.estimates[:, :, names.index(name), end] for end in (1, 2))
        given = found.judged & np.isfinite(low) & np.isfinite(high)
        inside = given & (low <= truth) & (truth <= high)
        counts = np.column_stack([inside.sum(axis=1), given.sum(axis=1)]).astype(np.float64)
        if given.any():
            counts = counts[counts[:, 1] > 0]
            result[COVERED[name]] = bootstrap(_share, counts, seed=seed, n_draws=_N_DRAWS)
    return result


def _share(counts: Array) -> float:
    return float(counts[:, 0].sum() / counts[:, 1].sum())
