"""Words and shapes of a verdict: what a maintainer reads, and the trend points behind it."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from detectors.words.states import CAUSES, FAULTS, SIDE_OF, Side, State

__all__ = [
    "CAUSES",
    "ESTIMATES",
    "FAULTS",
    "NO_FIT",
    "SIDE_OF",
    "TREND_METRICS",
    "UNINFORMED",
    "Assessment",
    "BlindSpot",
    "CasePressure",
    "Crossing",
    "Estimate",
    "Fit",
    "Intermittent",
    "MissingEvidence",
    "Quality",
    "Resolved",
    "Side",
    "State",
    "Verdict",
]

UNINFORMED: Mapping[State, float] = dict.fromkeys(CAUSES, 1.0 / len(CAUSES))
"""Probabilities before a baseline allows any comparison: every answer alike."""

ESTIMATES: Mapping[str, str] = {
    "pump_leakage_change_lpm": "L/min",
    "system_leakage_change_lpm": "L/min",
    "pressure_setting_change_bar": "bar",
    "drain_resistance_change_percent": "%",
    "case_flow_at_reference_lpm": "L/min",
}
"""Estimated quantities with their units; changes of the pump's quantities count from its own baseline or its last
overhaul, those of the position from its."""

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
class Fit:
    """How many of the last ``records`` records the leading cause explains, and since when it does not (None: it does)."""

    records: int
    explained: int
    since: datetime | None = None


NO_FIT = Fit(0, 0)
"""Nothing has been asked to fit yet."""


@dataclass(frozen=True, slots=True)
class BlindSpot:
    """What a pump's channels cannot show: changes of a quantity of ``ESTIMATES`` below a size in its unit (None: of any)."""

    quantity: str
    below: float | None
    because: str


@dataclass(frozen=True, slots=True)
class Crossing:
    """Probability that the case flow at the reference condition crosses its limit within some flight hours."""

    within_flight_hours: float
    probability: float


@dataclass(frozen=True, slots=True)
class Intermittent:
    """A fault that comes and goes: on how many of how many records it showed, and since when."""

    state: State
    records: int
    of: int
    since: datetime


@dataclass(frozen=True, slots=True)
class Resolved:
    """A fault that ended with something that was done; ``action`` joins the actions of one day with ``+``."""

    state: State
    action: str
    at: datetime


@dataclass(frozen=True, slots=True)
class MissingEvidence:
    """What would tell, in how many records of it, and between which causes."""

    what: str
    records: int
    would_decide: tuple[State, ...]


@dataclass(frozen=True, slots=True)
class CasePressure:
    """The plain rule that stands beside the judge: case over reservoir pressure on the last flight.

    ``reference_bar`` is what this pump's own reference says at the condition, ``limit_bar`` the pump type's limit of
    case pressure. ``beyond`` raises a critical alarm and accuses nobody.
    """

    over_reservoir_bar: float
    reference_bar: float
    limit_bar: float
    beyond: bool


@dataclass(frozen=True, slots=True)
class Verdict:
    """The answer for one pump at one event time.

    ``probabilities`` has an entry for each of ``CAUSES`` and sums to 1.
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
    fit: Fit = NO_FIT
    blind_spots: tuple[BlindSpot, ...] = ()
    probability_beyond_limit: float | None = None
    crossing: Crossing | None = None
    intermittent: Intermittent | None = None
    resolved_by: Resolved | None = None
    missing_evidence: tuple[MissingEvidence, ...] = ()
    case_pressure: CasePressure | None = None


@dataclass(frozen=True, slots=True)
class Assessment:
    """State of the knowledge right after one observation: its residuals as trend points and the verdict.

    ``trend`` maps metric names of ``TREND_METRICS`` to values; empty when the record had no usable window.
    """

    record_id: str
    at: datetime
    trend: Mapping[str, Estimate]
    verdict: Verdict
