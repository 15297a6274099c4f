"""The scatter of a healthy pump's line at once per revolution, learnt from its own bursts.

Successive differences carry it without the trend that a growing fault draws (von Neumann 1941); one that lies far off is a
step or an outlier and is cut to what scatter could make.
"""

import math
from dataclasses import dataclass

_PRIOR_BAR, _WORTH = 0.003, 4.0
"""Scatter from flight to flight before a burst has been seen, and how many differences it is worth (estimates: half of what
the thesis' figure 3-3 leaves open)."""
_LEAST_BAR = 0.001
"""No pump repeats better (estimate: a twentieth of a step of the converter)."""
_CUT = 3.0
"""Standard deviations to which a difference is cut."""


@dataclass(frozen=True, slots=True)
class LineScatter:
    """What successive bursts of a pump said so far: differences, the sum of their squares [bar^2], and the last line [bar]."""

    n: int = 0
    total: float = 0.0
    last: float | None = None

    @property
    def variance(self) -> float:
        """Of the line from flight to flight, without the error of its measurement [bar^2]."""
        learnt = (_WORTH * _PRIOR_BAR**2 + self.total) / (_WORTH + self.n)
        return max(learnt, _LEAST_BAR**2)

    def with_line(self, amplitude: float, error_variance: float) -> "LineScatter":
        """After one more burst; ``error_variance`` is that of its measurement [bar^2]."""
        if self.last is None:
            return LineScatter(self.n, self.total, amplitude)
        most = _CUT * math.sqrt(2.0 * (self.variance + error_variance))
        difference = min(abs(amplitude - self.last), most)
        own = max(0.5 * difference**2 - error_variance, 0.0)
        return LineScatter(self.n + 1, self.total + own, amplitude)
