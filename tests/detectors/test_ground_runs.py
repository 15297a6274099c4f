"""Ground runs at constant flow and load steps of a known flow: they enter the same evidence as the zero-flow window."""

import math
from dataclasses import replace

import numpy as np
import pytest

from detectors.bank.bank import Bank
from detectors.bank.hypotheses import FAULT_KINDS
from detectors.bank.measurement import measured_windows
from detectors.bank.prediction import CASE, DISCHARGE, ZERO
from detectors.evaluation.ground_runs import GroundRuns
from detectors.evaluation.reality import REALITIES, Reality, fleet
from detectors.evaluation.rows import Faults, Growing, NoFault
from detectors.evaluation.sensing import Sensing, histories
from detectors.evaluation.study import seed_of
from detectors.expectation.components import LOAD_LPM, N_LINES, N_SLOW, N_STATE, PLACE
from detectors.judgement.assessment import assess
from detectors.reduction.load_steps import droop_from_rest
from detectors.reduction.recording import reduce_recording
from detectors.words.observation import History, Mean, Observation, Window, WindowKind
from detectors.words.signature import Droop
from detectors.words.states import SIDE_OF, Side, State
from detectors.words.thresholds import effective
from detectors.words.verdict import Verdict
from tests.detectors.fleet import CIRCUIT, PUMP, history
from twin.condition import Condition, Health
from twin.operating_point import operating_point
from twin.recording import Recording

THRESHOLDS = effective({})
LAMINAR = REALITIES[1]


def flown(reality: Reality, course: Faults, n_pumps: int, every: int | None, n_flights: int = 180) -> list[History]:
    rng = seed_of(31, reality.name, str(course))
    courses = course.courses(n_pumps, n_flights, 0)
    flights = fleet(reality, PUMP, CIRCUIT, rng, n_pumps, n_flights, courses)
    return histories(flights, PUMP, Sensing(ground_runs=GroundRuns(every) if every else None), rng)


def last_verdicts(found: list[History]) -> list[Verdict]:
    return [assess(h, PUMP, CIRCUIT, THRESHOLDS)[-1].verdict for h in found]


def ground_run(levels: tuple[float, ...] = (0.0, 10.0, 20.0), hold_s: int = 60, hz: int = 1) -> Recording:
    """A record that holds each flow for a while, with the operating point's pressures and the sensors' noise."""
    rng = np.random.default_rng(5)
    health, off, held = Health(system_leakage_lpm=0.4), 30 * hz, hold_s * hz
    speed, pressure, case, commanded = [0.0] * off, [8.0] * off, [0.5] * off, [0.0] * off
    for flow in levels:
        point = operating_point(PUMP.pump, Condition(4600.0, 50.0, 0.5, flow), CIRCUIT, health)
        speed += [4600.0] * held
        pressure += [float(point.value("discharge_pressure_bar")[0])] * held
        case += [float(point.value("case_pressure_bar")[0])] * held
        commanded += [flow] * held
    n = len(speed)
    return Recording(
        {
            "time_s": np.arange(n) / hz,
            "discharge_pressure_bar": np.array(pressure) + rng.normal(0.0, 0.05, n),
            "case_pressure_bar": np.array(case) + rng.normal(0.0, 0.003, n),
            "shaft_speed_rpm": np.array(speed) + rng.normal(0.0, 2.0, n),
            "fluid_temperature_degc": 50.0 + rng.normal(0.0, 0.05, n),
            "reservoir_pressure_bar": 0.5 + rng.normal(0.0, 0.001, n),
            "commanded_flow_lpm": np.array(commanded),
        }
    )


def observed(recording: Recording) -> Observation:
    return replace(history(1, 1).observations[0], reduction=reduce_recording(recording, PUMP, THRESHOLDS))


