"""The life of an alarm as a pure function: what must hold follows from ISA-18.2 and from the rules' own words."""

import itertools
from datetime import UTC, datetime, timedelta

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.alarms.life_cycle import CASE_PRESSURE, Action, Life, Point, Rules, lives

START = datetime(2026, 5, 1, 8, tzinfo=UTC)
RULES = Rules(on_flights=1, off_flights=2, limit_lpm=1.5, limit_off_lpm=1.425)
SIDES = {
    "pump_degradation": "pump",
    "system_leakage": "system",
    "healthy": "none",
    "indeterminate": "unknown",
    "insufficient_data": "unknown",
}
LETTERS = {
    "h": "healthy",
    "i": "indeterminate",
    "p": "pump_degradation",
    "s": "system_leakage",
    "z": "sensor_fault",
    "b": "insufficient_data",
}


def day(n: float) -> datetime:
    return START + timedelta(days=n)


def points(letters: str, flows: dict[int, float] | None = None) -> list[Point]:
    """One flight a day, one letter each; a capital says that the case pressure is beyond its rule."""
    return [
        Point(f"r{i}", day(i), f"F{i}", state, SIDES.get(state, "sensor"), (), (flows or {}).get(i, 1.0), c.isupper())
        for i, c in enumerate(letters)
        for state in (LETTERS[c.lower()],)
    ]


def action(kind: str, onset: int, seen: int, state: str, priority: str, number: int = 1) -> Action:
    until = day(999) if kind == "shelve" else None
    return Action(number, kind, "ann", "because", until, day(onset), day(seen), state, priority, day(seen + 0.5))


def events(alarm: Life) -> list[str]:
    return [entry["event"] for entry in alarm.history]


def test_a_fault_raises_and_its_end_clears() -> None:
    (alarm,) = lives(points("hhiihhh"), [], RULES)
    assert (alarm.raised_at, alarm.cleared_at) == (day(2), day(5))
    assert alarm.state == "indeterminate"
    assert alarm.priority == "medium"
    assert not alarm.acknowledged
    assert events(alarm) == ["raised", "cleared"]


def test_the_on_delay_counts_flights_not_records() -> None:
    rules = Rules(on_flights=3, off_flights=2, limit_lpm=1.5, limit_off_lpm=1.425)
    assert lives(points("hiihiih"), [], rules) == ()
    (alarm,) = lives(points("hiii"), [], rules)
    assert (alarm.onset_at, alarm.raised_at, alarm.record_id) == (day(1), day(3), "r1")
    burst = [Point(f"b{i}", day(1 + i / 100), "F1", "indeterminate", "unknown") for i in range(5)]
    assert lives(burst, [], rules) == ()


def test_the_off_delay_keeps_one_alarm_through_a_gap() -> None:
    assert len(lives(points("ihihih"), [], RULES)) == 1
    assert len(lives(points("ihhihh"), [], RULES)) == 2


def test_a_new_baseline_ends_the_alarm_at_once() -> None:
    (alarm,) = lives(points("hpb"), [], RULES)
    assert alarm.cleared_at == day(2)
    assert alarm.history[-1]["reason"] == "a new baseline began"


def test_acknowledging_lasts_until_an_escalation() -> None:
    acknowledged = [action("acknowledge", 1, 2, "indeterminate", "medium")]
    (alarm,) = lives(points("hii"), acknowledged, RULES)
    assert alarm.acknowledged
    (alarm,) = lives(points("hiii"), acknowledged, RULES)
    assert alarm.acknowledged
    (alarm,) = lives(points("hiip"), acknowledged, RULES)
    assert not alarm.acknowledged
    assert events(alarm) == ["raised", "acknowledged", "escalated", "reopened"]


def test_wear_beyond_the_limit_is_an_escalation_with_hysteresis() -> None:
    done = [action("acknowledge", 0, 0, "pump_degradation", "high")]
    (alarm,) = lives(points("ppp", {1: 1.49}), done, RULES)
    assert (alarm.priority, alarm.acknowledged) == ("high", True)
    (alarm,) = lives(points("ppp", {1: 1.51, 2: 1.45}), done, RULES)
    assert (alarm.priority, alarm.acknowledged) == ("critical", False)
    (alarm,) = lives(points("ppp", {1: 1.51, 2: 1.42}), done, RULES)
    assert alarm.priority == "high"


def test_another_named_fault_of_the_same_priority_asks_again() -> None:
    done = [action("acknowledge", 0, 0, "pump_degradation", "high")]
    (alarm,) = lives(points("pps"), done, RULES)
    assert not alarm.acknowledged
    assert events(alarm)[-2:] == ["changed", "reopened"]
    (alarm,) = lives(points("ppi"), done, RULES)
    assert alarm.acknowledged, "to know less is no reason to ask again"


@pytest.mark.parametrize("kind", ["shelve", "close"])
def test_an_escalation_takes_it_from_the_shelf_and_opens_what_was_closed(kind: str) -> None:
    done = [action(kind, 0, 1, "indeterminate", "medium")]
    (alarm,) = lives(points("iii"), done, RULES)
    assert (alarm.shelved_until is not None) == (kind == "shelve")
    assert (alarm.closed_at is not None) == (kind == "close")
    (alarm,) = lives(points("iip"), done, RULES)
    assert alarm.shelved_until is None
    assert alarm.closed_at is None
    assert not alarm.acknowledged


def test_a_late_record_that_reveals_more_than_was_seen_asks_again() -> None:
    done = [action("acknowledge", 0, 3, "indeterminate", "medium")]
    (alarm,) = lives(points("iiii"), done, RULES)
    assert alarm.acknowledged
    # the same action, but the history now shows a named fault at the moment of acknowledging
    (alarm,) = lives(points("iipp"), done, RULES)
    assert not alarm.acknowledged
    assert next(e for e in alarm.history if e["event"] == "acknowledged")["effective"] is False


