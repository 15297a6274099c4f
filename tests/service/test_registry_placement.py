"""Pure parts of the history: places, surroundings, the fold across them, a pump's habit."""

from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from detectors.judgement.assessment import assess
from detectors.reduction.recording import reduce_recording
from detectors.words.flights import outline_of
from detectors.words.observation import History, Observation, Reduction
from detectors.words.thresholds import effective
from detectors.words.verdict import Assessment
from service.history.known import Known, PlacedRecord
from service.history.placement import Interval, changes, place_at
from service.history.setting import Setting, setting_at
from service.monitoring.fold import fold
from service.reading.silence import patience
from tests.service.records import document
from twin.pumps import circuit_parameters, pump_type
from twin.recording import Recording

START = datetime(2026, 5, 2, 7, 11, tzinfo=UTC)
THRESHOLDS = effective({"baseline_records": 3})


def day(n: float) -> datetime:
    return START + timedelta(days=n)


@pytest.fixture(scope="module")
def reduction() -> Reduction:
    channels = {name: np.array(samples) for name, samples in document()["channels"].items()}
    return reduce_recording(Recording(channels, {}), pump_type("h225"), THRESHOLDS)


def observations(reduction: Reduction, n: int, moved_at: int) -> list[Observation]:
    places = [("F-1", "LH") if i < moved_at else ("F-2", "LH") for i in range(n)]
    return [Observation(f"r{i:02}", day(i), *places[i], f"F{i}", reduction) for i in range(n)]


@dataclass(frozen=True)
class Placed:
    observation: Observation
    setting: Setting
    flags: tuple[str, ...] = ()


def folded(placed: list[Placed]) -> tuple[Assessment, ...]:
    records = tuple(PlacedRecord(outline_of(p.observation), "", p.setting, p.flags) for p in placed)
    held = {p.observation.record_id: p.observation for p in placed}
    return fold(Known(pump_type("h225"), THRESHOLDS, records), lambda ids: {i: held[i] for i in ids})


def test_in_one_setting_the_fold_is_the_assessment(reduction: Reduction) -> None:
    seen = observations(reduction, 6, 6)
    expected = assess(History(tuple(seen)), pump_type("h225"), circuit_parameters("shared_return"), THRESHOLDS)
    placed = [Placed(o, Setting()) for o in seen]
    assert folded(placed) == expected
    assert folded([]) == ()


def test_each_aircraft_is_judged_in_its_own_circuit(reduction: Reduction) -> None:
    seen = observations(reduction, 10, 5)
    drained = Setting(circuit="separate_drain")
    placed = [Placed(o, Setting() if i < 5 else drained) for i, o in enumerate(seen)]
    both = folded(placed)
    before = folded(placed[:5])
    after = folded(placed[5:])
    assert both[:5] == before
    measured = ("case_residual_bar", "discharge_residual_bar")
    for together, alone in zip(both[5:], after, strict=True):
        assert [together.trend[m] for m in measured] == [alone.trend[m] for m in measured]
        assert together.verdict.quality.records_used > alone.verdict.quality.records_used  # the pump's own goes on
    # the run of a state goes on across the move
    states = [a.verdict.state for a in both]
    starts = [both[max((j for j in range(1, i + 1) if states[j] != states[j - 1]), default=0)].at for i in range(10)]
    assert [a.verdict.since for a in both] == starts


def test_flags_count_their_records_until_the_pump_moves(reduction: Reduction) -> None:
    seen = observations(reduction, 4, 2)
    placed = [Placed(o, Setting(), ("odd",) if i in (0, 1) else ()) for i, o in enumerate(seen)]
    flags = [a.verdict.quality.flags for a in folded(placed)]
    assert flags == [("odd (1 record)",), ("odd (2 records)",), (), ()]


class TestPlace:
    FIRST = Interval("F-1", "LH", day(0), day(10))
    SECOND = Interval("F-2", "RH", day(20), None)

    def test_an_entry_wins_from_its_start_up_to_its_end(self) -> None:
        both = [self.FIRST, self.SECOND]
        assert place_at(both, "F-1", "LH", day(0)).flags == ()
        contradicted = place_at(both, "F-9", "LH", day(9.99))
        assert (contradicted.aircraft, contradicted.position) == ("F-1", "LH")
        assert "F-9 LH" in contradicted.flags[0]
        assert place_at(both, "F-9", "LH", day(10)).aircraft == "F-9"
        assert place_at(both, "F-1", "LH", day(30)).aircraft == "F-2"

    def test_a_record_from_where_the_pump_was_removed_is_remarked(self) -> None:
        assert "removal" in place_at([self.FIRST], "F-1", "LH", day(11)).flags[0]
        assert place_at([self.FIRST], "F-1", "RH", day(11)).flags == ()
        assert place_at([self.FIRST], "F-1", "LH", day(-1)).flags == ()

    def test_starts_and_ends_are_changes(self) -> None:
        assert changes([self.SECOND, self.FIRST]) == (day(0), day(10), day(20))


def test_the_newest_sensor_by_then_counts() -> None:
    old = {"channel": "case_pressure_bar", "full_scale_bar": 5.0, "since": day(0).isoformat()}
    new = {**old, "full_scale_bar": 10.0, "accuracy_percent_full_scale": 0.5, "since": day(5).isoformat()}
    aircraft = {"circuit": "separate_drain", "sensors": [new, old]}
    assert setting_at(aircraft, day(-1)).sensors == ()
    assert setting_at(aircraft, day(4)).sensors[0].full_scale_bar == 5.0
    fitted = setting_at(aircraft, day(5)).pump_type(pump_type("h225")).sensors["case_pressure_bar"]
    usual = pump_type("h225").sensors["case_pressure_bar"]
    assert fitted.full_scale_bar == 10.0
    assert fitted.accuracy_fs == pytest.approx(0.005)
    assert fitted.repeatability_fs / fitted.accuracy_fs == pytest.approx(usual.repeatability_fs / usual.accuracy_fs)
    assert setting_at({}, day(0)) == Setting() == replace(Setting(), circuit="shared_return")


def test_patience_follows_the_habit() -> None:
    daily = [day(i) for i in range(20)]
    assert patience(daily) == timedelta(days=7)
    weekly = [day(7 * i) for i in range(20)]
    assert patience(weekly) == timedelta(days=35)
    assert patience(daily[:5]) == timedelta(days=30)
    assert patience([day(0)] * 9) == timedelta(days=30)
