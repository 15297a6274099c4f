"""What a history remembers of faults that are gone: the plain bookkeeping, record by record."""

from collections.abc import Iterable
from datetime import UTC, datetime, timedelta

from detectors.judgement.memory import Entry, Memory, Showing
from detectors.words.states import State
from detectors.words.verdict import Intermittent, Resolved

START = datetime(2026, 1, 5, 8, 0, tzinfo=UTC)
DRAIN, WORN = State.DRAIN_RESTRICTION, State.PUMP_DEGRADATION


def day(i: int) -> datetime:
    return START + timedelta(days=i)


def after(memory: Memory, leaders: Iterable[State | None], first: int = 0) -> Memory:
    """The memory after one record a day, each with the fault that leads the alarm, or none."""
    for i, leader in enumerate(leaders, first):
        memory = memory.after(leader, day(i))
    return memory


def test_nothing_is_remembered_of_a_quiet_pump() -> None:
    memory = after(Memory(), [None] * 30)
    assert memory == Memory()
    assert memory.came_and_went is None


def test_a_fault_that_vanished_is_remembered() -> None:
    """Four records with an alarm from day 5 on, then none: of what was asked since day 5 it led on four."""
    memory = after(Memory(), [None] * 5 + [DRAIN] * 4)
    assert (memory.suspect, memory.since, memory.came_and_went) == (DRAIN, day(5), None)  # it stands: nothing is over
    gone = after(memory, [None] * 6, 9)
    assert (gone.suspect, gone.since) == (None, None)
    assert gone.came_and_went == Intermittent(DRAIN, 4, 10, day(5))


def test_a_short_alarm_is_not() -> None:
    """An alarm takes three records to be raised: what lasted two more is a rumour."""
    memory = after(Memory(), [None, DRAIN, DRAIN, None, None])
    assert memory.came_and_went is None
    assert memory.suspect is None
    assert after(Memory(), [None, DRAIN, DRAIN, DRAIN, None]).came_and_went is not None


def test_a_fault_that_returns_is_counted_on() -> None:
    memory = after(Memory(), [DRAIN] * 3 + [None] * 4 + [DRAIN] * 5 + [None] * 2)
    assert memory.came_and_went == Intermittent(DRAIN, 8, 14, day(0))
    # another fault that came and went is another memory
    other = after(memory, [WORN] * 3 + [None] * 2, 14)
    assert other.came_and_went == Intermittent(WORN, 3, 5, day(14))


def test_a_fault_that_comes_and_goes_counts_where_it_showed() -> None:
    """It had shown on two of the last five records when the alarm began, and on every second one of the next six."""
    memory = Memory().after(DRAIN, day(5), Showing(True, 2, 5))
    for i in range(1, 6):
        memory = memory.after(DRAIN, day(5 + i), Showing(i % 2 == 0))
    found = memory.after(None, day(11)).came_and_went
    assert found == Intermittent(DRAIN, 2 + 3, 5 + 6 + 1, day(5))


def test_who_led_last_is_what_is_remembered() -> None:
    memory = after(Memory(), [WORN, WORN, DRAIN, DRAIN, None])
    found = memory.came_and_went
    assert found is not None
    assert (found.state, found.records, found.since) == (DRAIN, 4, day(0))


def test_it_never_showed_more_often_than_it_was_asked_for() -> None:
    patterns = ("0001110100111", "1110111011100", "11111111110", "0101010101", "1110001110000111100")
    for pattern in patterns:
        memory = Memory()
        for i, bit in enumerate(pattern):
            memory = memory.after(DRAIN if bit == "1" else None, day(i))
            found = memory.came_and_went
            if found is not None:
                assert 0 < found.records <= found.of <= i + 1, pattern


def test_an_entry_resolves() -> None:
    """The fault that ended with it is explained: nothing came and went, and the verdict names the action and its day."""
    memory = after(Memory(), [DRAIN] * 6).done("filter_changed", day(6))
    resolved = memory.ended(DRAIN)
    assert resolved.resolved == Resolved(DRAIN, "filter_changed", day(6))
    assert (resolved.suspect, resolved.since, resolved.shown) == (None, None, 0)
    quiet = after(resolved, [None] * 10, 7)
    assert quiet.came_and_went is None
    assert quiet.resolved == resolved.resolved  # it stays said


def test_nothing_ends_with_an_entry_that_nobody_made() -> None:
    memory = after(Memory(), [DRAIN] * 6)
    assert memory.ended(DRAIN) == memory


def test_what_was_left_behind_did_not_come_and_go() -> None:
    memory = after(Memory(), [DRAIN] * 6).moved()
    assert after(memory, [None] * 5, 6).came_and_went is None
    # what was remembered before stays
    gone = after(Memory(), [DRAIN] * 6 + [None] * 2)
    assert gone.moved().came_and_went == gone.came_and_went


def test_an_entry_alone_resolves_nothing() -> None:
    memory = after(Memory(), [DRAIN] * 6).done("filter_changed", day(6))
    assert memory.resolved is None
    assert after(memory, [DRAIN] * 3, 6).suspect is DRAIN
    assert after(memory, [None] * 3, 6).came_and_went == Intermittent(DRAIN, 6, 9, day(0))


def test_entries_of_one_day_are_one() -> None:
    """Joined in the order of the alphabet; the instant is that of the last. The next day's stand alone."""
    morning, evening = day(3), day(3) + timedelta(hours=9)
    memory = Memory().done("filter_changed", morning).done("drain_cleaned", evening)
    assert memory.entry == Entry(("filter_changed", "drain_cleaned"), evening)
    assert memory.ended(DRAIN).resolved == Resolved(DRAIN, "drain_cleaned+filter_changed", evening)
    twice = memory.done("filter_changed", evening)
    assert twice.ended(DRAIN).resolved == Resolved(DRAIN, "drain_cleaned+filter_changed", evening)
    later = memory.done("fluid_changed", day(4))
    assert later.entry == Entry(("fluid_changed",), day(4))
