"""Pumps: the list, trends, forecast and the damage identification curve."""

from typing_extensions import TypedDict

from service.answers.history import PlaceInTime
from service.answers.words import Instant, Side, State, shape


@shape
class Pump(TypedDict):
    """A pump, where it was last seen and how it is."""

    serial: str
    """Serial number, unique within an operator."""
    operator: str
    """Operator that it belongs to."""
    pump_type: str
    """Id of its pump type."""
    confirmed: bool
    """False where only records speak of it."""
    aircraft: str | None
    """Helicopter of its latest record."""
    position: str | None
    """Position of its latest record."""
    records: int
    """Number of records that count (a count)."""
    last_record_at: Instant | None
    """Start of the latest record."""
    flight_hours: float | None
    """Accumulated flight hours at its start [h]."""
    silent: bool
    """Whether records stay out for unusually long."""
    silence_unusual_from: Instant | None
    """From when on that silence is unusual."""
    state: State
    """State of the verdict now."""
    side: Side
    """Side of the verdict now."""
    since: Instant | None
    """Since when it is in that state."""
    confidence: float
    """Largest of the verdict's probabilities (a share from 0 to 1)."""
    candidates: list[State]
    """What remains possible where the state is `indeterminate`."""
    advice: str
    """What to do, in one sentence."""
    case_pressure_beyond: bool
    """Whether case over reservoir pressure is at twice its own reference or beyond its limit, whatever the cause."""


@shape
class PumpWithPlace(Pump):
    """A pump with where it sits now."""

    installation: PlaceInTime | None
    """As entered, else where its records last came from; null once it was removed."""


@shape
class RankedPump(Pump):
    """A pump in the order of urgency."""

    rank: int
    """Place in the order, from 1 (a count)."""
    urgency: str
    """Priority of its open alarm, or `none`."""
    reasons: list[str]
    """Why it stands there, in plain words."""


@shape
class TrendPoint(TypedDict):
    """One record's value of a metric, with its 90 % interval."""

    at: Instant
    """Event time of the record."""
    value: float
    """Mean, in the trend's `unit`."""
    low: float
    """Lower end of the 90 % interval, in the trend's `unit`."""
    high: float
    """Upper end of the 90 % interval, in the trend's `unit`."""
    record_id: str
    """The record."""


@shape
class Trend(TypedDict):
    """A metric over time, thinned without losing extremes."""

    metric: str
    """Name of the metric."""
    unit: str
    """Unit of value, low and high."""
    items: list[TrendPoint]
    """Points in event order."""


@shape
class PositionTrendPoint(TrendPoint):
    """A point of a position's trend."""

    pump: str
    """Serial number of the pump that sat there."""


@shape
class PositionTrend(TypedDict):
    """A metric over all pumps that sat at a position."""

    metric: str
    """Name of the metric."""
    unit: str
    """Unit of value, low and high."""
    items: list[PositionTrendPoint]
    """Points in event order."""


@shape
class FlightHours(TypedDict):
    """Flight hours until a limit, with their 90 % interval."""

    mean: float
    """Mean [h]."""
    low: float
    """Lower end of the 90 % interval [h]."""
    high: float
    """Upper end of the 90 % interval [h]."""


@shape
class Forecast(TypedDict):
    """Flight hours until a metric reaches its limit, or why none can be given."""

    flight_hours: FlightHours | None
    """Flight hours from now [h]; null where no forecast is honest."""
    limit: float
    """The limit, in `limit_unit`."""
    limit_unit: str
    """Unit of the limit."""
    metric: str
    """The metric that is followed."""
    records: int
    """Number of records that it rests on (a count)."""
    median_flight_hours: float | None
    """Median of the flight hours [h]."""
    reason: str | None
    """Why there is none."""


@shape
class CurveAxes(TypedDict):
    """What the axes of the damage identification curve are; both in bar."""

    x: str
    """Quantity along x [bar]."""
    y: str
    """Quantity along y [bar]."""


@shape
class CurveConditions(TypedDict):
    """The condition that curve and points are brought to."""

    speed_rpm: float
    """Shaft speed [rpm]."""
    fluid_temperature_degc: float
    """Fluid temperature [degC]."""
    reservoir_pressure_bar: float
    """Reservoir pressure, gauge [bar]."""


@shape
class CurveBaseline(TypedDict):
    """How far the healthy pump's first records lie beside the twin's curve."""

    dx: float
    """Shift along x [bar]."""
    dy: float
    """Shift along y [bar]."""
    records: int
    """Number of records that it rests on (a count)."""


@shape
class CurvePoint(TypedDict):
    """A point of the healthy curve, with the 90 % band of healthy pumps."""

    x: float
    """Discharge pressure, gauge [bar]."""
    y: float
    """Case pressure minus reservoir pressure [bar]."""
    low: float
    """Lower end of the band of y [bar]."""
    high: float
    """Upper end of the band of y [bar]."""
    system_leakage_lpm: float
    """Demand of the circuit at this point [L/min]."""


@shape
class CurveRecord(TypedDict):
    """A record brought to the conditions."""

    at: Instant
    """Event time of the record."""
    x: float
    """Discharge pressure, gauge [bar]."""
    y: float
    """Case pressure minus reservoir pressure [bar]."""
    covariance: list[list[float]]
    """Covariance of x and y [bar^2], shape (2, 2)."""


@shape
class CurveDirection(TypedDict):
    """Where a fault moves a point."""

    dx: float
    """Movement along x [bar]."""
    dy: float
    """Movement along y [bar]."""
    per: str
    """Size of the fault that moves it so far, with its unit."""


@shape
class DamageIdentificationCurve(TypedDict):
    """Reference curve, a pump's records brought to the chosen conditions, and the direction of each fault."""

    axes: CurveAxes
    """What the axes are."""
    conditions: CurveConditions
    """The chosen conditions; default: the latest record's."""
    baseline: CurveBaseline
    """Shift of the pump's own baseline."""
    curve: list[CurvePoint]
    """The healthy pump under growing demand."""
    points: list[CurveRecord]
    """The pump's records in event order."""
    directions: dict[str, CurveDirection]
    """Direction of each fault by its state."""
