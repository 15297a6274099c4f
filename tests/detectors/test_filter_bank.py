"""Properties of the bank: resets, a second fit, evidence that grows with the evidence, lines of bursts."""

from dataclasses import replace

import numpy as np
import pytest

from detectors.bank.bank import Bank
from detectors.bank.hypotheses import FAULT_KINDS, GONE, prior
from detectors.bank.measurement import measured_windows
from detectors.bank.prediction import CASE_RIPPLE, LINE, RIPPLE
from detectors.bank.shapes import ARRIVAL, OPEN
from detectors.bank.tables import ARRIVAL_KINDS
from detectors.expectation.components import AMPLITUDE, INDEX, PLACE
from detectors.judgement.assessment import assess
from detectors.words.observation import History, Observation
from detectors.words.signature import ChannelSpectrum, OrderLine, Spectrum
from detectors.words.thresholds import effective
from detectors.words.verdict import State
from tests.detectors.fleet import CIRCUIT, PUMP, history
from tests.detectors.fleet import FAULTS as SIMULATED

THRESHOLDS = effective({})


def learnt(found: History, n: int) -> Bank:
    observations = sorted(found.observations, key=lambda o: o.at)
    measured = measured_windows(observations, {}, PUMP, CIRCUIT)
    bank = Bank(PUMP)
    for i, observation in enumerate(observations[:n]):
        bank.learn(measured[observation.record_id].measurements)
        if i >= 7 and i % 4 == 3:
            bank.spawn()
    return bank


def spectrum(case_n_bar: float, once_bar: float = 0.03) -> Spectrum:
    def channel(one: float, order_n: float, error: float) -> ChannelSpectrum:
        lines = tuple(
            OrderLine(k, a, error, None) for k, a in ((1, one), (8, 0.0), (9, order_n), (10, 0.0), (18, 0.02))
        )
        return ChannelSpectrum(lines, 0.1, 0.0, None, 0.001, True)

    channels = {
        "discharge_pressure_bar": channel(once_bar, 0.053, 0.0015),
        "case_pressure_bar": channel(0.001, case_n_bar, 3e-5),
    }
    return Spectrum(60.0, 62.0, 4600.0, 150.0, channels)


def with_bursts(found: History, case_n_bar: list[float], once_bar: list[float]) -> History:
    observations = sorted(found.observations, key=lambda o: o.at)
    return replace(
        found,
        observations=tuple(
            replace(o, reduction=replace(o.reduction, spectrum=spectrum(a, b)))
            for o, a, b in zip(observations, case_n_bar, once_bar, strict=True)
        ),
    )


def test_evidence_of_a_growing_fault_grows() -> None:
    odds = []
    for share in (0.0, 0.05, 0.1, 1.05):
        fault = lambda i, own, s=share: own._replace(  # noqa: E731
            pump_leakage_scale=own.pump_leakage_scale * (1.0 + s * max(0.0, (i - 12) / 27))
        )
        final = assess(history(21, 40, fault), PUMP, CIRCUIT, THRESHOLDS)[-1].verdict
        odds.append(1.0 - final.probabilities[State.HEALTHY])
    assert odds[:3] == sorted(odds[:3])
    # a twentieth more is 0.03 L/min, less than is worth a word; a tenth is just worth one
    assert odds[2] > 0.9
    assert odds[3] > 0.99


def test_a_reset_gives_the_population_s_spread_back() -> None:
    bank = learnt(history(22, 30), 30)
    place = PLACE["case_offset"]
    mean, sd = prior(PUMP)
    assert bank.filters.covariance[0, place, place] < 0.25 * sd[place] ** 2
    bank.reset({"case_offset": None})
    assert bank.filters.mean[0, place] == mean[place]
    assert bank.filters.covariance[0, place, place] == pytest.approx(sd[place] ** 2)
    others = np.delete(np.arange(len(sd)), place)
    assert (bank.filters.covariance[0, place, others] == 0.0).all()


def test_a_reset_by_an_amount_adds_it_and_keeps_what_was_learnt() -> None:
    bank = learnt(history(22, 30), 30)
    place = PLACE["ln_drain"]
    mean, covariance = bank.filters.mean[0].copy(), bank.filters.covariance[0].copy()
    bank.reset({"ln_drain": 0.12})
    assert bank.filters.mean[0] == pytest.approx(mean, abs=0.0)
    covariance[place, place] += 0.12**2
    assert bank.filters.covariance[0] == pytest.approx(covariance, abs=0.0)


def test_a_second_fit_changes_little_where_the_first_was_good() -> None:
    """Healthy pump after 40 records: the Gauss-Newton step stays within one spread."""
    bank = learnt(history(23, 40), 40)
    before, spread = bank.filters.mean[0].copy(), np.sqrt(np.diag(bank.filters.covariance[0]))
    bank._fit_anew()
    known = spread > 0.0
    assert (np.abs(bank.filters.mean[0] - before)[known] < spread[known]).all()


