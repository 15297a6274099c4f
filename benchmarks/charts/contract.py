"""What every chart promises: pure steps, one statistic, one threshold, no reset of its own."""

from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Sequence = NDArray[np.float64]
"""Values of one step: shape () for one sequence, (m,) for m independent ones side by side."""

S = TypeVar("S")


class Chart(Protocol[S]):
    """An immutable sequential detector; it alarms at a step whose statistic reaches ``threshold``.

    States are immutable values: keeping one and going on from it later gives what an unbroken run gives.
    A missing value (NaN) leaves the state's verdict as it was. Nothing ahead of the step is ever read.
    """

    @property
    def threshold(self) -> float:
        """Statistic at which the chart alarms, in the statistic's own unit."""
        ...

    def start(self, shape: tuple[int, ...] = ()) -> S:
        """State before the first value, for ``shape`` independent sequences."""
        ...

    def update(self, state: S, x: ArrayLike) -> tuple[S, Sequence]:
        """State and statistic after one more value of each sequence."""
        ...


def run(chart: Chart[S], values: ArrayLike) -> Sequence:
    """Statistic after each value, shape of ``values``: (n,) or (n, m), steps along the first axis."""
    x = np.asarray(values, dtype=np.float64)
    state = chart.start(x.shape[1:])
    out = np.empty_like(x)
    for i, value in enumerate(x):
        state, out[i] = chart.update(state, value)
    return out
