"""What a fleet's healthy pumps say of their population: spreads learnt from many installations.

Every pump's healthy filter holds what differs about that pump as mean and variance. The mean of their squares over the
fleet is one step of expectation-maximisation from the spread that the filters began with (Dempster, Laird and Rubin
1977): it never overshoots, whatever the filters think of their sensors, and leaves a spread alone that no record spoke
of. Learning again with the learnt pump type goes a step further. A few pumps move it little.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from detectors.bank.bank import HEALTHY
from detectors.bank.hypotheses import prior
from detectors.expectation.components import PLACE
from detectors.judgement.assessment import Fold
from detectors.words.verdict import FAULTS, State
from twin.parameters import PumpType

Array = NDArray[np.float64]

FEWEST_PUMPS = 8
"""Pumps below which nothing is learnt."""
FEWEST_RECORDS = 24
"""Records of an installation before its pump counts: what is known of it by then is its own."""
_COMPONENTS: Mapping[str, tuple[str, ...]] = {
    "pump_leakage_scale": ("ln_slipper", "ln_laminar"),
    "pressure_setting_bar": ("setting",),
    "drain_resistance_scale": ("ln_drain",),
    "system_leakage_lpm": ("system_orifice", "system_laminar"),
    "case_zero_bar": ("case_offset",),
}
"""Spreads of ``PumpType.population``, and the components whose prior they are in proportion to.

Droop and the drain's weights are not learnt: their posteriors are far from Gaussian, and one step made the droop of a
simulated fleet narrower where it was wider."""
_WORTH = 10.0
"""Pumps that the spread before is worth (our choice)."""
_WORTH_RECORDS = 5000
"""Records that a stated rate is worth (our choice: some five faults of each kind must be found before it gives way)."""
MOST_TIMES = 5.0
"""How many times the stated rate, or which part of it, findings may make of it (our choice)."""
_TOLD = 0.9
"""A pump has said something of a component whose variance has fallen to this share of the prior's."""
_N_DRAWS = 500
"""Resamples of the fleet (estimate: a spread is then known to some per cent)."""


@dataclass(frozen=True, slots=True)
class Posterior:
    """What one healthy pump's records say of its state with the prior: mean and variance, shapes (N_STATE,)."""

    mean: Array
    variance: Array


@dataclass(frozen=True, slots=True)
class Spread:
    """A spread of the population: as it was and as the fleet has it, with the 90 % interval (pumps resampled), in ``unit``.

    ``pumps`` had something to say about it.
    """

    name: str
    unit: str
    before: float
    value: float
    low: float
    high: float
    pumps: int


@dataclass(frozen=True, slots=True)
class Rate:
    """How often a fault sets in, in 1000 records: as it was and as findings have it, with the 90 % interval.

    ``cases`` are findings of it, ``records`` those of the pumps that they were made on.
    """

    name: str
    unit: str
    before: float
    value: float
    low: float
    high: float
    cases: int
    records: int


def learnt_rates(cases: Mapping[State, int], records: int, pump: PumpType) -> tuple[Rate, ...]:
    """Rates of onset from what the workshop found, as gamma posteriors: a few findings move them little.

    Parameters
    ----------
    cases
        Faults found, by state; entries that ended a deviation count as findings.
    records
        Of all pumps that could have had them, sound ones as well.

    Notes
    -----
    A rate stays within ``MOST_TIMES`` of what the pump type states: what is found more often is also looked for more often.
    """
    found = []
    for state in FAULTS:
        name = f"{state.value}_onsets"
        stated = pump.population[name]
        shape, rate = stated.value * _WORTH_RECORDS / 1000.0 + cases.get(state, 0), (_WORTH_RECORDS + records) / 1000.0
        mean, low, high = (
            min(max(v, stated.value / MOST_TIMES), stated.value * MOST_TIMES)
            for v in (shape / rate, *(float(gammaincinv(shape, q)) / rate for q in (0.05, 0.95)))
        )
        found.append(Rate(name, stated.unit, stated.value, mean, low, high, cases.get(state, 0), records))
    return tuple(found)


def posterior_of(fold: Fold) -> Posterior | None:
    """What a fold holds of its pump; None where the pump is not judged healthy, or not known well enough yet."""
    verdict, bank = fold.verdict, fold.bank
    healthy = verdict is not None and verdict.state is State.HEALTHY and bank.filters.kind[0] == HEALTHY
    if not healthy or fold.used < FEWEST_RECORDS:
        return None
    return Posterior(bank.filters.mean[0].copy(), np.diag(bank.filters.covariance[0]).copy())


def learnt(posteriors: Sequence[Posterior], pump: PumpType) -> tuple[Spread, ...]:
    """Spreads of the population from its healthy pumps.

    Parameters
    ----------
    posteriors
        One for each pump, all begun from the prior of ``pump``.

    Raises
    ------
    ValueError
        when there are too few pumps.
    """
    if len(posteriors) < FEWEST_PUMPS:
        raise ValueError(
            f"{len(posteriors)} healthy pumps of type {pump.name} have {FEWEST_RECORDS} records or more; "
            f"{FEWEST_PUMPS} are needed to learn from"
        )
    mean, sd = prior(pump)
    return tuple(_spread(name, posteriors, pump, mean, sd) for name in _COMPONENTS)


def _spread(name: str, posteriors: Sequence[Posterior], pump: PumpType, mean: Array, sd: Array) -> Spread:
    places = [PLACE[component] for component in _COMPONENTS[name]]
    # squares over the variance before, shape (n_pumps, n_components)
    squares = np.array(
        [[((p.mean[k] - mean[k]) ** 2 + p.variance[k]) / sd[k] ** 2 for k in places] for p in posteriors]
    )
    told = np.array([any(p.variance[k] < _TOLD * sd[k] ** 2 for k in places) for p in posteriors])
    by_pump, n = squares.mean(axis=1), len(posteriors)
    draws = np.random.default_rng(0).integers(0, n, (_N_DRAWS, n))
    factors = np.sqrt((_WORTH + by_pump[draws].sum(axis=1)) / (_WORTH + n))
    factor = math.sqrt((_WORTH + by_pump.sum()) / (_WORTH + n))
    quantity = pump.population[name]
    low, high = (quantity.value * float(q) for q in np.quantile(factors, (0.05, 0.95)))
    return Spread(name, quantity.unit, quantity.value, quantity.value * factor, low, high, int(told.sum()))
