"""Pumps that follow each other at their positions: who takes over from whom, and what that decides."""

from collections.abc import Sequence
from dataclasses import replace
from datetime import timedelta
from functools import cache

import numpy as np
import pytest

from detectors.bank.position import OF_POSITION
from detectors.evaluation.reality import REALITIES, Course, fleet
from detectors.evaluation.sensing import Sensing, histories
from detectors.evaluation.study import seed_of
from detectors.expectation.components import PLACE
from detectors.judgement.assessment import Fold
from detectors.judgement.handover import FromOthers, handed_over
from detectors.judgement.memory import EXCHANGED
from detectors.judgement.snapshot import fold_from, snapshot
from detectors.judgement.succession import FOLLOWED, Judged, Seat, assess_together, sources_of
from detectors.words.flights import outline_of, roles_of
from detectors.words.observation import History, Maintenance, Observation
from detectors.words.states import Side, State
from detectors.words.thresholds import effective
from tests.detectors.fleet import CIRCUIT, PUMP, START, history

THRESHOLDS = effective({})
A, B = ("F-1", "LH"), ("F-2", "LH")
N_PAIRS, N_FLIGHTS, AT = 2, 90, 50


def seats(pump: int, places: str, first: int = 0) -> list[Seat]:
    """One record a day of a pump, by the letters of its places; a blank is a day without."""
    return [
        Seat(START + timedelta(days=first + i, minutes=pump), f"{pump}-{first + i}", pump, A if letter == "A" else B)
        for i, letter in enumerate(places)
        if letter != " "
    ]


def there(*pumps: Sequence[Seat]) -> dict[tuple[str, str], list[Seat]]:
    return {place: sorted(s for own in pumps for s in own if s.place == place) for place in (A, B)}


def test_a_stay_takes_over_from_the_last_record_of_another_pump() -> None:
    """The first pump at a place takes over nothing, the next one from the record before its own first."""
    one, two = seats(1, "AAABBB"), seats(2, "BB  AAA")
    assert sources_of(one, there(one, two), ()).arrivals == {"1-3": (2, "2-1")}
    assert sources_of(two, there(one, two), ()).arrivals == {"2-4": (1, "1-2")}


def test_a_pump_that_comes_back_with_nobody_between_takes_over_from_itself() -> None:
    one = seats(1, "AAABBBAA")
    assert sources_of(one, there(one), ()).arrivals == {}
    # put in again at the same place: a stay begins, and it is its own predecessor
    assert sources_of(one, there(one), (one[1].at,)).arrivals == {}


def test_two_pumps_at_one_place_at_a_time_begin_one_stay_each() -> None:
    """Contradictory records take turns: what each takes over is asked once."""
    one, two = seats(1, "AAAA"), seats(2, "AAAA")
    assert sources_of(one, there(one, two), ()).arrivals == {}
    assert sources_of(two, there(one, two), ()).arrivals == {"2-0": (1, "1-0")}


def test_hindsight_waits_for_enough_records_of_one_successor() -> None:
    """At the first record behind the twelfth of the next pump; never where a third one came between."""
    one, two = seats(1, "AAA" + "B" * 20), seats(2, "   " + "A" * 20)
    assert FOLLOWED == 12
    assert sources_of(one, there(one, two), ()).hindsights == {"1-15": (2, "2-14")}
    assert sources_of(two, there(one, two), ()).hindsights == {}
    few = two[: FOLLOWED - 1]
    assert sources_of(one, there(one, few), ()).hindsights == {}
    third = seats(3, "A", 10)
    assert sources_of(one, there(one, two, third), ()).hindsights == {}


@cache
def exchanged(kind: str) -> tuple[tuple[Judged, ...], ...]:
    """Pairs with bursts that change places at flight 50: pumps that wear by 1 L/min, or whose drain doubles at flight 25."""
    rng = seed_of(11, "succession", kind)
    flight, first = np.arange(N_FLIGHTS), np.arange(2 * N_PAIRS)[:, None] < N_PAIRS
    size = np.clip((flight - 9) / 30, 0.0, 1.0) * first
    if kind == "drain":
        size = np.where(first, (flight >= 25) & (flight < AT), flight >= AT).astype(float)
    flown = fleet(
        REALITIES[1],
        PUMP,
        CIRCUIT,
        rng,
        2 * N_PAIRS,
        N_FLIGHTS,
        (Course(kind, size),),
        moved_at=AT,
        exchanged=True,
    )
    seen = histories(flown, PUMP, Sensing(burst=True), rng, AT, exchanged=True)
    return tuple(assess_together([seen[i], seen[i + N_PAIRS]], PUMP, CIRCUIT, THRESHOLDS) for i in range(N_PAIRS))


def behind(judged: Judged) -> list[tuple[int, object]]:
    return [(int(a.record_id[:5]), a.verdict) for a in judged.assessments if int(a.record_id[:5]) >= AT]


