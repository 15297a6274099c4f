"""Windows and zero go by time: what a recorder does to samples and clock costs information and changes no answer.

The recordings are drawn with known levels; a disturbed one must give the same window as the undisturbed one, its case
pressure above the zero within 0.01 bar and its discharge pressure within 0.1 bar.
"""

from collections.abc import Callable, Mapping

import numpy as np
import pytest

from detectors.reduction.conditioning import LONGEST_AGE_S, conditioned, gaps_of, without_single_spikes
from detectors.reduction.recording import reduce_recording
from detectors.words.observation import Reduction, Window, WindowKind
from detectors.words.thresholds import effective
from twin.pumps import pump_type
from twin.recording import Recording

PUMP = pump_type("h225")
THRESHOLDS = effective({})
OFF_S, ON_S, END_S = 40.0, 45.0, 165.0
ZERO, CASE, DISCHARGE = 0.07, 0.9, 174.0
RATES = (0.2, 0.5, 1.0, 10.0)
SEEDS = {0.2: 12, 0.5: 12, 1.0: 12, 10.0: 4}
Channels = dict[str, np.ndarray]
Disturbance = Callable[[Channels, np.random.Generator], Channels]


def flight(rate_hz: float, seed: int = 1) -> Channels:
    """Off until 40 s, a run-up of 5 s, zero flow until 165 s, manoeuvres until 215 s."""
    rng = np.random.default_rng(seed)
    n = int(215 * rate_hz)
    time = np.arange(n) / rate_hz
    up = np.clip((time - OFF_S) / (ON_S - OFF_S), 0.0, 1.0)
    flying = time >= END_S
    wave = np.where(flying, 15.0 * np.sin(time), 0.0)
    return {
        "time_s": time,
        "discharge_pressure_bar": 8.0 + up * (DISCHARGE - 8.0) + wave + rng.normal(0, 0.2, n),
        "case_pressure_bar": 0.5 + up * (CASE - 0.5) + ZERO + 0.02 * wave + rng.normal(0, 0.004, n),
        "shaft_speed_rpm": 4600.0 * up + rng.normal(0, 2, n),
        "fluid_temperature_degc": 50.0 + rng.normal(0, 0.05, n),
        "reservoir_pressure_bar": 0.5 + rng.normal(0, 0.003, n),
        "flight_control_activity": np.where(flying, 0.6, 0.0),
    }


def reduced(channels: Mapping[str, np.ndarray]) -> Reduction:
    return reduce_recording(Recording({k: np.array(v) for k, v in channels.items()}), PUMP, THRESHOLDS)


def window_of(channels: Mapping[str, np.ndarray]) -> tuple[Window, Reduction]:
    found = reduced(channels)
    assert found.zero.measured, found.windows
    assert found.zero_flow is not None, found.explanation
    return found.zero_flow, found


def rows(keep: Callable[[np.ndarray, np.random.Generator], np.ndarray]) -> Disturbance:
    def disturbed(channels: Channels, rng: np.random.Generator) -> Channels:
        kept = keep(channels["time_s"], rng)
        return {name: samples[kept] for name, samples in channels.items()}

    return disturbed


def jitter(largest_s: float) -> Disturbance:
    def disturbed(channels: Channels, rng: np.random.Generator) -> Channels:
        time = channels["time_s"]
        return {**channels, "time_s": np.sort(time + rng.uniform(-largest_s, largest_s, len(time)))}

    return disturbed


def drift(channels: Channels, rng: np.random.Generator) -> Channels:
    return {**channels, "time_s": channels["time_s"] * (1.0 + rng.uniform(-0.01, 0.01))}


def jump_ahead(channels: Channels, rng: np.random.Generator) -> Channels:
    time = channels["time_s"].copy()
    time[rng.integers(5, len(time) - 5) :] += rng.uniform(1.0, 15.0)
    return {**channels, "time_s": time}


