"""From what is to what a sensor shows: offset, repeatability, drift, filter, own rate, quantum, range, dropouts, spikes."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from twin.recording import TIME, Recording

Samples = NDArray[np.float64]
_SECONDS_PER_HOUR = 3600.0


@dataclass(frozen=True, slots=True)
class SensorModel:
    """One sensor in the units of its channel.

    Attributes
    ----------
    low, high
        Range; beyond it the sensor saturates.
    accuracy
        One-sigma fixed error of one specimen: an offset that stays.
    repeatability
        One-sigma error that changes from recording to recording and stays within one.
    noise
        One-sigma noise from sample to sample, before the filter.
    quantum
        Step of the converter; 0 for none.
    filter_hz
        Corner of a first-order low pass [Hz]; 0 for none. It acts at the recording's rate: within 4 % of the analogue
        filter where that is seven times the corner, and no filter at all where it is far below it.
    offset
        Further offset: a zero that has moved.
    dropout_probability, spike_probability
        Share of samples that are missing, and that jump anywhere in the range.
    drift_per_hour
        Steady drift, per hour from the start of the recording.
    walk_per_sqrt_hour
        One-sigma random walk after an hour, on top of the steady drift.
    update_s
        Interval of the sensor's own samples [s], each held until the next; 0 where it follows the recording. The
        filter comes first, so that it keeps what is too fast out of the samples.
    """

    low: float
    high: float
    accuracy: float = 0.0
    repeatability: float = 0.0
    noise: float = 0.0
    quantum: float = 0.0
    filter_hz: float = 0.0
    offset: float = 0.0
    dropout_probability: float = 0.0
    spike_probability: float = 0.0
    drift_per_hour: float = 0.0
    walk_per_sqrt_hour: float = 0.0
    update_s: float = 0.0


# full scales, filters and quanta: Mkadara 2020, tables 3-2 and 3-3; accuracy 1 % of full scale as two sigma;
# repeatability a tenth of it (estimate); noise as the quantum asks (estimate)
HELICOPTER: Mapping[str, SensorModel] = {
    "discharge_pressure_bar": SensorModel(-1, 350, 1.75, 0.35, 0.15, 0.0854, 1500),
    "case_pressure_bar": SensorModel(-1, 5, 0.025, 0.005, 0.003, 5 / 4096, 1000),
    "reservoir_pressure_bar": SensorModel(-1, 5, 0.025, 0.005, 0.003, 5 / 4096, 100),
    "shaft_speed_rpm": SensorModel(0, 8000, 2.0, 0.0, 2.0, 1.0),
    "fluid_temperature_degc": SensorModel(-60, 200, 0.3, 0.1, 0.05, 0.1, 0.2),
}
"""Sensors of a monitored helicopter: the thesis' discharge sensor and its proposed 5 bar case sensor."""

# full scales, accuracies, filters and quanta: Mkadara 2020, tables 3-2 and 3-3; accuracies as two sigma; repeatability
# and noise as above. The thesis says nothing of the tank's pressure sensor and has no data of the thermocouples: the
# one is taken as the case's, the other as a class 1 thermocouple (1.5 degC as two sigma, a second to follow). A turbine
# shows no backward flow, and neither flow meter has a filter.
TEST_BENCH: Mapping[str, SensorModel] = {
    "discharge_pressure_bar": SensorModel(-1, 350, 1.75, 0.175, 0.15, 0.0854, 1500),
    "case_pressure_bar": SensorModel(-1, 17, 0.085, 0.0085, 0.008, 0.00415, 1000),
    "reservoir_pressure_bar": SensorModel(-1, 17, 0.085, 0.0085, 0.008, 0.00415, 1000),
    "discharge_flow_lpm": SensorModel(0, 29.7, 0.1485, 0.01485, 0.007, 0.00725, update_s=0.01315),
    "case_flow_lpm": SensorModel(0, 5.2, 0.026, 0.0026, 0.0013, 0.00127, update_s=0.01315),
    "shaft_speed_rpm": SensorModel(0, 10000, 5.0, 0.5, 2.0, 2.44, 5),
    "shaft_torque_nm": SensorModel(-100, 100, 0.05, 0.005, 0.02, 0.0244, 5),
    "fluid_temperature_degc": SensorModel(-40, 1000, 0.75, 0.075, 0.05, 0.0, 0.16),
}
"""Sensors of the thesis' test bench, with its 17 bar case sensor and its two flow meters."""


def specimen(model: SensorModel, rng: np.random.Generator) -> SensorModel:
    """One sensor off the shelf: its accuracy turned into an offset that it keeps."""
    return replace(model, offset=model.offset + float(rng.normal(0.0, model.accuracy)), accuracy=0.0)


