"""What a pump's records lack costs something, and the verdict's first sentence says what: for every channel of the kind."""

from dataclasses import replace

import numpy as np
import pytest

from detectors.judgement.assessment import assess
from detectors.reduction.recording import reduce_recording
from detectors.words.observation import History, Mean, Window, WindowKind, Zero
from detectors.words.states import FAULTS as NAMED
from detectors.words.states import State
from detectors.words.thresholds import effective
from detectors.words.verdict import Verdict
from tests.detectors.fleet import CIRCUIT, FAULTS, PUMP, Fault, history
from tests.detectors.sentences import disagreements, held_by
from twin.pumps.written import ParameterFaultsError, document_of, pump_type_from
from twin.recording import MAY_LACK, REQUIRED_CHANNELS, Recording

THRESHOLDS = effective({}, PUMP)
PRESSURES = ("discharge_pressure_bar", "case_pressure_bar")
SAID = {
    "discharge_pressure_bar": "discharge pressure is not measured",
    "case_pressure_bar": "case pressure is not measured",
    "shaft_speed_rpm": "shaft speed is not measured",
    "fluid_temperature_degc": "fluid temperature is not measured",
    "zero": "no pump-off stretch shows the zero",
    "reservoir": "reservoir pressure is not measured",
    "spread": "all windows lie within",
}


def without(found: History, lost: str) -> History:
    """The history as records without a channel, a zero or a temperature spread leave it."""
    observations = []
    for observation in found.observations:
        (window,) = observation.reduction.windows
        means = dict(window.means)
        zero = observation.reduction.zero
        if lost in PRESSURES:
            del means[lost]
        elif lost == "shaft_speed_rpm":
            means[lost] = Mean(PUMP.nominal_speed_rpm, 0.0)
        elif lost == "fluid_temperature_degc":
            means[lost] = Mean(60.0, 0.0)
        if lost in ("zero", "case_pressure_bar", "shaft_speed_rpm"):
            zero = Zero(0.0, 0.06, measured=False)
        if lost == "spread" and not 45.0 < means["fluid_temperature_degc"].mean < 62.0:
            continue
        reduction = replace(observation.reduction, zero=zero, windows=(replace(window, means=means),))
        observations.append(replace(observation, reduction=reduction))
    return History(tuple(observations))


def verdicts(lost: str, fault: Fault | None, seed: int = 3) -> list[Verdict]:
    kind = replace(PUMP, lacks=(lost,)) if lost in MAY_LACK else PUMP
    flown = history(seed, 60 if lost == "spread" else 34, fault, with_reservoir=lost != "reservoir")
    found = without(flown, lost)
    said = [a.verdict for a in assess(found, kind, CIRCUIT, THRESHOLDS)]
    held = held_by(sorted(found.observations, key=lambda o: (o.at, o.record_id)))
    wrong = [w for v, h in zip(said, held, strict=True) for w in disagreements(v, h, THRESHOLDS)]
    assert wrong == []
    return said


@pytest.mark.parametrize("lost", SAID)
def test_health_is_confined_to_what_is_seen(lost: str) -> None:
    last = verdicts(lost, None)[-1]
    assert last.state is State.HEALTHY
    spots = [spot for spot in last.blind_spots if SAID[lost] in spot.because]
    assert spots
    first = last.advice.split(". ")[0]
    assert first.startswith("Healthy as far as")
    assert SAID[lost] in first


@pytest.mark.parametrize("lost", PRESSURES)
@pytest.mark.parametrize("name", FAULTS)
def test_one_pressure_names_no_cause(lost: str, name: str) -> None:
    said = verdicts(lost, FAULTS[name])
    assert {v.state for v in said} <= {State.INSUFFICIENT_DATA, State.HEALTHY, State.INDETERMINATE}
    last = said[-1]
    assert last.estimates == {}
    assert last.probability_beyond_limit is None
    shares = {last.probabilities[f] for f in NAMED}
    assert max(shares) - min(shares) < 1e-12
    if last.state is State.INDETERMINATE:
        (seen,) = set(PRESSURES) - {lost}
        assert last.sensor == seen
        assert "on a test stand" in " ".join(m.what for m in last.missing_evidence)


