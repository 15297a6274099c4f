"""Sensors show what their data sheet says."""

import numpy as np
import pytest

from twin.instrumentation import HELICOPTER, SensorModel, measured, shown, specimen
from twin.recording import Recording

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
