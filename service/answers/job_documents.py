"""Documents that jobs leave as JSON: the report of a fleet, and the study of the judge on simulated pumps."""

from typing import Annotated, NotRequired

from pydantic import Field
from typing_extensions import TypedDict

from service.answers.alarms import Alarm
from service.answers.fleet import Agreement
from service.answers.history import Finding
from service.answers.pumps import Forecast, Pump, RankedPump, TrendPoint
from service.answers.verdicts import Software, Verdict
from service.answers.words import Instant, Side, State, shape


@shape
class ReportedChange(TypedDict):
    """A verdict of the period at which a pump's state changed."""

    at: Instant
    """When."""
    state: State
    """State from then on."""
    advice: str
    """What the verdict advised."""


@shape
class ReportedPump(TypedDict):
    """A pump's chapter of a report."""

    pump: Pump
    """The pump and where it is."""
    verdict: Verdict
    """Its verdict as it stands."""
    forecast: Forecast
    """When its limit will be reached."""
    case_flow_limit_lpm: float
    """Limit of its case flow at the reference condition [L/min]."""
    trends: dict[str, list[TrendPoint]]
    """Trends of the period by metric, in the unit that the metric's name ends in; one without a point is left out."""
    changes: list[ReportedChange]
    """Changes of state within the period."""
    alarms: list[Alarm]
    """Alarms raised within the period."""
    findings: list[Finding]
    """What the workshop found within the period."""


@shape
class FleetOverview(TypedDict):
    """A fleet as a report begins with it."""

    by_state: dict[str, int]
    """Number of pumps by the state of their verdict (counts)."""
    ranking: list[RankedPump]
    """All pumps, the most urgent first."""
    silent: list[str]
    """Serial numbers of pumps that have sent nothing for unusually long."""
    alarms: list[Alarm]
    """Alarms raised within the period."""
    findings: Agreement
    """How often the workshop agreed, at any time."""


@shape
class FleetReport(FleetOverview):
    """What a job `report` leaves."""

    subject: str
    """Serial number of the pump, the operator, or `all operators`."""
    since: Instant
    """Begin of the period."""
    until: Instant
    """End of the period; not in it."""
    pumps: list[ReportedPump]
    """A chapter for each pump."""


@shape
class Scored(TypedDict):
    """A score with its 95 % interval, in the unit that the score's name or its row's `unit` says."""

    value: float | None
    """Point estimate, in the score's unit; null where it is not finite (a pump that never alarmed)."""
    low: float | None
    """Lower end of the 95 % interval, in the same unit."""
    high: float | None
    """Upper end of the 95 % interval, in the same unit."""


@shape
class StudyTarget(Scored):
    """A wish and what was found."""

    row: str
    """Row of the study."""
    burst: bool
    """Whether each window held a burst."""
    quantity: str
    """The score that is asked for."""
    scope: str
    """Over which worlds."""
    at_least: float | None
    """Lowest value that meets it, in the score's unit; null for none."""
    at_most: float | None
    """Highest value that meets it, in the score's unit; null for none."""
    met: bool | None
    """Whether the point estimate meets it; null where there is none."""
    note: str
    """How the quantity stands for the words of the wish."""


ReliabilityBin = TypedDict(
    "ReliabilityBin",
    {  # `from` is no name that a class could give a field
        "from": NotRequired[Annotated[float, Field(description="Lower bound of what was stated (a share)")]],
        "to": NotRequired[Annotated[float, Field(description="Upper bound of what was stated (a share)")]],
        "share": Annotated[float, Field(description="How many of all statements fell here (a share)")],
        "stated": Annotated[float | None, Field(description="Their mean (a share); null without any")],
        "happened": Annotated[float | None, Field(description="How often it was so (a share); null without any")],
    },
)
ReliabilityBin.__doc__ = "Stated probabilities that fell together, and how often it was so."
shape(ReliabilityBin)
Reliabilities = dict[str, list[ReliabilityBin]]


