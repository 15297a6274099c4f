"""What a bank knows of the position that its pump sits in, and how the bank of the next pump there begins with it.

Drain, leak of the circuit, fluid and sensors stay when a pump is exchanged. Its history there has learnt them together: their
common error is handed on, that of the pump is left out. What may be wrong with them is handed on as hypotheses beside.
"""

import math
from dataclasses import dataclass

import numpy as np

from detectors.bank.bank import HEALTHY, Bank
from detectors.bank.hypotheses import FAULT_KINDS, MEASURED_RESERVOIR_SD_BAR
from detectors.bank.shapes import ARRIVAL, Array, Integers
from detectors.bank.summary import split
from detectors.bank.tables import KINDS, MOST_ONSETS
from detectors.expectation.components import AMPLITUDE, LAW, PLACE, RATE
from detectors.words.verdict import State

OF_POSITION: tuple[str, ...] = (
    *("ln_drain", "drain_viscosity", "drain_flow", "system_orifice", "system_laminar", "case_warmth", "ln_viscosity"),
    *("case_offset", "reservoir"),
    *("load_case", "load_case_square", "load_warmth", "load_discharge", "load_discharge_square"),
)
"""Components that stay when the pump goes."""
_PLACES = np.array([PLACE[name] for name in OF_POSITION])
_WITH_FAULT = np.append(_PLACES, (AMPLITUDE, RATE, LAW))
_EXCHANGED_SD = {"ln_drain": 0.02, "ln_viscosity": 0.02}
"""What an exchange may change: hoses are opened, some litres refilled (estimate: 2 %)."""
_LEAST_LOG_ODDS, _MOST_LOG_ODDS = -7.0, 6.0
"""Log odds of a fault of the position against none below which it is not handed on, and above which it counts no more (our
choice): what the next pump's records say must be able to outweigh what laws that are not the world's have added up."""
_SUSPECTED = 5.0
"""Lead of a fault over health from which its end is worth a word [nat] (estimate: as much as an alarm asks for)."""


@dataclass(frozen=True, slots=True)
class PositionFault:
    """A fault that may be the position's: kind, shape, and log odds against none under either prior [nat].

    ``mean`` and ``covariance`` are those of ``OF_POSITION`` with amplitude, rate and law, shapes (n + 3,) and (n + 3, n + 3);
    ``shown`` are the records on which one that comes and goes showed, as bits.
    """

    kind: int
    shape: int
    stated: float
    alike: float
    mean: Array
    covariance: Array
    shown: int


@dataclass(frozen=True, slots=True)
class Position:
    """What is known of a position where nothing is wrong with it, and what may be.

    ``mean`` and ``covariance`` are those of ``OF_POSITION``, shapes (n,) and (n, n). ``blamed`` is the kind of the likeliest
    fault of the pump that leaves where something was wrong (-1: nothing was).
    """

    mean: Array
    covariance: Array
    faults: tuple[PositionFault, ...]
    blamed: int

    @property
    def wrong(self) -> float:
        """Probability that something is wrong with the position itself."""
        return 1.0 / (1.0 + math.exp(-self.log_odds))

    @property
    def log_odds(self) -> float:
        """Log odds of something being wrong with the position itself [nat]."""
        return math.log(max(sum(math.exp(0.5 * (f.stated + f.alike)) for f in self.faults), 1.0e-12))


def position_of(bank: Bank, whole: Array, by_prior: Array) -> Position:
    """What a bank knows of its position.

    Parameters
    ----------
    whole
        Posterior shares of its filters by all that the data say, shape (m,).
    by_prior
        Those by the tempered likelihood under the stated and the shape-neutral prior, shape (2, m): causes compete by them.
    """
    filters, n = bank.filters, bank.n
    kind, shape = filters.kind[:n], filters.shape[:n]
    shares = shares_of(bank, whole, by_prior)
    stays = _STAYS[kind] >= 0
    none = np.flatnonzero(~stays & (kind != _OTHER))
    by_none = np.maximum(shares[:, none].sum(axis=1), 1.0e-12)
    faults = []
    for k, form in sorted({(int(_STAYS[kind[f]]), int(shape[f])) for f in np.flatnonzero(stays)}):
        rows = np.flatnonzero(stays & (_STAYS[kind] == k) & (shape == form))
        odds = np.log(np.maximum(shares[:, rows].sum(axis=1), 1.0e-12) / by_none)
        if odds.max() < _LEAST_LOG_ODDS or MOST_ONSETS[form, k] == 0:
            continue
        best = int(rows[shares[:, rows].sum(axis=0).argmax()])
        stated, alike = np.clip(odds, _LEAST_LOG_ODDS, _MOST_LOG_ODDS).tolist()
        mean, covariance = filters.mean[best][_WITH_FAULT], filters.covariance[best][np.ix_(_WITH_FAULT, _WITH_FAULT)]
        faults.append(PositionFault(k, form, stated, alike, mean, covariance, int(filters.shown[best])))
    mean, covariance = _together(bank, none, shares[:, none].mean(axis=0))
    return Position(mean, covariance, tuple(faults), _blamed(bank))


def shares_of(bank: Bank, whole: Array, by_prior: Array) -> Array:
    """Shares of a bank's filters under either prior, shape (2, m), arguments as in ``position_of``.

    Whether anything changed follows from all that the data say, which cause from the tempered likelihood.
    """
    shares = np.empty((2, bank.n))
    split(bank.filters.kind, bank.filters.shape, _IS_HEALTHY, whole, by_prior, shares)
    return shares


