"""Shapes that the bank and its kernels hand on: NamedTuples of plain arrays, which compiled code takes.

N is the size of a state (``detectors.expectation.components.N_STATE``), M counts filters, K kinds of fault, R measurements.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


STEP, RAMP, ARRIVAL, ON_OFF, OPEN = range(5)
"""Shapes of a fault: there at once, growing, there from the first record on, coming and going, and none that is known."""
N_SHAPES = 5
STATED, ALIKE = range(2)
"""Columns of a filter's priors: as stated, and with the same shapes for every cause."""
REMEMBERED = 20
"""Records of which a filter remembers whether it explained them, and whether its fault showed."""


class Filters(NamedTuple):
    """Filters side by side, first axis M.

    Attributes
    ----------
    mean, covariance
        Of the state, shapes (M, N) and (M, N, N).
    kind, shape, onset
        Index into ``FAULT_KINDS`` (-1: healthy), one of the shapes, and the record number at which the fault sets in.
    log_evidence
        Log of stated prior times product of predictive densities [nat].
    setting_at_onset
        The setting when the fault set in [bar].
    scale
        One-sigma size that the fault was expected to have when it set in, in its kind's unit.
    prior
        Logarithms of the stated and of the shape-neutral prior [nat], shape (M, 2).
    misfit
        Largest squared distance of a window of the record that is being taken, over the largest that counts as explained.
    unexplained, shown
        The last ``REMEMBERED`` records as bits, the latest lowest: was it not explained, and did the fault show.
    """

    mean: Array
    covariance: Array
    kind: Integers
    shape: Integers
    onset: Integers
    log_evidence: Array
    setting_at_onset: Array
    scale: Array
    prior: Array
    misfit: Array
    unexplained: Integers
    shown: Integers


class Walks(NamedTuple):
    """Variances by which the state wanders from record to record.

    Attributes
    ----------
    state
        Of a healthy pump's state, shape (N,).
    amplitude, rate, setting
        Of a fault's amplitude and of its rate by shape and kind, shape (N_SHAPES, K + 1), and of the setting on top of its own
        by kind, shape (K + 1,); the healthy pump last.
    """

    state: Array
    amplitude: Array
    rate: Array
    setting: Array


class Reading(NamedTuple):
    """One measurement as a filter takes it.

    Attributes
    ----------
    anchor, ripple
        The nominal twin at the condition (``detectors.expectation.anchor``), and how order n of either pressure answers to each
        component, shape (2, N_COMPONENTS).
    values, noise
        What was measured, shape (6,), and its covariance, shape (6, 6).
    seen
        Which of the six were measured, in rising order.
    """

    anchor: Array
    ripple: Array
    values: Array
    noise: Array
    seen: Integers


class Freed(NamedTuple):
    """Components that something made unknown again before a record was taken, in order of the records, first axis E.

    ``record`` is the number of that record, ``place`` the component's place in a state, ``mean`` and ``variance`` what
    is known of it from then on; a mean of NaN leaves it as it was and adds the variance.
    """

    record: Integers
    place: Integers
    mean: Array
    variance: Array


class History(NamedTuple):
    """Measurements in order, first axis R: those of a ``Reading`` one after another.

    ``seen`` says of each of the six whether it was measured, shape (R, 6); ``record`` to which record each belongs, shape (R,);
    ``wander`` is the variance by which the reservoir pressure wandered before it on top of its own, shape (R,).
    ``freed`` is what happened on the way.
    """

    anchors: Array
    ripples: Array
    values: Array
    noises: Array
    seen: NDArray[np.bool_]
    record: Integers
    wander: Array
    freed: Freed


class Base(NamedTuple):
    """Where a history begins: the healthy pump's state (N,), its covariance (N, N), number of records before it."""

    mean: Array
    covariance: Array
    records: int


