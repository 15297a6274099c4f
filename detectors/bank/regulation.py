"""How the compensator regulates, watched beside the filter bank: scatter, ripple and frequency of discharge pressure.

A spool that sticks lets the regulated pressure swing; one that is stuck, or whose metering edges are rounded, answers
more slowly. Neither moves the means that the bank lives on, and how restless the consumers are says nothing about
leakage: these numbers share no unknown with the bank's state. Each is therefore followed by a chart of its own, and
what the charts find is weighed against the healthy pump of the bank (``detectors.judgement.isolation``).
"""

import math
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from detectors.bank.regulation_kernel import advance, learn, log_odds, spawn
from detectors.bank.shapes import LEVEL, WARMTH, Array, Charts


class Feature(IntEnum):
    """What is followed, each as a natural logarithm of its number."""

    SCATTER = 0
    """One-sigma of the discharge pressure's samples in a zero-flow window, at any sampling rate [bar]."""
    RIPPLE = 1
    """Root mean square below order 1, from a burst [bar]."""
    FREQUENCY = 2
    """Where that ripple lies, its mean frequency, from a burst [Hz]."""


N_FEATURES = len(Feature)
MOST_ONSETS = 5
"""Onsets of one feature that are kept, as the bank keeps steps of one kind (estimate)."""
LOG_HAZARD = math.log(3.0e-4)
"""Prior of a change of one feature setting in between two onset candidates (estimate)."""
_SIGN = np.array([1.0, 1.0, -1.0])
"""Direction of a fault: a sticking spool swings, a stuck or eroded one is slow. A calmer or quicker pump is no worse."""
_SCALE = np.array([1.5, 1.5, 0.4])
_FLOOR = np.array([0.9, 0.9, 0.15])
"""Size of a fault and the size that is worth a word [-]: consumers double their restlessness, the twin's regulation slows
down by a tenth between 30 and 90 degC and by a quarter where edges are rounded tenfold."""
_NOISE = np.array([0.30, 0.30, 0.06])
"""Spread from flight to flight of a healthy pump [-] (estimates); each chart learns its own from here."""
_LEVEL_SD = np.array([2.0, 2.0, 0.5])
_WARMTH_SD = np.array([0.3, 0.3, 0.10])
"""One-sigma spread between pumps of the level about their first flight and of its change per 30 K [-] (estimates: nothing is
known of the consumers; the twin's frequency falls by a tenth between 30 and 90 degC)."""
_LEVEL_WALK = (np.array([0.01, 0.01, 0.0015]) / _NOISE) ** 2
_SIZE_WALK = (np.array([0.05, 0.05, 0.004]) / _NOISE) ** 2
"""Variance from record to record of a healthy pump's level and of a fault's size, in noise variances (estimates)."""
_SIZE_VARIANCE = (_SCALE / _NOISE) ** 2
_FIRST_HALF_DEGREES = 2.5
_MOST_HALF_DEGREES = 6.0
"""Degrees of freedom, halved, of the Student-t evidence: at first, and once the spread is known. Never more, so that a
single flight with busy consumers stays cheap."""
_MOST_NOISE = 2.0
"""A healthy pump's spread over the expected one, at most: a fault that comes and goes is no noise."""
_MOST_VARIANCE = (_MOST_NOISE * _NOISE) ** 2
_PRESENCE = np.array([9.0, 1.0])
"""Prior flights on which a fault shows and does not (estimate)."""
_CAPACITY = 1 + MOST_ONSETS
"""The healthy filter and every onset."""


def _unknown() -> Charts:
    """Charts of a healthy pump of which nothing is known."""
    charts = Charts(
        mean=np.zeros((N_FEATURES, _CAPACITY, 3)),
        covariance=np.zeros((N_FEATURES, _CAPACITY, 3, 3)),
        half_degrees=np.full((N_FEATURES, _CAPACITY), _FIRST_HALF_DEGREES),
        sum_of_squares=np.zeros((N_FEATURES, _CAPACITY)),
        presence=np.tile(_PRESENCE, (N_FEATURES, _CAPACITY, 1)),
        log_evidence=np.zeros((N_FEATURES, _CAPACITY)),
        n=np.ones(N_FEATURES, dtype=np.int64),
        begun=np.zeros(N_FEATURES, dtype=np.bool_),
    )
    charts.sum_of_squares[:] = (_FIRST_HALF_DEGREES * _NOISE**2)[:, None]
    charts.covariance[:, 0, WARMTH, WARMTH] = (_WARMTH_SD / _NOISE) ** 2
    charts.covariance[:, 0, LEVEL, LEVEL] = (_LEVEL_SD / _NOISE) ** 2
    return charts


@dataclass(slots=True)
class Regulation:
    """Charts of one installation, a healthy filter and up to five onsets each. Changed in place by its methods."""

    charts: Charts = field(default_factory=_unknown)

    def learn(self, values: Array, warmth: float) -> None:
        """Take the features of one window or burst, shape (N_FEATURES,), NaN where one was not seen."""
        learn(self.charts, values, warmth, _MOST_VARIANCE, _MOST_HALF_DEGREES)

    def pass_time(self) -> None:
        """From one record to the next: levels and faults wander."""
        advance(self.charts, _LEVEL_WALK, _SIZE_WALK)

    def spawn(self) -> None:
        """A change of every feature setting in now; the least likely onset gives way."""
        spawn(self.charts, _PRESENCE, _SIZE_VARIANCE, LOG_HAZARD)

    def log_odds(self) -> float:
        """Log of prior odds times evidence of a changed regulation against the healthy pump, over all charts.

        The charts are rivals, not witnesses: ripple and scatter of one flight have one cause, so the larger counts and
        not their product.
        """
        return log_odds(self.charts, _SIGN, _FLOOR)
