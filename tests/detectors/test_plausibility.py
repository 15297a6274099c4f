"""Records that cannot be true: each doubt against what a sensor, a converter and a running pump can do."""

from collections.abc import Mapping
from dataclasses import replace

import pytest

from detectors.bank.measurement import measured_windows
from detectors.judgement.assessment import assess
from detectors.judgement.plausibility import (
    CASE,
    DISCHARGE,
    IMPLAUSIBLE_FLIGHTS,
    Doubt,
    Reference,
    case_pressure,
    doubt,
    is_saturated,
)
from detectors.words.observation import Behaviour, History, Observation, Residual
from detectors.words.states import Side, State
from detectors.words.thresholds import effective
from detectors.words.verdict import Assessment, Verdict
from tests.detectors.fleet import CIRCUIT, PUMP, history

THRESHOLDS = effective({})
SOUND = history(1, 16).observations
RESERVOIR = "reservoir_pressure_bar"
LIVELY = Behaviour(at_rest=5, running=8, samples=300, at_full_scale=0.0)
FULL_SCALE = PUMP.sensors[CASE].full_scale_bar


def shown(observation: Observation, **means: float) -> Observation:
    """The record with other means, by channel without its ending."""
    (window,) = observation.reduction.windows
    changed = {f"{name}_pressure_bar": value for name, value in means.items()}
    kept = {name: replace(mean, mean=changed.get(name, mean.mean)) for name, mean in window.means.items()}
    return replace(observation, reduction=replace(observation.reduction, windows=(replace(window, means=kept),)))


def behaving(observation: Observation, **behaviours: Behaviour) -> Observation:
    found = {f"{name}_pressure_bar": behaviour for name, behaviour in behaviours.items()}
    return replace(observation, reduction=replace(observation.reduction, behaviours=found))


def mean_of(observation: Observation, channel: str) -> float:
    (window,) = observation.reduction.windows
    return window.means[channel].mean


def residuals_of(observation: Observation) -> Mapping[str, Residual]:
    return measured_windows([observation], {}, PUMP, CIRCUIT)[observation.record_id].residuals


def doubted(observation: Observation, reference: Reference | None = None) -> Doubt | None:
    return doubt(observation, residuals_of(observation), PUMP, reference)


def nominal_rise(observation: Observation) -> float:
    """Case over reservoir pressure of the nominal pump at the record's condition [bar]."""
    return residuals_of(observation)[CASE].twin - mean_of(observation, RESERVOIR)


def with_rise(observation: Observation, share: float) -> Observation:
    """The record of a case that stands a share of the nominal rise over the reservoir, its zero as it was."""
    zero = observation.reduction.zero.offset_bar
    return shown(observation, case=mean_of(observation, RESERVOIR) + zero + share * nominal_rise(observation))


def test_a_sound_record_is_believed() -> None:
    for observation in SOUND:
        assert doubted(observation) is None
        assert doubted(behaving(observation, case=LIVELY, discharge=LIVELY)) is None


@pytest.mark.parametrize(("share", "believed"), [(0.0, False), (0.2, False), (0.4, True), (0.55, True), (3.0, True)])
def test_a_running_pump_s_case_does_not_read_the_reservoir(share: float, believed: bool) -> None:
    """A quarter of the nominal rise is less than half of what the freest drain and the tightest pump leave, 0.55."""
    found = doubted(with_rise(SOUND[0], share))
    assert (found is None) is believed
    if found is not None:
        assert (found.channel, found.states) == (CASE, (State.SENSOR_FAULT,))
        assert "over the reservoir" in found.why


def test_a_rise_too_small_to_be_seen_is_not_missed() -> None:
    """A sensor far too wide for the case, whose three steps are more than the whole rise, says nothing of it."""
    coarse = replace(PUMP, sensors={**PUMP.sensors, CASE: replace(PUMP.sensors[CASE], full_scale_bar=6000.0)})
    dead = with_rise(SOUND[0], 0.0)
    assert doubt(dead, residuals_of(dead), PUMP, None) is not None
    assert 3.0 * coarse.sensors[CASE].resolution_bar > nominal_rise(SOUND[0])
    assert doubt(dead, residuals_of(dead), coarse, None) is None


@pytest.mark.parametrize(
    ("at_rest", "running", "samples", "believed"),
    [
        (5, 1, 300, False),  # frozen as the pump starts
        (5, 2, 300, False),  # its converter toggles between two neighbours
        (5, 3, 300, True),
        (
            2,
            2,
            300,
            True,
        ),  # a coarse sensor that toggles at rest as well: its steps are that wide, its window that quiet
        (1, 1, 300, True),
        (5, 1, 29, True),  # half a minute says nothing yet
    ],
)
def test_a_case_sensor_that_stops_with_the_pump_running_is_doubted(
    at_rest: int, running: int, samples: int, believed: bool
) -> None:
    found = doubted(behaving(SOUND[0], case=Behaviour(at_rest, running, samples, 0.0), discharge=LIVELY))
    assert (found is None) is believed
    if found is not None:
        assert (found.channel, found.states) == (CASE, (State.SENSOR_FAULT,))


