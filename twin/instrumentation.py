"""From what is to what a sensor shows: offset, repeatability, drift, filter, quantisation, range, dropouts, spikes."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin.recording import TIME, Recording

Samples = NDArray[np.float64]


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
        Corner of a first-order low pass; 0 for none.
    offset
        Further offset: a zero that has moved.
    dropout_probability, spike_probability
        Share of samples that are missing, and that jump anywhere in the range.
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


def specimen(model: SensorModel, rng: np.random.Generator) -> SensorModel:
    """One sensor off the shelf: its accuracy turned into an offset that it keeps."""
    return replace(model, offset=model.offset + float(rng.normal(0.0, model.accuracy)), accuracy=0.0)


def shown(samples: Samples, step_s: float, model: SensorModel, rng: np.random.Generator) -> Samples:
    """What the sensor shows of true ``samples``, shape (n,), taken every ``step_s`` seconds."""
    n = len(samples)
    value = samples + model.offset + rng.normal(0.0, model.accuracy) + rng.normal(0.0, model.repeatability)
    value = value + rng.normal(0.0, model.noise, n)
    if model.filter_hz > 0.0:
        value = _low_pass(value, 1.0 - np.exp(-2.0 * np.pi * model.filter_hz * step_s))
    if model.quantum > 0.0:
        value = np.round(value / model.quantum) * model.quantum
    value = np.clip(value, model.low, model.high)
    spiky = rng.random(n) < model.spike_probability
    value[spiky] = rng.uniform(model.low, model.high, int(spiky.sum()))
    value[rng.random(n) < model.dropout_probability] = np.nan
    return value


def measured(truth: Recording, sensors: Mapping[str, SensorModel], rng: np.random.Generator) -> Recording:
    """Recording of what the sensors show; channels without a sensor stay as they are."""
    time = truth.time_s
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    channels = {TIME: time}
    for name, samples in truth.channels.items():
        if name != TIME:
            channels[name] = shown(samples, step, sensors[name], rng) if name in sensors else samples
    return Recording(channels, truth.attributes)


def _low_pass(samples: Samples, share: float) -> Samples:
    """First-order low pass that starts at its first sample."""
    if share >= 1.0 - 1e-9 or len(samples) == 0:
        return samples
    out = np.empty_like(samples)
    level = samples[0]
    for i, sample in enumerate(samples):
        level += share * (sample - level)
        out[i] = level
    return out