def test_entries_never_ask_for_more_room_than_there_is() -> None:
    """Each entry may turn a fault's filter into one that ended, beside those that are kept: arrays in kernels have no bounds."""
    found = sorted(history(24, 60, SIMULATED["drain"]).observations, key=lambda o: o.at)
    measured = measured_windows(found, {}, PUMP, CIRCUIT)
    bank = Bank(PUMP)
    for i, observation in enumerate(found):
        bank.learn(measured[observation.record_id].measurements)
        bank.spawn()
        if i > 20 and i % 5 == 0:
            for freed in ({"drain_extra": None}, {"setting": None}, {"slipper_extra": None}):
                bank.reset(freed)
        assert bank.n <= len(bank.filters.kind)


def test_covariances_stay_positive() -> None:
    bank = learnt(history(24, 60, SIMULATED["worn"]), 60)
    for covariance in bank.filters.covariance[: bank.n]:
        assert np.linalg.eigvalsh(covariance).min() > -1e-9


def test_arrivals_leave_with_the_reservoir_sensor_and_never_without() -> None:
    n_arrivals = len(ARRIVAL_KINDS)
    assert Bank(PUMP).n == 1 + n_arrivals
    assert learnt(history(25, 4, with_reservoir=False), 4).n == 1
    # how a pump came is asked as long as it is there: nothing but records can answer
    long = learnt(history(25, 60), 60)
    assert (long.filters.shape[: long.n] == ARRIVAL).sum() == n_arrivals
    assert np.isfinite(learnt(history(25, 20), 20).filters.mean[:, AMPLITUDE]).all()


def test_a_burst_is_measured_beside_its_window() -> None:
    found = with_bursts(history(26, 3), [0.011] * 3, [0.03] * 3)
    measured = measured_windows(list(found.observations), {}, PUMP, CIRCUIT)
    (measurement,) = measured[found.observations[0].record_id].measurements
    assert set(measurement.seen) >= {RIPPLE, CASE_RIPPLE, LINE}
    assert 0.3 < measurement.values[CASE_RIPPLE] < 3.0
    assert measurement.ripple[1, INDEX["slipper_extra"]] > 0.5


def test_a_burst_of_its_own_record_counts_with_its_flight_and_without_time_passing() -> None:
    main = history(27, 30)
    observations = sorted(main.observations, key=lambda o: o.at)
    bursts = tuple(
        Observation(
            record_id=f"{o.record_id}-burst",
            at=o.at + (observations[1].at - observations[0].at) / 1000,
            aircraft=o.aircraft,
            position=o.position,
            flight_id=o.flight_id,
            reduction=replace(o.reduction, windows=(), spectrum=spectrum(0.011)),
            segment="burst-1",
        )
        for o in observations
    )
    found = assess(History((*observations, *bursts)), PUMP, CIRCUIT, THRESHOLDS)
    assert found[-1].verdict.quality.records_used == 30
    assert found[-1].verdict.state is State.HEALTHY


def test_a_line_once_per_turn_accuses_the_pump() -> None:
    """Unequal wear draws it, no fault of the circuit can (own transient runs: 57 to 260 mbar)."""
    n = 40
    growing = [0.03 + 0.25 * max(0.0, (i - 15) / 24) for i in range(n)]
    found = assess(with_bursts(history(28, n), [0.011] * n, growing), PUMP, CIRCUIT, THRESHOLDS)
    assert found[-1].verdict.state is State.PUMP_DEGRADATION


def test_a_long_history_forgets_no_kind_of_fault() -> None:
    """Before a long history is fitted anew what the data speak against is dropped; what would be found is still said."""
    found = assess(history(4, 40), PUMP, CIRCUIT, THRESHOLDS)
    known = [set(a.verdict.minimum_detectable) for a in found if a.verdict.quality.records_used >= 10]
    assert known[0] == {
        "pump_leakage_change_lpm",
        "system_leakage_change_lpm",
        "pressure_setting_change_bar",
        "drain_resistance_change_percent",
    }
    assert all(names == known[0] for names in known)
    bank = learnt(history(4, 40), 31)
    before = bank.n
    bank.learn(bank.learnt[-1])  # the 32nd record
    assert bank.records == 32
    assert len(bank.learnt) == 32
    assert bank.n < before
    assert set(bank.filters.kind[: bank.n]) >= {
        i for i, k in enumerate(FAULT_KINDS) if k.sudden and not any(n == "once" for n, _ in k.moves)
    } - {GONE}
    assert (bank.filters.shape[: bank.n] == OPEN).any()  # that it may be none of these is never forgotten
