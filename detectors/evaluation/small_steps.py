"""Small steps inside the judge's own model class, against the least delay that any detector can have.

The world is the judge's own: its prior, its walks, its reduced twin, its noise. A fault steps in with a size at which
its information, after everything unknown is projected out, is a small number of nat a record. No detector with
``ARL`` records between false alarms finds it sooner than in about ``log ARL / KL`` records in the mean (Lorden 1971;
Lai 1998 for observations that depend on each other); the study asks how near the judge comes.

What a record adds is the Kullback-Leibler divergence of the healthy filter's innovations: a fault of known size and
onset shifts them by what the filter has not yet taken for a nuisance.
"""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from detectors.bank.bank import SPAWN_EVERY, Bank
from detectors.bank.hypotheses import FAULT_KINDS, prior, walk_variance
from detectors.bank.measurement import measured_windows
from detectors.bank.prediction import N_MEASURED, N_SLOPES, predicted
from detectors.bank.tables import DIRECTIONS
from detectors.bank.window import Measurement
from detectors.evaluation.prevalence import hazard_per_record
from detectors.evaluation.reality import Reality, fleet
from detectors.evaluation.rows import Row, SmallStep
from detectors.evaluation.sensing import histories
from detectors.evaluation.study import NAMES, Outcome, blank, seed_of, state_number
from detectors.expectation.components import AMPLITUDE, N_COMPONENTS, N_STATE, RATE
from detectors.judgement.isolation import Alarm, Decision, decided, evidence
from detectors.words.verdict import FAULTS, State
from twin.parameters import Circuit, PumpType

Array = NDArray[np.float64]

ARL = 10_000.0
"""Records between false alarms that the delay is asked at."""


def chart_threshold(arl: float = ARL) -> float:
    """Log odds [nat] at which the judge's evidence has at least ``arl`` records between false alarms in its own world.

    Its odds are the sum of likelihood ratios over all onsets times the hazard: a Shiryaev-Roberts statistic, whose
    value less the number of records is a martingale, so that the sum reaches ``arl`` no sooner in the mean (Pollak
    1985).
    """
    return math.log(arl * hazard_per_record())


def judged_in_class(
    row: Row,
    reality: Reality,
    pump: PumpType,
    circuit: Circuit,
    thresholds: Mapping[str, float],
    seed: int,
    chunk: int,
    n_pumps: int,
) -> Outcome:
    """Simulate and judge one chunk of a row whose course is a ``SmallStep``; conditions and gaps as in ``reality``.

    ``Outcome.size`` is the size of the step in the fault's own unit, ``information`` what each record adds to find it.

    Raises
    ------
    ValueError
        If the row's course is no ``SmallStep`` or names an unknown kind of fault.
    """
    course = row.course
    kinds = {k.name: i for i, k in enumerate(FAULT_KINDS)}
    if not isinstance(course, SmallStep) or course.kind not in kinds:
        raise ValueError(f"row {row.name!r} is no small step of a kind that the judge has: {', '.join(kinds)}")
    rng = seed_of(seed, row.name, reality.name, chunk)
    flights = fleet(reality, pump, circuit, rng, n_pumps, row.n_flights)
    outcome = blank(n_pumps, row.n_flights)
    for i, history in enumerate(histories(flights, pump, row.sensing, rng)):
        found = measured_windows(history.observations, {}, pump, circuit)
        flown = [int(name) for name in found]
        measurements = [m.measurements[-1] for m in found.values()]
        onset = next((j for j, f in enumerate(flown) if f >= course.onset), len(flown))
        state = _course_of_state(pump, len(flown), rng)
        direction = DIRECTIONS[kinds[course.kind]]
        unit = _information(pump, measurements, state, direction, onset)
        size = _size(unit[onset:], course) * (FAULT_KINDS[kinds[course.kind]].sign or -1)
        amplitude = np.where(np.arange(len(flown)) >= onset, size, 0.0)
        seen = [_drawn(m, x, direction, a, rng) for m, x, a in zip(measurements, state, amplitude, strict=True)]
        _judge(outcome, i, seen, pump, thresholds)
        n = len(flown)
        outcome.flight[i, :n], outcome.size[i, :n], outcome.information[i, :n] = flown, amplitude, unit * size**2
        outcome.faulty[i, :n] = np.abs(amplitude) >= max(FAULT_KINDS[kinds[course.kind]].floor, 1e-12)
    return outcome