class Kinds(NamedTuple):
    """What a fault of each kind is before anything is measured.

    Attributes
    ----------
    directions, scales
        What each kind moves per unit of amplitude and of its product with the law, shape (K + 1, 2, N_COMPONENTS), and its
        one-sigma size, shape (K + 1,); the last row, zeros, serves the healthy pump.
    laws
        Mean and spread of the place of each kind's law, shape (K + 1, 2).
    signs, most
        Sign of each kind's amplitude (0: both) and the largest one that it can have, shape (K + 1,).
    heals
        How likely each kind goes away by itself, against what does so readily, shape (K + 1,) [nat].
    log_priors
        How likely each sets in, as stated and shape-neutral, shape (2, N_SHAPES, K) [nat].
    ramp_records
        Records in which a ramp of one sigma grows by the kind's scale.
    arrival_mean, arrival_spread
        Of the amplitude of a pump that arrives worn.
    """

    directions: Array
    scales: Array
    laws: Array
    signs: Integers
    most: Array
    heals: Array
    log_priors: Array
    ramp_records: float
    arrival_mean: float
    arrival_spread: float


class Meaning(NamedTuple):
    """What a filter of each kind counts for, arrays by kind, the healthy pump (-1) last.

    Attributes
    ----------
    signs, most, floors
        Sign of the amplitude (0: both), the largest size that it can have and the smallest one worth a word; arrivals' floor
        is one more entry.
    states, quantities
        Number of the state and of the quantity (-1: none).
    beside
        Number of the state of the second fault (-1: none).
    scales
        Sizes by which two faults are compared.
    setting_scale, setting_floor, setting_quantity
        Scale, floor and quantity of a setting that moved beside another fault.
    """

    signs: Integers
    most: Array
    floors: Array
    states: Integers
    quantities: Integers
    beside: Integers
    scales: Array
    setting_scale: float
    setting_floor: float
    setting_quantity: int


class Sums(NamedTuple):
    """Room for what a bank says in sums, filled by ``detectors.bank.summary.summed``.

    Attributes
    ----------
    weights
        Posterior shares of the filters, shape (N_WAYS, M); one-sided faults are weighed by the sign they came out with.
    of_all, changed
        Shares by state, none of these and the healthy pump last, shape (N_WAYS, n_states + 2): of all, and of what changed since
        the first record (an arrival counts as healthy there).
    together
        Shares of two faults by state of the first and of the second, shape (n_states, n_states).
    moments
        By quantity: share, first and second moment of the amplitude, and how well a sudden fault of the first such kind
        is known since its oldest onset (0: no onset has seen two records), shape (n_quantities, N_MOMENTS).
    """

    weights: Array
    of_all: Array
    changed: Array
    together: Array
    moments: Array


WHOLE, AS_STATED, AS_ALIKE = range(3)
N_WAYS = 3
"""Ways to weigh filters: by the stated prior and all that the data say; by the stated and by the shape-neutral prior and what
the data are good for where causes compete."""
N_MOMENTS = 4
SHARE, FIRST, SECOND, RESOLUTION = range(N_MOMENTS)
"""Columns of ``Sums.moments``."""


class Charts(NamedTuple):
    """Charts of how the pressure is regulated, first axes feature and filter; see ``detectors.bank.regulation``.

    Attributes
    ----------
    mean, covariance
        Level at 50 degC, slope by warmth and size of the fault; the covariance counts in noise variances. Shapes
        (N_FEATURES, M, 3) and (N_FEATURES, M, 3, 3).
    half_degrees, sum_of_squares
        What is known of the noise: shape and rate of the inverse-gamma law of its variance, (N_FEATURES, M).
    presence
        Flights on which the fault showed and on which it did not, by responsibility and prior, (N_FEATURES, M, 2).
    log_evidence
        (N_FEATURES, M).
    n, begun
        Filters of each chart, and whether it has seen a flight, (N_FEATURES,).
    """

    mean: Array
    covariance: Array
    half_degrees: Array
    sum_of_squares: Array
    presence: Array
    log_evidence: Array
    n: Integers
    begun: NDArray[np.bool_]


LEVEL, WARMTH, SIZE = range(3)
"""Places of a chart's state."""
SHOWN, ABSENT = range(2)
"""Columns of ``Charts.presence``."""
