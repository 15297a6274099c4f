"""A reset hides nothing: what sets in beside an entry or a lost channel is found as it is without."""

from dataclasses import replace
from datetime import timedelta

import pytest

from detectors.judgement.assessment import assess
from detectors.words.observation import ACTIONS, History, Maintenance, Reduction, Zero
from detectors.words.states import SIDE_OF, Side, State
from detectors.words.thresholds import effective
from tests.detectors.fleet import CIRCUIT, PUMP, Fault, history
from twin.condition import Health

ONSET, RECORDS = 20, 60


def sudden(field: str, amount: float, *, factor: bool = False) -> Fault:
    """A fault that is there from record ``ONSET`` on."""

    def fault(i: int, own: Health) -> Health:
        value = getattr(own, field)
        return own._replace(**{field: value * amount if factor else value + amount}) if i >= ONSET else own

    return fault


FAULTS: dict[str, tuple[State, Fault]] = {
    "setting": (State.COMPENSATOR_FAULT, sudden("pressure_setting_change_bar", -4.0)),
    "worn": (State.PUMP_DEGRADATION, sudden("pump_leakage_scale", 2.3, factor=True)),
    "leaking": (State.SYSTEM_LEAKAGE, sudden("system_leakage_lpm", 6.0)),
    "drain": (State.DRAIN_RESTRICTION, sudden("drain_resistance_scale", 1.5, factor=True)),
}
TOUCHED = {
    "setting": {"setting_adjusted", "pump_overhauled"},
    "worn": {"pump_overhauled"},
    "leaking": set(),
    "drain": {"filter_changed", "drain_cleaned"},
}
"""Entries that may explain the fault away: it came with them, or they may have ended it."""
ALIKE_ON_THE_DAY = {
    ("worn", "drain_cleaned"),
    ("leaking", "drain_cleaned"),
    ("drain", "pump_overhauled"),
}
"""Faults that set in with the very entry that makes unknown what they look like: more case flow through the same drain, or the
same flow through a drain that is another, give one rise of the case pressure. A leak of 0.9 L/min adds two thirds to the drop of
a drain that the entry lets differ by a quarter (one sigma), half as much again is what another pump may leak. No flight
before it can tell, those after it need more than forty."""


def entered(found: History, action: str, before: int) -> History:
    """The history with an entry one hour before a record."""
    return replace(found, maintenance=(Maintenance(found.observations[before].at - timedelta(hours=1), action),))


def without_reservoir(found: History, record: int) -> History:
    """The history with one record whose reservoir channel is missing: its zero is taken against the nominal value."""
    observations = list(found.observations)
    observation = observations[record]
    (window,) = observation.reduction.windows
    means = {name: mean for name, mean in window.means.items() if name != "reservoir_pressure_bar"}
    reduction = Reduction(Zero(observation.reduction.zero.offset_bar, 0.1, True), (replace(window, means=means),), None)
    observations[record] = replace(observation, reduction=reduction)
    return replace(found, observations=tuple(observations))


def last_side(found: History) -> tuple[State, Side]:
    verdict = assess(found, PUMP, CIRCUIT, effective({}))[-1].verdict
    return verdict.state, verdict.side


@pytest.mark.parametrize("before", [ONSET - 9, ONSET, ONSET + 9])
@pytest.mark.parametrize("action", ACTIONS)
@pytest.mark.parametrize("name", FAULTS)
def test_no_entry_hides_a_fault_that_it_did_not_touch(name: str, action: str, before: int) -> None:
    state, fault = FAULTS[name]
    if action in TOUCHED[name]:
        pytest.skip("the entry may be the reason, or the end, of the change")
    for seed in (0, 3):
        found = history(seed, RECORDS, fault)
        told, side = last_side(entered(found, action, before))
        if before == ONSET and (name, action) in ALIKE_ON_THE_DAY:
            assert side in (SIDE_OF[state], Side.UNKNOWN, Side.NONE), seed  # whatever is said, nobody else is accused
            continue
        assert told is not State.HEALTHY, seed
        assert told is state or side in (SIDE_OF[state], Side.UNKNOWN), seed


@pytest.mark.parametrize("record", [ONSET - 1, ONSET, ONSET + 3])
@pytest.mark.parametrize("name", FAULTS)
def test_a_lost_channel_costs_its_record_and_no_more(name: str, record: int) -> None:
    state, fault = FAULTS[name]
    for seed in (0, 3):
        found = history(seed, RECORDS, fault)
        told, side = last_side(without_reservoir(found, record))
        assert told is not State.HEALTHY, seed
        assert told is state or side in (SIDE_OF[state], Side.UNKNOWN), seed


@pytest.mark.parametrize("action", ACTIONS)
def test_an_entry_accuses_no_healthy_pump(action: str) -> None:
    for seed in range(4):
        told, _ = last_side(entered(history(seed, RECORDS), action, ONSET))
        assert told is State.HEALTHY, seed