@pytest.mark.parametrize(
    ("behaviour", "with_window", "believed"),
    [
        (Behaviour(1, 1, 300, 0.0), False, False),
        (Behaviour(1, 2, 300, 0.0), False, False),
        (Behaviour(1, 3, 300, 0.0), False, True),
        (Behaviour(0, 1, 300, 0.0), False, True),  # nothing of it at rest: it may have been at pressure all along
        (Behaviour(1, 1, 20, 0.0), False, True),
        (
            Behaviour(1, 2, 300, 0.0),
            True,
            True,
        ),  # a coarse sensor over a quiet window that holds the regulated pressure
    ],
)
def test_a_discharge_sensor_that_never_leaves_its_place_is_doubted(
    behaviour: Behaviour, with_window: bool, believed: bool
) -> None:
    """From standstill to 175 bar and back a pressure cannot show two values; over a window alone it can."""
    observation = behaving(SOUND[0], discharge=behaviour, case=LIVELY)
    found = doubt(observation, residuals_of(observation) if with_window else {}, PUMP, None)
    assert (found is None) is believed
    if found is not None:
        assert (found.channel, found.states) == (DISCHARGE, (State.SENSOR_FAULT,))


def at_full_scale(risen: float, share: float = 0.9) -> tuple[Observation, Reference]:
    """A case sensor at its end, and what was expected: the discharge pressure lies ``risen`` above that."""
    expected = Reference(
        discharge_bar=mean_of(SOUND[0], DISCHARGE), case_bar=1.4, over_reservoir_bar=0.9, leading_case_bar=1.4
    )
    observation = shown(SOUND[0], case=FULL_SCALE, discharge=expected.discharge_bar + risen)
    clipped = Behaviour(5, 1, 300, share)
    return behaving(observation, case=clipped, discharge=LIVELY), expected


def test_a_full_scale_that_the_discharge_pressure_contradicts_is_the_sensor_s() -> None:
    """The spool refers to the case, so that discharge follows it bar for bar: 3.6 bar must show as half of that at least."""
    observation, expected = at_full_scale(risen=0.4)
    assert is_saturated(observation, PUMP)
    found = doubted(observation, expected)
    assert found is not None
    assert (found.channel, found.states) == (CASE, (State.SENSOR_FAULT,))
    assert "+0.4 bar" in found.why


@pytest.mark.parametrize("risen", [1.9, 3.6])
def test_a_full_scale_that_the_discharge_pressure_confirms_is_believed(risen: float) -> None:
    observation, expected = at_full_scale(risen)
    assert doubted(observation, expected) is None


def test_a_full_scale_that_the_likeliest_cause_expects_is_believed() -> None:
    observation, expected = at_full_scale(risen=0.0)
    assert doubted(observation, replace(expected, leading_case_bar=0.79 * FULL_SCALE)) is not None
    assert doubted(observation, replace(expected, leading_case_bar=0.81 * FULL_SCALE)) is None


def test_a_full_scale_without_a_reference_leaves_both() -> None:
    """A blocked drain does it as well as a broken sensor; so does a window that is not the one at full scale."""
    observation, expected = at_full_scale(risen=0.0)
    both = (State.DRAIN_RESTRICTION, State.SENSOR_FAULT)
    found = doubted(observation)
    assert found is not None
    assert (found.channel, found.states) == (CASE, both)
    elsewhere = shown(observation, case=1.4)
    found = doubted(elsewhere, expected)
    assert found is not None
    assert found.states == both
    # a share of samples at the end is a peak, no state
    assert doubted(at_full_scale(risen=3.6, share=0.4)[0], expected) is not None  # still two values while it runs
    assert doubted(behaving(at_full_scale(3.6)[0], case=replace(LIVELY, at_full_scale=0.4)), expected) is None


@pytest.mark.parametrize(("off", "believed"), [(20.0, True), (-20.0, True), (30.0, False), (-60.0, False)])
def test_a_regulated_pressure_that_no_screw_reaches_is_doubted(off: float, believed: bool) -> None:
    """Ten bar are a screw at its end; beyond 25 it is the compensator that broke or the sensor, and nobody can say which."""
    twin = residuals_of(SOUND[0])[DISCHARGE].twin
    found = doubted(shown(SOUND[0], discharge=twin + off))
    assert (found is None) is believed
    if found is not None:
        assert (found.channel, found.states) == (DISCHARGE, (State.COMPENSATOR_FAULT, State.SENSOR_FAULT))


def assessed(observations: list[Observation]) -> tuple[Assessment, ...]:
    return assess(History(tuple(observations)), PUMP, CIRCUIT, THRESHOLDS)


