"""Damage identification curve against the twin; the picture is well-formed and self-contained."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from detectors.curve.picture import curve_svg
from detectors.curve.points import damage_identification_curve, latest_condition
from detectors.curve.svg import ticks
from tests.detectors.fleet import CIRCUIT, FAULTS, PUMP, history
from twin.condition import Condition, Health
from twin.operating_point import operating_point


def test_reference_is_the_twin_moved_by_the_baseline() -> None:
    found = history(1, 20)
    condition = Condition(4600, 50, 0.4)
    curve = damage_identification_curve(found.observations, PUMP, CIRCUIT, condition)
    for point in curve.curve:
        twin = operating_point(PUMP.pump, condition, CIRCUIT, Health(system_leakage_lpm=point.system_leakage_lpm))
        assert point.x - curve.baseline.dx == pytest.approx(twin.value("discharge_pressure_bar")[0])
        assert point.y - curve.baseline.dy == pytest.approx(twin.value("case_pressure_bar")[0] - 0.4)
    assert curve.baseline.records == 8


def test_points_of_a_healthy_pump_gather_at_the_foot_of_the_curve() -> None:
    found = history(2, 40)
    curve = damage_identification_curve(found.observations, PUMP, CIRCUIT, Condition(4600, 50, 0.5))
    foot = curve.curve[0]
    assert np.mean([p.x for p in curve.points]) == pytest.approx(foot.x, abs=0.5)
    assert np.mean([p.y for p in curve.points]) == pytest.approx(foot.y, abs=0.05)


def test_a_worn_pump_lifts_off_and_a_leak_moves_along() -> None:
    condition = Condition(4600, 50, 0.5)
    worn = damage_identification_curve(history(3, 40, FAULTS["worn"]).observations, PUMP, CIRCUIT, condition)
    assert worn.points[-1].y > worn.curve[0].high
    leak = worn.directions["system_leakage"]
    tangent = (worn.curve[4].x - worn.curve[0].x, worn.curve[4].y - worn.curve[0].y)
    assert np.arctan2(leak.dy, leak.dx) == pytest.approx(np.arctan2(tangent[1], tangent[0]), abs=0.05)


def test_without_points_the_reference_stands_alone() -> None:
    condition = latest_condition((), PUMP)
    assert condition.fluid_temperature_degc == 60.0
    curve = damage_identification_curve((), PUMP, CIRCUIT, condition)
    assert curve.points == ()
    assert "no points yet" in curve_svg(curve, "pump X")


def test_picture_is_well_formed_and_names_are_escaped() -> None:
    curve = damage_identification_curve(history(4, 15).observations, PUMP, CIRCUIT, Condition(4600, 50, 0.5))
    root = ET.fromstring(curve_svg(curve, "pump <A&B>"))
    texts = " ".join("".join(e.itertext()) for e in root.iter())
    assert "pump <A&B>" in texts
    assert "worn pump" in texts
    assert root.find("{http://www.w3.org/2000/svg}desc") is not None


@pytest.mark.parametrize(("low", "high"), [(0, 1), (171.3, 178.9), (-0.02, 0.05), (1e4, 9e5)])
def test_ticks_are_round_and_inside(low: float, high: float) -> None:
    marks = ticks(low, high)
    assert 3 <= len(marks) <= 9
    assert low <= marks[0] <= marks[-1] <= high
