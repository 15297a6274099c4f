"""From a history's windows to what a filter bank takes: numbers, their noise, and the nominal twin beside them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from detectors.anchor import COLUMN, anchors
from detectors.components import N_COMPONENTS
from detectors.filter_bank import Measurement
from detectors.filter_kernel import CASE, DISCHARGE, N_MEASURED, ZERO
from detectors.observation import Observation, Residual, Window, WindowKind, Zero
from detectors.reduced_twin import nominal_pressures
from detectors.residuals import (
    TEMPERATURE_SD_K,
    case_noise_sd,
    discharge_noise_sd,
    matching_condition,
    reservoir_noise_sd,
)
from twin.parameters import Circuit, PumpType

Array = NDArray[np.float64]

MOST_WINDOWS = 3
"""Windows of one record that are learnt from; a longer list adds hardly anything but correlated errors."""
NO_RIPPLE = np.zeros(1 + N_COMPONENTS)


@dataclass(frozen=True, slots=True)
class Measured:
    """What one record adds: a measurement per window, and the residuals of the window that the flight is judged by."""

    measurements: tuple[Measurement, ...]
    residuals: dict[str, Residual]


def measured_windows(observations: Sequence[Observation], pump: PumpType, circuit: Circuit) -> dict[str, Measured]:
    """Measurements of every record with an accepted zero-flow window that the twin can follow, by record."""
    windows = [(o, w) for o in observations for w in _judged(o)]
    if not windows:
        return {}
    rows, solved = anchors([matching_condition(w, pump) for _, w in windows], pump, circuit)
    found: dict[str, Measured] = {}
    for (observation, window), anchor, good in zip(windows, rows, solved, strict=True):
        if not good:
            continue
        zero = observation.reduction.zero
        earlier = found.get(observation.record_id)
        taken = earlier.measurements if earlier else ()
        # the zero is one measurement of the record, however many windows it has
        measurement = _measurement(window, zero, anchor, pump, with_zero=not taken)
        found[observation.record_id] = Measured((*taken, measurement), _residuals(window, zero, anchor, pump))
    return found


def _judged(observation: Observation) -> list[Window]:
    accepted = [w for w in observation.reduction.windows if w.accepted and w.kind is WindowKind.ZERO_FLOW]
    return accepted[-MOST_WINDOWS:]


def _measurement(window: Window, zero: Zero, anchor: Array, pump: PumpType, *, with_zero: bool) -> Measurement:
    values, noise = np.zeros(N_MEASURED), np.zeros((N_MEASURED, N_MEASURED))
    # the zero is a measurement of its own, so the case pressure enters with its offset still in it
    values[DISCHARGE] = window.means["discharge_pressure_bar"].mean
    values[CASE] = window.means["case_pressure_bar"].mean
    values[ZERO] = zero.offset_bar
    noise[DISCHARGE, DISCHARGE] = discharge_noise_sd(window, pump) ** 2
    noise[CASE, CASE] = case_noise_sd(window, pump) ** 2
    noise[ZERO, ZERO] = zero.standard_deviation_bar**2
    slopes = np.array([anchor[COLUMN["discharge_by_temperature"]], anchor[COLUMN["case_by_temperature"]]])
    noise[:2, :2] += TEMPERATURE_SD_K**2 * np.outer(slopes, slopes)
    reservoir_measured = "reservoir_pressure_bar" in window.means
    if reservoir_measured:
        noise[:2, :2] += reservoir_noise_sd(window, pump) ** 2
    seen = [DISCHARGE, CASE] + ([ZERO] if zero.measured and with_zero else [])
    return Measurement(values, noise, np.array(seen), anchor, NO_RIPPLE, reservoir_measured)


def _residuals(window: Window, zero: Zero, anchor: Array, pump: PumpType) -> dict[str, Residual]:
    discharge, case = nominal_pressures(anchor)
    reservoir = reservoir_noise_sd(window, pump)
    by_temperature = TEMPERATURE_SD_K * anchor[[COLUMN["discharge_by_temperature"], COLUMN["case_by_temperature"]]]
    measured_case = window.means["case_pressure_bar"].mean - zero.offset_bar
    measured = window.means["discharge_pressure_bar"].mean
    noise_case = math.hypot(case_noise_sd(window, pump), zero.standard_deviation_bar, by_temperature[1], reservoir)
    noise = math.hypot(discharge_noise_sd(window, pump), by_temperature[0], reservoir)
    return {
        "case_pressure_bar": Residual(measured_case, case, measured_case - case, noise_case),
        "discharge_pressure_bar": Residual(measured, discharge, measured - discharge, noise),
    }
