"""Can a record be true? What cannot says something about its sensor, and nothing about pump or circuit."""

from collections.abc import Mapping
from dataclasses import dataclass

from detectors.bank.bank import Bank
from detectors.bank.window import Measurement
from detectors.words.observation import Observation, Residual
from detectors.words.states import State
from detectors.words.verdict import CasePressure
from twin.parameters import PumpType

IMPLAUSIBLE_FLIGHTS = 3
"""Flights in a row that cannot be true before the verdict says so (our choice: one may be a loose plug, two a habit)."""
CASE, DISCHARGE, RESERVOIR = "case_pressure_bar", "discharge_pressure_bar", "reservoir_pressure_bar"
_LEAST_RISE_SHARE = 0.25
"""Share of the nominal pump's rise of case over reservoir pressure below which a running pump's case sensor reads its
reference. The freest drain and the tightest pump of the population leave 0.55 together (twin, table 2-1's spread)."""
_SIGMAS = 3.0
"""Standard deviations, and steps of the sensor, by which the twin must miss a movement (our choice)."""
_TOGGLING = 2
"""Different values that a stuck converter shows."""
_LEAST_SAMPLES = 30
"""Samples at speed below which nothing is said of how they vary (estimate: half a minute at 1 Hz)."""
_MOSTLY = 0.5
_FULL_SCALE_SHARE = 0.995
"""Share of its full scale from which a mean stands at it."""
_MOST_OFF_BAR = 25.0
"""Regulated pressure off by more than this is doubted (estimate: the acceptance sheet allows 2 bar, a screw turned to its end
some 10; at 150 bar the cockpit's lamp would be lit)."""
_FOLLOWS = 0.5
"""Share of a rise of the case pressure that the discharge pressure must show with it: the spool refers to the case, so it
follows bar for bar."""
_NEARLY = 0.8
"""Share of its full scale that the likeliest cause must expect for a sensor that stands there to be believed."""
SATURATED_BAR = (0.4, 0.4)
"""How far above a sensor's full scale the pressure is when it stands there, and how far that may be off (estimate: a drain
blocked tenfold reaches 5.4 bar of 5 at 80 degC)."""
TWICE = 2.0
"""Case over reservoir pressure against this pump's own reference from which an alarm is critical, whatever the cause."""


@dataclass(frozen=True, slots=True)
class Doubt:
    """Why a record cannot be taken at its word: the channel, the reason, and what remains possible.

    ``states`` holds ``sensor_fault`` alone where only the sensor can be wrong.
    """

    channel: str
    why: str
    states: tuple[State, ...] = (State.SENSOR_FAULT,)


@dataclass(frozen=True, slots=True)
class Reference:
    """What a pump's own healthy filter expects a window to show: both pressures as measured, and case over reservoir [bar].

    ``leading_case_bar`` is the case pressure that the likeliest filter expects, with its fault.
    """

    discharge_bar: float
    case_bar: float
    over_reservoir_bar: float
    leading_case_bar: float

    @classmethod
    def of(cls, bank: Bank, window: Measurement) -> "Reference":
        """What a bank expects the window that the flight is judged by to show."""
        healthy, leading = bank.expected(window)
        return cls(*healthy, leading[1])


def doubt(
    observation: Observation, residuals: Mapping[str, Residual], pump: PumpType, reference: Reference | None
) -> Doubt | None:
    """Why this record is no evidence for pump or circuit; None where it can be true.

    Parameters
    ----------
    observation, residuals
        The record, and its residuals where it has a zero-flow window.
    pump
        Its type, with what its sensors can show.
    reference
        What this pump is expected to show at the window's condition; None before it has a baseline.
    """
    behaviours = observation.reduction.behaviours
    case, discharge = behaviours.get(CASE), behaviours.get(DISCHARGE)
    if case is not None and case.at_full_scale > _MOSTLY:
        return _at_full_scale(observation, pump, reference)
    # from standstill to 175 bar and back: two values are no measurement
    if (
        not residuals
        and discharge is not None
        and discharge.samples >= _LEAST_SAMPLES
        and discharge.running <= _TOGGLING
        and discharge.at_rest > 0
    ):
        return Doubt(DISCHARGE, "does not move while the pump runs")
    if case is not None and case.samples >= _LEAST_SAMPLES and case.running <= _TOGGLING < case.at_rest:
        return Doubt(CASE, "does not move while the pump runs, and does at rest")
    return _reads_its_reference(observation, residuals, pump) or _far_off(residuals)


