"""What a pump's history holds and what it lacks: blind spots, and the evidence that would decide."""

from collections.abc import Mapping
from dataclasses import dataclass

from detectors.judgement.sight import WHOLE_SIGHT, Sight
from detectors.words.observation import Observation, WindowKind
from detectors.words.states import SIDE_OF, Side, State
from detectors.words.verdict import BlindSpot, MissingEvidence

_TEMPERATURE = "fluid_temperature_degc"
_LEAK = "pump_leakage_change_lpm"
_SYSTEM = "system_leakage_change_lpm"
_DRAIN = "drain_resistance_change_percent"
_WITHOUT_RESERVOIR_LPM = 0.6
"""Leakage that an unknown reservoir pressure hides (study: never found where it is not measured; half a bar is as much)."""
_WITHOUT_ZERO_LPM = 0.3
"""Leakage that a wandering zero of the case sensor hides (study: alarm at 0.31 L/min without a zero)."""
SPAN_K = 20.0
"""Temperatures of the windows from which leak and drain begin to part (estimate: their laws then differ by a fifth)."""
_FLOW, _SETTING = "case_flow_at_reference_lpm", "pressure_setting_change_bar"
_NOT_MEASURED = {
    "discharge_pressure_bar": "discharge pressure",
    "case_pressure_bar": "case pressure",
    "shaft_speed_rpm": "shaft speed",
    "fluid_temperature_degc": "fluid temperature",
}
_COSTS: tuple[tuple[str, tuple[str, ...], str], ...] = (
    (
        "case_pressure_bar",
        (_FLOW, _LEAK, _SYSTEM, _DRAIN, _SETTING),
        "whatever moves the discharge pressure looks alike, and the level stays unknown",
    ),
    (
        "discharge_pressure_bar",
        (_FLOW, _LEAK, _SYSTEM, _DRAIN, _SETTING),
        "whatever moves the case pressure looks alike, and the setting stays unknown",
    ),
    ("shaft_speed_rpm", (_FLOW,), "how far the pump ran from its reference speed stays unknown"),
    ("fluid_temperature_degc", (_FLOW, _DRAIN), "a warm flight, a worn pump and a restricted drain look alike"),
)
"""What each channel that a type lacks costs: the quantities that stay unseen, and why."""
_MOSTLY = 0.5
_LOADED, _BURSTS, _STEPS = 4, 10, 2
"""Ground runs, bursts and load steps from which more of them would add little (study: they decide within as many)."""


@dataclass(frozen=True, slots=True)
class Coverage:
    """Counts of records that were learnt from, and the range of their windows' temperatures [degC]."""

    records: int = 0
    coldest: float | None = None
    warmest: float | None = None
    zeros: int = 0
    reservoirs: int = 0
    loaded: int = 0
    bursts: int = 0
    steps: int = 0

    @property
    def span_k(self) -> float:
        """Range of the windows' temperatures [K]."""
        return 0.0 if self.warmest is None or self.coldest is None else self.warmest - self.coldest

    def grown(self, observation: Observation) -> "Coverage":
        """With one more record."""
        reduction, coldest, warmest = observation.reduction, self.coldest, self.warmest
        loaded = reservoir = False
        for window in reduction.windows:
            if not window.accepted:
                continue
            loaded = loaded or window.kind is WindowKind.CONSTANT_FLOW
            temperature = window.means.get(_TEMPERATURE) if window.kind is WindowKind.ZERO_FLOW else None
            if temperature is not None:
                coldest = temperature.mean if coldest is None else min(coldest, temperature.mean)
                warmest = temperature.mean if warmest is None else max(warmest, temperature.mean)
                reservoir = "reservoir_pressure_bar" in window.means
        return Coverage(
            self.records + 1,
            coldest,
            warmest,
            self.zeros + reduction.zero.measured,
            self.reservoirs + reservoir,
            self.loaded + loaded,
            self.bursts + (reduction.spectrum is not None),
            self.steps + (reduction.droop is not None),
        )


