"""Sensors show what their data sheet says."""

import numpy as np
import pytest

from twin.recording import Recording
from twin.simulation.instrumentation import HELICOPTER, TEST_BENCH, Instrument, SensorModel, measured, shown, specimen

N = 20_000
TRUTH = np.full(N, 1.0)


def rng() -> np.random.Generator:
    return np.random.default_rng(9)


def test_a_perfect_sensor_shows_the_truth() -> None:
    samples = np.linspace(0, 1, 50)
    assert shown(samples, 1.0, SensorModel(-1, 5), rng()) == pytest.approx(samples)


def test_repeatability_changes_between_recordings_and_not_within() -> None:
    model = SensorModel(-10, 10, repeatability=0.1)
    generator = rng()
    means = []
    for _ in range(500):
        samples = shown(TRUTH[:20], 1.0, model, generator)
        assert np.ptp(samples) == 0.0
        means.append(samples[0])
    assert np.std(means) == pytest.approx(0.1, rel=0.1)


def test_a_specimen_keeps_its_error() -> None:
    generator = rng()
    one = specimen(SensorModel(-10, 10, accuracy=0.5), generator)
    first, second = (shown(TRUTH[:5], 1.0, one, generator)[0] for _ in range(2))
    assert first == second != 1.0


def test_quantum_range_dropouts_and_spikes() -> None:
    quantised = shown(np.linspace(0, 4, N), 1.0, SensorModel(0, 5, quantum=5 / 4096), rng())
    assert np.allclose(quantised / (5 / 4096), np.round(quantised / (5 / 4096)))
    assert shown(np.array([-3.0, 9.0]), 1.0, SensorModel(0, 5), rng()) == pytest.approx([0.0, 5.0])
    gaps = shown(TRUTH, 1.0, SensorModel(0, 5, dropout_probability=0.1), rng())
    assert np.isnan(gaps).mean() == pytest.approx(0.1, abs=0.01)
    spikes = shown(TRUTH, 1.0, SensorModel(0, 5, spike_probability=0.01), rng())
    assert (spikes != 1.0).mean() == pytest.approx(0.01, abs=0.003)


