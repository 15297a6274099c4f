"""How the compensator regulates: what records show of it, and the charts that follow it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from detectors.bank.measurement import measured_windows
from detectors.bank.regulation import N_FEATURES, Feature, Regulation
from detectors.judgement.assessment import assess
from detectors.reduction.recording import reduce_recording
from detectors.reduction.spectrum import spectrum
from detectors.words.observation import History, Maintenance
from detectors.words.thresholds import effective
from detectors.words.verdict import State
from tests.detectors.fleet import CIRCUIT, PUMP, history
from twin.condition import Condition
from twin.recording import Recording
from twin.simulation.run import simulate
from twin.simulation.scenario import Scenario, Schedule

THRESHOLDS = effective({})
ONSET, FLIGHTS = 30, 70


def odds(feature: Feature, change: float, seed: int, *, shows: float = 1.0, spread: float = 0.3) -> np.ndarray:
    """Log odds after each flight of a pump whose feature changes by ``change`` on a share of the flights."""
    rng = np.random.default_rng(seed)
    if feature is Feature.FREQUENCY:
        spread *= 0.2
    chart, found = Regulation(), []
    level, slope = rng.normal(0.0, 1.0), rng.normal(0.0, 0.1)
    for k in range(FLIGHTS):
        warmth = rng.normal(0.2, 0.4)
        values = np.full(N_FEATURES, np.nan)
        values[feature] = level + slope * warmth + spread * rng.standard_t(5) / math.sqrt(5 / 3)
        values[feature] += change * (k >= ONSET and rng.uniform() < shows)
        chart.pass_time()
        chart.learn(values, warmth)
        if k >= 7 and k % 4 == 3:
            chart.spawn()
        found.append(chart.log_odds())
    return np.array(found)


def raised(found: np.ndarray) -> bool:
    """Above the alarm's level on four flights in a row, at any time."""
    above = np.lib.stride_tricks.sliding_window_view(found > THRESHOLDS["alarm_on_log_odds"], 4)
    return bool(above.all(axis=1).any())


@pytest.mark.parametrize(
    ("feature", "change", "shows"),
    [
        (Feature.SCATTER, math.log(6.0), 0.7),
        (Feature.RIPPLE, math.log(6.0), 0.7),
        (Feature.FREQUENCY, math.log(0.27), 0.7),
        (Feature.FREQUENCY, math.log(0.72), 1.0),
    ],
)
def test_a_changed_regulation_is_seen_even_where_it_comes_and_goes(
    feature: Feature, change: float, shows: float
) -> None:
    found = [odds(feature, change, seed, shows=shows) for seed in range(10)]
    assert not any(raised(f[:ONSET]) for f in found)
    assert sum(bool((f[-10:] > THRESHOLDS["alarm_on_log_odds"]).all()) for f in found) >= 9


@pytest.mark.parametrize("feature", list(Feature))
@pytest.mark.parametrize("change", [0.0, 1.5])
def test_healthy_calmer_or_quicker_pumps_raise_nothing(feature: Feature, change: float) -> None:
    better = change if feature is Feature.FREQUENCY else -change
    assert not any(raised(odds(feature, better, seed, spread=s)) for seed in range(15) for s in (0.15, 0.5))


def test_what_was_never_seen_says_nothing() -> None:
    chart = Regulation()
    for _ in range(20):
        chart.pass_time()
        chart.learn(np.full(N_FEATURES, np.nan), 0.0)
        chart.spawn()
    assert math.exp(chart.log_odds()) == 0.0


def swinging(amplitude_bar: float, n: int = 180) -> Recording:
    """A 1 Hz record: 40 s at rest, then a pump whose pressure swings at 16.3 Hz."""
    rng = np.random.default_rng(3)
    t = np.arange(n, dtype=float)
    on = t >= 40
    swing = amplitude_bar * np.cos(2.0 * math.pi * 16.3 * t + 0.7 * rng.normal(size=n).cumsum())
    return Recording(
        {
            "time_s": t,
            "discharge_pressure_bar": np.where(on, 174.0 + swing, 8.0) + rng.normal(0, 0.15, n),
            "case_pressure_bar": np.where(on, 0.9, 0.5) + rng.normal(0, 0.004, n),
            "shaft_speed_rpm": np.where(on, 4600.0, 0.0),
            "fluid_temperature_degc": 50.0 + rng.normal(0, 0.05, n),
            "reservoir_pressure_bar": 0.5 + rng.normal(0, 0.003, n),
        }
    )


@pytest.mark.parametrize("amplitude_bar", [0.5, 8.0])
def test_a_slow_record_shows_the_swing_as_scatter_and_keeps_its_window(amplitude_bar: float) -> None:
    window = reduce_recording(swinging(amplitude_bar), PUMP, THRESHOLDS).zero_flow
    assert window is not None
    assert window.end_s - window.start_s > 120
    assert window.scatter_bar is not None
    # a sine's one-sigma, and the sensor's; 140 samples tell it to 6 %
    assert window.scatter_bar == pytest.approx(math.hypot(amplitude_bar / math.sqrt(2.0), 0.15), rel=0.2)