def test_what_one_pressure_sees_is_a_change() -> None:
    # the case follows a worn pump and a restricted drain, the discharge pressure a setting
    assert verdicts("discharge_pressure_bar", FAULTS["worn"])[-1].state is State.INDETERMINATE
    assert verdicts("case_pressure_bar", FAULTS["setting"])[-1].state is State.INDETERMINATE


def flight(lacks: tuple[str, ...], rng: np.random.Generator) -> Recording:
    """A minute at rest and four running, without some channels; the controls are told."""
    time = np.arange(300.0)
    turning = time >= 60.0
    noise = 0.002 * rng.normal(size=(2, 300))
    channels = {
        "time_s": time,
        "discharge_pressure_bar": np.where(turning, 174.0, 0.0) + 100.0 * noise[0],
        "case_pressure_bar": np.where(turning, 0.4, 0.02) + noise[1],
        "shaft_speed_rpm": np.where(turning, 4600.0, 0.0),
        "fluid_temperature_degc": np.full(300, 50.0) + 0.01 * (time - 180.0) * turning,
        "flight_control_activity": np.where((time < 100.0) | (time > 240.0), 1.0, 0.0),
    }
    return Recording({name: samples for name, samples in channels.items() if name not in lacks})


def zero_flow(found: Recording, lacks: tuple[str, ...]) -> tuple[Window, tuple[str, ...]]:
    reduction = reduce_recording(found, replace(PUMP, lacks=lacks), THRESHOLDS)
    (window,) = [w for w in reduction.windows if w.accepted and w.kind is WindowKind.ZERO_FLOW]
    return window, reduction.flags


@pytest.mark.parametrize(
    "lacks", [(), *((name,) for name in MAY_LACK), ("case_pressure_bar", "shaft_speed_rpm", "fluid_temperature_degc")]
)
def test_a_record_without_declared_channels_still_has_its_window(lacks: tuple[str, ...]) -> None:
    window, flags = zero_flow(flight(lacks, np.random.default_rng(4)), lacks)
    assert (window.start_s, window.end_s) == (pytest.approx(100.0, abs=2.0), pytest.approx(241.0, abs=2.0))
    held = set(REQUIRED_CHANNELS[1:]) - {p for p in PRESSURES if p in lacks}
    assert held == {name for name in window.means if name in REQUIRED_CHANNELS}
    words = {
        "_pressure_bar": " pressure",
        "shaft_speed_rpm": "shaft speed",
        "fluid_temperature_degc": "fluid temperature",
    }
    for name in lacks:
        said = name
        for old, new in words.items():
            said = said.replace(old, new)
        assert any(flag.startswith(f"{said} is not recorded") for flag in flags), flags
    if "fluid_temperature_degc" in lacks:
        assert window.warming_k_per_min is None
    else:
        assert window.warming_k_per_min == pytest.approx(0.6, abs=0.01)


def test_a_channel_that_is_there_all_the_same_is_used() -> None:
    found = flight((), np.random.default_rng(4))
    plain, _ = zero_flow(found, ())
    declared, flags = zero_flow(found, ("shaft_speed_rpm",))
    assert declared == plain
    assert not any("not recorded" in flag for flag in flags)


def test_a_type_keeps_what_it_lacks_and_has_another_version() -> None:
    changed = {"id": "blind", "base": "h225", "lacks": ["case_pressure_bar"], "nominal_speed_rpm": 4500.0}
    kind = pump_type_from(changed)
    assert (kind.lacks, kind.own_twin, kind.nominal_speed_rpm) == (("case_pressure_bar",), True, 4500.0)
    again = pump_type_from(document_of(kind))
    assert (again.lacks, again.sensors, again.limits) == (kind.lacks, kind.sensors, kind.limits)
    assert "lacks" not in document_of(PUMP)
    with pytest.raises(ParameterFaultsError, match="names both pressures"):
        pump_type_from({**changed, "lacks": list(PRESSURES)})