def is_saturated(observation: Observation, pump: PumpType) -> bool:
    """Whether the case sensor stands at its full scale in the window that the flight is judged by: a lower bound."""
    window = observation.reduction.zero_flow
    case = window.means.get(CASE) if window is not None else None
    return case is not None and case.mean >= _FULL_SCALE_SHARE * pump.sensors[CASE].full_scale_bar


def case_pressure(measured_bar: float, reference: Reference, limit_bar: float, *, has_baseline: bool) -> CasePressure:
    """The plain rule: case over reservoir pressure at twice this pump's own reference, or beyond the limit.

    ``measured_bar`` is the case pressure as measured, with the offset that ``reference`` expects in it.
    """
    over = reference.over_reservoir_bar + measured_bar - reference.case_bar
    doubled = has_baseline and over >= TWICE * reference.over_reservoir_bar
    return CasePressure(over, reference.over_reservoir_bar, limit_bar, doubled or over >= limit_bar)


def _at_full_scale(observation: Observation, pump: PumpType, reference: Reference | None) -> Doubt | None:
    """A true blockage saturates the sensor; then the discharge pressure has risen with the case."""
    full_scale, window = pump.sensors[CASE].full_scale_bar, observation.reduction.zero_flow
    why = f"stands at its full scale of {full_scale:g} bar"
    if reference is None or window is None or not is_saturated(observation, pump):
        why += ": the pressure is at least that, or the sensor is wrong"
        return Doubt(CASE, why, (State.DRAIN_RESTRICTION, State.SENSOR_FAULT))
    if DISCHARGE not in window.means:
        return None  # nothing else was measured that could contradict it
    risen = window.means[DISCHARGE].mean - reference.discharge_bar
    needed = _FOLLOWS * (full_scale - reference.case_bar)
    if risen >= needed or reference.leading_case_bar >= _NEARLY * full_scale:
        return None
    return Doubt(CASE, f"{why}, and the discharge pressure has not risen with it ({risen:+.1f} bar)")


def _reads_its_reference(observation: Observation, residuals: Mapping[str, Residual], pump: PumpType) -> Doubt | None:
    """A running pump leaks: its case cannot stand at the reservoir's pressure."""
    window, residual = observation.reduction.zero_flow, residuals.get(CASE)
    if window is None or residual is None:
        return None
    mean = window.means.get(RESERVOIR)
    reservoir = mean.mean if mean is not None else pump.nominal_reservoir_pressure_bar
    nominal, measured = residual.twin - reservoir, residual.measured - reservoir
    clear = max(_SIGMAS * residual.standard_deviation, _SIGMAS * pump.sensors[CASE].resolution_bar)
    if measured < _LEAST_RISE_SHARE * nominal and nominal - measured > clear:
        return Doubt(CASE, f"reads {measured:+.2f} bar over the reservoir where a running pump makes {nominal:.2f} bar")
    return None


def _far_off(residuals: Mapping[str, Residual]) -> Doubt | None:
    """A regulated pressure that no screw reaches is first a question to its sensor."""
    residual = residuals.get(DISCHARGE)
    if residual is None or abs(residual.residual) <= _MOST_OFF_BAR:
        return None
    return Doubt(
        DISCHARGE,
        f"reads {residual.residual:+.0f} bar off the regulated pressure, further than a setting can be",
        (State.COMPENSATOR_FAULT, State.SENSOR_FAULT),
    )
