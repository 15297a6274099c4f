"""Verdicts: how a pump is, why, and what the answer rests on."""

from typing import NotRequired

from typing_extensions import TypedDict

from service.answers.words import Cause, Instant, Side, State, shape


@shape
class Estimate(TypedDict):
    """Posterior mean with the 90 % interval, in the unit that the quantity's name ends in."""

    mean: float | None
    """Mean, in the unit that the quantity's name ends in; null where it cannot be told."""
    low: float | None
    """Lower end of the 90 % interval, in the same unit."""
    high: float | None
    """Upper end of the 90 % interval, in the same unit."""


@shape
class Estimates(TypedDict, total=False):
    """Estimated quantities; a change counts from its own baseline. Empty before there is one."""

    pump_leakage_change_lpm: Estimate
    """Change of the pump's internal leakage [L/min]."""
    system_leakage_change_lpm: Estimate
    """Change of the leakage of the circuit's consumers and valves [L/min]."""
    pressure_setting_change_bar: Estimate
    """Change of the compensator's pressure setting [bar]."""
    drain_resistance_change_percent: Estimate
    """Change of the resistance of the drain line and its filter [%]."""
    case_flow_at_reference_lpm: Estimate
    """Case flow at the pump type's reference condition [L/min]."""


@shape
class Detectable(TypedDict, total=False):
    """Smallest change that would have been found by now; a quantity is left out where that cannot be told."""

    pump_leakage_change_lpm: float | None
    """Smallest change of the pump's internal leakage [L/min]."""
    system_leakage_change_lpm: float | None
    """Smallest change of the circuit's leakage [L/min]."""
    pressure_setting_change_bar: float | None
    """Smallest change of the pressure setting [bar]."""
    drain_resistance_change_percent: float | None
    """Smallest change of the drain's resistance [%]."""
    case_flow_at_reference_lpm: float | None
    """Smallest change of the case flow at the reference condition [L/min]."""


@shape
class Probabilities(TypedDict):
    """Probability of each explanation of the records; they sum to 1."""

    healthy: float
    """Probability (a share from 0 to 1) that nothing is wrong."""
    pump_degradation: float
    """Probability (a share) of worn pistons, slippers or port plate."""
    compensator_fault: float
    """Probability (a share) of a fault of the pressure compensator."""
    system_leakage: float
    """Probability (a share) of a leak in the circuit."""
    drain_restriction: float
    """Probability (a share) of a restricted drain line or filter."""
    sensor_fault: float
    """Probability (a share) of a faulty sensor."""
    other: NotRequired[float]  # left out by what releases before 1.1 have stored
    """Probability (a share) that no known cause explains the records."""


@shape
class Quality(TypedDict):
    """What a verdict rests on."""

    records_used: int
    """Number of records that count (a count)."""
    windows_rejected: int
    """Number of windows that were found and not used (a count)."""
    reservoir_pressure: str
    """`measured`, `nominal` (no sensor: the pump type's value) or `mixed`."""
    flags: list[str]
    """Remarks on the records' quality."""


@shape
class Fit(TypedDict):
    """How far the leading cause explains the last records."""

    records: int
    """Records that were asked (a count)."""
    explained: int
    """Records among them that the leading cause explains (a count)."""
    since: Instant | None
    """Since when records in a row are not explained; null where the last one is."""


@shape
class BlindSpot(TypedDict):
    """What this pump's channels cannot show."""

    quantity: str
    """The quantity, by its name among the estimates."""
    below: float | None
    """Changes below this size stay unseen, in the unit that the quantity's name ends in; null: none can be seen."""
    because: str
    """What is missing."""


@shape
class Crossing(TypedDict):
    """Chance that the case flow at the reference condition crosses its limit before the next inspection."""

    within_flight_hours: float
    """Flight hours until the next inspection [h]."""
    probability: float
    """Probability (a share from 0 to 1)."""


@shape
class Intermittent(TypedDict):
    """A fault that comes and goes."""

    state: State
    """The fault."""
    records: int
    """Records that showed it (a count)."""
    of: int
    """Records that were asked (a count)."""
    since: Instant
    """When it showed first."""


