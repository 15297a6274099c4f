"""A bank of extended Kalman filters, one per hypothesis and onset, all with the twin inside.

Each filter keeps its own state, its own robust weights and its own evidence: weights taken from a common healthy
filter would kill the very evidence that a fault brings. Predictive densities are Student-t (5 degrees of
freedom), so that one outlier costs a hypothesis a bounded amount.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from detectors.state_model import FAULT, FAULT_KINDS, INDEX, Scene, predicted, prior, walk_variance
from twin.parameters import Circuit, PumpType

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

STUDENT_DEGREES = 5.0
HEALTHY = -1
_FIRST_RECORDS = 5
_FIRST_ITERATIONS = 3
_LOG_HAZARD = float(np.log(1.0e-3))
"""Prior of one kind of fault setting in within the spacing of onset candidates (estimate: rare, not absurd)."""
_LOG_GROWTH = float(np.log(3.0e-3))
"""Prior of one kind of fault growing slowly at any time (estimate)."""
SPAWN_EVERY = 4
MOST_ONSETS = 5
_STEP_WALK = 0.03
_GROWTH_WALK = 0.10
"""Walk of a fault amplitude from record to record, as a share of its scale: sudden and growing faults."""


@dataclass(frozen=True)
class Bank:
    """Filters side by side; the first is the healthy hypothesis.

    Attributes
    ----------
    mean, covariance
        Shapes (m, N_STATE) and (m, N_STATE, N_STATE).
    kind
        Index into ``FAULT_KINDS``, -1 for healthy, shape (m,).
    onset
        Record number at which the fault sets in; -1 for a growing one that is alive throughout, shape (m,).
    log_evidence
        Log of prior times product of predictive densities, shape (m,).
    records
        Number of records seen.
    """

    mean: Array
    covariance: Array
    kind: Integers
    onset: Integers
    log_evidence: Array
    records: int

    @property
    def component(self) -> Integers:
        """State component that each filter's fault moves, -1 for the healthy one, shape (m,)."""
        table = np.array([INDEX[k.component] for k in FAULT_KINDS] + [HEALTHY])
        return table[self.kind]

    @property
    def log_odds(self) -> Array:
        """Log posterior weight of each filter, one-sided faults weighed by the sign they came out with, (m,)."""
        sign = np.array([k.sign for k in FAULT_KINDS] + [0])[self.kind]
        spread = np.sqrt(np.maximum(self.covariance[:, FAULT, FAULT], 1e-300))
        with np.errstate(over="ignore"):
            right = log_ndtr(self.mean[:, FAULT] / spread) + np.log(2.0)
        return self.log_evidence + np.where(sign == 1, right, 0.0)


@dataclass(frozen=True, slots=True)
class Measurement:
    """One record's three numbers with their noise covariance; a zero that was not measured has a huge variance."""

    values: Array
    noise: Array
    scene: Scene


def new_bank(pump: PumpType) -> Bank:
    """Bank of a fresh installation: the healthy pump alone, with the population's spread."""
    mean, sd = prior(pump)
    return Bank(mean[None, :], np.diag(sd**2)[None, :, :], np.array([HEALTHY]), np.array([0]), np.zeros(1), 0)


def scales() -> Array:
    """One-sigma size of each kind of fault, healthy last, shape (len(FAULT_KINDS) + 1,)."""
    return np.array([k.scale for k in FAULT_KINDS] + [0.0])


