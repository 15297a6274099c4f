"""A flight counts once, whatever segments it was recorded in: parts of records told from their outlines alone."""

from datetime import UTC, datetime, timedelta

from detectors.words.flights import Outline, roles_of

START = datetime(2026, 5, 2, 7, tzinfo=UTC)


def outline(
    name: str, segment: str | None, *, flight: str = "F1", steady: bool = True, fast: bool = False, position: str = "LH"
) -> Outline:
    """Outline of a record that began so many minutes after the first as its name says."""
    at = START + timedelta(minutes=int(name[1:]))
    return Outline(name, at, "F-1", position, flight, segment, steady, fast)


def test_the_main_record_stands_for_its_flight() -> None:
    """Also behind a segment that began before it and has a zero-flow window of its own."""
    before, main, after = outline("r0", "burst-1"), outline("r5", None), outline("r9", "burst-2")
    assert roles_of([before, main, after]).counted == {"r5"}
    assert roles_of([before, after]).counted == {"r0"}


def test_a_main_record_without_a_window_leaves_its_flight_to_a_segment() -> None:
    assert roles_of([outline("r0", None, steady=False), outline("r5", "burst-1")]).counted == {"r5"}
    assert roles_of([outline("r0", None, steady=False)]).counted == frozenset()


def test_later_bursts_add_their_lines_and_earlier_or_slow_ones_nothing() -> None:
    """What was recorded before the record that counts cannot add to it: it is taken in event order."""
    records = [
        outline("r0", "burst-1", steady=False, fast=True),
        outline("r5", None),
        outline("r6", "burst-2", steady=False, fast=True),
        outline("r7", "ground", steady=False),
        outline("r8", "burst-3", fast=True),
    ]
    assert roles_of(records).adds_to == {"r6": "r5", "r8": "r5"}


def test_flights_of_other_positions_share_a_name_and_nothing_else() -> None:
    found = roles_of([outline("r0", None), outline("r1", None, position="RH"), outline("r2", None, flight="F2")])
    assert found.counted == {"r0", "r1", "r2"}
