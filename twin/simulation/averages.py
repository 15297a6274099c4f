"""Means over whole revolutions, and what else a run leaves."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled, inlined
from twin.laws.compressibility import P_FLOOR
from twin.simulation.layout import ALPHA, END, FIRST_MEAN, N_MEAN, N_STATE_MEANS, N_VOLUMES, THETA, TILT_MEAN

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

STOPPED_AT, ANGLE, ELAPSED, INTEGRALS, BEGUN = 0, 1, 2, 3, 3 + N_MEAN
N_REVOLUTION = BEGUN + N_MEAN
"""What is carried from step to step of a revolution: when the run stopped [s], angle after the last step [rad], time since
the last whole revolution [s], integrals of the means since then, and the states that the last step ended with."""
ENDED, TAKEN = range(2)
"""Counts: revolutions that ended, steps taken."""
ROUNDING = 1.0e-9
"""Angle by which a sum of steps may miss a whole revolution [rad]."""


class Account(NamedTuple):
    """What a run leaves.

    Attributes
    ----------
    keep, samples
        A sample per interval (>= n_steps, N_SAMPLE); all states where ``keep`` has as many rows, else none.
    revolution
        Shape (N_REVOLUTION,): carried between calls.
    means
        Cycle means, one row per revolution that ended, (m, FIRST_MEAN + N_MEAN); ``counts[ENDED]`` rows are filled.
    counts
        Shape (2,).
    """

    keep: Matrix
    samples: Matrix
    revolution: Vector
    means: Matrix
    counts: NDArray[np.int64]


@compiled
def average(
    y: Vector,
    time: float,
    step: float,
    flows: Vector,
    revolution: Vector,
    means: Matrix,
    counts: NDArray[np.int64],
) -> None:
    """Add a step to the integrals of its revolution; where the shaft came round, split the step and close the mean."""
    angle = y[THETA]
    turned = angle - revolution[ANGLE]
    whole = 2.0 * math.pi
    share = 1.0
    ended = angle >= whole - ROUNDING
    if ended:
        share = (whole - revolution[ANGLE]) / turned
        share = 1.0 if share > 1.0 - 1.0e-6 else share
    revolution[ELAPSED] += share * step
    for j in range(N_MEAN):
        value = _averaged(y, flows, j)
        if j < N_STATE_MEANS:
            # states by the trapezium of the step's both ends, flows as means of the step
            begun = revolution[BEGUN + j]
            middle = begun + 0.5 * share * (value - begun)
            revolution[INTEGRALS + j] += share * step * middle
        else:
            revolution[INTEGRALS + j] += share * step * value
    if ended:
        if counts[ENDED] < means.shape[0]:
            row = means[counts[ENDED]]
            row[END] = time - (1.0 - share) * step
            for j in range(N_MEAN):
                row[FIRST_MEAN + j] = revolution[INTEGRALS + j] / revolution[ELAPSED]
        counts[ENDED] += 1
        rest = (1.0 - share) * step
        revolution[ELAPSED] = rest
        for j in range(N_MEAN):
            value = _averaged(y, flows, j)
            if j < N_STATE_MEANS:
                begun = revolution[BEGUN + j]
                middle = value - 0.5 * (1.0 - share) * (value - begun)
                revolution[INTEGRALS + j] = rest * middle
            else:
                revolution[INTEGRALS + j] = rest * value
    for j in range(N_STATE_MEANS):
        revolution[BEGUN + j] = _averaged(y, flows, j)
    revolution[ANGLE] = angle - whole if ended else angle


@inlined
def _averaged(y: Vector, flows: Vector, j: int) -> float:
    """What mean ``j`` is the mean of; a pressure that counts missing fluid shows as the floor."""
    return float(max(y[j], P_FLOOR) if j < N_VOLUMES else (y[ALPHA] if j == TILT_MEAN else flows[j - N_STATE_MEANS]))