@shape
class Resolved(TypedDict):
    """A fault that ended with something that was done."""

    state: State
    """The fault."""
    action: str
    """What was done; the actions of one day are joined by `+`."""
    at: Instant
    """When it was done."""


@shape
class MissingEvidence(TypedDict):
    """Evidence that the history does not hold and that would decide."""

    what: str
    """What to record."""
    records: int
    """How many records of it (a count)."""
    would_decide: list[Cause]
    """Causes that it would tell apart."""


@shape
class CasePressure(TypedDict):
    """The plain rule beside the judge: case over reservoir pressure on the last flight."""

    over_reservoir_bar: float
    """Measured, at zero flow [bar]; at least this where the sensor stood at its full scale."""
    reference_bar: float
    """What this pump's own reference says at the same condition [bar]."""
    limit_bar: float
    """The pump type's limit of case pressure over the reservoir [bar]."""
    beyond: bool
    """Twice the reference or beyond the limit: a critical alarm, whatever the cause."""


@shape
class Software(TypedDict):
    """The code that computed an answer; it is no part of two verdicts being equal."""

    release: str
    """Released version (semantic)."""
    commit: str | None
    """Commit of the source tree; null where it is not known."""
    sources: str
    """Hash over the sources of twin and detectors."""


@shape
class Verdict(TypedDict):
    """The answer for one pump at one event time; intervals are 90 %."""

    state: State
    """What pump and circuit are judged to be in."""
    side: Side
    """Where to look."""
    since: Instant | None
    """Start of the first record in the unbroken run of the same state; null without records."""
    confidence: float
    """Largest of all probabilities (a share from 0 to 1)."""
    probabilities: Probabilities
    """Probability of each explanation."""
    candidates: list[Cause]
    """What remains possible where the state is `indeterminate`; `other`: no known cause explains the records."""
    secondary: State | None
    """A second fault beside the first."""
    sensor: str | None
    """Channel of the faulty sensor."""
    estimates: Estimates
    """Estimated quantities with their intervals."""
    minimum_detectable: Detectable
    """What would have been found by now."""
    quality: Quality
    """What the verdict rests on."""
    advice: str
    """What to do, in one sentence."""
    resolving_measurement: str | None
    """The measurement that would tell the candidates apart."""
    fit: NotRequired[Fit]
    """How far the leading cause explains the last records."""
    blind_spots: NotRequired[list[BlindSpot]]
    """What this pump's channels cannot show; empty when they can."""
    probability_beyond_limit: NotRequired[float | None]
    """Probability (a share from 0 to 1) that the case flow at the reference condition is beyond its limit; null without records."""
    crossing: NotRequired[Crossing | None]
    """Chance of crossing the limit before the next inspection, computed when a pump's verdict is asked for; null where none
    can be given, in the answer to an upload, and in lists."""
    intermittent: NotRequired[Intermittent | None]
    """A fault that comes and goes; null where none does."""
    resolved_by: NotRequired[Resolved | None]
    """The last fault that ended with something that was done; null where none did."""
    missing_evidence: NotRequired[list[MissingEvidence]]
    """What would decide, in records that the history does not hold yet."""
    case_pressure: NotRequired[CasePressure | None]
    """Case pressure against its own reference and limit; null without a zero-flow window."""
    twin_version: str
    """Version of the twin, with every prior."""
    threshold_version: int
    """Number of the thresholds' version (a count over the whole service)."""
    software: NotRequired[Software]
    """Release, commit and sources that computed it; left out by what older releases have stored."""


@shape
class VerdictChange(TypedDict):
    """A verdict at which a pump's state changed."""

    at: Instant
    """Event time of the record."""
    record_id: str
    """Record right after which it held."""
    verdict: Verdict
    """The verdict then, by today's knowledge."""


@shape
class VerdictRevision(TypedDict):
    """A past verdict that changed afterwards, and why."""

    at: Instant
    """Event time of the verdict."""
    record_id: str
    """Record right after which it held."""
    old_state: State | None
    """State before the change; null where there was no verdict."""
    new_state: State | None
    """State after the change; null where there is no verdict any more."""
    cause: str
    """What changed it, for example `record_arrived` or `thresholds_changed`."""
    cause_id: str | None
    """The record, entry or version that did."""
    changed_at: Instant
    """When it changed."""