class Instrument:
    """One sensor during one recording, which may come in pieces: offset, drift, filter and held value go on.

    Parameters
    ----------
    model
        The sensor.
    step_s
        Time between the samples of the recording [s].
    rng
        Where chance comes from; the fixed errors are drawn at once.
    """

    def __init__(self, model: SensorModel, step_s: float, rng: np.random.Generator) -> None:
        self._model, self._step_s, self._rng = model, step_s, rng
        self._offset = model.offset + rng.normal(0.0, model.accuracy) + rng.normal(0.0, model.repeatability)
        self._n_seen = 0
        self._walked = 0.0
        self._filter_state: Samples | None = None
        self._last_update = -1
        self._held = math.nan

    def shown(self, samples: Samples) -> Samples:
        """What the sensor shows of the next true ``samples``, shape (n,)."""
        model, n = self._model, len(samples)
        if n == 0:
            return samples
        index = np.arange(self._n_seen, self._n_seen + n)
        self._n_seen += n
        value = samples + self._offset + self._drift(index) + self._rng.normal(0.0, model.noise, n)
        value = self._low_pass(value)
        if model.update_s <= 0.0:
            return self._digitised(value)
        # counted a little ahead, so that rounding costs no update that falls on a sample
        update = np.floor(index * (self._step_s / model.update_s) + 1e-9).astype(np.int64)
        fresh = np.diff(update, prepend=self._last_update) != 0
        self._last_update = int(update[-1])
        readings = np.concatenate(([self._held], self._digitised(value[fresh])))
        self._held = float(readings[-1])
        held: Samples = readings[np.cumsum(fresh)]
        return held

    def _drift(self, index: NDArray[np.int64]) -> Samples:
        """Drift at samples counted from the recording's start, shape (n,)."""
        model = self._model
        drift = np.asarray(index * (model.drift_per_hour * self._step_s / _SECONDS_PER_HOUR), dtype=np.float64)
        if model.walk_per_sqrt_hour > 0.0:
            sigma = model.walk_per_sqrt_hour * math.sqrt(self._step_s / _SECONDS_PER_HOUR)
            walk = self._walked + np.cumsum(self._rng.normal(0.0, sigma, len(index)))
            self._walked = float(walk[-1])
            drift += walk
        return drift

    def _low_pass(self, value: Samples) -> Samples:
        """First-order low pass that starts at its first sample."""
        share = 1.0 - math.exp(-2.0 * math.pi * self._model.filter_hz * self._step_s)
        if self._model.filter_hz <= 0.0 or share >= 1.0 - 1e-9:
            return value
        if self._filter_state is None:
            self._filter_state = (1.0 - share) * value[:1]
        passed, state = lfilter([share], [1.0, share - 1.0], value, zi=self._filter_state)
        self._filter_state = np.asarray(state, dtype=np.float64)
        return np.asarray(passed, dtype=np.float64)

    def _digitised(self, value: Samples) -> Samples:
        """Quantum, range, spikes and dropouts of the sensor's own samples."""
        model, n = self._model, len(value)
        if model.quantum > 0.0:
            value = np.round(value / model.quantum) * model.quantum
        value = np.clip(value, model.low, model.high)
        spiky = self._rng.random(n) < model.spike_probability
        value[spiky] = self._rng.uniform(model.low, model.high, int(spiky.sum()))
        value[self._rng.random(n) < model.dropout_probability] = np.nan
        return value


class Instrumentation:
    """All sensors during one recording that comes in pieces; channels without a sensor stay as they are.

    Parameters
    ----------
    sensors
        Channel to its sensor.
    step_s
        Time between the samples of the recording [s].
    """

    def __init__(self, sensors: Mapping[str, SensorModel], step_s: float, rng: np.random.Generator) -> None:
        self._sensors, self._step_s, self._rng = sensors, step_s, rng
        self._instruments: dict[str, Instrument] = {}

    def measured(self, truth: Recording) -> Recording:
        """What the sensors show of the next piece."""
        channels = {TIME: truth.time_s}
        for name, samples in truth.channels.items():
            if name == TIME:
                continue
            if name in self._sensors and name not in self._instruments:
                self._instruments[name] = Instrument(self._sensors[name], self._step_s, self._rng)
            channels[name] = self._instruments[name].shown(samples) if name in self._instruments else samples
        return Recording(channels, truth.attributes)


def shown(samples: Samples, step_s: float, model: SensorModel, rng: np.random.Generator) -> Samples:
    """What the sensor shows of true ``samples``, shape (n,), taken every ``step_s`` seconds."""
    return Instrument(model, step_s, rng).shown(samples)


def measured(truth: Recording, sensors: Mapping[str, SensorModel], rng: np.random.Generator) -> Recording:
    """Recording of what the sensors show; channels without a sensor stay as they are."""
    time = truth.time_s
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    return Instrumentation(sensors, step, rng).measured(truth)