def test_what_was_done_sticks_to_the_stretch_it_was_meant_for() -> None:
    done = [action("acknowledge", 5, 6, "indeterminate", "medium")]
    split = lives(points("ihhhhiihh"), done, RULES)
    assert [a.acknowledged for a in split] == [False, True]
    merged = lives(points("iiiiiiihh"), done, RULES)
    assert [a.acknowledged for a in merged] == [True]
    moved = lives(points("hhhhhhihh"), done, RULES)
    assert [a.acknowledged for a in moved] == [True]
    assert [a.acknowledged for a in lives(points("ihhhhhhhh"), done, RULES)] == [False]


class TestCasePressure:
    """The plain rule: critical on that flight, whatever the cause; it accuses nobody and clears like the others."""

    SLOW = Rules(on_flights=3, off_flights=2, limit_lpm=1.5, limit_off_lpm=1.425)

    @pytest.mark.parametrize("letter", "HIPSZB")
    def test_it_is_critical_on_that_flight_in_every_state(self, letter: str) -> None:
        (alarm,) = lives(points(f"hh{letter}"), [], self.SLOW)
        assert (alarm.onset_at, alarm.raised_at, alarm.priority) == (day(2), day(2), "critical")
        assert alarm.case_pressure_beyond
        assert not alarm.beyond_limit
        assert alarm.history[0]["reason"] == CASE_PRESSURE

    def test_it_accuses_nobody_whom_the_verdict_does_not_name(self) -> None:
        sides = [lives(points(letter), [], RULES)[0].side for letter in "HIBPSZ"]
        assert sides == ["unknown", "unknown", "unknown", "pump", "system", "sensor"]

    @pytest.mark.parametrize("letter", "hb")
    def test_it_clears_after_the_off_delay(self, letter: str) -> None:
        calm, beyond = letter, letter.upper()
        (alarm,) = lives(points(f"{calm}{beyond}{calm}{beyond}{calm}{calm}"), [], RULES)
        assert (alarm.raised_at, alarm.cleared_at) == (day(1), day(5))
        assert alarm.history[-1]["reason"] is None
        (alarm,) = lives(points(f"{calm}{beyond}{calm}"), [], RULES)
        assert alarm.cleared_at is None

    def test_it_steps_down_to_what_the_verdict_says(self) -> None:
        (alarm,) = lives(points("hPp"), [], RULES)
        assert (alarm.priority, alarm.case_pressure_beyond) == ("high", False)
        assert events(alarm) == ["raised", "changed"]

    def test_it_escalates_what_somebody_has_dealt_with(self) -> None:
        done = [action("acknowledge", 0, 0, "indeterminate", "medium")]
        (alarm,) = lives(points("iI"), done, RULES)
        assert not alarm.acknowledged
        assert events(alarm) == ["raised", "acknowledged", "escalated", "reopened"]
        assert alarm.history[2]["reason"] == CASE_PRESSURE

    def test_beside_critical_wear_it_asks_once(self) -> None:
        worn = dict.fromkeys(range(6), 2.0)
        done = [action("acknowledge", 0, 0, "pump_degradation", "critical")]
        (alarm,) = lives(points("pP", worn), done, RULES)
        assert events(alarm) == ["raised", "acknowledged", "changed", "reopened"]
        done.append(action("acknowledge", 0, 1, "pump_degradation", "critical", 2))
        (alarm,) = lives(points("pPpPp", worn), done, RULES)
        assert alarm.acknowledged, "who has seen it once is not asked for every flight"

    def test_a_cause_that_gets_its_name_is_no_reason_to_ask_again(self) -> None:
        done = [action("acknowledge", 0, 0, "healthy", "critical")]
        (alarm,) = lives(points("HHS"), done, RULES)
        assert (alarm.acknowledged, alarm.side) == (True, "system")


HISTORIES = st.text("hipszbHIPB", min_size=1, max_size=25)
ACTIONS = st.lists(
    st.builds(
        action,
        st.sampled_from(["acknowledge", "shelve", "unshelve", "close"]),
        st.integers(0, 24),
        st.integers(0, 24),
        st.sampled_from(["indeterminate", "pump_degradation"]),
        st.sampled_from(["low", "medium", "high", "critical"]),
    ),
    max_size=6,
)


@settings(max_examples=200, deadline=None)
@given(HISTORIES, ACTIONS, st.integers(1, 4), st.integers(1, 4))
def test_laws_of_every_history(letters: str, done: list[Action], on: int, off: int) -> None:
    rules = Rules(on, off, 1.5, 1.425)
    found = lives(points(letters), done, rules)
    bare = lives(points(letters), [], rules)
    # actions never decide whether there is an alarm
    assert [(a.onset_at, a.raised_at, a.cleared_at, a.state) for a in found] == [
        (a.onset_at, a.raised_at, a.cleared_at, a.state) for a in bare
    ]
    assert not any(a.acknowledged or a.closed_at or a.shelved_until for a in bare)
    for before, after in itertools.pairwise(found):
        assert before.cleared_at is not None
        assert before.cleared_at < after.onset_at
    for alarm in found:
        assert alarm.onset_at <= alarm.raised_at
        assert events(alarm).count("raised") == 1
        assert events(alarm).count("cleared") == (alarm.cleared_at is not None)
        assert alarm.closed_at is None or alarm.acknowledged
    # what is known later never changes how the past was raised
    shorter = lives(points(letters[:-1]), [], rules)
    assert [a.raised_at for a in bare][: len(shorter)] == [a.raised_at for a in shorter]
