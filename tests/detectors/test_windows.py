"""Pump-off zero and steady windows on recordings with known stretches."""

import time as clock

import numpy as np
import pytest

from detectors.reduction.recording import reduce_recording
from detectors.reduction.windows import steady_windows
from detectors.words.observation import Window, WindowKind
from detectors.words.thresholds import effective
from twin.pumps import pump_type
from twin.recording import Recording

PUMP = pump_type("h225")
THRESHOLDS = effective({})
OFFSET = 0.07


def recording(
    rate_hz: float = 1.0, seed: int = 1, *, off_s: int = 40, zero_s: int = 120, **changes: np.ndarray
) -> Recording:
    """Pump off, then zero flow, then manoeuvres for 60 s; the case sensor sits 0.07 bar too high."""
    rng = np.random.default_rng(seed)
    n = int((off_s + zero_s + 60) * rate_hz)
    time = np.arange(n) / rate_hz
    on, flying = time >= off_s, time >= off_s + zero_s
    wave = np.where(flying, 15.0 * np.sin(time), 0.0)
    channels = {
        "time_s": time,
        "discharge_pressure_bar": np.where(on, 174.0 + wave, 8.0) + rng.normal(0, 0.2, n),
        "case_pressure_bar": np.where(on, 0.9, 0.5) + OFFSET + 0.02 * wave + rng.normal(0, 0.004, n),
        "shaft_speed_rpm": np.where(on, 4600.0, 0.0) + rng.normal(0, 2, n),
        "fluid_temperature_degc": 50.0 + rng.normal(0, 0.05, n),
        "reservoir_pressure_bar": 0.5 + rng.normal(0, 0.003, n),
        "flight_control_activity": np.where(flying, 0.6, 0.0),
    }
    channels |= changes
    return Recording({k: np.array(v, dtype=float) for k, v in channels.items()})


def windows(found: Recording, **thresholds: float) -> list[Window]:
    return [
        w for w in reduce_recording(found, PUMP, effective(thresholds)).windows if w.kind is not WindowKind.PUMP_OFF
    ]


def changed(base: Recording, name: str, samples: np.ndarray) -> Recording:
    return Recording({**base.channels, name: samples})


@pytest.mark.parametrize("rate", [1.0, 10.0, 100.0])
def test_zero_and_window_at_any_rate(rate: float) -> None:
    reduction = reduce_recording(recording(rate), PUMP, THRESHOLDS)
    assert reduction.zero.measured
    assert reduction.zero.offset_bar == pytest.approx(OFFSET, abs=0.003)
    window = reduction.zero_flow
    assert window is not None
    assert window.start_s == pytest.approx(40, abs=2)
    assert window.end_s == pytest.approx(160, abs=2)
    case = window.means["case_pressure_bar"]
    assert case.mean == pytest.approx(0.9 + OFFSET, abs=4 * case.standard_error + 1e-4)
    assert case.standard_error < 0.004
    assert reduction.explanation is None


def test_without_pump_off_the_offset_is_unknown_with_its_prior_spread() -> None:
    zero = reduce_recording(recording(off_s=0), PUMP, THRESHOLDS).zero
    assert not zero.measured
    assert (zero.offset_bar, zero.standard_deviation_bar) == (0.0, 0.06)


def test_without_reservoir_sensor_the_zero_is_less_sure() -> None:
    base = recording()
    without = Recording({k: v for k, v in base.channels.items() if k != "reservoir_pressure_bar"})
    reduction = reduce_recording(without, PUMP, THRESHOLDS)
    assert reduction.zero.standard_deviation_bar > 0.05
    assert "reservoir pressure not measured" in reduction.flags


def test_pressure_that_still_decays_gives_no_zero() -> None:
    base = recording()
    case = base["case_pressure_bar"].copy()
    case[:40] += np.exp(-np.arange(40) / 30.0)
    reduction = reduce_recording(changed(base, "case_pressure_bar", case), PUMP, THRESHOLDS)
    assert not reduction.zero.measured
    off = next(w for w in reduction.windows if w.kind is WindowKind.PUMP_OFF)
    assert "has not settled" in str(off.reason)


@pytest.mark.parametrize(
    ("name", "drift", "reason"),
    [
        ("fluid_temperature_degc", 8.0, "temperature drifts"),
        ("shaft_speed_rpm", 300.0, "speed moves"),
        ("case_pressure_bar", 0.4, "mean of case pressure varies"),
        ("discharge_pressure_bar", 20.0, "mean of discharge pressure varies"),
    ],
)
def test_what_is_not_steady_is_rejected_with_its_reason(name: str, drift: float, reason: str) -> None:
    base = recording(zero_s=32)
    ramp = np.clip((base.time_s - 40) / 32, 0, 1) * drift
    found = windows(changed(base, name, base[name] + ramp))
    assert found
    assert not any(w.accepted for w in found)
    assert any(reason in str(w.reason) for w in found)


