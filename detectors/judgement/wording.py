"""Sentences that a maintainer reads: what to do, and what would tell when the data cannot."""

from collections.abc import Mapping

from detectors.words.states import CAUSES, STATES
from detectors.words.verdict import SIDE_OF, Estimate, Side, State

SENSORS: Mapping[str, str] = {
    "case_pressure_bar": "case pressure sensor",
    "discharge_pressure_bar": "discharge pressure sensor",
    "reservoir_pressure_bar": "reservoir pressure sensor",
}
"""What a maintainer calls the sensor of a channel."""
_SENSOR_ADVICE: Mapping[str, str] = {
    "case_pressure_bar": "Check the case pressure sensor: its zero has moved. Pump and circuit stay monitored as long as "
    "records hold a pump-off stretch.",
    "reservoir_pressure_bar": "Check the reservoir pressure sensor: its reading has moved against the case pressure, with "
    "the pump at rest or running.",
}
NAMES: Mapping[State, str] = {state: STATES[state].word for state in CAUSES}


def advice(
    state: State,
    candidates: tuple[State, ...],
    found: Mapping[str, Estimate],
    limit_lpm: float,
    missing: int,
    sensor: str | None = None,
) -> str:
    """One or two plain sentences for this state; ``missing`` is the number of records a baseline still needs,
    ``sensor`` the channel of a sensor fault.
    """
    if state is State.INSUFFICIENT_DATA:
        return f"Keep recording: {missing} more flights with a zero-flow window are needed for a baseline."
    flow = found["case_flow_at_reference_lpm"]
    if state is State.HEALTHY:
        return (
            f"Fly on. Case flow at the reference condition is estimated at {flow.mean:.2f} L/min (limit {limit_lpm:g})."
        )
    if state is State.PUMP_DEGRADATION:
        leak = found.get("pump_leakage_change_lpm")
        urgency = "Replace the pump" if flow.mean > limit_lpm else "Plan the replacement of the pump"
        level = f"case flow at the reference condition is estimated at {flow.mean:.2f} L/min (limit {limit_lpm:g})."
        if leak is None or leak.low <= 0.0:
            return f"{urgency}: {level}"
        grown = f"{leak.mean:.2f} L/min ({leak.low:.2f} to {leak.high:.2f})"
        return f"{urgency}: its internal leakage has grown by {grown}; {level}"
    if state is State.COMPENSATOR_FAULT:
        setting = found.get("pressure_setting_change_bar")
        by = f" by {setting.mean:+.1f} bar" if setting else ""
        return (
            f"Check the pump's compensator: the regulated pressure has moved{by}. "
            "Compare the discharge sensor with a gauge, then adjust; if it does not hold, replace the pump."
        )
    if state is State.SYSTEM_LEAKAGE:
        leak = found.get("system_leakage_change_lpm")
        by = f" about {leak.mean:.1f} L/min ({leak.low:.1f} to {leak.high:.1f})" if leak else ""
        return (
            f"Leave the pump in place and look in the circuit: actuators and valves leak{by} more than at the baseline."
        )
    if state is State.DRAIN_RESTRICTION:
        drain = found.get("drain_resistance_change_percent")
        by = f" by {drain.mean:.0f} % ({drain.low:.0f} to {drain.high:.0f} %)" if drain else ""
        return f"Leave the pump in place and check the case drain line and its filter: its resistance has grown{by}."
    if state is State.SENSOR_FAULT:
        return _SENSOR_ADVICE[sensor or "case_pressure_bar"]
    names = ", ".join(NAMES[c] for c in candidates)
    if {SIDE_OF[c] for c in candidates} == {Side.SYSTEM}:
        return (
            f"Leave the pump in place: the change is in the circuit, the data cannot yet say which. Possible: {names}."
        )
    if {SIDE_OF[c] for c in candidates} == {Side.PUMP}:
        return f"Plan a check of the pump: the change is its own, the data cannot yet say which. Possible: {names}."
    return (
        f"Something has changed and the data cannot yet say what. Possible: {names}. Do not replace the pump on this."
    )


def implausible(channel: str, why: str, records: int) -> str:
    """What to do where the last records cannot be true."""
    return (
        f"Check the {SENSORS[channel]}, its plug and its line: on the last {records} flights it {why}. "
        "Pump and circuit are not monitored until it is mended: do not judge the pump by these flights."
    )


def gauge(channel: str) -> str:
    """What would tell whether a sensor is right."""
    return f"a reading of the {SENSORS[channel]} against a gauge, with the pump at rest and running"


def resolving_measurement(candidates: tuple[State, ...]) -> str | None:
    """What would separate the candidates; None when nothing has to be separated."""
    left = set(candidates)
    if len(left) < 2:
        return None
    if State.SENSOR_FAULT in left:
        return "records that begin with a pump-off stretch: there the case sensor must read the reservoir"
    if State.SYSTEM_LEAKAGE in left and State.PUMP_DEGRADATION in left:
        return (
            "ground runs at zero, 10 and 20 L/min with the commanded flow in the record (commanded_flow_lpm): "
            "leaks in the circuit and in the pump show differently there"
        )
    if {State.PUMP_DEGRADATION, State.DRAIN_RESTRICTION} <= left:
        return "zero-flow windows at clearly different fluid temperatures (20 K apart), or case flow on a test stand"
    if State.COMPENSATOR_FAULT in left:
        return (
            "load steps of a known flow (commanded_flow_lpm) sampled at 5 Hz or faster: they show the droop; "
            "or a gauge at discharge"
        )
    return "a ground run at constant flow, or zero-flow windows at clearly different fluid temperatures"
