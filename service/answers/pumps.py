"""Pumps: the list, trends, forecast and the damage identification curve."""

from typing import NotRequired

from typing_extensions import TypedDict

from service.answers.history import PlaceInTime
from service.answers.registry import LookAlike
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
class PumpMade(Pump):
    """A pump as it was registered."""

    looks_like: NotRequired[list[LookAlike]]
    """Other pumps of the operator whose serial numbers are easily taken for this one's; left out where there are none."""


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
    """How far this pump without its fault lies beside the nominal twin."""

    dx: float
    """Shift along x [bar]."""
    dy: float
    """Shift along y [bar]."""
    records: int
    """Number of records since the pump sits where it is (a count)."""


@shape
class CurvePoint(TypedDict):
    """This pump without its fault at one demand, with how surely that is known."""

    x: float
    """Discharge pressure, gauge [bar]."""
    y: float
    """Case pressure minus reservoir pressure [bar]."""
    low: float
    """Lower end of the 90 % band of y [bar]."""
    high: float
    """Upper end of the 90 % band of y [bar]."""
    system_leakage_lpm: float
    """Demand of the circuit at this point [L/min]."""
    covariance: list[list[float]]
    """Covariance of x and y [bar^2], shape (2, 2)."""


@shape
class CurveRecord(TypedDict):
    """Where the judge saw the pump after a record, brought to the conditions."""

    at: Instant
    """Event time of the record."""
    x: float
    """Discharge pressure, gauge [bar]."""
    y: float
    """Case pressure minus reservoir pressure [bar]."""
    covariance: list[list[float]]
    """Covariance of x and y [bar^2], shape (2, 2)."""


@shape
class CurveReading(TypedDict):
    """A record as measured, brought to the conditions."""

    at: Instant
    """Event time of the record."""
    x: float
    """Discharge pressure, gauge [bar]."""
    y: float
    """Case pressure minus reservoir pressure, the sensor's pump-off zero taken off [bar]."""
    y_first_zero: float
    """The same with the zero that the sensor had in the first records at this place: a shift of it stands between [bar]."""


@shape
class CurvePair(TypedDict):
    """A point of the plane."""

    x: float
    """Discharge pressure, gauge [bar]."""
    y: float
    """Case pressure minus reservoir pressure [bar]."""


@shape
class CurveDirection(TypedDict):
    """Where a fault moves this pump."""

    dx: float
    """Movement along x [bar]."""
    dy: float
    """Movement along y [bar]."""
    per: str
    """Size of the fault that moves it so far, with its unit."""
    both_ways: bool
    """Whether the fault can go the other way as well."""


@shape
class CurveResidual(TypedDict):
    """A record's case pressure beyond this pump's reference at the record's own condition."""

    at: Instant
    """Event time of the record."""
    fluid_temperature_degc: float
    """Fluid temperature [degC]."""
    residual: float
    """Case pressure beyond the reference [bar]."""
    standard_deviation: float
    """Of the measurement [bar]."""
    fitted: bool
    """Whether the laws were laid through it."""


@shape
class CurveLawPoint(TypedDict):
    """A point of a law."""

    fluid_temperature_degc: float
    """Fluid temperature [degC]."""
    residual: float
    """What the fault adds to the case pressure there [bar]."""


@shape
class CurveLaw(TypedDict):
    """What one fault would add to the case pressure over temperature, of the size that fits the newest records best."""

    size: float
    """Size of the fault, in `unit`."""
    unit: str
    """Unit of the size."""
    misfit: float
    """Root mean square by which it misses the records, in their standard deviations (a number without unit)."""
    curve: list[CurveLawPoint]
    """The law over the temperatures that the records span."""


@shape
class CurveResiduals(TypedDict):
    """Case pressure over temperature: where a leak of the pump and a restricted drain part."""

    points: list[CurveResidual]
    """Records in event order."""
    laws: dict[str, CurveLaw]
    """Laws by the state that they stand for; empty where the newest records do not stand out."""


@shape
class DamageIdentificationCurve(TypedDict):
    """Reference curve, a pump's records brought to the chosen conditions, and the direction of each fault."""

    axes: CurveAxes
    """What the axes are."""
    conditions: CurveConditions
    """The chosen conditions; default: the latest record's."""
    baseline: CurveBaseline
    """Where this pump's reference lies beside the nominal twin."""
    curve: list[CurvePoint]
    """The reference: this pump without its fault, under growing demand."""
    points: list[CurveRecord]
    """Where the judge saw the pump, record by record in event order."""
    directions: dict[str, CurveDirection]
    """Direction of each fault by its state, from the reference at no demand."""
    readings: list[CurveReading]
    """The records as measured, in event order."""
    measured_curve: list[CurvePair]
    """Healthy points of the pump type measured near these conditions, laid to the reference's foot; empty without."""
    residuals_by_temperature: CurveResiduals
    """Case pressure beyond the reference over fluid temperature."""
