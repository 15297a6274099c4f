"""Spectrum of fast records: synthetic pressures of known lines, the transient pump, and bursts without samples."""

import math
from dataclasses import replace

import numpy as np
import pytest

from detectors.reduction.recording import reduce_recording
from detectors.reduction.spectrum import PRESSURES, spectrum
from detectors.words.signature import Spectrum
from detectors.words.thresholds import effective
from service.history.codec import reduction_from_json, reduction_to_json
from twin.condition import Condition
from twin.orders.burst import amplitude_error, measured_amplitudes, resolution_of
from twin.pumps import circuit_parameters, pump_type
from twin.recording import Recording
from twin.simulation.instrumentation import HELICOPTER, measured
from twin.simulation.run import simulate
from twin.simulation.scenario import Scenario

KIND = pump_type("h225")
N = int(KIND.pump.piston.n)
DISCHARGE, CASE = PRESSURES
LINES = {1: (0.060, 0.010), N - 1: (0.004, 0.002), N: (0.055, 0.009), N + 1: (0.003, 0.001), 2 * N: (0.024, 0.020)}
"""Amplitudes of discharge and case [bar], of the size that the transient pump shows with three worn pistons."""
LEAD = math.radians(40.0)


def synthetic(
    *,
    seed: int = 1,
    rate_hz: float = 10_000.0,
    duration_s: float = 2.0,
    noise: tuple[float, float] = (0.15, 0.003),
    quantum: float = 0.0,
    speed_error: float = 0.0,
    drift_rpm: float = 0.0,
    lines: dict[int, tuple[float, float]] = LINES,
    low_hz: float = 0.0,
    low_bar: float = 0.0,
) -> Recording:
    """Burst of known lines; the case leads the discharge by 40 degrees at every order."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(rate_hz * duration_s)) / rate_hz
    speed = 4600.0 + drift_rpm * t / duration_s
    theta = 2.0 * math.pi / 60.0 * (4600.0 * t + 0.5 * drift_rpm * t * t / duration_s)
    pressures = []
    for k, mean in ((0, 175.0), (1, 0.9)):
        x = mean + rng.normal(0.0, noise[k], len(t)) + low_bar * np.cos(2.0 * math.pi * low_hz * t)
        for order, amplitude in lines.items():
            x += amplitude[k] * np.cos(order * theta + 0.3 * order + k * LEAD)
        pressures.append(np.round(x / quantum) * quantum if quantum and k == 0 else x)
    return Recording(
        {
            "time_s": t,
            DISCHARGE: pressures[0],
            CASE: pressures[1],
            "shaft_speed_rpm": np.round(speed * (1.0 + speed_error) + rng.normal(0.0, 2.0, len(t))),
            "fluid_temperature_degc": np.full(len(t), 50.0),
        }
    )


def changed(recording: Recording, **channels: np.ndarray) -> Recording:
    return Recording({**recording.channels, **channels})


def found(recording: Recording) -> Spectrum:
    answer = spectrum(recording, 0.0, 1.0e9, KIND)
    assert answer is not None
    return answer


def assert_lines(answer: Spectrum, sigmas: float = 4.5) -> None:
    """Every amplitude within its own error (and 0.5 % for the parabola of the speed's search)."""
    for k, name in enumerate(PRESSURES):
        for order, amplitude in LINES.items():
            line = answer.channels[name].line(order)
            # Rice's law: noise lifts a line near the floor by up to 1.25 errors
            assert abs(line.amplitude_bar - amplitude[k]) < sigmas * line.standard_error_bar + 0.005 * amplitude[k], (
                name,
                line,
            )


@pytest.mark.parametrize(
    "case",
    [
        {},
        {"quantum": 350.0 / 4096},
        {"speed_error": 0.0008},
        {"drift_rpm": 40.0},
        {"drift_rpm": -25.0, "speed_error": -0.001, "quantum": 350.0 / 4096},
        {"rate_hz": 4000.0},
    ],
    ids=["clean", "12 bits", "speed sensor off", "speed drifts", "all at once", "4 kHz"],
)
def test_lines_are_found_within_their_errors(case: dict[str, float]) -> None:
    for seed in range(3):
        answer = found(synthetic(seed=seed, **case))  # type: ignore[arg-type]
        assert_lines(answer)
        assert answer.channels[DISCHARGE].noise_bar == pytest.approx(
            math.hypot(0.15, case.get("quantum", 0.0) / math.sqrt(12.0)), rel=0.05
        )


def test_speed_comes_from_the_porting_line() -> None:
    """The sensor reads 0.1 % high: 4.6 rpm; the line of order 9 gives the speed to 0.1 rpm."""
    assert found(synthetic(speed_error=0.001)).speed_rpm == pytest.approx(4600.0, abs=0.1)


def test_phase_between_the_pressures() -> None:
    answer = found(synthetic())
    for order in (1, N, 2 * N):
        assert answer.channels[CASE].line(order).phase_to_discharge_deg == pytest.approx(40.0, abs=8.0)
    assert answer.channels[DISCHARGE].line(1).phase_to_discharge_deg is None


def test_standard_error_is_that_of_white_noise() -> None:
    """sqrt(2 v / N) of each part; twenty bins give it to about a sixth."""
    answer = found(synthetic(quantum=350.0 / 4096))
    theory = amplitude_error(0.15, resolution_of(350.0, 12), 10_000.0, 2.0)
    for order in LINES:
        assert answer.channels[DISCHARGE].line(order).standard_error_bar == pytest.approx(theory, rel=0.5)


def test_spikes_gaps_and_missing_samples_move_nothing() -> None:
    whole = synthetic(quantum=350.0 / 4096)
    rng = np.random.default_rng(5)
    x, c, speed = whole[DISCHARGE].copy(), whole[CASE].copy(), whole["shaft_speed_rpm"].copy()
    x[rng.choice(len(x), 60, replace=False)] = rng.uniform(0.0, 350.0, 60)
    c[rng.choice(len(c), 60, replace=False)] = 5.0
    x[rng.choice(len(x), 1000, replace=False)] = np.nan
    speed[rng.choice(len(x), 500, replace=False)] = np.nan
    holed = changed(whole, discharge_pressure_bar=x, case_pressure_bar=c, shaft_speed_rpm=speed)
    keep = np.ones(len(x), dtype=bool)
    keep[7000:7600] = False
    assert_lines(found(Recording({name: samples[keep] for name, samples in holed.channels.items()})))


def test_an_undithered_converter_is_told() -> None:
    assert not found(synthetic(noise=(0.01, 0.003), quantum=350.0 / 4096)).channels[DISCHARGE].dithered
    fine = found(synthetic(quantum=350.0 / 4096)).channels[DISCHARGE]
    assert fine.dithered
    assert fine.resolution_bar == pytest.approx(350.0 / 4096, rel=1e-6)


def test_a_limit_cycle_is_seen_and_noise_is_none() -> None:
    answer = found(synthetic(low_hz=23.0, low_bar=0.05)).channels[DISCHARGE]
    assert answer.limit_cycle is not None
    assert answer.limit_cycle.present
    assert answer.limit_cycle.frequency_hz == pytest.approx(23.0, abs=0.1)
    assert answer.limit_cycle.amplitude_bar == pytest.approx(0.05, rel=0.1)
    assert answer.ripple_bar == pytest.approx(0.05 / math.sqrt(2.0), rel=0.15)
    for seed in range(6):
        quiet = found(synthetic(seed=seed)).channels[DISCHARGE]
        assert quiet.limit_cycle is not None
        assert not quiet.limit_cycle.present
        # 0.15 bar of white noise has 0.017 bar below order 1; its floor is taken out, to within its own scatter
        assert quiet.ripple_bar < 0.012


@pytest.mark.parametrize(
    "part",
    [{"rate_hz": 3000.0}, {"duration_s": 0.4}],
    ids=["order 2n needs 3036 Hz", "40 revolutions take 0.52 s"],
)
def test_what_cannot_show_the_lines_gives_none(part: dict[str, float]) -> None:
    assert spectrum(synthetic(**part), 0.0, 1.0e9, KIND) is None  # type: ignore[arg-type]


def test_gives_none_at_rest_empty_or_incomplete() -> None:
    burst = synthetic()
    for speed in (0.0, np.nan):
        assert spectrum(changed(burst, shaft_speed_rpm=np.full(len(burst), speed)), 0.0, 9.0, KIND) is None
    missing = burst[DISCHARGE].copy()
    missing[:6000] = np.nan
    assert spectrum(changed(burst, discharge_pressure_bar=missing), 0.0, 9.0, KIND) is None
    assert spectrum(burst, 5.0, 9.0, KIND) is None


def test_transient_pump_through_its_sensors() -> None:
    """Three pistons with +150 % clearance (table 4-3), 2 s at 10 kHz; truth by the discrete transform of whole turns."""
    scenario = Scenario(2.3, Condition(4600, 50, 0.5), changes={f"piston_clearance_scale[{k}]": 2.5 for k in (1, 2, 3)})
    run = simulate(KIND.pump, circuit_parameters("shared_return"), scenario, sample_rate_hz=20_000.0)
    truth = run.recording.between(0.3, 2.3)
    turns = 2.0 * 4600 / 60
    sensors = {name: replace(HELICOPTER[name], filter_hz=0.0) for name in (*PRESSURES, "shaft_speed_rpm")}
    shown = measured(Recording({k: v[::2] for k, v in truth.channels.items()}), sensors, np.random.default_rng(3))
    answer = spectrum(shown, 0.0, 9.0, KIND)
    assert answer is not None
    for name in PRESSURES:
        theta = 2.0 * math.pi * 4600 / 60 * truth.time_s
        for order in (1, N, 2 * N):
            x = truth[name] - truth[name].mean()
            true = 2.0 * abs(np.exp(-1j * order * theta) @ (x * np.hanning(len(x)))) / np.hanning(len(x)).sum()
            line = answer.channels[name].line(order)
            assert abs(line.amplitude_bar - true) < 4.5 * line.standard_error_bar + 0.02 * true, (name, line, true)
    assert answer.revolutions == pytest.approx(turns, abs=1.0)
    assert (
        answer.channels[DISCHARGE].line(1).amplitude_bar > 20.0 * answer.channels[DISCHARGE].line(1).standard_error_bar
    )


@pytest.mark.study
def test_bursts_without_samples_scatter_as_the_pipeline_does() -> None:
    """Same mean and same spread of every amplitude, within the errors of so many."""
    n_bursts = 36
    answers = [found(synthetic(seed=s, quantum=350.0 / 4096)) for s in range(100, 100 + n_bursts)]
    real = np.array([[[a.channels[c].line(o).amplitude_bar for o in LINES] for c in PRESSURES] for a in answers])
    true = np.array([[LINES[o][k] for o in LINES] for k in range(2)])
    rng = np.random.default_rng(2)
    told, error = measured_amplitudes(np.broadcast_to(true, (4000, 2, 5)), rng, resolution_bar=(350.0 / 4096, 0.0))
    spread = told.std(axis=0)
    assert np.all(np.abs(real.mean(axis=0) - told.mean(axis=0)) < 4.5 * spread / math.sqrt(n_bursts) + 0.003 * true)
    ratio = real.std(axis=0) / spread
    # the spread of so many has an error of 12 %
    assert np.all((ratio > 0.6) & (ratio < 1.5)), ratio
    assert error[0, 0, 0] == pytest.approx(math.sqrt(2.0 * (0.15**2 + (350.0 / 4096) ** 2 / 12.0) / 20_000.0))


def test_a_burst_without_dither_or_with_nonsense_is_refused_in_one_message() -> None:
    with pytest.raises(ValueError, match="does not dither"):
        amplitude_error(0.02, resolution_of(350.0, 12), 10_000.0, 2.0)
    with pytest.raises(ValueError, match=r"noise_bar.*duration_s.*resolution_bar"):
        amplitude_error(-1.0, -1.0, 10_000.0, 0.0)


def test_reduction_of_a_burst_keeps_its_spectrum_and_survives_json() -> None:
    reduction = reduce_recording(synthetic(), KIND, effective({}))
    assert reduction.spectrum is not None
    assert reduction.zero_flow is None
    assert reduction_from_json(reduction_to_json(reduction)) == reduction


def test_reduction_of_a_slow_record_or_a_run_up_has_no_spectrum() -> None:
    slow = synthetic(rate_hz=10.0, duration_s=60.0)
    reduction = reduce_recording(slow, KIND, effective({}))
    assert reduction.spectrum is None
    assert reduction_from_json(reduction_to_json(reduction)) == reduction
    burst = synthetic()
    falling = changed(burst, discharge_pressure_bar=np.linspace(60.0, 175.0, len(burst)))
    assert reduce_recording(falling, KIND, effective({})).spectrum is None