@pytest.mark.parametrize(
    ("name", "limit"),
    [
        ("shaft_speed_rpm", 0.01 * 4600.0),  # 1 % of the speed itself
        ("fluid_temperature_degc", 2.0),  # 2 K
        ("case_pressure_bar", 0.01 * 5.0),  # 1 % of 5 bar full scale
        ("discharge_pressure_bar", 0.01 * 350.0),
        ("reservoir_pressure_bar", 0.01 * 5.0),
    ],
)
def test_what_is_steady_ends_at_the_stated_limit(name: str, limit: float) -> None:
    """A single step half-way through the stretch is a swing of its own height; the defaults of the thresholds' table."""
    smooth = {
        "discharge_pressure_bar": 174.0,
        "case_pressure_bar": 0.9,
        "shaft_speed_rpm": 4600.0,
        "fluid_temperature_degc": 50.0,
        "reservoir_pressure_bar": 0.5,
    }
    for share in (0.95, 1.05):
        channels = {n: np.full(32, value) for n, value in smooth.items()}
        channels[name][16:] += share * limit
        (window,) = steady_windows(Recording({"time_s": np.arange(32.0), **channels}), PUMP, THRESHOLDS)
        assert window.accepted == (share < 1.0), (name, window.reason)


@pytest.mark.parametrize(("share", "regulated"), [(0.7, False), (0.8, False), (0.9, True), (1.0, True)])
def test_only_a_regulated_pressure_is_zero_flow(share: float, regulated: bool) -> None:
    """Table 2-1 of the thesis: 173 bar at least at zero flow; a pump that a consumer pulls below 85 % of it delivers."""
    base = recording()
    steady = changed(base, "discharge_pressure_bar", np.where(base.time_s >= 40, share * 173.0, 8.0))
    quiet = changed(steady, "flight_control_activity", np.zeros(len(base)))
    assert bool(windows(quiet)) == regulated


@pytest.mark.parametrize(("share", "turning"), [(0.65, False), (0.75, True)])
def test_a_pump_that_turns_slowly_is_not_at_zero_flow(share: float, turning: bool) -> None:
    base = recording()
    slow = changed(base, "shaft_speed_rpm", np.where(base.time_s >= 40, share * PUMP.nominal_speed_rpm, 0.0))
    assert bool(windows(slow)) == turning


def test_after_a_shutdown_the_line_has_thirty_seconds_to_settle() -> None:
    """The case pressure falls for 29 s after the pump stopped and only then is the reservoir's."""
    n, stopped = 140, 60
    time = np.arange(float(n))
    rng = np.random.default_rng(8)
    decay = 0.4 * np.clip(1.0 - (time - stopped) / 29.0, 0.0, 1.0)
    found = reduce_recording(
        Recording(
            {
                "time_s": time,
                "discharge_pressure_bar": np.where(time < stopped, 174.0, 8.0),
                "case_pressure_bar": 0.5 + OFFSET + decay + rng.normal(0.0, 0.002, n),
                "shaft_speed_rpm": np.where(time < stopped, 4600.0, 0.0),
                "fluid_temperature_degc": np.full(n, 50.0),
                "reservoir_pressure_bar": np.full(n, 0.5),
            }
        ),
        PUMP,
        THRESHOLDS,
    )
    (off,) = (w for w in found.windows if w.kind is WindowKind.PUMP_OFF)
    assert (off.start_s, off.accepted) == (stopped + 30.0, True)
    assert found.zero.measured
    assert found.zero.offset_bar == pytest.approx(OFFSET, abs=0.002)


def test_a_slow_drift_cuts_the_stretch_into_steady_windows() -> None:
    base = recording(zero_s=240)
    ramp = np.clip((base.time_s - 40) / 240, 0, 1) * 6.0
    accepted = [
        w for w in windows(changed(base, "fluid_temperature_degc", base["fluid_temperature_degc"] + ramp)) if w.accepted
    ]
    assert len(accepted) >= 2
    for window in accepted:
        assert window.end_s - window.start_s >= 30


