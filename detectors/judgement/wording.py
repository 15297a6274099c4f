"""Sentences that a maintainer reads: what to do, and what would tell when the data cannot."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from detectors.judgement.coverage import SPAN_K, Coverage
from detectors.words.states import CAUSES, STATES
from detectors.words.verdict import (
    SIDE_OF,
    BlindSpot,
    CasePressure,
    Estimate,
    Intermittent,
    MissingEvidence,
    Side,
    State,
)

SENSORS: Mapping[str, str] = {
    "case_pressure_bar": "case pressure sensor",
    "discharge_pressure_bar": "discharge pressure sensor",
    "reservoir_pressure_bar": "reservoir pressure sensor",
}
"""What a maintainer calls the sensor of a channel."""
_SENSOR_ADVICE: Mapping[str, str] = {
    "case_pressure_bar": "Check the case pressure sensor: its zero or its span has moved. Pump and circuit stay monitored "
    "as long as records hold a pump-off stretch.",
    "reservoir_pressure_bar": "Check the reservoir pressure sensor: its reading has moved against the case pressure, with "
    "the pump at rest or running.",
    "discharge_pressure_bar": "Check the discharge pressure sensor.",
}
NAMES: Mapping[State, str] = {state: STATES[state].word for state in CAUSES}
FLY_ON = "Fly on"
_UNSURE = 0.5
"""Probability from which something is likelier than not."""
_LIKELY_BEYOND = 0.5
"""Probability of being beyond the limit from which nobody is told to fly on."""


@dataclass(frozen=True, slots=True)
class Said:
    """All that a sentence may speak of; fields as in the verdict."""

    state: State
    candidates: tuple[State, ...]
    probabilities: Mapping[State, float]
    values: Mapping[str, Estimate]
    beyond: float | None
    limit_lpm: float
    missing: int
    sensor: str | None
    blind: tuple[BlindSpot, ...]
    intermittent: Intermittent | None
    coverage: Coverage
    evidence: tuple[MissingEvidence, ...]


def advice(said: Said) -> str:
    """What to do, in plain sentences that say no more than the numbers beside them; first what cannot be seen."""
    if said.state is State.INSUFFICIENT_DATA:
        return keep_recording(said.missing)
    sentences = [_SENTENCES[said.state](said)]
    if said.blind and said.state is not State.HEALTHY:
        sentences.insert(0, f"Seen in part: {_reasons(said.blind)}.")
    if said.intermittent is not None:
        sentences.append(_comes_and_goes(said.intermittent))
    return " ".join(sentences)


def _reasons(spots: Sequence[BlindSpot]) -> str:
    """Why something is not seen, each reason once."""
    return "; ".join(dict.fromkeys(spot.because for spot in spots))


def _level(said: Said) -> str:
    flow = said.values.get("case_flow_at_reference_lpm")
    if flow is None:
        return "how its case flow stands against the limit cannot be told"
    return (
        f"case flow at the reference condition is estimated at {flow.mean:.2f} L/min "
        f"({max(flow.low, 0.0):.2f} to {flow.high:.2f}, limit {said.limit_lpm:g})"
    )


def _seen(blind: Sequence[BlindSpot]) -> str:
    """What health is confined to; empty where nothing is hidden."""
    sized = [b for b in blind if b.below is not None]
    hidden = [b for b in blind if b.below is None]
    if not blind:
        return ""
    first = "Healthy as far as " + "; ".join(f"leakage above {b.below:.1f} L/min goes ({b.because})" for b in sized)
    if not sized:
        first += f"can be seen: {_reasons(hidden)}"
    elif hidden:
        first += f"; unseen beside: {_reasons(hidden)}"
    return f"{first}."


def _is_beyond(said: Said) -> bool:
    """Whether the level lies beyond its limit, by its mean or more likely than not."""
    flow = said.values.get("case_flow_at_reference_lpm")
    if said.beyond is not None and said.beyond >= _LIKELY_BEYOND:
        return True
    return flow is not None and flow.mean > said.limit_lpm


def _healthy(said: Said) -> str:
    unsure = 1.0 - said.probabilities[State.HEALTHY]
    if _is_beyond(said):
        rest = (
            f"Nothing has changed, but {_level(said)}: beyond its limit with a probability of "
            f"{_percent(said.beyond or 0.0)}. Measure the case flow on a test stand"
        )
        if said.coverage.span_k < SPAN_K:
            rest += ", or record windows at clearly different fluid temperatures"
        rest += "."
    elif unsure > _UNSURE:
        likely = max((s for s in said.probabilities if s is not State.HEALTHY), key=lambda s: said.probabilities[s])
        rest = (
            f"Keep recording: something may have changed (probability {_percent(unsure)}, most likely {NAMES[likely]}), "
            f"too little for an alarm yet; {_level(said)}."
        )
    elif "case_flow_at_reference_lpm" not in said.values:
        rest = f"Nothing has changed; {_level(said)}."
    else:
        rest = f"{FLY_ON}: {_level(said)}."
    return f"{_seen(said.blind)} {rest}".strip()


def _percent(share: float) -> str:
    """A share as it is said: no certainty, and nothing that is left at 0 %."""
    if share < 0.005:
        return "under 1 %"
    return "over 99 %" if share > 0.995 else f"{100.0 * share:.0f} %"


def _grown(found: Estimate | None, pattern: str) -> str:
    """By how much something has grown; nothing where its interval holds no growth at all."""
    return "" if found is None or found.low <= 0.0 else pattern.format(found)


def _pump(said: Said) -> str:
    urgency = "Plan the replacement of the pump"
    if _is_beyond(said):
        urgency = "Replace the pump"
    grown = _grown(
        said.values.get("pump_leakage_change_lpm"),
        "its internal leakage has grown by {0.mean:.2f} L/min ({0.low:.2f} to {0.high:.2f}); ",
    )
    return f"{urgency}: {grown}{_level(said)}."


def _compensator(said: Said) -> str:
    setting = said.values.get("pressure_setting_change_bar")
    moved = "it does not regulate as it did"
    if setting is not None and setting.low * setting.high > 0.0:
        moved = f"the regulated pressure has moved by {setting.mean:+.1f} bar"
    return (
        f"Check the pump's compensator: {moved}. "
        "Compare the discharge sensor with a gauge, then adjust; if it does not hold, replace the pump."
    )


def _system(said: Said) -> str:
    by = _grown(said.values.get("system_leakage_change_lpm"), " about {0.mean:.1f} L/min ({0.low:.1f} to {0.high:.1f})")
    return f"Leave the pump in place and look in the circuit: actuators and valves leak{by} more than at the baseline."


def _drain(said: Said) -> str:
    drain = said.values.get("drain_resistance_change_percent")
    by = _grown(drain, " by {0.mean:.0f} % ({0.low:.0f} to {0.high:.0f} %)")
    return f"Leave the pump in place and check the case drain line and its filter: its resistance has grown{by}."


def _sensor(said: Said) -> str:
    return _SENSOR_ADVICE[said.sensor or "case_pressure_bar"]


def _undecided(said: Said) -> str:
    shares = sorted(((said.probabilities.get(c, 0.0), c) for c in said.candidates), reverse=True)
    names = ", ".join(f"{NAMES[c]} ({_percent(p)})" for p, c in shares)
    sides = {SIDE_OF[c] for c in said.candidates}
    if sides == {Side.SYSTEM}:
        first = "Leave the pump in place: the change is in the circuit, the data cannot yet say which."
    elif sides == {Side.PUMP}:
        first = "Plan a check of the pump: the change is its own, the data cannot yet say which."
    else:
        known = "the data cannot yet say what"
        if said.probabilities.get(State.OTHER, 0.0) > _UNSURE:
            known = "no known cause explains the records"
        first = f"Something has changed and {known}. Do not replace the pump on this."
    return f"{first} Possible: {names}.{_would_tell(said)}"


def _would_tell(said: Said) -> str:
    """What the history holds already, and what is still missing, in counts."""
    if not said.evidence:
        return ""
    history, first = said.coverage, said.evidence[0]
    holds = ""
    if history.coldest is not None and history.warmest is not None and history.span_k >= SPAN_K:
        holds = f" The windows span {history.coldest:.0f} to {history.warmest:.0f} degC already;"
    return f"{holds} {first.records} more would decide: {first.what}."


def _comes_and_goes(found: Intermittent) -> str:
    return (
        f"A {NAMES[found.state]} comes and goes: it showed on {found.records} of {found.of} flights "
        f"since {found.since:%d %b %Y}."
    )


_SENTENCES = {
    State.HEALTHY: _healthy,
    State.PUMP_DEGRADATION: _pump,
    State.COMPENSATOR_FAULT: _compensator,
    State.SYSTEM_LEAKAGE: _system,
    State.DRAIN_RESTRICTION: _drain,
    State.SENSOR_FAULT: _sensor,
    State.INDETERMINATE: _undecided,
}


def beyond_case_limit(said: str, found: CasePressure) -> str:
    """Advice where the plain rule of the case pressure is broken: nobody flies on beside it."""
    warning = (
        f"Find out before the next flight why the case stands {found.over_reservoir_bar:.1f} bar over the reservoir "
        f"(this pump's reference {found.reference_bar:.1f} bar, limit {found.limit_bar:g} bar)."
    )
    return f"{warning} {said.replace(f'{FLY_ON}: c', 'C')}"


def implausible(channel: str, why: str, records: int) -> str:
    """What to do where the last records cannot be true."""
    return (
        f"Check the {SENSORS[channel]}, its plug and its line: on the last {records} flights it {why}. "
        "Pump and circuit are not monitored until it is mended: do not judge the pump by these flights."
    )


def gauge(channel: str) -> str:
    """What would tell whether a sensor is right."""
    return f"a reading of the {SENSORS[channel]} against a gauge, with the pump at rest and running"


def gauge_evidence(channel: str, states: tuple[State, ...]) -> tuple[MissingEvidence, ...]:
    """The same as evidence that is missing; nothing where only the sensor is left."""
    return (MissingEvidence(gauge(channel), 1, states),) if len(states) > 1 else ()


def keep_recording(records: int) -> str:
    """What to do before there is a baseline."""
    return f"Keep recording: {records} more flights with a zero-flow window are needed for a baseline."
