"""From a history's windows to what a filter bank takes: numbers, their noise, and the nominal twin beside them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from detectors.bank.prediction import CASE, CASE_RIPPLE, DISCHARGE, LINE, N_MEASURED, RIPPLE, ZERO
from detectors.bank.regulation import N_FEATURES, Feature
from detectors.bank.window import Measurement
from detectors.expectation.anchor import COLUMN, anchors
from detectors.expectation.components import N_COMPONENTS
from detectors.expectation.reduced_twin import nominal_pressures
from detectors.expectation.residuals import (
    LOAD_CASE_SD_RELATIVE,
    LOAD_FLOW_SD_LPM,
    case_noise_sd,
    discharge_noise_sd,
    matching_condition,
    reservoir_noise_sd,
    temperature_sd,
)
from detectors.expectation.ripple import CASE_RIPPLE_SD, RIPPLE_SD, ripples, surfaces_of
from detectors.expectation.stand_in import stand_ins
from detectors.expectation.type_correction import Correction, HealthyCurve, corrections
from detectors.words.observation import Mean, Observation, Residual, Window, WindowKind, Zero
from detectors.words.signature import Droop, Spectrum
from twin.condition import Condition
from twin.parameters import Circuit, PumpType

Array = NDArray[np.float64]

MOST_WINDOWS = 3
"""Zero-flow windows of one record that are learnt from, and windows under load; a longer list adds hardly anything but
correlated errors."""
_DISCHARGE_BY_K, _CASE_BY_K = COLUMN["discharge_by_temperature"], COLUMN["case_by_temperature"]
_DISCHARGE_BY_LOAD, _CASE_BY_LOAD = COLUMN["discharge_by_load"], COLUMN["case_by_load"]
NO_RIPPLE = np.zeros((2, N_COMPONENTS))
_ORDER_N = ((RIPPLE, "discharge_pressure_bar", RIPPLE_SD), (CASE_RIPPLE, "case_pressure_bar", CASE_RIPPLE_SD))
_FAINT = 3.0
"""Standard errors that order n must stand out by to count."""


@dataclass(frozen=True, slots=True)
class Measured:
    """What one record adds: a measurement per window, the residuals of the window that the flight is judged
    by, and what each later burst of the flight adds, by its record.

    ``outside_curve`` names what takes a window outside the range of the type's measured healthy curve. Where nothing else
    could judge it there are no measurements and no residuals.
    """

    measurements: tuple[Measurement, ...]
    residuals: dict[str, Residual]
    supplements: Mapping[str, Measurement]
    outside_curve: tuple[str, ...] = ()


def measured_windows(
    observations: Sequence[Observation],
    bursts: Mapping[str, Sequence[Observation]],
    pump: PumpType,
    circuit: Circuit,
    healthy: HealthyCurve | None = None,
) -> dict[str, Measured]:
    """Measurements of every record with an accepted zero-flow window that the twin can follow, by record.

    Windows at constant flow count beside a zero-flow window of their record and come before it: the last window is the
    one that the flight is judged by.

    ``bursts`` are the other records of the same flight that hold a spectrum, by the record that they belong to.
    ``healthy`` is the pump type's measured curve: where it reaches, it stands in for the nominal twin.
    """
    windows = [(o, w) for o in observations for w in _judged(o)]
    if not windows:
        return {}
    conditions = [matching_condition(w, pump) for _, w in windows]
    warming = [w.warming_k_per_min for _, w in windows]
    if pump.own_twin:
        rows, solved = anchors(conditions, pump, circuit)
        shifts = corrections(healthy, conditions, pump, circuit, warming)
    else:
        stand = stand_ins(healthy, conditions, warming, pump, circuit)
        rows, solved = stand.rows, stand.solved
        shifts = [Correction(0.0, c, o, d) for (d, c), o in zip(stand.spreads.tolist(), stand.outside, strict=True)]
    found: dict[str, Measured] = {}
    for (observation, window), anchor, good, shift in zip(windows, rows, solved, shifts, strict=True):
        if not good:
            if shift.outside and not pump.own_twin:
                found.setdefault(observation.record_id, Measured((), {}, {}, shift.outside))
            continue
        zero = observation.reduction.zero
        earlier = found.get(observation.record_id)
        before = earlier.measurements if earlier else ()
        # the zero is one measurement of the record, however many windows it has
        measurement = _corrected(_measurement(window, zero, anchor, pump, with_zero=not before), shift)
        zero_flow = window.kind is WindowKind.ZERO_FLOW
        residuals = _residuals(window, zero, anchor, pump, shift) if zero_flow else {}
        found[observation.record_id] = Measured((*before, measurement), residuals, {}, shift.outside)
    # what the twin follows under load only cannot be judged
    judged = {record: m for record, m in found.items() if m.residuals}
    lost = {record: m for record, m in found.items() if not m.measurements}
    return lost | _with_lines(judged, observations, bursts, conditions, windows, pump, circuit)


def _with_lines(
    found: dict[str, Measured],
    observations: Sequence[Observation],
    bursts: Mapping[str, Sequence[Observation]],
    conditions: Sequence[Condition],
    windows: Sequence[tuple[Observation, Window]],
    pump: PumpType,
    circuit: Circuit,
) -> dict[str, Measured]:
    """Add what fast records show to the last window of their flight."""
    last = {o.record_id: c for (o, _), c in zip(windows, conditions, strict=True)}
    fast = [
        o
        for o in observations
        if o.record_id in found and (o.reduction.spectrum is not None or bursts.get(o.record_id))
    ]
    if not fast:
        return found
    surfaces = surfaces_of(pump) if pump.own_twin else None
    amplitudes, slopes = np.full((len(fast), 2), np.nan), np.tile(NO_RIPPLE, (len(fast), 1, 1))
    if surfaces is not None:
        law = np.array([found[o.record_id].measurements[-1].anchor[COLUMN["system_law"]] for o in fast])
        amplitudes, slopes = ripples([last[o.record_id] for o in fast], pump, circuit, surfaces, law)
    for observation, twin, relative in zip(fast, amplitudes, slopes, strict=True):
        measured = found[observation.record_id]
        *rest, plain = measured.measurements
        whole = _lines(plain, observation.reduction.spectrum, twin, relative, pump)
        supplements = {}
        for burst in bursts.get(observation.record_id, ()):
            supplement = _lines(plain, burst.reduction.spectrum, twin, relative, pump)
            if supplement is not plain:
                only = supplement.seen[supplement.seen > ZERO]
                # the window's own scatter was learnt with the window
                fresh = supplement.regulation.copy()
                fresh[Feature.SCATTER] = np.nan
                supplements[burst.record_id] = replace(supplement, seen=only, regulation=fresh)
        found[observation.record_id] = replace(measured, measurements=(*rest, whole), supplements=supplements)
    return found


def _lines(
    measurement: Measurement, spectrum: Spectrum | None, twin: Array, relative: Array, pump: PumpType
) -> Measurement:
    """The measurement with the lines of a spectrum; unchanged where none of them stands out."""
    if spectrum is None:
        return measurement
    values, noise = measurement.values.copy(), measurement.noise.copy()
    seen = list(measurement.seen)
    n = int(pump.pump.piston.n)
    for k, (place, channel, share) in enumerate(_ORDER_N):
        line = spectrum.channels[channel].line(n) if channel in spectrum.channels else None
        if line is None or not math.isfinite(twin[k]) or line.amplitude_bar < _FAINT * line.standard_error_bar:
            continue
        values[place] = line.amplitude_bar / twin[k]
        noise[place, place] = (line.standard_error_bar / twin[k]) ** 2 + (share * values[place]) ** 2
        seen.append(place)
    once = spectrum.channels["discharge_pressure_bar"].line(1)
    values[LINE] = once.amplitude_bar
    noise[LINE, LINE] = once.standard_error_bar**2  # its scatter from flight to flight is learnt
    seen.append(LINE)
    regulation = measurement.regulation.copy()
    discharge = spectrum.channels["discharge_pressure_bar"]
    if discharge.regulation_hz is not None:
        # swings that the ripple measures would be counted twice by the samples' scatter
        regulation[Feature.SCATTER] = np.nan
        regulation[Feature.RIPPLE] = math.log(discharge.ripple_bar)
        regulation[Feature.FREQUENCY] = math.log(discharge.regulation_hz)
    return replace(measurement, values=values, noise=noise, seen=np.array(seen), ripple=relative, regulation=regulation)


def _judged(observation: Observation) -> list[Window]:
    """Windows that the record is learnt from, those under load first; none without one at zero flow."""
    accepted = [w for w in observation.reduction.windows if w.accepted]
    zero_flow = [w for w in accepted if w.kind is WindowKind.ZERO_FLOW]
    if not zero_flow:
        return []
    loaded = [w for w in accepted if w.kind is WindowKind.CONSTANT_FLOW]
    droop = observation.reduction.droop
    if not loaded and droop is not None:
        loaded = [_stepped(zero_flow[-1], droop)]
    return loaded[-MOST_WINDOWS:] + zero_flow[-MOST_WINDOWS:]


def _stepped(zero_flow: Window, droop: Droop) -> Window:
    """What load steps tell of the discharge pressure at constant flow, at the condition of the zero-flow window.

    The case follows a step too slowly to count.
    """
    means = {name: mean for name, mean in zero_flow.means.items() if name != "case_pressure_bar"}
    at_rest = zero_flow.means["discharge_pressure_bar"]
    means["discharge_pressure_bar"] = Mean(
        at_rest.mean - droop.fall_bar, math.hypot(at_rest.standard_error, droop.error_bar)
    )
    means["commanded_flow_lpm"] = Mean(droop.flow_lpm, 0.0)
    return Window(WindowKind.CONSTANT_FLOW, zero_flow.start_s, zero_flow.end_s, True, None, means)


def _measurement(window: Window, zero: Zero, anchor: Array, pump: PumpType, *, with_zero: bool) -> Measurement:
    # the zero is a measurement of its own, so the case pressure enters with its offset still in it
    discharge, case = window.means.get("discharge_pressure_bar"), window.means.get("case_pressure_bar")
    discharge_variance, case_variance, covariance = 0.0, 0.0, 0.0
    if discharge is not None:
        discharge_variance = discharge_noise_sd(window, pump) ** 2
    if case is not None:
        case_variance = case_noise_sd(window, pump) ** 2
    # what moves both pressures: by how much for one standard deviation
    kelvin = temperature_sd(pump)
    shared = [(kelvin * float(anchor[_DISCHARGE_BY_K]), kelvin * float(anchor[_CASE_BY_K]))]
    if window.kind is WindowKind.CONSTANT_FLOW:
        flow = (LOAD_FLOW_SD_LPM * float(anchor[_DISCHARGE_BY_LOAD]), LOAD_FLOW_SD_LPM * float(anchor[_CASE_BY_LOAD]))
        return_line = LOAD_CASE_SD_RELATIVE * (nominal_pressures(anchor)[1] - float(anchor[COLUMN["reservoir"]]))
        shared += [flow, (return_line, return_line)]
    reservoir_measured = "reservoir_pressure_bar" in window.means or pump.reservoir_is_known
    if reservoir_measured:
        reservoir = reservoir_noise_sd(window, pump)
        shared.append((reservoir, reservoir))
    for by_discharge, by_case in shared:
        discharge_variance += by_discharge * by_discharge
        case_variance += by_case * by_case
        covariance += by_discharge * by_case
    values, noise = np.zeros(N_MEASURED), np.zeros((N_MEASURED, N_MEASURED))
    values[: ZERO + 1] = discharge.mean if discharge else 0.0, case.mean if case else 0.0, zero.offset_bar
    noise[DISCHARGE, : CASE + 1] = discharge_variance, covariance
    noise[CASE, : CASE + 1] = covariance, case_variance
    noise[ZERO, ZERO] = zero.standard_deviation_bar**2
    seen = [DISCHARGE] * (discharge is not None) + [CASE] * (case is not None) + [ZERO] * (zero.measured and with_zero)
    regulation = np.full(N_FEATURES, np.nan)
    if window.scatter_bar is not None and window.kind is WindowKind.ZERO_FLOW:
        regulation[Feature.SCATTER] = math.log(window.scatter_bar)
    return Measurement(values, noise, np.array(seen), anchor, NO_RIPPLE, reservoir_measured, regulation)


def _corrected(measurement: Measurement, shift: Correction) -> Measurement:
    """The measurement as a pump of the nominal twin would have shown it."""
    if shift.standard_deviation_bar == shift.discharge_sd_bar == 0.0:
        return measurement
    values, noise = measurement.values.copy(), measurement.noise.copy()
    values[CASE] -= shift.case_bar
    noise[CASE, CASE] += shift.standard_deviation_bar**2
    noise[DISCHARGE, DISCHARGE] += shift.discharge_sd_bar**2
    return replace(measurement, values=values, noise=noise)


def _residuals(window: Window, zero: Zero, anchor: Array, pump: PumpType, shift: Correction) -> dict[str, Residual]:
    discharge, case = nominal_pressures(anchor)
    case += shift.case_bar
    reservoir = reservoir_noise_sd(window, pump)
    by_temperature = [temperature_sd(pump) * float(anchor[column]) for column in (_DISCHARGE_BY_K, _CASE_BY_K)]
    found = {}
    if "case_pressure_bar" in window.means:
        measured = window.means["case_pressure_bar"].mean - zero.offset_bar
        noise = math.hypot(
            case_noise_sd(window, pump),
            zero.standard_deviation_bar,
            by_temperature[1],
            reservoir,
            shift.standard_deviation_bar,
        )
        found["case_pressure_bar"] = Residual(measured, case, measured - case, noise)
    if "discharge_pressure_bar" in window.means:
        measured = window.means["discharge_pressure_bar"].mean
        noise = math.hypot(discharge_noise_sd(window, pump), by_temperature[0], reservoir, shift.discharge_sd_bar)
        found["discharge_pressure_bar"] = Residual(measured, discharge, measured - discharge, noise)
    return found