def test_a_record_is_learnt_from_under_load_and_judged_by_its_zero_flow_window() -> None:
    observation = observed(ground_run())
    (found,) = measured_windows([observation], {}, PUMP, CIRCUIT).values()
    alone = observed(ground_run(levels=(0.0,)))
    (plain,) = measured_windows([alone], {}, PUMP, CIRCUIT).values()
    assert [list(m.seen) for m in found.measurements] == [[DISCHARGE, CASE, ZERO], [DISCHARGE, CASE], [DISCHARGE, CASE]]
    assert found.measurements[-1].values[CASE] == pytest.approx(plain.measurements[-1].values[CASE], abs=0.002)
    assert found.residuals["case_pressure_bar"].measured == pytest.approx(
        plain.residuals["case_pressure_bar"].measured, abs=0.002
    )


def test_a_record_under_load_only_says_what_is_missing() -> None:
    reduction = reduce_recording(ground_run(levels=(10.0, 20.0)), PUMP, THRESHOLDS)
    assert reduction.zero_flow is None
    assert "beside one at zero flow" in str(reduction.explanation)
    assert measured_windows([observed(ground_run(levels=(10.0, 20.0)))], {}, PUMP, CIRCUIT) == {}


def log_odds(verdicts: list[Verdict], right: State, wrong: State) -> np.ndarray:
    """What each last verdict holds for one cause against another [nat], bounded where one of them is nothing."""
    p = np.array([[v.probabilities[right], v.probabilities[wrong]] for v in verdicts])
    return np.log(np.maximum(p[:, 0], 1e-4)) - np.log(np.maximum(p[:, 1], 1e-4))


@pytest.mark.study
@pytest.mark.parametrize(
    ("course", "right", "wrong"),
    [
        (Growing(("system",), 3.0), State.SYSTEM_LEAKAGE, State.PUMP_DEGRADATION),
        (Growing(("slippers",), 0.6), State.PUMP_DEGRADATION, State.SYSTEM_LEAKAGE),
    ],
)
def test_a_leaking_circuit_is_told_from_a_worn_pump(course: Growing, right: State, wrong: State) -> None:
    """A laminar leak looks like 0.14 times as much pump leakage at zero flow; under load the return line tells them.

    With runs the right cause leads in eleven of twelve leaking circuits and in ten of twelve worn pumps, and the evidence for it
    grows by more than a factor of three at the median. The circuit's side is said in seven of twelve (ten while a leak of the circuit
    wandered half as far as a pump's).
    """
    found = {every: last_verdicts(flown(LAMINAR, course, 12, every)) for every in (None, 5)}
    without, with_runs = (log_odds(found[every], right, wrong) for every in (None, 5))
    assert (with_runs > 0.0).sum() >= (11 if right is State.SYSTEM_LEAKAGE else 10)
    assert np.median(with_runs) > np.median(without) + math.log(3.0)
    sides = [v.side for v in found[5]]
    assert SIDE_OF[wrong] not in sides
    assert sides.count(SIDE_OF[right]) >= [v.side for v in found[None]].count(SIDE_OF[right])
    if right is State.SYSTEM_LEAKAGE:
        assert sides.count(Side.SYSTEM) >= 7


def test_healthy_pumps_stay_healthy_under_load() -> None:
    """The return line's drop, its temperature law, the flow and the droop all differ from what the judge is told."""
    for reality in REALITIES[::2]:
        assert {v.side for v in last_verdicts(flown(reality, NoFault(), 8, 4, 120))} == {Side.NONE}


def test_what_load_shows_stays_out_of_histories_without_it() -> None:
    bank = Bank(PUMP)
    for observation in sorted(history(3, 10).observations, key=lambda o: o.at):
        bank.learn(measured_windows([observation], {}, PUMP, CIRCUIT)[observation.record_id].measurements)
    assert bank.alive == N_SLOW < N_LINES < N_STATE
    (found,) = measured_windows([observed(ground_run())], {}, PUMP, CIRCUIT).values()
    bank.learn(found.measurements)
    assert bank.alive == N_STATE
    bank.spawn()
    assert "uneven wear" not in {FAULT_KINDS[k].name for k in bank.filters.kind[: bank.n] if k >= 0}