def test_filter_passes_slow_and_damps_fast() -> None:
    step, corner = 1e-4, 100.0
    time = np.arange(N) * step
    model = SensorModel(-10, 10, filter_hz=corner)
    for frequency, gain in ((5.0, 1.0), (corner, 1 / np.sqrt(2)), (2000.0, corner / 2000.0)):
        out = shown(np.sin(2 * np.pi * frequency * time), step, model, rng())[N // 2 :]
        # a first-order filter of |H| = 1 / sqrt(1 + (f / f_c)^2); the discrete one differs by a few per cent
        assert np.std(out) * np.sqrt(2) == pytest.approx(gain, rel=0.35 if frequency > corner else 0.05)


def test_a_recording_keeps_time_and_unknown_channels() -> None:
    recording = Recording(
        {"time_s": np.arange(5.0), "case_pressure_bar": np.ones(5), "mood": np.arange(5.0)}, {"a": 1.0}
    )
    out = measured(recording, HELICOPTER, rng())
    assert out["mood"] == pytest.approx(np.arange(5.0))
    assert out.time_s == pytest.approx(np.arange(5.0))
    assert out["case_pressure_bar"] != pytest.approx(np.ones(5), abs=1e-9)
    assert out.attributes == {"a": 1.0}


def test_the_filter_is_3_db_down_at_its_corner_and_rises_with_its_time_constant() -> None:
    step, corner = 1e-5, 100.0
    time = np.arange(N) * step
    model = SensorModel(-10, 10, filter_hz=corner)
    sine = shown(np.sin(2 * np.pi * corner * time), step, model, rng())[N // 2 :]
    assert 20 * np.log10(np.std(sine) * np.sqrt(2)) == pytest.approx(-3.01, abs=0.05)
    ones = np.ones(N)
    ones[0] = 0.0
    answer = shown(ones, step, model, rng())
    assert answer[0] == 0.0
    assert np.interp(1.0 - np.exp(-1.0), answer, time) == pytest.approx(1 / (2 * np.pi * corner), rel=0.01)


def test_the_filter_starts_at_its_first_sample() -> None:
    answer = shown(np.full(50, 3.0), 1e-4, SensorModel(0, 10, filter_hz=5.0), rng())
    assert answer == pytest.approx(np.full(50, 3.0), abs=1e-12)


def test_drift_is_steady_and_its_walk_spreads_with_the_root_of_time() -> None:
    drifting = shown(np.zeros(3601), 1.0, SensorModel(-10, 10, drift_per_hour=0.5), rng())
    assert np.diff(drifting) == pytest.approx(np.full(3600, 0.5 / 3600))
    assert drifting[-1] == pytest.approx(0.5)
    model, generator = SensorModel(-10, 10, walk_per_sqrt_hour=0.2), rng()
    walks = np.array([shown(np.zeros(400), 9.0, model, generator) for _ in range(1500)])
    for i, share in ((99, 0.25), (399, 1.0)):
        assert walks[:, i].std() == pytest.approx(0.2 * np.sqrt(share), rel=0.08)
        assert walks[:, i].mean() == pytest.approx(0.0, abs=0.02)


def test_a_slow_meter_holds_its_value_between_updates() -> None:
    step, update = 1e-4, 0.01315
    time = np.arange(N) * step
    held = shown(time, step, SensorModel(0, 10, update_s=update), rng())
    changes = np.flatnonzero(np.diff(held)) + 1
    # each value is the truth at its own instant, and instants are the first samples at or after each update
    assert held[changes] == pytest.approx(time[changes])
    expected = np.ceil(update * np.arange(1, len(changes) + 1) / step - 1e-9)
    assert changes == pytest.approx(expected)
    assert held[0] == 0.0


def test_the_filter_comes_before_the_slow_samples() -> None:
    """A ripple that a meter of 76 samples a second would fold down to 4 Hz is gone if it filters first."""
    step = 1e-4
    ripple = np.sin(2 * np.pi * 80.0 * np.arange(N) * step)
    folded = shown(ripple, step, SensorModel(-10, 10, update_s=0.01315), rng())
    filtered = shown(ripple, step, SensorModel(-10, 10, update_s=0.01315, filter_hz=1.0), rng())
    assert folded.std() > 0.6
    assert filtered[N // 2 :].std() < 0.02


def test_pieces_show_what_the_whole_shows() -> None:
    """Drift, filter and held value go on from piece to piece; a share of slow samples is lost as a whole."""
    model = SensorModel(-10, 10, 0.1, 0.1, quantum=0.001, filter_hz=20.0, drift_per_hour=30.0, update_s=0.0137)
    samples = np.sin(np.arange(2000) * 0.01)
    whole = shown(samples, 1e-3, model, rng())
    instrument = Instrument(model, 1e-3, rng())
    parts = [instrument.shown(piece) for piece in np.split(samples, [1, 5, 700, 700, 1300])]
    assert np.concatenate(parts) == pytest.approx(whole, abs=1e-12)
    gappy = shown(samples, 1e-3, SensorModel(-10, 10, update_s=0.0137, dropout_probability=0.3), rng())
    gaps = np.diff(np.flatnonzero(np.diff(np.isnan(gappy).astype(int))))
    assert np.isnan(gappy).mean() == pytest.approx(0.3, abs=0.1)
    assert gaps.min() >= 13


def test_the_bench_has_the_sensors_of_the_thesis() -> None:
    recording = Recording({"time_s": np.arange(N) * 1e-4} | {name: np.full(N, 1.0) for name in TEST_BENCH})
    out = measured(recording, TEST_BENCH, rng())
    for name, quantum in (("discharge_flow_lpm", 0.00725), ("case_flow_lpm", 0.00127), ("case_pressure_bar", 0.00415)):
        assert out[name] / quantum == pytest.approx(np.round(out[name] / quantum), abs=1e-6)
    assert (np.diff(out["case_flow_lpm"]) != 0).sum() <= N * 1e-4 / 0.01315 + 1
    flooded = shown(np.full(10, 8.0), 1e-4, TEST_BENCH["case_flow_lpm"], rng())
    assert flooded == pytest.approx(np.full(10, 5.2))
    # 1 % of full scale is two sigma: 0.17 bar and 0.052 L/min, as section 4.2.2 counts them
    assert 2 * TEST_BENCH["case_pressure_bar"].accuracy == pytest.approx(0.17)
    assert 2 * TEST_BENCH["case_flow_lpm"].accuracy == pytest.approx(0.052)