def test_touched_controls_give_no_window_and_say_so() -> None:
    base = recording()
    reduction = reduce_recording(changed(base, "flight_control_activity", np.full(len(base), 0.5)), PUMP, THRESHOLDS)
    assert reduction.zero_flow is None
    assert "untouched controls" in str(reduction.explanation)


def test_too_short_says_how_long_it_must_be() -> None:
    found = windows(recording(zero_s=20))
    assert [w.accepted for w in found] == [False]
    assert "at least 30 s" in str(found[0].reason)
    assert any(w.accepted for w in windows(recording(zero_s=20), window_minimum_duration_s=15))


def test_spikes_and_dropouts_leave_the_window_alone() -> None:
    base = recording()
    case = base["case_pressure_bar"].copy()
    case[[60, 90, 120]] = (5.0, -1.0, 4.0)
    case[70:75] = np.nan
    window = reduce_recording(changed(base, "case_pressure_bar", case), PUMP, THRESHOLDS).zero_flow
    assert window is not None
    assert window.end_s - window.start_s > 100
    assert window.means["case_pressure_bar"].mean == pytest.approx(0.9 + OFFSET, abs=0.003)


def test_a_channel_missing_over_the_stretch_rejects_it() -> None:
    base = recording()
    case = base["case_pressure_bar"].copy()
    case[40:] = np.nan
    found = windows(changed(base, "case_pressure_bar", case))
    assert "case pressure is missing" in str(found[0].reason)


def test_constant_flow_of_a_ground_run_is_its_own_kind() -> None:
    base = recording(zero_s=180)
    commanded = np.where((base.time_s > 100) & (base.time_s < 200), 10.0, 0.0)
    kinds = {w.kind for w in windows(changed(base, "commanded_flow_lpm", commanded)) if w.accepted}
    assert kinds == {WindowKind.ZERO_FLOW, WindowKind.CONSTANT_FLOW}


def test_a_stuck_channel_is_flagged() -> None:
    base = recording()
    case = np.where(base.time_s >= 40, 0.97, 0.57)
    flags = reduce_recording(changed(base, "case_pressure_bar", case), PUMP, THRESHOLDS).flags
    assert any("case_pressure_bar does not change" in f for f in flags)


def test_hours_at_ten_hertz_are_quick() -> None:
    long = recording(10.0, off_s=60, zero_s=7200)
    started = clock.perf_counter()
    reduction = reduce_recording(long, PUMP, THRESHOLDS)
    assert reduction.zero_flow is not None
    assert clock.perf_counter() - started < 10.0  # a guard against quadratic work, not a benchmark


def test_thresholds_must_be_in_order_and_range() -> None:
    with pytest.raises(ValueError, match=r"alarm_records: 0 records is outside 1 to 20 records"):
        effective({"alarm_records": 0})
    with pytest.raises(ValueError, match="mood: no such threshold"):
        effective({"mood": 1})
    with pytest.raises(ValueError, match="lies above"):
        effective({"alarm_off_log_odds": 6.0, "alarm_on_log_odds": 5.0})


def test_each_level_of_a_ground_run_is_a_window_of_its_own() -> None:
    """Section 4.4.1 of the thesis: ground runs at constant flow, one level after the other."""
    found = steady_windows(_ground_run([10.0] * 90 + [20.0] * 90), PUMP, THRESHOLDS)
    flows = [round(w.means["commanded_flow_lpm"].mean, 1) for w in found if w.accepted]
    assert flows == [10.0, 20.0]


def test_an_unknown_command_is_neither_zero_nor_constant_flow() -> None:
    found = steady_windows(_ground_run([0.0] * 60 + [np.nan] * 60 + [10.0] * 60), PUMP, THRESHOLDS)
    assert [(w.kind, round(w.end_s - w.start_s)) for w in found if w.accepted] == [
        (WindowKind.ZERO_FLOW, 60),
        (WindowKind.CONSTANT_FLOW, 59),
    ]


def _ground_run(commanded: list[float]) -> Recording:
    n = len(commanded)
    rng = np.random.default_rng(4)
    flow = np.nan_to_num(np.array(commanded))
    return Recording(
        {
            "time_s": np.arange(n, dtype=np.float64),
            "discharge_pressure_bar": 175.0 - 0.05 * flow + rng.normal(0.0, 0.1, n),
            "case_pressure_bar": 0.6 + 0.01 * flow + rng.normal(0.0, 0.002, n),
            "shaft_speed_rpm": 4600.0 + rng.normal(0.0, 2.0, n),
            "fluid_temperature_degc": np.full(n, 50.0),
            "commanded_flow_lpm": np.array(commanded),
        }
    )
