"""The numbers that an operator may set, each with unit, range and meaning."""

from collections.abc import Mapping
from dataclasses import dataclass

from twin.parameters import PumpType


@dataclass(frozen=True, slots=True)
class ThresholdKey:
    """One adjustable number: default with its allowed range (both ends included)."""

    name: str
    unit: str
    default: float
    low: float
    high: float
    meaning: str


KEYS: tuple[ThresholdKey, ...] = (
    ThresholdKey("window_minimum_duration_s", "s", 30.0, 2.0, 600.0, "shortest stretch that counts as a window"),
    ThresholdKey("window_speed_band_percent", "%", 1.0, 0.1, 10.0, "largest change of shaft speed within a window"),
    ThresholdKey("window_temperature_drift_k", "K", 2.0, 0.2, 20.0, "largest change of fluid temperature in a window"),
    ThresholdKey(
        "window_steady_percent_full_scale",
        "%",
        1.0,
        0.05,
        5.0,
        "a pressure is steady when its mean varies by less than this share of full scale",
    ),
    ThresholdKey(
        "window_control_activity", "-", 0.05, 0.0, 1.0, "flight-control activity up to which controls are untouched"
    ),
    ThresholdKey("window_commanded_flow_lpm", "L/min", 0.5, 0.0, 5.0, "commanded flow up to which flow counts as zero"),
    ThresholdKey("pump_off_minimum_duration_s", "s", 10.0, 1.0, 600.0, "shortest pump-off stretch that gives a zero"),
    ThresholdKey("baseline_records", "records", 8.0, 3.0, 100.0, "records after an installation that set its baseline"),
    ThresholdKey("alarm_on_log_odds", "nat", 3.5, 0.5, 30.0, "log odds of a fault at which an alarm counts up"),
    ThresholdKey("alarm_off_log_odds", "nat", 1.0, -5.0, 30.0, "log odds below which an alarm ends"),
    ThresholdKey("alarm_records", "records", 3.0, 1.0, 20.0, "records in a row above the on-level before an alarm"),
    ThresholdKey(
        "side_probability",
        "-",
        0.95,
        0.5,
        0.9999,
        "share of the pump's faults, or the sensor's, from which it is their side",
    ),
    ThresholdKey(
        "system_side_probability",
        "-",
        0.95,
        0.5,
        0.9999,
        "share of the circuit's faults from which it is their side: looking there costs less than pulling a sound pump",
    ),
    ThresholdKey("state_probability", "-", 0.97, 0.5, 0.9999, "share of one fault among all faults to be named"),
    ThresholdKey(
        "side_records", "records", 6.0, 1.0, 50.0, "records in a row above such a share before side or fault is named"
    ),
    ThresholdKey("candidate_probability", "-", 0.02, 0.001, 0.5, "share from which a fault stays a candidate"),
    ThresholdKey("case_flow_limit_lpm", "L/min", 1.5, 0.5, 20.0, "acceptance limit of case flow at zero flow, 60 degC"),
    ThresholdKey(
        "case_pressure_limit_bar",
        "bar",
        3.5,
        0.1,
        20.0,
        "limit of case over reservoir pressure at zero flow: beyond it a critical alarm, whatever the cause",
    ),
    ThresholdKey("inspection_interval_h", "h", 50.0, 1.0, 5000.0, "flight hours from one inspection to the next"),
    ThresholdKey(
        "alarm_on_delay_flights", "flights", 1.0, 1.0, 20.0, "flights in a row with a fault that raise an alarm"
    ),
    ThresholdKey(
        "alarm_off_delay_flights", "flights", 2.0, 1.0, 50.0, "flights in a row without a fault that clear an alarm"
    ),
    ThresholdKey(
        "alarm_limit_hysteresis_percent",
        "%",
        5.0,
        0.0,
        50.0,
        "case flow must fall this far below its limit before an alarm beyond the limit steps down",
    ),
    ThresholdKey("alarm_shelving_maximum_h", "h", 168.0, 1.0, 2160.0, "longest time for which an alarm can be shelved"),
    ThresholdKey("sensor_shift_bar", "bar", 0.06, 0.01, 1.0, "shift of the case sensor's zero that is worth a word"),
)
OF_PUMP_TYPE: Mapping[str, str] = {
    "case_flow_limit_lpm": "case_flow_lpm",
    "case_pressure_limit_bar": "case_pressure_limit_bar",
}
"""Thresholds that are the pump type's own limit where no layer sets them, with that limit's name."""
_BY_NAME = {key.name: key for key in KEYS}
_ORDERED = (("alarm_off_log_odds", "alarm_on_log_odds"),)


def effective(values: Mapping[str, float], kind: PumpType | None = None) -> dict[str, float]:
    """All thresholds with ``values`` laid over the limits of a pump type, and those over the defaults.

    Raises
    ------
    ValueError
        naming every unknown key, every value outside its range and every pair out of order at once.
    """
    faults = threshold_faults(values)
    if faults:
        raise ValueError("; ".join(f"{name}: {problem}" for name, problem in faults))
    under = {} if kind is None else limits_of(kind)
    return {key.name: float(values.get(key.name, under.get(key.name, key.default))) for key in KEYS}


def limits_of(kind: PumpType) -> dict[str, float]:
    """Thresholds that a pump type's own limits give, by key; no range holds for them, but a limit that is none is left out."""
    found = {key: kind.limits[name].value for key, name in OF_PUMP_TYPE.items() if name in kind.limits}
    return {key: float(value) for key, value in found.items() if value > 0.0}


def threshold_faults(values: Mapping[str, float]) -> list[tuple[str, str]]:
    """Every fault of a set of values as (key, problem); empty when they are good."""
    faults = []
    for name, value in values.items():
        key = _BY_NAME.get(name)
        if key is None:
            faults.append((name, "no such threshold"))
        elif not key.low <= value <= key.high:
            faults.append((name, f"{value:g} {key.unit} is outside {key.low:g} to {key.high:g} {key.unit}"))
    for low, high in _ORDERED:
        below = values.get(low, _BY_NAME[low].default)
        above = values.get(high, _BY_NAME[high].default)
        if below > above:
            faults.append((low, f"{below:g} lies above {high} = {above:g}"))
    return faults