def samples_at_random(channels: Channels, rng: np.random.Generator) -> Channels:
    return {
        name: samples if name == "time_s" else np.where(rng.random(len(samples)) < 0.2, np.nan, samples)
        for name, samples in channels.items()
    }


def one_gap(channels: Channels, rng: np.random.Generator) -> Channels:
    """A single gap of one channel, of 20 s of the 120 s."""
    name = str(rng.choice([c for c in channels if c != "time_s"]))
    start, time = rng.uniform(50.0, 140.0), channels["time_s"]
    return {**channels, name: np.where((time > start) & (time < start + 20.0), np.nan, channels[name])}


def every_nth(channels: Channels, rng: np.random.Generator) -> Channels:
    name = str(rng.choice([c for c in channels if c != "time_s"]))
    changed = channels[name].copy()
    changed[:: int(rng.integers(5, 26))] = np.nan
    return {**channels, name: changed}


def spikes(channels: Channels, rng: np.random.Generator) -> Channels:
    found = dict(channels)
    for name in ("discharge_pressure_bar", "case_pressure_bar", "shaft_speed_rpm", "fluid_temperature_degc"):
        changed = channels[name].copy()
        places = rng.choice(len(changed) // 12, max(1, len(changed) // 60), replace=False) * 12 + 5
        changed[places] = rng.choice([0.0, -5.0, 1000.0])
        found[name] = changed
    return found


def slower(name: str, period_s: float) -> Disturbance:
    def disturbed(channels: Channels, rng: np.random.Generator) -> Channels:
        time = channels["time_s"]
        every = max(1, round(period_s / float(np.median(np.diff(time)))))
        changed = np.full(len(time), np.nan)
        first = int(rng.integers(0, every))
        changed[first::every] = channels[name][first::every]
        return {**channels, name: changed}

    return disturbed


def _at_random(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    kept: np.ndarray = rng.random(len(time)) > 0.2
    return kept


def _but_twenty_seconds(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    start = rng.uniform(50.0, 140.0)
    return ~((time > start) & (time < start + 20.0))


DISTURBANCES: dict[str, Disturbance] = {
    "jitter of 1 us": jitter(1e-6),
    "jitter of 1 ms": jitter(1e-3),
    "jitter of 200 ms": jitter(0.2),
    "drift": drift,
    "jump ahead": jump_ahead,
    "a fifth of the rows at random": rows(_at_random),
    "20 s of rows": rows(_but_twenty_seconds),
    "a fifth of the samples at random": samples_at_random,
    "20 s of a channel": one_gap,
    "every nth sample of a channel": every_nth,
    "single spikes": spikes,
    "temperature every 30 s": slower("fluid_temperature_degc", 30.0),
    "reservoir pressure every 30 s": slower("reservoir_pressure_bar", 30.0),
    "speed every 5 s": slower("shaft_speed_rpm", 5.0),
    "control activity every 5 s": slower("flight_control_activity", 5.0),
    "case pressure every 5 s": slower("case_pressure_bar", 5.0),
}


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("name", DISTURBANCES)
def test_a_disturbed_record_gives_the_undisturbed_answer(name: str, rate: float) -> None:
    plain, whole = window_of(flight(rate))
    kept = 0
    for seed in range(SEEDS[rate]):
        found = reduced(DISTURBANCES[name](flight(rate), np.random.default_rng(seed)))
        window = found.zero_flow
        if window is None or not found.zero.measured:
            assert found.explanation or found.flags, "a record that adds nothing says why"
            continue
        kept += 1
        case = window.means["case_pressure_bar"].mean - found.zero.offset_bar
        assert case == pytest.approx(plain.means["case_pressure_bar"].mean - whole.zero.offset_bar, abs=0.01)
        assert case == pytest.approx(CASE, abs=0.01)
        discharge = window.means["discharge_pressure_bar"].mean
        assert discharge == pytest.approx(plain.means["discharge_pressure_bar"].mean, abs=0.1 if rate >= 0.5 else 0.2)
    # 20 s of 120 s may leave the last stretch just too short at five seconds a sample
    assert kept >= SEEDS[rate] - 1, f"{SEEDS[rate] - kept} of {SEEDS[rate]} records lost their window"


@pytest.mark.parametrize("rate", RATES)
def test_bounds_are_found_to_a_sample(rate: float) -> None:
    window, found = window_of(flight(rate))
    off = found.windows[0]
    assert off.start_s == 0.0
    # the run-up passes a twentieth of the nominal speed within its first quarter of a second
    assert OFF_S - 1.01 / rate <= off.end_s <= OFF_S + 0.25 + 1.01 / rate
    assert window.end_s == pytest.approx(END_S, abs=1.01 / rate)
    # the run-up's speed moves: where it ends, the shortest window that holds a part of it is rejected
    assert window.start_s <= ON_S + THRESHOLDS["window_minimum_duration_s"] + 2.0 / rate


def test_what_was_lost_is_counted_and_told() -> None:
    channels = flight(1.0)
    time = channels["time_s"]
    lost = (time > 99.5) & (time < 102.5)
    window, _ = window_of({**channels, "case_pressure_bar": np.where(lost, np.nan, channels["case_pressure_bar"])})
    assert window.bridged == f"3 of {window.end_s - window.start_s:.3g} s bridged: case pressure"
    plain, _ = window_of(channels)
    assert plain.bridged is None


def test_a_record_that_has_lost_more_than_the_share_says_so() -> None:
    channels = flight(1.0)
    time = channels["time_s"]
    for name in ("shaft_speed_rpm", "case_pressure_bar"):
        lost = (time > OFF_S) & (time < END_S) & (time % 30.0 > 14.0)
        found = reduced({**channels, name: np.where(lost, np.nan, channels[name])})
        assert found.zero_flow is None
        assert "missing" in (found.explanation or "") or "at least 30 s" in (found.explanation or "")


def test_a_record_that_begins_blank_has_no_shutdown_to_settle_from() -> None:
    """A stretch counts as one after a shutdown where the pump has run, not where its first samples are missing."""
    channels = flight(1.0)
    blank = np.where(channels["time_s"] < 5.0, np.nan, channels["shaft_speed_rpm"])
    found = reduced({**channels, "shaft_speed_rpm": blank})
    assert found.zero.measured
    assert found.windows[0].start_s == pytest.approx(5.0, abs=1.0)


def test_settling_after_a_shutdown_goes_by_time_across_a_gap() -> None:
    channels = flight(1.0)
    speed = np.where(channels["time_s"] < 60.0, 4600.0, 0.0)
    falling = np.where(channels["time_s"] < 60.0, CASE + ZERO, 0.5 + ZERO)
    settled = [
        w for w in reduced({**channels, "shaft_speed_rpm": speed, "case_pressure_bar": falling}).windows if w.accepted
    ]
    kept = ~((channels["time_s"] > 62.0) & (channels["time_s"] < 75.0))
    with_gap = {
        name: samples[kept]
        for name, samples in {**channels, "shaft_speed_rpm": speed, "case_pressure_bar": falling}.items()
    }
    found = [w for w in reduced(with_gap).windows if w.accepted]
    starts = [w.start_s for w in settled if w.kind is WindowKind.PUMP_OFF]
    assert starts == [90.0]
    assert [w.start_s for w in found if w.kind is WindowKind.PUMP_OFF] == starts


def test_conditions_are_known_between_samples_up_to_their_stated_age() -> None:
    time = np.arange(400.0)
    for name, age in LONGEST_AGE_S.items():
        for period, known in ((int(age), True), (int(age) + 2, False)):
            sparse = np.full(400, np.nan)
            sparse[::period] = 1.0 + time[::period]
            channels = {n: np.ones(400) for n in ("discharge_pressure_bar", "case_pressure_bar")}
            full = {**channels, "time_s": time, "shaft_speed_rpm": np.ones(400), "fluid_temperature_degc": np.ones(400)}
            filled = conditioned(Recording({**full, name: sparse}), PUMP)[name]
            throughout = name == "reservoir_pressure_bar"
            assert np.isfinite(filled[1:period]).all() == (known or throughout), (name, period)
            if known:
                held = name in ("flight_control_activity", "commanded_flow_lpm")
                assert filled[period // 2] == pytest.approx(1.0 if held else 1.0 + period // 2)


def test_what_is_there_stays_bit_for_bit() -> None:
    channels = flight(10.0)
    found = conditioned(Recording({k: v.copy() for k, v in channels.items()}), PUMP)
    for name, samples in channels.items():
        assert np.array_equal(found[name], samples)


def test_edges_ramps_and_long_excursions_are_no_spikes() -> None:
    step = np.concatenate((np.zeros(50), np.full(50, 4600.0)))
    ramp = np.concatenate((np.zeros(50), np.linspace(0.0, 4600.0, 6), np.full(50, 4600.0)))
    touched = np.where((np.arange(100) >= 40) & (np.arange(100) < 43), 100.0, 0.0)
    for samples in (step, ramp, touched):
        assert np.array_equal(without_single_spikes(samples, 1.0), samples)
    for width in (1, 2):
        spiked = np.full(100, 4600.0)
        spiked[40 : 40 + width] = 0.0
        assert np.flatnonzero(np.isnan(without_single_spikes(spiked, 46.0))).tolist() == list(range(40, 40 + width))


def test_lost_time_is_what_the_gaps_hold() -> None:
    time = np.arange(100.0)
    samples = np.ones(100)
    samples[20:30] = np.nan
    samples[95:] = np.nan
    gaps = gaps_of(time, samples)
    assert gaps.lost(0.0, 60.0) == pytest.approx(10.0)
    assert gaps.lost(25.0, 60.0) == pytest.approx(4.5)
    assert gaps.lost(60.0, 99.0) == pytest.approx(5.0, abs=1.0)
    assert not gaps.too_many(0.0, 60.0)
    assert gaps.too_many(10.0, 35.0)


def test_a_case_sensor_that_starts_late_has_no_zero_and_the_pump_stood_all_the_same() -> None:
    channels = flight(1.0)
    late = np.where(channels["time_s"] < 60.0, np.nan, channels["case_pressure_bar"])
    found = reduced({**channels, "case_pressure_bar": late})
    off = found.windows[0]
    assert (off.kind, off.accepted) == (WindowKind.PUMP_OFF, True)
    assert "case_pressure_bar" not in off.means
    assert not found.zero.measured
    assert "no case pressure while the pump stood: the case sensor's offset is unknown on this record" in found.flags
    assert found.zero_flow is not None


@pytest.mark.parametrize("gone", [(60.0, 300.0), (0.0, 60.0), (0.0, 100.0), (30.0, 130.0)])
def test_a_reservoir_pressure_of_a_part_is_the_same_for_zero_and_window(gone: tuple[float, float]) -> None:
    channels = flight(1.0)
    window, whole = window_of(channels)
    inside = (channels["time_s"] >= gone[0]) & (channels["time_s"] < gone[1])
    channels["reservoir_pressure_bar"] = np.where(inside, np.nan, channels["reservoir_pressure_bar"])
    part_window, part = window_of(channels)
    assert part.zero.offset_bar == pytest.approx(whole.zero.offset_bar, abs=0.01)
    for name in ("case_pressure_bar", "reservoir_pressure_bar"):
        assert part_window.means[name].mean == pytest.approx(window.means[name].mean, abs=0.01)
    assert any("taken from its nearest samples" in flag for flag in part.flags)


def test_a_reservoir_pressure_of_two_samples_is_not_measured() -> None:
    channels = flight(1.0)
    channels["reservoir_pressure_bar"][2:] = np.nan
    _, found = window_of(channels)
    assert "reservoir pressure not measured" in found.flags