def transient(friction_n: float) -> Recording:
    """Burst of the transient pump under restless consumers, the last 2 s of 4, through a sensor with 0.15 bar of noise."""
    rng = np.random.default_rng(4)
    at = np.arange(0.1, 4.0, 0.01)
    opening = np.concatenate(([0.0], 0.2 * rng.uniform(size=len(at) - 1))) / math.sqrt(174.0)
    changes = {
        "load_conductance_lpm_per_sqrt_bar": Schedule(tuple(at.tolist()), tuple(opening.tolist())),
        "spool_jamming_force_n": friction_n,
    }
    run = simulate(PUMP.pump, CIRCUIT, Scenario(4.0, Condition(4600.0, 60.0), changes=changes), sample_rate_hz=10_000.0)
    assert run.status.ok
    channels = dict(run.recording.channels)
    channels["discharge_pressure_bar"] = channels["discharge_pressure_bar"] + rng.normal(0, 0.15, len(run.recording))
    return Recording(channels).between(2.0, 5.0)


def test_bursts_of_the_transient_pump_tell_a_sticking_and_a_stuck_spool() -> None:
    shown = []
    for friction_n in (0.0, 3.0, 500.0):
        found = spectrum(transient(friction_n), 0.0, 1.0e9, PUMP)
        assert found is not None
        shown.append(found.channels["discharge_pressure_bar"])
    healthy, sticking, stuck = shown
    assert healthy.regulation_hz is not None
    assert sticking.regulation_hz is not None
    assert stuck.regulation_hz is not None
    assert sticking.ripple_bar > 5.0 * healthy.ripple_bar
    assert sticking.limit_cycle is not None
    assert sticking.limit_cycle.present
    # a limit cycle is a line: its frequency is the ripple's
    assert sticking.regulation_hz == pytest.approx(sticking.limit_cycle.frequency_hz, rel=0.1)
    assert stuck.regulation_hz < 0.5 * healthy.regulation_hz


def test_noise_alone_has_no_frequency() -> None:
    t = np.arange(20_000) / 10_000.0
    rng = np.random.default_rng(5)
    flat = {"shaft_speed_rpm": 4600.0, "fluid_temperature_degc": 50.0}
    channels = {name: np.full(len(t), value) for name, value in flat.items()}
    pressures = {
        "discharge_pressure_bar": 175.0 + rng.normal(0, 0.15, len(t)),
        "case_pressure_bar": 1.0 + rng.normal(0, 0.003, len(t)),
    }
    found = spectrum(Recording({"time_s": t, **channels, **pressures}), 0.0, 1.0e9, PUMP)
    assert found is not None
    assert found.channels["discharge_pressure_bar"].regulation_hz is None


def sticking(n: int = 60) -> History:
    """Healthy means; from flight 30 on the window's samples swing on two flights of three."""
    rng = np.random.default_rng(6)
    whole = history(11, n)
    observations = []
    for k, o in enumerate(whole.observations):
        (window,) = o.reduction.windows
        swing = 3.0 * (k >= ONSET and k % 3 > 0)
        scatter = math.hypot(0.4 * math.exp(rng.normal(0, 0.3)), 0.15, swing)
        reduction = replace(o.reduction, windows=(replace(window, scatter_bar=scatter),))
        observations.append(replace(o, reduction=reduction))
    return History(tuple(observations))


def test_a_sticking_spool_is_a_fault_of_the_compensator_and_ends_with_its_repair() -> None:
    found = assess(sticking(), PUMP, CIRCUIT, THRESHOLDS)
    assert all(a.verdict.state in {State.HEALTHY, State.INSUFFICIENT_DATA} for a in found[:ONSET])
    assert found[-1].verdict.state is State.COMPENSATOR_FAULT
    assert found[-1].verdict.probabilities[State.COMPENSATOR_FAULT] > 0.97
    assert sum(found[-1].verdict.probabilities.values()) == pytest.approx(1.0)
    repaired = replace(sticking(), maintenance=(Maintenance(sticking().observations[-1].at, "setting_adjusted"),))
    last = assess(repaired, PUMP, CIRCUIT, THRESHOLDS)[-1].verdict
    assert last.probabilities[State.COMPENSATOR_FAULT] < 0.5


def test_windows_of_older_reductions_know_no_scatter() -> None:
    plain = history(12, 10)
    measured = measured_windows(list(plain.observations), {}, PUMP, CIRCUIT)
    assert all(np.isnan(m.regulation).all() for found in measured.values() for m in found.measurements)