def blind_spots(
    history: Coverage, smallest: Mapping[str, float], settling: int = 0, sight: Sight = WHOLE_SIGHT
) -> tuple[BlindSpot, ...]:
    """What the records of this pump cannot show.

    Parameters
    ----------
    smallest
        The smallest changes that would have been found, by quantity.
    settling
        Records that are missing until the drain and the circuit of a new position have a reference of their own.
    sight
        What the pump type's records lack from the start.
    """
    if not history.records:
        return ()
    found = [BlindSpot(q, None, why) for q, why in _from_the_start(sight)]
    cased = "case_pressure_bar" not in sight.lacks
    if cased and not sight.reservoir_known and history.reservoirs < _MOSTLY * history.records:
        below = max(_WITHOUT_RESERVOIR_LPM, smallest.get(_LEAK, 0.0))
        found.append(BlindSpot(_LEAK, below if sight.parts_causes else None, "reservoir pressure is not measured"))
    if cased and history.zeros < _MOSTLY * history.records:
        below = max(_WITHOUT_ZERO_LPM, smallest.get(_LEAK, 0.0))
        why = "no pump-off stretch shows the zero of the case sensor"
        found.append(BlindSpot(_LEAK, below if sight.parts_causes else None, why))
    if settling > 0:
        why = f"the position is new to the pump: {settling} more records are needed for its own reference"
        found += [BlindSpot(quantity, None, why) for quantity in (_DRAIN, _SYSTEM)]
    elif sight.parts_causes and history.span_k < SPAN_K:
        why = f"all windows lie within {history.span_k:.0f} K: a restricted drain and a worn pump look alike"
        found.append(BlindSpot(_DRAIN, None, why))
    return tuple(found)


def _from_the_start(sight: Sight) -> list[tuple[str, str]]:
    """Quantities that no record of the type shows, each with the reason."""
    found = [
        (quantity, f"{_NOT_MEASURED[channel]} is not measured: {cost}")
        for channel, quantities, cost in _COSTS
        if channel in sight.lacks
        for quantity in quantities
    ]
    if not sight.own_twin:
        why = "the pump type has no twin of its own: against its measured curve a change shows, not its size or cause"
        found += [(quantity, why) for quantity in (_FLOW, _LEAK, _SYSTEM, _DRAIN)]
    return found


def missing_evidence(
    candidates: tuple[State, ...], history: Coverage, sight: Sight = WHOLE_SIGHT
) -> tuple[MissingEvidence, ...]:
    """What the history does not hold and what would tell the candidates apart, the best first."""
    left = set(candidates)
    if len(left) < 2:
        return ()
    if not sight.parts_causes:
        # no flight of such a type can tell, whatever it holds
        return (
            MissingEvidence("a reading of the pressure sensor against a gauge, at rest and running", 1, candidates),
            MissingEvidence("case flow on a test stand", 1, candidates),
        )
    found = []
    if State.SENSOR_FAULT in left:
        if history.zeros < _MOSTLY * history.records:
            what = "records that begin with a pump-off stretch: there the case sensor must read the reservoir"
            found.append(MissingEvidence(what, 3, candidates))
        found.append(MissingEvidence("a reading of the sensor against a gauge, at rest and running", 1, candidates))
    pump = tuple(c for c in candidates if SIDE_OF[c] is Side.PUMP)
    if State.SYSTEM_LEAKAGE in left and pump and history.loaded < _LOADED:
        what = "ground runs at zero, 10 and 20 L/min with the commanded flow in the record (commanded_flow_lpm)"
        found.append(MissingEvidence(what, _LOADED - history.loaded, (*pump, State.SYSTEM_LEAKAGE)))
    if State.DRAIN_RESTRICTION in left and len(left) > 1 and history.bursts < _BURSTS:
        rivals = tuple(c for c in candidates if c is not State.OTHER)
        what = "bursts of two seconds at 10 kHz in the zero-flow window: a clogged drain leaves the pump's ripple alone"
        found.append(MissingEvidence(what, _BURSTS - history.bursts, rivals))
    if State.PUMP_DEGRADATION in left and State.DRAIN_RESTRICTION in left and history.span_k < SPAN_K:
        what = "zero-flow windows at clearly different fluid temperatures (20 K apart)"
        found.append(MissingEvidence(what, 4, (State.PUMP_DEGRADATION, State.DRAIN_RESTRICTION)))
    if State.COMPENSATOR_FAULT in left and history.steps < _STEPS:
        what = "load steps of a known flow (commanded_flow_lpm) at 5 Hz or faster, or a gauge at discharge"
        found.append(MissingEvidence(what, _STEPS - history.steps, candidates))
    if State.OTHER in left:
        what = "an inspection of sensors and wiring: no fault of pump or circuit that is known explains these records"
        found.append(MissingEvidence(what, 1, candidates))
    if not found:
        found.append(MissingEvidence("case flow on a test stand", 1, candidates))
    return tuple(found)