def test_droop_of_load_steps_is_that_of_the_operating_points() -> None:
    """Eight seconds a level are too short for a window; at 10 Hz the steps between them still show the droop."""
    levels = (0.0,) * 5 + (15.0, 0.0, 15.0, 0.0, 15.0)
    own = Health(system_leakage_lpm=0.4)
    at = [
        float(
            operating_point(PUMP.pump, Condition(4600.0, 50.0, 0.5, q), CIRCUIT, own).value("discharge_pressure_bar")[0]
        )
        for q in (0.0, 15.0)
    ]
    recording = ground_run(levels, 8, 10)
    droop = droop_from_rest(recording, PUMP)
    assert droop is not None
    assert droop.flow_lpm == pytest.approx(15.0, abs=0.01)
    assert abs(droop.fall_bar - (at[0] - at[1])) < 4.0 * droop.error_bar + 0.02
    assert reduce_recording(recording, PUMP, THRESHOLDS).droop == droop
    assert droop_from_rest(ground_run((10.0, 20.0), 8, 10), PUMP) is None


@pytest.mark.parametrize("scale", [0.5, 1.5])
def test_load_steps_teach_the_droop(scale: float) -> None:
    """The bank is told what five records' steps showed of a pump whose droop differs from the nominal one."""
    own = Health(droop_scale=scale)
    fall = {
        q: float(
            operating_point(PUMP.pump, Condition(4600.0, 50.0, 0.5, q), CIRCUIT, own).value("discharge_pressure_bar")[0]
        )
        for q in (0.0, LOAD_LPM)
    }
    place = PLACE["ln_droop"]
    before, after = Bank(PUMP), Bank(PUMP)
    base = history(2, 5).observations
    for observation in sorted(base, key=lambda o: o.at):
        stepped = replace(
            observation,
            reduction=replace(observation.reduction, droop=Droop(LOAD_LPM, fall[0.0] - fall[LOAD_LPM], 0.05)),
        )
        for bank, o in ((before, observation), (after, stepped)):
            bank.learn(measured_windows([o], {}, PUMP, CIRCUIT)[o.record_id].measurements)
    sd = math.sqrt(after.filters.covariance[0, place, place])
    assert sd < 0.7 * math.sqrt(before.filters.covariance[0, place, place])
    assert abs(after.filters.mean[0, place] - math.log(scale)) < 2.5 * sd


def test_windows_under_load_count_instead_of_the_steps_between_them() -> None:
    """The same fall of pressure is not learnt twice."""
    without = observed(ground_run())
    observation = replace(without, reduction=replace(without.reduction, droop=Droop(20.0, 2.0, 0.05)))
    (a,), (b,) = (measured_windows([o], {}, PUMP, CIRCUIT).values() for o in (observation, without))
    assert len(a.measurements) == len(b.measurements) == 3
    for one, other in zip(a.measurements, b.measurements, strict=True):
        assert np.array_equal(one.values, other.values)


def test_a_rejected_window_under_load_teaches_nothing() -> None:
    observation = observed(ground_run())
    windows = tuple(
        replace(w, accepted=w.kind is not WindowKind.CONSTANT_FLOW, reason="unsteady")
        for w in observation.reduction.windows
    )
    rejected = replace(observation, reduction=replace(observation.reduction, windows=windows, droop=None))
    (found,) = measured_windows([rejected], {}, PUMP, CIRCUIT).values()
    assert len(found.measurements) == 1


def test_errors_grow_with_the_load() -> None:
    """The flow is not quite what was commanded, and the return line has a temperature law of its own."""
    observation = observed(ground_run())
    zero = observation.reduction.zero_flow
    assert zero is not None
    means = {**zero.means, "commanded_flow_lpm": Mean(20.0, 0.0)}
    loaded = Window(WindowKind.CONSTANT_FLOW, 200.0, 260.0, True, None, means)
    reduction = replace(observation.reduction, windows=(zero, loaded), droop=None)
    (found,) = measured_windows([replace(observation, reduction=reduction)], {}, PUMP, CIRCUIT).values()
    at_load, at_rest = (m.noise[CASE, CASE] for m in found.measurements)
    assert at_load > at_rest + 0.03**2