def test_a_deviation_that_ends_with_an_exchange_was_the_pump_s() -> None:
    """It stays worn where it goes; the next pump is healthy at once, and what it ended is said with the exchange."""
    for goes, comes in exchanged("slippers"):
        assert goes.assessments[-1].verdict.state is State.PUMP_DEGRADATION
        states = {a.verdict.state for a in comes.assessments if int(a.record_id[:5]) >= AT}
        assert states == {State.HEALTHY}
        resolved = comes.assessments[-1].verdict.resolved_by
        assert resolved is not None
        assert (resolved.state, resolved.action) == (State.PUMP_DEGRADATION, EXCHANGED)
        assert resolved.at == next(a.at for a in comes.assessments if int(a.record_id[:5]) >= AT)
        assert goes.assessments[-1].verdict.resolved_by is None


def test_a_deviation_that_survives_an_exchange_is_the_position_s() -> None:
    """The sound pump that comes is never accused, the one that went is healthy where it is now."""
    for goes, comes in exchanged("drain"):
        after = [a.verdict for a in comes.assessments if int(a.record_id[:5]) >= AT]
        assert all(v.side is not Side.PUMP for v in after)
        assert all(State.DRAIN_RESTRICTION in (v.state, *v.candidates) for v in after[3:])
        assert (after[-1].side, after[-1].resolved_by) == (Side.SYSTEM, None)
        final = goes.assessments[-1].verdict
        assert (final.state, final.resolved_by, final.intermittent) == (State.HEALTHY, None, None)


def test_alone_is_alone() -> None:
    """Pumps that share no position are judged as each by itself, to the last digit."""
    one, two = history(3, 14), history(4, 14)
    apart = replace(two, observations=tuple(replace(o, aircraft="F-2") for o in two.observations))
    both = assess_together([one, apart], PUMP, CIRCUIT, THRESHOLDS)
    for own, judged in zip((one, apart), both, strict=True):
        assert judged.assessments == assess_together([own], PUMP, CIRCUIT, THRESHOLDS)[0].assessments
        assert not judged.others


def folded(found: History) -> Fold:
    fold = Fold(PUMP, CIRCUIT, THRESHOLDS)
    list(fold.continued(found.observations, roles_of([outline_of(o) for o in found.observations]), found))
    return fold


def arrived(coming: Observation, fold: Fold, maintenance: tuple[Maintenance, ...] = ()) -> Fold:
    """A new pump behind its first record, which took over from a fold."""
    begun = Fold(PUMP, CIRCUIT, THRESHOLDS)
    others = {coming.record_id: FromOthers(fold.handover(maintenance))}
    list(begun.continued([coming], roles_of([outline_of(coming)]), History((coming,)), others=others))
    return begun


def test_what_is_known_of_the_position_is_handed_on_and_nothing_of_the_pump() -> None:
    fold = folded(history(3, 30))
    known = handed_over(fold.bank, THRESHOLDS, START, 30).position
    drain = PLACE["ln_drain"]
    new = Fold(PUMP, CIRCUIT, THRESHOLDS).bank.filters.covariance[0]
    assert known.covariance[0, 0] < 0.6 * new[drain, drain]
    coming = replace(history(8, 31).observations[30], aircraft="F-1")
    begun = arrived(coming, fold)
    assert begun.place_records == 31
    for name in ("ln_slipper", "setting", "ln_droop"):
        assert PLACE[name] not in [PLACE[n] for n in OF_POSITION]
    assert np.all(np.linalg.eigvalsh(known.covariance) > -1e-12)
    # a pump that has hardly begun there has nothing to hand on
    assert arrived(coming, folded(history(3, 5))).place_records == 1


@pytest.mark.parametrize("action", ["drain_cleaned", "setting_adjusted"])
def test_what_was_done_to_the_pump_that_left_touches_the_position_alone(action: str) -> None:
    fold = folded(history(3, 30))
    coming = history(8, 31).observations[30]
    entry = (Maintenance(coming.at - timedelta(hours=1), action),)
    plain, touched = arrived(coming, fold), arrived(coming, fold, entry)
    drain, setting = PLACE["ln_drain"], PLACE["setting"]
    before, after = (f.bank.filters.covariance[0] for f in (plain, touched))
    assert (after[drain, drain] > before[drain, drain]) == (action == "drain_cleaned")
    assert after[setting, setting] == pytest.approx(before[setting, setting], rel=0.05)


def test_a_snapshot_behind_an_exchange_goes_on_as_the_fold_does() -> None:
    fold = folded(history(3, 30))
    coming = history(8, 34).observations[30:]
    begun = arrived(coming[0], fold)
    again = fold_from(snapshot(begun), PUMP, CIRCUIT, THRESHOLDS)
    roles = roles_of([outline_of(o) for o in coming])
    both = [list(f.continued(coming[1:], roles, History(tuple(coming)))) for f in (begun, again)]
    assert both[0] == both[1]
    assert again.inherited == begun.inherited