def changed(observation: Observation, kind: str) -> Observation:
    if kind == "dead":
        return with_rise(observation, 0.0)
    if kind == "frozen":
        return behaving(observation, case=Behaviour(5, 1, 300, 0.0), discharge=LIVELY)
    return shown(observation, discharge=mean_of(observation, DISCHARGE) - 40.0)


def test_three_flights_in_a_row_are_said_and_one_is_not() -> None:
    """Nor are two, nor three with a good one among them; what was known before stays."""
    assert IMPLAUSIBLE_FLIGHTS == 3
    for kind in ("dead", "frozen"):
        bad = [changed(o, kind) if i in (11, 12, 13) else o for i, o in enumerate(SOUND)]
        found = [a.verdict for a in assessed(bad)]
        assert [v.state for v in found[10:15]] == [State.HEALTHY] * 3 + [State.SENSOR_FAULT, State.HEALTHY], kind
        said = found[13]
        assert (said.side, said.sensor, said.candidates) == (Side.SENSOR, CASE, ())
        assert "case pressure sensor" in said.advice
        assert sum(said.probabilities.values()) == pytest.approx(1.0)
        assert said.probabilities[State.SENSOR_FAULT] == said.confidence > 0.9
        assert said.estimates == found[10].estimates
        assert said.quality.records_used == found[10].quality.records_used == 11
        assert [any(CASE in flag for flag in v.quality.flags) for v in found[10:15]] == [False, True, True, True, False]
        among = [changed(o, kind) if i in (10, 11, 13, 14) else o for i, o in enumerate(SOUND)]
        assert {a.verdict.state for a in assessed(among)[8:]} == {State.HEALTHY}


def test_what_two_causes_can_do_stays_undecided() -> None:
    bad = [changed(o, "far off") if i >= 12 else o for i, o in enumerate(SOUND)]
    found: list[Verdict] = [a.verdict for a in assessed(bad)]
    assert [v.state for v in found[11:15]] == [State.HEALTHY] * 3 + [State.INDETERMINATE]
    said = found[-1]
    assert said.candidates == (State.COMPENSATOR_FAULT, State.SENSOR_FAULT)
    assert (said.side, said.sensor) == (Side.UNKNOWN, DISCHARGE)
    assert said.probabilities[State.COMPENSATOR_FAULT] == said.probabilities[State.SENSOR_FAULT] > 0.4
    assert said.missing_evidence
    assert said.missing_evidence[0].would_decide == said.candidates
    assert said.since == SOUND[14].at


def test_doubts_of_two_channels_are_not_added_up() -> None:
    bad = list(SOUND)
    for i, kind in ((10, "frozen"), (11, "far off"), (12, "frozen"), (13, "far off"), (14, "far off")):
        bad[i] = changed(bad[i], kind)
    assert {a.verdict.state for a in assessed(bad)[8:]} == {State.HEALTHY}


@pytest.mark.parametrize(
    ("measured", "has_baseline", "beyond"),
    [
        (1.3, True, False),
        (2.05, True, False),
        (2.11, True, True),  # twice its own 0.8 bar over the reservoir
        (2.11, False, False),  # whose reference is not known yet
        (4.05, False, True),  # 3.55 bar over the reservoir: beyond the limit, whoever it is
    ],
)
def test_the_plain_rule_of_case_pressure(measured: float, has_baseline: bool, beyond: bool) -> None:
    """The healthy pump was to show 1.3 bar with a zero of 0.1 and 0.4 in the reservoir: 0.8 over it."""
    reference = Reference(175.0, 1.3, 0.8, 1.3)
    found = case_pressure(measured, reference, 3.5, has_baseline=has_baseline)
    assert found.over_reservoir_bar == pytest.approx(measured - 0.5)
    assert (found.reference_bar, found.limit_bar, found.beyond) == (0.8, 3.5, beyond)


def test_a_drain_three_times_as_resistant_breaks_the_plain_rule() -> None:
    """Case over reservoir as measured, zero taken out; the reference is what this pump's own drain would show."""
    blocked = history(
        2, 16, lambda i, own: own._replace(drain_resistance_scale=own.drain_resistance_scale * (1 + 2 * (i > 11)))
    )
    sound = history(2, 16)
    found = assess(blocked, PUMP, CIRCUIT, THRESHOLDS)
    for i, (assessment, observation, healthy) in enumerate(
        zip(found, blocked.observations, sound.observations, strict=True)
    ):
        rule = assessment.verdict.case_pressure
        assert rule is not None
        zero = observation.reduction.zero.offset_bar
        over, own = (mean_of(o, CASE) - zero - mean_of(o, RESERVOIR) for o in (observation, healthy))
        if i >= 8:
            assert rule.over_reservoir_bar == pytest.approx(over, abs=0.05)
            assert rule.beyond is (i > 11)
        if i == 12:
            assert rule.reference_bar == pytest.approx(own, abs=0.1)
