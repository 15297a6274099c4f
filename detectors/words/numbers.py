"""Numbers of statistics that several stations of the judge need, each with its source."""

from twin.numbers import Z_90

__all__ = ["LOWEST_PRESSURE_SHARE", "MAD_TO_SIGMA", "MEDIAN_ERROR", "MOST_MISSING", "STUDENT_DEGREES", "Z_90"]

MAD_TO_SIGMA = 1.4826
"""Standard deviation over median absolute deviation of a normal law: 1 over its 75 % quantile, 0.67449."""
MEDIAN_ERROR = 1.2533
"""Standard error of a median over that of a mean, for a normal law: the root of pi / 2."""
STUDENT_DEGREES = 5.0
"""Degrees of freedom where outliers are expected (estimate): tails heavy enough that one outlier of any size costs a bounded
amount, and light enough that variance and kurtosis still exist."""
MOST_MISSING = 0.2
"""Share of a stretch's samples that may be missing (estimate: one in five, spread out, moves no mean by more than noise)."""
LOWEST_PRESSURE_SHARE = 0.85
"""Share of the lowest pressure at zero flow from which the pump counts as regulating (estimate: below 147 bar of 173 on the
H225, table 2-1, it delivers all that it can, and the compensator says nothing)."""
