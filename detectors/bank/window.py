"""One window's numbers as a bank takes them."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from detectors.bank.hypotheses import UNMEASURED_RESERVOIR_WALK_BAR
from detectors.bank.prediction import N_MEASURED
from detectors.bank.regulation import N_FEATURES
from detectors.bank.shapes import Array, Freed, History, Integers, Reading

_UNSEEN = np.full(N_FEATURES, np.nan)
_UNSEEN.flags.writeable = False


@dataclass(frozen=True, slots=True)
class Measurement:
    """One window's numbers with their noise.

    Attributes
    ----------
    values, noise
        Discharge pressure, case pressure and zero [bar], order n of both pressures over the twin's [-], line at once
        per revolution of discharge pressure [bar], shape (6,), and their covariance, shape (6, 6).
    seen
        Which of them were measured, in rising order, shape (k,).
    anchor, ripple
        The nominal twin at the window's condition (``detectors.expectation.anchor``), and how its order n of either pressure
        answers to each component, shape (2, N_COMPONENTS).
    reservoir_measured
        False where the pump type's nominal reservoir pressure stands in for a sensor.
    regulation
        Logarithms of how the pressure is regulated (``detectors.bank.regulation``), NaN where not seen, shape (N_FEATURES,).
    """

    values: Array
    noise: Array
    seen: Integers
    anchor: Array
    ripple: Array
    reservoir_measured: bool
    regulation: Array = field(default_factory=lambda: _UNSEEN)

    def with_noise(self, noise: Array) -> "Measurement":
        """The same with another covariance, shape (6, 6)."""
        return Measurement(
            self.values, noise, self.seen, self.anchor, self.ripple, self.reservoir_measured, self.regulation
        )

    @property
    def reading(self) -> Reading:
        """What the filters take of it."""
        return Reading(self.anchor, self.ripple, self.values, self.noise, self.seen)


def nothing_freed() -> Freed:
    """Nothing has happened yet."""
    return Freed(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0), np.empty(0))


def history_of(learnt: Sequence[tuple[Measurement, ...]], before: int, freed: Freed) -> History:
    """Measurements of the records that were learnt since a base, which had ``before`` records; ``freed`` since then."""
    numbered = [(i, m) for i, measurements in enumerate(learnt) for m in measurements]
    seen = np.zeros((len(numbered), N_MEASURED), dtype=np.bool_)
    for place, (_, m) in enumerate(numbered):
        seen[place, m.seen] = True
    return History(
        anchors=np.array([m.anchor for _, m in numbered]),
        ripples=np.array([m.ripple for _, m in numbered]),
        values=np.array([m.values for _, m in numbered]),
        noises=np.array([m.noise for _, m in numbered]),
        seen=seen,
        record=np.array([before + i for i, _ in numbered]),
        wander=np.array([0.0 if m.reservoir_measured else UNMEASURED_RESERVOIR_WALK_BAR**2 for _, m in numbered]),
        freed=freed,
    )
