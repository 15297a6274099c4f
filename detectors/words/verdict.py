"""Words and shapes of a verdict: what a maintainer reads, and the trend points behind it."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from detectors.words.states import FAULTS, SIDE_OF, Side, State

__all__ = [
    "ESTIMATES",
    "FAULTS",
    "SIDE_OF",
    "TREND_METRICS",
    "UNINFORMED",
    "Assessment",
    "Estimate",
    "Quality",
    "Side",
    "State",
    "Verdict",
]

UNINFORMED: Mapping[State, float] = dict.fromkeys((State.HEALTHY, *FAULTS), 1.0 / (1 + len(FAULTS)))
"""Probabilities before a baseline allows any comparison: every answer alike."""

ESTIMATES: Mapping[str, str] = {
    "pump_leakage_change_lpm": "L/min",
    "system_leakage_change_lpm": "L/min",
    "pressure_setting_change_bar": "bar",
    "drain_resistance_change_percent": "%",
    "case_flow_at_reference_lpm": "L/min",
}
"""Estimated quantities with their units; changes count from the installation's baseline."""

TREND_METRICS: Mapping[str, str] = {
    **ESTIMATES,
    "discharge_residual_bar": "bar",
    "case_residual_bar": "bar",
    "fluid_temperature_degc": "degC",
    "reservoir_pressure_bar": "bar",
}
"""Metrics that a trend can show, with units."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """Posterior mean with the 90 % interval."""

    mean: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Quality:
    """What the verdict rests on."""

    records_used: int
    windows_rejected: int
    reservoir_pressure: str
    """``measured``, ``nominal`` (no sensor: the pump type's value) or ``mixed``."""
    flags: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Verdict:
    """The answer for one pump at one event time.

    ``probabilities`` has an entry for ``healthy`` and each of ``FAULTS`` and sums to 1.
    """

    state: State
    side: Side
    since: datetime | None
    confidence: float
    probabilities: Mapping[State, float]
    candidates: tuple[State, ...]
    secondary: State | None
    sensor: str | None
    estimates: Mapping[str, Estimate]
    minimum_detectable: Mapping[str, float]
    quality: Quality
    advice: str
    resolving_measurement: str | None


@dataclass(frozen=True, slots=True)
class Assessment:
    """State of the knowledge right after one observation: its residuals as trend points and the verdict.

    ``trend`` maps metric names of ``TREND_METRICS`` to values; empty when the record had no usable window.
    """

    record_id: str
    at: datetime
    trend: Mapping[str, Estimate]
    verdict: Verdict