def settle(bank: Bank, known: Position) -> None:
    """Let a bank go on at a position of which something is known: its history begins anew there.

    The bank must not hold faults of another position any more.
    """
    filters, n, records = bank.filters, bank.n, bank.records
    mean, covariance = known.mean.copy(), known.covariance.copy()
    for name, sd in _EXCHANGED_SD.items():
        covariance[OF_POSITION.index(name), OF_POSITION.index(name)] += sd**2
    for f in range(n):
        _put(bank, f, _PLACES, mean, covariance)
    for fault in known.faults:
        row = bank.n
        for array in filters:
            array[row] = array[0]
        _put(bank, row, _WITH_FAULT, fault.mean, fault.covariance)
        # it set in before anything that this pump has seen
        filters.kind[row], filters.shape[row], filters.onset[row] = fault.kind, fault.shape, records - 1
        filters.log_evidence[row] = filters.log_evidence[0] + fault.stated
        filters.prior[row] = filters.prior[0] + (fault.stated, fault.alike)
        filters.scale[row], filters.shown[row], filters.misfit[row] = KINDS.scales[fault.kind], fault.shown, 0.0
        bank.n += 1
    bank.rebase()


def log_odds_of(bank: Bank, whole: Array, onset: int) -> float:
    """Log odds of what was wrong with the position when its pump came, by filters of this onset [nat].

    ``whole`` are the posterior shares of the filters, shape (m,).
    """
    filters, n = bank.filters, bank.n
    rows = (_STAYS[filters.kind[:n]] >= 0) & (filters.onset[:n] == onset)
    share = min(max(float(whole[rows].sum()), 1.0e-12), 1.0 - 1.0e-12)
    return math.log(share / (1.0 - share))


def exonerate(bank: Bank, before: int, log_ratio: float) -> None:
    """Weigh what was wrong before record ``before``: the position, which was left then, or the pump, which is here.

    ``log_ratio`` is how far what was seen elsewhere speaks for the position [nat]; against it, where it is negative.
    """
    filters, n = bank.filters, bank.n
    rows = (_IS_PUMPS[filters.kind[:n]] | (filters.shape[:n] == ARRIVAL)) & (filters.onset[:n] < before)
    filters.log_evidence[:n][rows] -= log_ratio
    filters.log_evidence[:n] -= filters.log_evidence[:n].max()
    bank.rebase()


def _together(bank: Bank, rows: Integers, weights: Array) -> tuple[Array, Array]:
    """Mean and covariance of the position over some filters by their weights; what a healthy change has moved is moved."""
    filters = bank.filters
    if weights.sum() <= 0.0:
        rows, weights = np.zeros(1, dtype=np.int64), np.ones(1)
    weights = weights / weights.sum()
    mean, second = np.zeros(len(_PLACES)), np.zeros((len(_PLACES), len(_PLACES)))
    for f, weight in zip(rows, weights, strict=True):
        if weight < 1.0e-6:
            continue
        into = np.zeros((len(_PLACES), filters.mean.shape[1]))
        into[np.arange(len(_PLACES)), _PLACES] = 1.0
        if _IS_HEALTHY[filters.kind[f]] and filters.kind[f] != HEALTHY:
            for name, share in FAULT_KINDS[filters.kind[f]].moves:
                if name in OF_POSITION:
                    into[OF_POSITION.index(name), AMPLITUDE] = share
        own = into @ filters.mean[f]
        mean += weight * own
        second += weight * (into @ filters.covariance[f] @ into.T + np.outer(own, own))
    covariance = second - np.outer(mean, mean)
    if not bank.reservoir_measured:
        # what stood in for a sensor says nothing of the next pump's
        k = OF_POSITION.index("reservoir")
        mean[k], covariance[k, :], covariance[:, k] = 0.0, 0.0, 0.0
        covariance[k, k] = MEASURED_RESERVOIR_SD_BAR**2
    return mean, 0.5 * (covariance + covariance.T)


def _put(bank: Bank, row: int, places: Integers, mean: Array, covariance: Array) -> None:
    """Give some components of a filter a mean and a covariance of their own, which nothing else has a part in."""
    own, spread = bank.filters.mean[row], bank.filters.covariance[row]
    spread[places, :] = 0.0
    spread[:, places] = 0.0
    own[places] = mean
    spread[np.ix_(places, places)] = covariance


def _blamed(bank: Bank) -> int:
    """Kind of the likeliest fault of the pump where it is far likelier than health; -1 where none is."""
    filters, n = bank.filters, bank.n
    of_pump = np.flatnonzero(_IS_PUMPS[filters.kind[:n]] & (filters.shape[:n] != ARRIVAL))
    if not len(of_pump):
        return HEALTHY
    likeliest = int(of_pump[filters.log_evidence[of_pump].argmax()])
    is_wrong = filters.log_evidence[likeliest] - filters.log_evidence[0] > _SUSPECTED
    return int(filters.kind[likeliest]) if is_wrong else HEALTHY


def _plain(number: int) -> int:
    """The kind that stays at the position when the pump goes; -1 where nothing of it does."""
    kind = FAULT_KINDS[number]
    if kind.state not in (State.DRAIN_RESTRICTION, State.SYSTEM_LEAKAGE, State.SENSOR_FAULT):
        return -1
    if kind.beside is None:
        return number
    return next(i for i, k in enumerate(FAULT_KINDS) if k.state is kind.state and k.beside is None)


_STAYS = np.array([*(_plain(i) for i in range(len(FAULT_KINDS))), -1])
_IS_HEALTHY = np.array([*(k.state is State.HEALTHY for k in FAULT_KINDS), True])
_IS_PUMPS = np.array([*(k.state in (State.PUMP_DEGRADATION, State.COMPENSATOR_FAULT) for k in FAULT_KINDS), False])
_OTHER = next(i for i, k in enumerate(FAULT_KINDS) if k.state is State.OTHER)
"""By kind, the healthy pump (-1) last."""
