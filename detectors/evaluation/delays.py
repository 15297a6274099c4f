"""How near the judge comes to the least delay on small steps: its chart, its alarm, and a detector that knows all.

Information fades: whatever is unknown of a pump wanders, and a filter takes a step for such a wander in the end. So a
step gives away a finite amount, and some steps are found by nobody. The reference is Page's chart of the true log
likelihood ratio, with the step's size and course known and the same records between false alarms; delays of steps that
were not found count up to the end of the row, which makes every mean a lower bound.
"""

import math

import numpy as np
from numpy.typing import NDArray

from detectors.evaluation.operating import log_odds
from detectors.evaluation.scores import N_DRAWS, Score, bootstrap, proportion, time_between_false_alarms
from detectors.evaluation.scoring import Seen
from detectors.evaluation.small_steps import ARL, chart_threshold

Array = NDArray[np.float64]

INFORMATION = "information [nat a record] on the way to log ARL"
LEAST_DELAY = "log ARL / KL [records]"
CHART, ALARM, INFORMED = "evidence chart", "alarm", "a detector that knows size and course"
CHART_FALSE_ALARMS = "false alarms of the evidence chart per 10,000 records before the step"
FLOORED = "steps below the smallest size worth a word"
_N_PATHS = 100
"""Simulated courses of one detector (estimate: the study's own pumps scatter more)."""


def mean_delay(of: str) -> str:
    """Name of the mean delay of one detector."""
    return f"mean delay of the {of} [records]" if of != INFORMED else f"mean delay of {of} [records]"


def excess(of: str) -> str:
    """Name of a mean delay less 5 records over ``LEAST_DELAY``."""
    return f"{mean_delay(of).removesuffix(' [records]')} less 5 records, over log ARL / KL"


def found_by(of: str) -> str:
    """Name of the share of steps that a detector found before the row ends."""
    return f"steps found by the {of}" if of != INFORMED else f"steps found by {of}"


def delay_scores(found: Seen, seed: int) -> dict[str, Score]:
    """Scores of a row of small steps; pumps that were in alarm at the step are left out, as is usual.

    Delays count the step's own record: 1 is the least.
    """
    odds = log_odds(found)
    chart = odds >= chart_threshold()
    alarm = found.alarmed
    rng = np.random.default_rng(seed)
    onset = np.array([int(np.argmax(line)) if line.any() else -1 for line in found.after])
    held = np.array([n >= 0 and not (chart[i, n - 1] or alarm[i, n - 1]) for i, n in enumerate(onset)])
    pumps = np.flatnonzero(held)
    if not len(pumps):
        return {}
    gains = [found.outcome.information[i, onset[i] : found.last[i] + 1] for i in pumps]
    least = np.array([_least(gain) for gain in gains])
    delays = {
        CHART: [_first(chart[i, onset[i] : found.last[i] + 1]) for i in pumps],
        ALARM: [_first(alarm[i, onset[i] : found.last[i] + 1]) for i in pumps],
    }
    before = int(
        sum(chart_episodes(chart[i, : onset[i]], found.judged[i, : onset[i]]) for i in np.flatnonzero(onset >= 0))
    )
    records = int(sum(found.judged[i, : onset[i]].sum() for i in np.flatnonzero(onset >= 0)))
    between = time_between_false_alarms(before, max(records, 1))
    result = {
        INFORMATION: bootstrap(_mean, math.log(ARL) / least, seed=seed, n_draws=N_DRAWS),
        LEAST_DELAY: bootstrap(_mean, least, seed=seed, n_draws=N_DRAWS),
        CHART_FALSE_ALARMS: Score(1e4 * before / max(records, 1), 1e4 / between.high, 1e4 / between.low),
        FLOORED: proportion(int((~found.outcome.faulty[pumps, found.last[pumps]]).sum()), len(pumps)),
    }
    ends = np.array([float(len(gain)) for gain in gains])
    for name, values in delays.items():
        late = np.minimum(np.array(values), ends)
        result[found_by(name)] = proportion(int(np.isfinite(values).sum()), len(values))
        result |= _means(name, late, least, seed)
    paths = [_informed(gain, rng) for gain in gains]
    shares = np.array([np.isfinite(p).mean() for p in paths])
    result[found_by(INFORMED)] = bootstrap(_mean, shares, seed=seed, n_draws=N_DRAWS)
    late = np.array([np.minimum(p, end).mean() for p, end in zip(paths, ends, strict=True)])
    return result | _means(INFORMED, late, least, seed)


def chart_episodes(above: NDArray[np.bool_], judged: NDArray[np.bool_]) -> int:
    """Times that a chart came to stand above its threshold on judged records."""
    at = above & judged
    return int(at[:1].sum() + (at[1:] & ~at[:-1]).sum())


def _means(name: str, late: Array, least: Array, seed: int) -> dict[str, Score]:
    pairs = np.column_stack([late, least])
    return {
        mean_delay(name): bootstrap(_mean, late, seed=seed, n_draws=N_DRAWS),
        excess(name): bootstrap(
            lambda x: float((x[:, 0].mean() - 5.0) / x[:, 1].mean()), pairs, seed=seed, n_draws=N_DRAWS
        ),
    }


def _least(gain: Array) -> float:
    """Records until the information adds up to ``log ARL``; all of them where it does not."""
    reached = np.cumsum(gain) >= math.log(ARL) - 1e-9
    return float(np.argmax(reached) + 1) if reached.any() else float(len(gain))


def _first(above: NDArray[np.bool_]) -> float:
    return float(np.argmax(above) + 1) if above.any() else math.inf


def _informed(gain: Array, rng: np.random.Generator) -> Array:
    """Delays of Page's chart of the true log likelihood ratio: increments N(gain, 2 gain), shape (n_paths,)."""
    steps = gain + np.sqrt(2.0 * gain) * rng.normal(size=(_N_PATHS, len(gain)))
    sums = np.zeros(_N_PATHS)
    delay = np.full(_N_PATHS, math.inf)
    for j, step in enumerate(steps.T, 1):
        sums = np.maximum(sums, 0.0) + step
        delay = np.where((sums >= evidence_threshold(ARL)) & np.isinf(delay), float(j), delay)
    return delay


def _mean(values: Array) -> float:
    return float(values.mean())


def evidence_threshold(arl: float) -> float:
    """``ln(arl)`` [nat]: with a true likelihood ratio at least ``arl`` records lie between false alarms.

    Lorden (1971), Annals of Mathematical Statistics 42, 1897.
    """
    if not arl > 1.0:
        raise ValueError(f"arl is {arl:g}; it must exceed 1 record")
    return math.log(arl)
