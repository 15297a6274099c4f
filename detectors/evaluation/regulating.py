"""How the compensators of a simulated fleet regulate: ripple below order 1 and its frequency, flight by flight.

Levels, spreads and courses are none of the judge's: consumers differ between aircraft and flights, get busier or calmer
over the years, and drive a nonlinear valve to another frequency. What faults do comes from the transient twin
(``benchmarks/regulation.py``).
"""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SWING_PER_FRICTION = 1.2
"""Ripple that a sticking spool draws [bar per N of friction], own valve; a closed-centre valve 3.5."""
STUCK_RIPPLE, STUCK_FREQUENCY = 1.9, 0.27
"""Factors on ripple and frequency of a spool that is stuck at zero flow: discharge drifts with its consumers."""
ERODED_FREQUENCY_PER_UM = -0.29 / 45.0
"""Change of the logarithm of the frequency by rounding of the edges, closed-centre valve; the set's own valve stands
0.4 mm open and shows 0.004 of it at 45 um."""
ERODED_SETTING_BAR_PER_UM = 0.34 / 45.0
"""Shift of the regulated pressure of the closed-centre valve, which the set's own compensator has not."""
OWN_FREQUENCY_PER_UM = -0.004 / 45.0
SHOWS = 0.7
"""Share of flights on which a jam shows at all (estimate)."""


class Coursed(Protocol):
    """A fault's name and its size over the flights."""

    @property
    def kind(self) -> str: ...

    @property
    def size(self) -> Array: ...


def regulation(courses: tuple[Coursed, ...], warmth: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Ripple [bar] and its frequency [Hz] of every flight, shapes (n_pumps, n_flights).

    ``warmth`` is (fluid temperature - 50 degC) / 30 K.
    """
    n_pumps, n_flights = warmth.shape
    one, every = (n_pumps, 1), warmth.shape
    own = rng.normal
    share = np.arange(n_flights) / 250.0
    busy = own(0.0, 1.0, every) * rng.uniform(0.15, 0.5, one) + own(0.0, 0.3, one) * share
    # now and then a consumer works during the window
    busy += np.where(rng.uniform(size=every) < 0.02, 1.1, 0.0)
    ripple = np.exp(np.log(0.4) + own(0.0, 0.7, one) + own(-0.1, 0.15, one) * warmth + busy)
    ln_frequency = np.log(17.0) + own(0.0, 0.25, one) + own(0.0, 0.07, one) * warmth + own(0.0, 0.04, one) * share
    ln_frequency = (
        ln_frequency + rng.uniform(0.0, 0.15, one) * busy + own(0.0, 1.0, every) * rng.uniform(0.03, 0.08, one)
    )
    shows = rng.uniform(size=every) < SHOWS
    unequal, depth = rng.uniform(0.6, 1.4, one), own(0.0, 0.4, every)
    for course in courses:
        if course.kind == "sticking spool":
            swing = SWING_PER_FRICTION * unequal * course.size * shows
            # a limit cycle keeps its own beat, not that of its drive
            ln_frequency = np.where(swing > ripple, np.log(16.4) + 0.1 * (ln_frequency - np.log(17.0)), ln_frequency)
            ripple = np.hypot(ripple, swing)
        elif course.kind == "stuck spool":
            stuck = shows & (course.size > 0.0)
            ripple = np.where(stuck, ripple * STUCK_RIPPLE * np.exp(depth), ripple)
            ln_frequency = np.where(stuck, ln_frequency + np.log(STUCK_FREQUENCY) + 0.4 * depth, ln_frequency)
        elif course.kind == "erosion":
            ln_frequency = ln_frequency + OWN_FREQUENCY_PER_UM * course.size
        elif course.kind == "erosion, closed-centre valve":
            ln_frequency = ln_frequency + ERODED_FREQUENCY_PER_UM * unequal * course.size
    return ripple, np.exp(ln_frequency)
