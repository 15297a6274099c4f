"""Marks of an engineer: what is bad is no evidence, what is good is a window as it stands."""

import numpy as np
import pytest

from detectors.reduction.recording import reduce_recording
from detectors.words.observation import Mark, Reduction, WindowKind
from tests.detectors.test_windows_by_time import CASE, DISCHARGE, END_S, PUMP, THRESHOLDS, ZERO, Channels, flight
from twin.recording import Recording


def reduced(channels: Channels, *marks: Mark) -> Reduction:
    return reduce_recording(Recording({k: np.array(v) for k, v in channels.items()}), PUMP, THRESHOLDS, marks)


def test_a_disturbed_stretch_marked_bad_gives_the_undisturbed_means_back() -> None:
    channels = flight(10.0)
    time = channels["time_s"]
    knocked = (time >= 110.0) & (time <= 120.0)
    disturbed = {**channels, "case_pressure_bar": channels["case_pressure_bar"] + np.where(knocked, 0.05, 0.0)}
    plain, marked = reduced(channels).zero_flow, reduced(disturbed, Mark(110.0, 120.0, good=False))
    window = marked.zero_flow
    assert plain is not None
    assert window is not None
    assert window.means["case_pressure_bar"].mean == pytest.approx(plain.means["case_pressure_bar"].mean, abs=1e-3)
    assert reduced(disturbed).zero_flow != window
    assert "10 s marked bad by an engineer" in marked.flags
    assert "bridged" in (window.bridged or "")


def test_a_window_marked_bad_as_a_whole_is_no_window() -> None:
    found = reduced(flight(1.0), Mark(40.0, END_S, good=False))
    assert found.zero_flow is None
    assert found.zero.measured, "the pump-off stretch before it still counts"


def test_pump_off_marked_bad_gives_no_zero() -> None:
    found = reduced(flight(1.0), Mark(0.0, 40.0, good=False))
    assert not found.zero.measured
    assert found.zero_flow is not None


def test_an_unsteady_stretch_marked_good_is_the_window() -> None:
    channels = flight(1.0)
    warming = {**channels, "fluid_temperature_degc": 50.0 + 0.2 * channels["time_s"]}
    assert reduced(warming).zero_flow is None
    found = reduced(warming, Mark(60.0, 150.0, good=True))
    window = found.zero_flow
    assert window is not None
    assert (window.start_s, window.kind) == (60.0, WindowKind.ZERO_FLOW)
    assert window.end_s == pytest.approx(150.0, abs=1.0)
    assert window.means["case_pressure_bar"].mean - found.zero.offset_bar == pytest.approx(CASE, abs=0.01)
    assert window.means["discharge_pressure_bar"].mean == pytest.approx(DISCHARGE, abs=0.1)
    assert "60 to 150 s marked good by an engineer" in found.flags


def test_a_short_settled_end_marked_good_is_the_zero() -> None:
    channels = flight(1.0)
    decaying = np.where(channels["time_s"] < 33.0, 2.0 - 0.04 * channels["time_s"], 0.0)
    slow = {**channels, "case_pressure_bar": channels["case_pressure_bar"] + decaying}
    assert not reduced(slow).zero.measured
    found = reduced(slow, Mark(33.0, 39.0, good=True))
    assert found.zero.measured
    assert found.zero.offset_bar == pytest.approx(ZERO, abs=0.01)


def test_what_cannot_be_a_window_is_none_however_good_it_is_called() -> None:
    channels = flight(1.0)
    unregulated = {**channels, "discharge_pressure_bar": np.full(len(channels["time_s"]), 60.0)}
    found = reduced(unregulated, Mark(60.0, 150.0, good=True))
    assert found.zero_flow is None
    assert any("is no window" in flag for flag in found.flags)


def test_without_marks_nothing_changes() -> None:
    plain, marked = reduced(flight(1.0)), reduced(flight(1.0), Mark(300.0, 400.0, good=False))
    assert (plain.zero, plain.windows) == (marked.zero, marked.windows)
