"""Load steps: synthetic records of known droop and recovery, and the transient pump."""

import math
import tracemalloc

import numpy as np
import pytest

from detectors.reduction.load_steps import droop_from_rest, load_steps
from twin.condition import Condition
from twin.operating_point import operating_point
from twin.pumps import circuit_parameters, pump_type
from twin.recording import Recording
from twin.simulation.run import simulate
from twin.simulation.scenario import Scenario, Schedule

KIND = pump_type("h225")
DROOP, TAU = 0.15, 0.08


def flight(seed: int = 1, *, rate_hz: float = 100.0, noise: float = 0.1, flow: bool = True) -> Recording:
    """0, 20, 0, 10 L/min, five seconds each; the pressure follows with a time constant of 80 ms."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(20.0 * rate_hz)) / rate_hz
    demand = np.select([t < 5.0, t < 10.0, t < 15.0], [0.0, 20.0, 0.0], 10.0)
    pressure = np.full(len(t), 175.0)
    for at, change in ((5.0, 20.0), (10.0, -20.0), (15.0, 10.0)):
        later = np.maximum(t - at, 0.0)
        pressure -= np.where(t >= at, change * (DROOP + 0.8 * np.exp(-later / TAU)), 0.0)
    channels = {
        "time_s": t,
        "discharge_pressure_bar": pressure + rng.normal(0.0, noise, len(t)),
        "case_pressure_bar": np.full(len(t), 0.9),
        "shaft_speed_rpm": np.full(len(t), 4600.0),
        "fluid_temperature_degc": np.full(len(t), 50.0),
    }
    if flow:
        channels["discharge_flow_lpm"] = demand + rng.normal(0.0, 0.05, len(t))
    return Recording(channels)


def test_droop_and_recovery_of_known_steps() -> None:
    """Recovery to a tenth of an exponential takes 2.303 time constants."""
    for seed in range(5):
        steps = load_steps(flight(seed), KIND)
        assert [round(s.at_s, 1) for s in steps] == [5.0, 10.0, 15.0]
        for step, change in zip(steps, (20.0, -20.0, 10.0), strict=True):
            assert step.flow_change_lpm == pytest.approx(change, abs=0.1)
            assert step.droop_bar_per_lpm is not None
            assert step.droop_error_bar_per_lpm is not None
            assert abs(step.droop_bar_per_lpm - DROOP) < 4.5 * step.droop_error_bar_per_lpm
            assert step.droop_error_bar_per_lpm < 0.005
            assert step.excursion_bar == pytest.approx(-0.8 * change, abs=0.6)
            assert abs(step.recovery_s - TAU * math.log(10.0)) < 4.5 * step.recovery_error_s


def test_without_a_flow_the_pressure_shows_the_steps() -> None:
    steps = load_steps(flight(flow=False), KIND)
    assert [round(s.at_s, 1) for s in steps] == [5.0, 10.0, 15.0]
    for step, change in zip(steps, (-20.0, 20.0, -10.0), strict=True):
        assert step.droop_bar_per_lpm is None
        assert abs(step.pressure_change_bar - DROOP * change) < 4.5 * step.pressure_error_bar


def test_spikes_and_gaps_move_nothing() -> None:
    whole = flight()
    rng = np.random.default_rng(4)
    pressure = whole["discharge_pressure_bar"].copy()
    pressure[rng.choice(len(pressure), 10, replace=False)] = 350.0
    pressure[rng.choice(len(pressure), 60, replace=False)] = np.nan
    steps = load_steps(Recording({**whole.channels, "discharge_pressure_bar": pressure}), KIND)
    assert len(steps) == 3
    for step in steps:
        assert step.droop_bar_per_lpm is not None
        assert step.droop_bar_per_lpm == pytest.approx(DROOP, abs=0.01)


def test_quiet_short_and_empty_records_have_no_steps() -> None:
    whole = flight()
    assert load_steps(whole.between(0.0, 4.9), KIND) == ()
    assert load_steps(flight(flow=False).between(0.0, 4.9), KIND) == ()
    assert load_steps(whole.between(0.0, 0.05), KIND) == ()
    assert load_steps(whole.between(1.0, 1.0), KIND) == ()


def test_droop_of_a_fast_record_costs_little_room() -> None:
    """Twenty seconds at 10 kHz: the droop is that of the steps, in some copies of the record and no more."""
    fast = flight(3, rate_hz=10_000.0)
    tracemalloc.start()
    droop = droop_from_rest(fast, KIND)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert droop is not None
    assert abs(droop.fall_bar - DROOP * droop.flow_lpm) < 4.0 * droop.error_bar + 0.02
    assert most < 6 * fast["discharge_pressure_bar"].nbytes
    assert droop_from_rest(flight(flow=False), KIND) is None


def test_transient_pump_has_the_droop_of_its_operating_points() -> None:
    bench, scenario = circuit_parameters("shared_return"), Scenario(
        4.0, Condition(4600, 50, 0.5), changes={"discharge_flow_lpm": Schedule.step(2.0, 0.0, 15.0)}
    )  # fmt: skip
    run = simulate(KIND.pump, bench, scenario, sample_rate_hz=1000.0)
    steps = load_steps(run.recording, KIND)
    assert len(steps) == 1
    at = [
        float(operating_point(KIND.pump, Condition(4600, 50, 0.5, q), bench).value("discharge_pressure_bar")[0])
        for q in (0.0, 15.0)
    ]
    assert steps[0].at_s == pytest.approx(2.0, abs=0.005)
    assert steps[0].droop_bar_per_lpm == pytest.approx((at[0] - at[1]) / 15.0, rel=0.03)
    assert steps[0].excursion_bar < 0.0
    assert 0.0 < steps[0].recovery_s < 0.5
