"""A measured curve as the anchor of a type without a twin: the shape of data of a public valve-plate rig.

An axial pump at constant speed with leak-line pressure: zero unknown, the slope of the line a tenth of ours. Damage of the
valve plate lifts the leak line by 0.03 to 0.09 bar there (Rojek and Blachnik 2024).
"""

from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest

from detectors.expectation.anchor import COLUMN
from detectors.expectation.reduced_twin import nominal_pressures
from detectors.expectation.stand_in import stand_ins
from detectors.expectation.type_correction import HealthyCurve, HealthyPoint
from detectors.judgement.assessment import assess
from detectors.words.observation import History, Mean, Observation, Reduction, Window, WindowKind, Zero
from detectors.words.states import State
from detectors.words.thresholds import effective
from detectors.words.verdict import Verdict
from tests.detectors.fleet import START
from tests.detectors.sentences import disagreements, held_by
from twin.condition import Condition
from twin.pumps import circuit_parameters
from twin.pumps.written import pump_type_from

RIG = pump_type_from(
    {
        "id": "valve-plate-rig",
        "base": "h225",
        "own_twin": False,
        "nominal_speed_rpm": 1500.0,
        "changes": {
            "population.reservoir_pressure_bar": {"value": 0.01, "unit": "bar", "source": "open tank"},
            "limits.zero_flow_pressure_low_bar": {"value": 195.0, "unit": "bar", "source": "rig"},
            "limits.zero_flow_pressure_high_bar": {"value": 205.0, "unit": "bar", "source": "rig"},
        },
    }
)
CIRCUIT = circuit_parameters("separate_drain")
THRESHOLDS = effective({}, RIG)


def healthy(celsius: float) -> tuple[float, float]:
    """Discharge and leak-line pressure of the healthy pump on its rig [bar]."""
    return 200.0 - 0.02 * (celsius - 50.0), 0.040 * (1.0 + 0.015 * (celsius - 50.0))


def point(celsius: float, warming: float = 0.0) -> HealthyPoint:
    return HealthyPoint(*healthy(celsius), celsius, 1500.0, warming)


CURVE = HealthyCurve(tuple(point(float(t)) for t in range(40, 63, 2)))


def rig_history(rise: float, fall: float = 0.0, n: int = 40, onset: int = 20, seed: int = 1) -> History:
    """Runs at constant speed without a pump-off stretch; from ``onset`` on the pressures have moved [bar]."""
    rng = np.random.default_rng(seed)
    observations = []
    for i in range(n):
        celsius = float(rng.uniform(42.0, 60.0))
        discharge, case = healthy(celsius)
        later = i >= onset
        means = {
            "discharge_pressure_bar": Mean(discharge + 0.8 - fall * later + 0.2 * float(rng.normal()), 0.02),
            "case_pressure_bar": Mean(case + 0.05 + rise * later + 0.004 * float(rng.normal()), 0.001),
            "shaft_speed_rpm": Mean(1500.0 + float(rng.normal()), 0.5),
            "fluid_temperature_degc": Mean(celsius + 0.2 * float(rng.normal()), 0.02),
        }
        window = Window(WindowKind.ZERO_FLOW, 0.0, 60.0, True, None, means, warming_k_per_min=0.1)
        zero = Zero(0.0, 0.06, measured=False)
        at = START + timedelta(hours=i)
        observations.append(Observation(f"{i:03d}", at, "rig", "A", f"{i:03d}", Reduction(zero, (window,), None)))
    return History(tuple(observations))


def judged(found: History) -> list[Verdict]:
    said = [a.verdict for a in assess(found, RIG, CIRCUIT, THRESHOLDS, CURVE)]
    held = held_by(list(found.observations))
    assert [w for v, h in zip(said, held, strict=True) for w in disagreements(v, h, THRESHOLDS)] == []
    return said


def test_the_anchor_is_the_curve_and_the_line_s_slope_follows_it() -> None:
    conditions = [Condition(1500.0, t, 0.3) for t in (44.0, 58.0)]
    found = stand_ins(CURVE, conditions, [0.0, None], RIG, CIRCUIT)
    assert found.solved.all()
    for row, condition in zip(found.rows, conditions, strict=True):
        discharge, case = healthy(condition.fluid_temperature_degc)
        # a reservoir above the rig's moves both pressures one to one
        assert nominal_pressures(row) == pytest.approx((discharge + 0.3, case + 0.3), abs=0.005)
    ratio = found.rows[1][COLUMN["drain"]] / found.rows[0][COLUMN["drain"]]
    assert ratio == pytest.approx(healthy(58.0)[1] / healthy(44.0)[1], rel=0.05)
    assert (found.spreads > 0.0).all()


def test_outside_its_range_a_curve_says_by_what() -> None:
    conditions = [Condition(1500.0, t, 0.0) for t in (50.0, 80.0, 50.0, 50.0)]
    conditions[2] = conditions[2]._replace(speed_rpm=900.0)
    found = stand_ins(CURVE, conditions, [0.5, 0.0, 0.0, 3.0], RIG, CIRCUIT)
    assert found.outside == ((), ("fluid_temperature_degc",), ("speed_rpm",), ("warming_k_per_min",))
    assert found.solved.tolist() == [True, False, False, False]
    warm = HealthyCurve((*CURVE.points, point(50.0, 2.5)))
    assert stand_ins(warm, conditions[3:], [3.0], RIG, CIRCUIT).solved.all()
    assert not stand_ins(None, conditions[:1], [0.0], RIG, CIRCUIT).solved.any()
    loaded = [conditions[0]._replace(discharge_flow_lpm=10.0)]
    assert not stand_ins(CURVE, loaded, [0.0], RIG, CIRCUIT).solved.any()


def test_a_steady_curve_keeps_its_name() -> None:
    plain = HealthyCurve(tuple(HealthyPoint(*p[:4]) for p in CURVE.points))
    assert plain.version == CURVE.version
    assert replace(CURVE, points=(*CURVE.points[:-1], point(62.0, 1.0))).version != CURVE.version


def test_a_healthy_rig_pump_is_healthy_as_far_as_it_is_seen() -> None:
    last = judged(rig_history(0.0))[-1]
    assert last.state is State.HEALTHY
    assert "no twin of its own" in last.advice.split(". ")[0]
    assert last.estimates == {}


def test_what_the_zero_of_a_sensor_may_do_names_nothing() -> None:
    # the same rig's zero moves by 0.06 bar between campaigns
    assert {v.state for v in judged(rig_history(0.05))} <= {State.INSUFFICIENT_DATA, State.HEALTHY, State.INDETERMINATE}


@pytest.mark.parametrize("rise", [0.09, 0.15])
def test_a_damaged_valve_plate_is_a_change_that_the_rig_cannot_place(rise: float) -> None:
    last = judged(rig_history(rise))[-1]
    assert last.state is State.INDETERMINATE
    assert {State.PUMP_DEGRADATION, State.DRAIN_RESTRICTION, State.SENSOR_FAULT} <= set(last.candidates)
    assert "Do not replace the pump on this" in last.advice


def test_a_setting_leaves_the_leak_line_alone_and_is_not_taken_for_a_leak() -> None:
    last = judged(rig_history(0.0, fall=4.0))[-1]
    setting, *others = sorted(last.probabilities.items(), key=lambda item: -item[1])
    assert setting[0] is State.COMPENSATOR_FAULT
    assert setting[1] > 3.0 * others[0][1]
    assert State.COMPENSATOR_FAULT in (last.state, *last.candidates)
