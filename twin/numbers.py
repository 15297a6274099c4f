"""Numbers that several parts of the twin and its users need, each with its source."""

Z_90 = 1.645
"""Half of a two-sided 90 % interval of the normal law, in standard deviations (its 95 % quantile, 1.64485)."""
ZERO_FLOW_BAR = 175.0
"""Regulated pressure at zero flow [bar]: middle of 173 to 177 bar (Mkadara 2020, table 2-1)."""
ZERO_FLOW_PRESSURE = 175.0e5
"""The same [Pa]; leaks with the law of an orifice are counted at it, and films are exact there."""
