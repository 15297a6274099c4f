"""Can a record be true? What cannot says something about its sensor, and nothing about pump or circuit."""

from collections.abc import Mapping
from dataclasses import dataclass

from detectors.words.observation import Observation, Residual
from detectors.words.states import State
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


@dataclass(frozen=True, slots=True)
class Doubt:
    """Why a record cannot be taken at its word: the channel, the reason, and what remains possible.

    ``states`` holds ``sensor_fault`` alone where only the sensor can be wrong.
    """

    channel: str
    why: str
    states: tuple[State, ...] = (State.SENSOR_FAULT,)


def doubt(observation: Observation, residuals: Mapping[str, Residual], pump: PumpType) -> Doubt | None:
    """What makes a record implausible; None where nothing does.

    Parameters
    ----------
    residuals
        Those of the window that the flight is judged by; empty where it has none.
    """
    behaviours = observation.reduction.behaviours
    case, discharge = behaviours.get(CASE), behaviours.get(DISCHARGE)
    if case is not None and case.at_full_scale > _MOSTLY:
        full_scale = pump.sensors[CASE].full_scale_bar
        why = f"stands at its full scale of {full_scale:g} bar: the pressure is at least that, or the sensor is wrong"
        return Doubt(CASE, why, (State.DRAIN_RESTRICTION, State.SENSOR_FAULT))
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
    return _reads_its_reference(observation, residuals, pump)


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
