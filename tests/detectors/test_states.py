"""The table of states is complete, and its order is one."""

from detectors.words.states import BY_URGENCY, CAUSES, QUIET, SIDE_OF, STATES, VERDICTS, Side
from detectors.words.verdict import FAULTS, UNINFORMED, State


def test_every_state_has_its_row_in_the_order_of_the_states() -> None:
    assert list(STATES) == list(State)


def test_words_labels_and_marks_tell_states_apart() -> None:
    """Marks stand for the side: a colour-blind reader sees where to look."""
    assert len({row.word for row in STATES.values()}) == len({row.label for row in STATES.values()}) == len(State)
    named = [(STATES[f].side, STATES[f].mark) for f in FAULTS]
    assert len(set(named)) == len({side for side, _ in named}) == len({mark for _, mark in named})


def test_urgency_is_a_strict_order_that_ends_with_what_is_quiet() -> None:
    assert sorted(STATES[s].urgency for s in VERDICTS) == list(range(len(VERDICTS)))
    assert set(BY_URGENCY[-len(QUIET) :]) == set(QUIET)


def test_what_competes_with_health_is_what_has_a_side() -> None:
    assert all(SIDE_OF[f] in (Side.PUMP, Side.SYSTEM, Side.SENSOR) for f in FAULTS)
    assert set(State) - set(FAULTS) == {*QUIET, State.INDETERMINATE, State.OTHER}
    assert set(UNINFORMED) == set(CAUSES) == {State.HEALTHY, *FAULTS, State.OTHER}


def test_nothing_quiet_raises_an_alarm() -> None:
    assert {s for s in State if STATES[s].priority is None} == {State.HEALTHY, State.INSUFFICIENT_DATA}