def _course_of_state(pump: PumpType, n: int, rng: np.random.Generator) -> Array:
    """A pump's own state drawn from the judge's prior, walking as the judge expects, shape (n, N_STATE)."""
    mean, sd = prior(pump)
    steps = rng.normal(size=(n, N_STATE)) * np.sqrt(walk_variance())
    steps[0] = mean + sd * np.clip(rng.normal(size=N_STATE), -2.0, 2.0)
    return np.cumsum(steps, axis=0)


def _answer(measurement: Measurement, state: Array, direction: Array) -> tuple[Array, Array]:
    """What the sensors show and its slopes, shapes (k,) and (k, N_STATE), of what was measured."""
    y, slopes = np.empty(N_MEASURED), np.empty((N_MEASURED, N_SLOPES))
    predicted(state, direction, measurement.anchor, measurement.ripple, np.empty(N_COMPONENTS), y, slopes)
    return y[measurement.seen], slopes[measurement.seen][:, :N_STATE]


def _information(pump: PumpType, measurements: list[Measurement], state: Array, direction: Array, onset: int) -> Array:
    """What each record adds for a step of size 1, ``nu' S^-1 nu / 2`` [nat], shape (n,); 0 before the onset."""
    _, sd = prior(pump)
    covariance, walk, missed = np.diag(sd**2), np.diag(walk_variance()), np.zeros(N_STATE)
    result = np.zeros(len(measurements))
    for j, (measurement, x) in enumerate(zip(measurements, state, strict=True)):
        covariance = covariance + walk
        _, slopes = _answer(measurement, x, direction)
        noise = measurement.noise[np.ix_(measurement.seen, measurement.seen)]
        gain = np.linalg.solve(slopes @ covariance @ slopes.T + noise, slopes @ covariance).T
        if j >= onset:
            # the column of the amplitude is the fault's own mark; ``missed`` is what the filter took for nuisances
            own = slopes.copy()
            own[:, [AMPLITUDE, RATE]] = 0.0
            shift = slopes[:, AMPLITUDE] - own @ missed
            result[j] = 0.5 * shift @ np.linalg.solve(slopes @ covariance @ slopes.T + noise, shift)
            missed = missed + gain @ shift
        covariance = covariance - gain @ slopes @ covariance
        covariance = 0.5 * (covariance + covariance.T)
    return result


def _size(unit: Array, course: SmallStep) -> float:
    """Size at which the information of the first ``log ARL / information`` records adds up to ``log ARL``."""
    n = math.ceil(math.log(ARL) / course.information)
    gained = float(unit[:n].sum())
    return math.sqrt(math.log(ARL) / gained) if gained > 0.0 else 0.0


def _drawn(
    measurement: Measurement, state: Array, direction: Array, amplitude: float, rng: np.random.Generator
) -> Measurement:
    """The window as the judge's own world would have shown it."""
    x = state.copy()
    x[AMPLITUDE] = amplitude
    y, _ = _answer(measurement, x, direction)
    seen = measurement.seen
    values = measurement.values.copy()
    values[seen] = y + np.linalg.cholesky(measurement.noise[np.ix_(seen, seen)]) @ rng.normal(size=len(seen))
    return replace(measurement, values=values)


def _judge(
    outcome: Outcome, pump_row: int, measurements: list[Measurement], pump: PumpType, thresholds: Mapping[str, float]
) -> None:
    """Take the windows in order, as a fold does after an installation, and write what was said."""
    bank, alarm, baseline = Bank(pump), Alarm(), int(thresholds["baseline_records"])
    for j, measurement in enumerate(measurements):
        bank.learn((measurement,))
        after = j + 1 - baseline
        if after >= 0 and after % SPAWN_EVERY == 0:
            bank.spawn()
        found = evidence(bank, thresholds)
        decision = Decision(State.INSUFFICIENT_DATA)
        if after >= 0:
            alarm, decision = decided(alarm, found, thresholds)
        outcome.state[pump_row, j] = state_number(decision.state)
        outcome.candidates[pump_row, j] = sum(1 << FAULTS.index(c) for c in decision.candidates)
        outcome.probabilities[pump_row, j] = [found.probabilities[s] for s in NAMES]
