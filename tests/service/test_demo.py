"""The demo's fleet: reproducible, physically what it says, readable by the real ingest."""

import numpy as np

from detectors.reduction.recording import reduce_recording
from detectors.words.thresholds import effective
from service.demo.fleet import PUMPS, Truth, is_right, pump_records
from service.ingest.decode import Limits, decode
from twin.condition import Condition
from twin.operating_point import operating_point
from twin.pumps import circuit_parameters, pump_type

LIMITS = Limits(10_000_000, 100_000)


def test_the_same_seed_gives_the_same_bytes() -> None:
    first, again = ([r.content for r in pump_records(PUMPS[0], 12, 3)] for _ in range(2))
    assert first == again
    assert next(pump_records(PUMPS[0], 12, 4)).content != first[0]


def test_every_record_has_a_zero_and_a_zero_flow_window() -> None:
    kind, circuit = pump_type("h225"), circuit_parameters("shared_return")
    residuals = []
    for record in pump_records(PUMPS[0], 12, 1):
        decoded = decode(record.content, "text/csv", "", {}, LIMITS)
        reduction = reduce_recording(decoded.recording, kind, effective({}))
        assert reduction.zero.measured
        window = reduction.zero_flow
        assert window is not None
        means = {name: mean.mean for name, mean in window.means.items()}
        condition = Condition(
            means["shaft_speed_rpm"], means["fluid_temperature_degc"], means["reservoir_pressure_bar"]
        )
        twin = operating_point(kind.pump, condition, circuit).value("case_pressure_bar")[0]
        residuals.append(means["case_pressure_bar"] - reduction.zero.offset_bar - twin)
    # leakage and drain of a healthy pump differ by some 20 % each from the nominal pump with its 0.5 bar
    assert np.median(np.abs(residuals)) < 0.15
    assert np.max(np.abs(residuals)) < 0.35


def test_right_means_right_state_or_undecided_with_it() -> None:
    truth = Truth("x", lambda h, _s: h, ("pump_degradation",), "pump_degradation")
    assert is_right(truth, {"state": "pump_degradation", "candidates": []})
    assert is_right(truth, {"state": "indeterminate", "candidates": ["drain_restriction", "pump_degradation"]})
    assert not is_right(truth, {"state": "indeterminate", "candidates": ["drain_restriction"]})
    assert not is_right(truth, {"state": "healthy", "candidates": []})
    assert not is_right(PUMPS[0].truth, {"state": "indeterminate", "candidates": ["sensor_fault"]})