def updated(bank: Bank, measurement: Measurement, pump: PumpType, circuit: Circuit) -> Bank:
    """The bank after one more record: predict, weigh, update every filter."""
    covariance = bank.covariance + np.diag(walk_variance())
    share = np.where(bank.onset < 0, _GROWTH_WALK, _STEP_WALK)
    covariance[:, FAULT, FAULT] += (share * scales()[bank.kind]) ** 2
    iterations = _FIRST_ITERATIONS if bank.records < _FIRST_RECORDS else 1
    point = bank.mean
    log_density = np.zeros(len(bank.mean))
    mean, posterior = bank.mean, covariance
    for iteration in range(iterations):
        y, slopes, solved = predicted(point, bank.component, measurement.scene, pump, circuit)
        # the innovation about the prior mean, through the slopes at the current point (iterated filter)
        innovation = measurement.values - y - np.einsum("mij,mj->mi", slopes, bank.mean - point)
        innovation_cov = np.einsum("mij,mjk,mlk->mil", slopes, covariance, slopes) + measurement.noise
        innovation[~solved], slopes[~solved] = 0.0, 0.0
        innovation_cov[~solved] = np.eye(3)
        weighted = np.linalg.solve(innovation_cov, innovation[:, :, None])[:, :, 0]
        distance = np.einsum("mi,mi->m", innovation, weighted)
        if iteration == 0:
            log_density = _student_log_density(distance, innovation_cov)
            log_density[~solved] = log_density.min(initial=0.0) - 20.0
        inflation = np.maximum(1.0, (STUDENT_DEGREES + distance) / (STUDENT_DEGREES + 3.0))
        robust = innovation_cov + (inflation - 1.0)[:, None, None] * measurement.noise
        gain = np.linalg.solve(robust, np.einsum("mij,mjk->mik", slopes, covariance)).transpose(0, 2, 1)
        mean = bank.mean + np.einsum("mij,mj->mi", gain, innovation)
        posterior = covariance - np.einsum("mij,mjk,mlk->mil", gain, robust, gain)
        point = mean
    posterior = 0.5 * (posterior + posterior.transpose(0, 2, 1))
    return replace(
        bank,
        mean=mean,
        covariance=posterior,
        log_evidence=bank.log_evidence + log_density,
        records=bank.records + 1,
    )


def with_growth(bank: Bank) -> Bank:
    """The bank with one slowly growing fault of each kind, started from the healthy posterior."""
    return _with_faults(bank, np.full(len(FAULT_KINDS), -1), np.zeros(len(FAULT_KINDS)), _LOG_GROWTH)


def with_onsets(bank: Bank) -> Bank:
    """The bank with a sudden fault of each kind setting in now; the least likely old onset of a kind gives way."""
    n = len(FAULT_KINDS)
    grown = _with_faults(bank, np.full(n, bank.records), scales()[:n] ** 2, _LOG_HAZARD)
    keep = np.ones(len(grown.kind), dtype=bool)
    weight = grown.log_odds
    for kind in range(n):
        places = np.flatnonzero((grown.kind == kind) & (grown.onset >= 0) & (grown.onset < bank.records))
        if len(places) >= MOST_ONSETS:
            keep[places[np.argmin(weight[places])]] = False
    return _subset(grown, keep)


def with_reset(bank: Bank, components: tuple[str, ...], pump: PumpType) -> Bank:
    """The bank after maintenance that touched ``components``: their spread is the population's again.

    Faults of those components are forgotten with what they were.
    """
    places = np.array([INDEX[name] for name in components], dtype=np.int64)
    keep = ~np.isin(bank.component, places)
    kept = _subset(bank, keep)
    _, sd = prior(pump)
    covariance = kept.covariance.copy()
    covariance[:, places, :] = 0.0
    covariance[:, :, places] = 0.0
    covariance[:, places, places] = sd[places] ** 2
    return replace(kept, covariance=covariance)


def _with_faults(bank: Bank, onset: Integers, variance: Array, log_prior: float) -> Bank:
    n = len(FAULT_KINDS)
    mean = np.repeat(bank.mean[:1], n, axis=0)
    covariance = np.repeat(bank.covariance[:1], n, axis=0)
    covariance[:, FAULT, FAULT] = variance
    return replace(
        bank,
        mean=np.concatenate((bank.mean, mean)),
        covariance=np.concatenate((bank.covariance, covariance)),
        kind=np.concatenate((bank.kind, np.arange(n))),
        onset=np.concatenate((bank.onset, onset)),
        log_evidence=np.concatenate((bank.log_evidence, np.full(n, bank.log_evidence[0] + log_prior))),
    )


def _subset(bank: Bank, keep: NDArray[np.bool_]) -> Bank:
    return replace(
        bank,
        mean=bank.mean[keep],
        covariance=bank.covariance[keep],
        kind=bank.kind[keep],
        onset=bank.onset[keep],
        log_evidence=bank.log_evidence[keep],
    )


def _student_log_density(distance: Array, covariance: Array) -> Array:
    """Log density of a 3-variate Student-t up to a constant common to all filters, shape (m,)."""
    log_det: Array = np.linalg.slogdet(covariance)[1]
    density: Array = -0.5 * log_det - 0.5 * (STUDENT_DEGREES + 3.0) * np.log1p(distance / STUDENT_DEGREES)
    return density