@shape
class StudyPool(TypedDict):
    """All rows with, or all without, bursts taken together."""

    burst: bool
    """Whether each window held a burst."""
    rows: list[str]
    """Names of the rows."""
    weights: list[float]
    """Weight of each row (a share of 1)."""
    scores: dict[str, Scored]
    """Scores by name."""
    reliability: Reliabilities
    """Stated against happened, by reading."""
    confusion: dict[str, dict[str, int]]
    """Number of pumps (counts) by true side and by the side that was said at the end."""


@shape
class StudyScope(TypedDict):
    """Scores of a row over some of the worlds."""

    pumps: int
    """Number of simulated pumps (a count)."""
    records: int
    """Number of their records (a count)."""
    scores: dict[str, Scored]
    """Scores by name."""


@shape
class FalseAlarm(TypedDict):
    """A healthy pump that was in alarm."""

    reality: str
    """World that it lived in."""
    pump: int
    """Its place in the row (a count)."""
    flight: int
    """Flight at which the alarm began (a count)."""
    records: int
    """Number of records that it lasted (a count)."""
    state: State
    """What was said."""


@shape
class OperatingPointOfAlarm(TypedDict):
    """What one threshold of the alarm would give."""

    alarm_on_log_odds: float
    """Threshold: natural logarithm of the odds that something is wrong (a number without unit)."""
    false_alarms_per_10000_records: Scored
    """False alarms (a count per 10,000 healthy records)."""
    detected: Scored
    """Share of the faults that were found."""
    median_delay_flights: Scored
    """Flights between onset and alarm (a count)."""


@shape
class RocCurve(TypedDict):
    """Receiver operating characteristic from corner to corner."""

    false_alarm_rate: list[float]
    """How many of the healthy records are in alarm (a share), by threshold."""
    detection_rate: list[float]
    """How many of the faulty records are in alarm (a share), by threshold."""


@shape
class StudyRow(TypedDict):
    """One fault, its course and what was said of it."""

    row: str
    """Its name."""
    truth: State
    """What is true at the end."""
    burst: bool
    """Whether each window held a burst."""
    flights: int
    """Flights of each pump (a count)."""
    onset_flight: int | None
    """First flight with the fault (a count); null for a healthy pump."""
    unit: str
    """Unit of the fault's size."""
    scopes: dict[str, StudyScope]
    """Scores by the worlds that they are over."""
    sides_at_the_end: dict[Side, int]
    """Number of pumps by the side said at the end (counts)."""
    sizes_at_the_alarm: list[float | None]
    """Size of the fault at each pump's alarm, in `unit`; null for one that never alarmed."""
    false_alarms: list[FalseAlarm]
    """Alarms before the onset, or of healthy pumps."""
    delays: list[float | None]
    """Flights from onset to alarm of each pump (counts); null for one that never alarmed."""
    reliability: NotRequired[Reliabilities]
    """Stated against happened, by reading."""
    roc: NotRequired[RocCurve]
    """Detection against false alarms."""
    operating_curve: NotRequired[list[OperatingPointOfAlarm]]
    """What other thresholds of the alarm would give."""


@shape
class StudySetting(TypedDict):
    """What was simulated, and by which software."""

    version: str
    """Release."""
    software: Software
    """Release, commit and sources."""
    twin: str
    """Version of the twin, with every prior."""
    seed: int
    """Seed of the random draws (a number without unit)."""
    pumps_per_row: int
    """Simulated pumps of each row (a count)."""
    healthy_records_per_reality: int
    """Records of healthy pumps in each world (a count)."""
    realities: list[str]
    """Names of the worlds."""
    differences: list[str]
    """How the worlds differ from what the judge assumes."""
    intervals: float
    """Probability that an interval holds (a share)."""
    not_simulated: list[str]
    """What no row holds."""


@shape
class StudyReport(TypedDict):
    """What a job `evaluation` leaves."""

    study: StudySetting
    """What was simulated."""
    targets: list[StudyTarget]
    """What is wished, and what was found."""
    pooled: list[StudyPool]
    """All rows together."""
    rows: list[StudyRow]
    """Each row."""


JOB_DOCUMENTS = (FleetReport, StudyReport)
"""Every shape that ``/jobs/{id}/result?format=json`` can have."""
