"""The linear Gaussian model behind an isolability study: what every flight shows of every component, and its noise.

The judge's own measurement model (``detectors.bank.kernel.predicted``), linearised about the newly installed healthy
pump, with the judge's own prior, random walks and noise, scaled to the sensors that are asked about.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from detectors.bank.hypotheses import UNMEASURED_RESERVOIR_WALK_BAR, prior, walk_variance
from detectors.bank.prediction import CASE, CASE_RIPPLE, DISCHARGE, LINE, N_MEASURED, N_SLOPES, RIPPLE, ZERO, predicted
from detectors.expectation.anchor import COLUMN, anchors
from detectors.expectation.components import AMPLITUDE, COMPONENTS, INDEX, N_COMPONENTS, N_LIVING, PLACE, SLIPPER_EXTRA
from detectors.expectation.residuals import (
    LOAD_CASE_SD_RELATIVE,
    LOAD_FLOW_SD_LPM,
    TEMPERATURE_SD_K,
    TWIN_CASE_SD_BAR,
    TWIN_CASE_SD_RELATIVE,
    TWIN_DISCHARGE_SD_BAR,
)
from detectors.expectation.ripple import CASE_RIPPLE_SD, LINE_SD_BAR, RIPPLE_SD, ripples, surfaces_of
from detectors.isolability.plan import Plan, PlanFaultsError
from detectors.reduction.zero import UNMEASURED_RESERVOIR_SD_BAR
from twin.condition import Condition
from twin.orders.burst import DITHER, amplitude_error, resolution_of
from twin.parameters import Circuit, PumpType, Sensor

Array = NDArray[np.float64]

WINDOW_SE_CASE_BAR = 0.0015
WINDOW_SE_DISCHARGE_BAR = 0.015
ZERO_SE_BAR = 0.0005
"""Standard errors of a window's means and of a zero as simulated flights at 1 Hz show them, sensor noise and wander of
the conditions together."""
LARGEST_LEAKAGE_LPM = 1.2
"""Leakage on top of the healthy pump's that the case sensor's range should still hold."""
_PLACES = [PLACE[name] for name in COMPONENTS]
_SIGMAS = 2.0
"""Spread of reservoir and setting that a range must hold."""
_GOLDEN, _SILVER = (math.sqrt(5.0) - 1.0) / 2.0, math.sqrt(2.0) - 1.0
_BITS = 12
_BURST_RATE_HZ, _BURST_S = 10_000.0, 2.0
_BURST_NOISE_BAR = (0.15, 0.003)
"""White noise of the two sensors within a burst (that of ``twin.simulation.instrumentation``), never below what dithers the
converter."""


@dataclass(frozen=True, slots=True)
class FlightModel:
    """One flight: ``slopes`` of what it measures by the components, shape (m, N_COMPONENTS), and ``noise``, (m, m)."""

    slopes: Array
    noise: Array


@dataclass(frozen=True, slots=True)
class Model:
    """Prior variances and walk variances of the components, both (N_COMPONENTS,), and the flights in their order.

    ``case_pressure_range_bar`` is what the case sensor should hold: healthy and cold to worn and pressurised.
    """

    prior: Array
    walk: Array
    flights: tuple[FlightModel, ...]
    case_pressure_range_bar: tuple[float, float]


def model_of(plan: Plan, pump: PumpType, circuit: Circuit) -> Model:
    """Model of a plan.

    Raises
    ------
    PlanFaultsError
        when a sensor's range does not hold a healthy pump's pressures, or the twin has no solution at a temperature.
    """
    n_flights, n_windows = plan.baseline_flights + plan.flights, plan.windows_per_flight
    conditions = [
        Condition(pump.nominal_speed_rpm, t, pump.nominal_reservoir_pressure_bar) for t in temperatures(plan).ravel()
    ]
    rows, solved = anchors(conditions, pump, circuit)
    if not solved.all():
        worst = conditions[int(np.flatnonzero(~solved)[0])].fluid_temperature_degc
        raise PlanFaultsError([("temperature_range_degc", f"the twin has no solution at {worst:.0f} degC")])
    under_load = _under_load(plan, conditions[n_windows - 1 :: n_windows], pump, circuit)
    mean, _ = prior(pump)
    relative = np.zeros((n_flights, 2, N_COMPONENTS))
    amplitudes = np.full((n_flights, 2), np.nan)
    surfaces = surfaces_of(pump) if plan.burst else None
    if surfaces is not None:
        last = slice(n_windows - 1, None, n_windows)
        law = rows[last, COLUMN["system_law"]]
        amplitudes, relative = ripples(conditions[last], pump, circuit, surfaces, law)
    flights, pressures_seen, worn = [], [], -math.inf
    for i in range(n_flights):
        own = slice(i * n_windows, (i + 1) * n_windows)
        windows = list(_linearised(rows[own], mean, relative[i]))
        loaded = under_load.get(i, rows[:0])
        windows += _linearised(loaded, mean, relative[i])
        flights.append(_flight(plan, windows, np.vstack((rows[own], loaded)), amplitudes[i], pump))
        pressures_seen += [y for y, _, _ in windows]
        worn = max(worn, *(case for _, _, case in windows))
    healthy = np.array(pressures_seen)
    tank = _SIGMAS * pump.population["reservoir_pressure_bar"].value
    _hold(plan, pump, healthy.max(axis=0), tank)
    pressures = (float(healthy[:, CASE].min()), float(worn + tank))
    return Model(*_spreads(plan, pump), tuple(flights), pressures)


def _under_load(plan: Plan, conditions: Sequence[Condition], pump: PumpType, circuit: Circuit) -> dict[int, Array]:
    """Anchors of the windows under load by the number of their flight; ``conditions`` are its last zero-flow window's."""
    flows, flights = plan.ground_run_flows_lpm, range(0, len(conditions), plan.ground_run_every)
    if not flows:
        return {}
    asked = [conditions[i]._replace(discharge_flow_lpm=flow) for i in flights for flow in flows]
    rows, solved = anchors(asked, pump, circuit)
    if not solved.all():
        worst = asked[int(np.flatnonzero(~solved)[0])]
        where = f"{worst.discharge_flow_lpm:g} L/min and {worst.fluid_temperature_degc:.0f} degC"
        raise PlanFaultsError([("ground_run_flows_lpm", f"the twin has no solution at {where}")])
    return {i: rows[k * len(flows) : (k + 1) * len(flows)] for k, i in enumerate(flights)}


def _hold(plan: Plan, pump: PumpType, highest: Array, tank: float) -> None:
    """Refuse sensors that do not hold what a healthy pump shows; ``tank`` is what the reservoir may add [bar]."""
    setting = _SIGMAS * pump.population["pressure_setting_bar"].value
    asked = [
        ("case", plan.sensors.case, highest[CASE] + tank),
        ("discharge", plan.sensors.discharge, highest[DISCHARGE] + tank + setting),
    ]
    if plan.sensors.reservoir is not None:
        asked.append(("reservoir", plan.sensors.reservoir, pump.nominal_reservoir_pressure_bar + tank))
    faults = [
        (f"sensors.{name}.full_scale_bar", f"{sensor.full_scale_bar:g} bar do not hold a healthy pump's {most:.2f} bar")
        for name, sensor, most in asked
        if most > sensor.full_scale_bar
    ]
    if faults:
        raise PlanFaultsError(faults)


def temperatures(plan: Plan) -> Array:
    """Fluid temperature of every window, shape (flights of baseline and fault, windows) [degC].

    An even sequence in which flight i and window j do not depend on how many follow: more flights only add.
    """
    flight = np.arange(plan.baseline_flights + plan.flights)[:, None]
    window = np.arange(plan.windows_per_flight)[None, :]
    share = np.mod(0.5 + flight * _GOLDEN + window * _SILVER, 1.0)
    low, high = plan.temperature_range_degc
    return np.asarray(low + (high - low) * share)


def _linearised(rows: Array, mean: Array, relative: Array) -> Iterator[tuple[Array, Array, float]]:
    """What each window shows of the healthy pump, (6,), its slopes, (6, N_COMPONENTS), and a worn pump's case pressure."""
    full, y, worn = np.empty(N_COMPONENTS), np.empty(N_MEASURED), mean.copy()
    worn[AMPLITUDE] = LARGEST_LEAKAGE_LPM
    nothing, leak = np.zeros((2, N_COMPONENTS)), np.zeros((2, N_COMPONENTS))
    leak[0, SLIPPER_EXTRA] = 1.0
    for row in rows:
        H = np.empty((N_MEASURED, N_SLOPES))
        predicted(worn, leak, row, relative, full, y, H)
        highest = float(y[CASE])
        predicted(mean, nothing, row, relative, full, y, H)
        yield y.copy(), H[:, _PLACES], highest


def _flight(
    plan: Plan, windows: list[tuple[Array, Array, float]], rows: Array, amplitudes: Array, pump: PumpType
) -> FlightModel:
    """Stack the windows, the zero and the lines of one flight; windows under load stand after those at zero flow.

    Within a flight its windows share the sensors' repeatability and what the twin misses: more windows average the
    standard errors only.
    """
    sensors, w = plan.sensors, len(windows)
    slopes = [H[[DISCHARGE, CASE]] for _, H, _ in windows]
    shared = np.zeros((2 * w, 2 * w))
    own = np.tile([WINDOW_SE_DISCHARGE_BAR**2, WINDOW_SE_CASE_BAR**2], w)
    discharge, case = np.tile([1.0, 0.0], w), np.tile([0.0, 1.0], w)
    level = case * np.repeat([y[CASE] for y, _, _ in windows], 2)
    by_temperature = rows[:, [COLUMN["discharge_by_temperature"], COLUMN["case_by_temperature"]]].ravel()
    parts = [
        (sensors.discharge.repeatability_bar, discharge),
        (sensors.case.repeatability_bar, case),
        (TWIN_DISCHARGE_SD_BAR, discharge),
        (TWIN_CASE_SD_BAR, case),
        (TWIN_CASE_SD_RELATIVE, level),
        (TEMPERATURE_SD_K, by_temperature),
    ]
    if sensors.reservoir is not None:
        parts.append((sensors.reservoir.repeatability_bar, discharge + case))
    for i in range(plan.windows_per_flight, w):
        here = np.repeat(np.arange(w) == i, 2)
        by_load = rows[i, [COLUMN["discharge_by_load"], COLUMN["case_by_load"]]]
        parts.append((LOAD_FLOW_SD_LPM, np.where(here, np.tile(by_load, w), 0.0)))
        parts.append((LOAD_CASE_SD_RELATIVE * (windows[i][0][CASE] - rows[i, COLUMN["reservoir"]]), here.astype(float)))
    for sd, pattern in parts:
        shared += sd**2 * np.outer(pattern, pattern)
    blocks = [shared + np.diag(own)]
    if sensors.zero_measured:
        tank = UNMEASURED_RESERVOIR_SD_BAR if sensors.reservoir is None else sensors.reservoir.repeatability_bar
        slopes.append(windows[0][1][[ZERO]])
        blocks.append(np.array([[ZERO_SE_BAR**2 + sensors.case.repeatability_bar**2 + tank**2]]))
    if plan.burst:
        last = windows[plan.windows_per_flight - 1]
        seen, noise = _lines(plan, amplitudes, last[0])
        slopes.append(last[1][seen])
        blocks.append(np.diag(noise))
    return FlightModel(np.vstack(slopes), _diagonal(blocks))


def _lines(plan: Plan, amplitudes: Array, shown: Array) -> tuple[list[int], list[float]]:
    """Lines of a burst that the judge takes, and the variance of each."""
    errors = [
        _line_error(sensor, noise)
        for sensor, noise in zip((plan.sensors.discharge, plan.sensors.case), _BURST_NOISE_BAR, strict=True)
    ]
    seen, variances = [], []
    for place, k, share in ((RIPPLE, 0, RIPPLE_SD), (CASE_RIPPLE, 1, CASE_RIPPLE_SD)):
        if np.isfinite(amplitudes[k]):
            seen.append(place)
            variances.append((errors[k] / amplitudes[k]) ** 2 + (share * shown[place]) ** 2)
    return [*seen, LINE], [*variances, errors[0] ** 2 + LINE_SD_BAR**2]


def _line_error(sensor: Sensor, noise_bar: float) -> float:
    resolution = resolution_of(sensor.full_scale_bar, _BITS)
    return amplitude_error(max(noise_bar, DITHER * resolution), resolution, _BURST_RATE_HZ, _BURST_S)


def _spreads(plan: Plan, pump: PumpType) -> tuple[Array, Array]:
    """Prior and walk variances: the judge's own, where they belong to a sensor in proportion to its accuracy."""
    _, sd = prior(pump)
    variance, walk = np.zeros(N_COMPONENTS), np.zeros(N_COMPONENTS)  # what only faults move has no spread of its own
    variance[:N_LIVING], walk[:N_LIVING] = sd[_PLACES[:N_LIVING]] ** 2, walk_variance()[_PLACES[:N_LIVING]]
    by_case = _worse(plan.sensors.case, pump.sensors["case_pressure_bar"]) ** 2
    variance[INDEX["case_offset"]] *= by_case
    walk[INDEX["case_offset"]] *= by_case
    # a discharge sensor that reads wrong looks like a pump that is set wrong; its accuracy counts as two sigma
    variance[INDEX["setting"]] += (
        0.5 * plan.sensors.discharge.accuracy_fs * plan.sensors.discharge.full_scale_bar
    ) ** 2
    place = INDEX["reservoir"]
    if plan.sensors.reservoir is None:
        variance[place] = pump.population["reservoir_pressure_bar"].value ** 2
        walk[place] = UNMEASURED_RESERVOIR_WALK_BAR**2
    else:
        by_reservoir = _worse(plan.sensors.reservoir, pump.sensors["reservoir_pressure_bar"]) ** 2
        variance[place] *= by_reservoir
        walk[place] *= by_reservoir
    return variance, walk


def _worse(sensor: Sensor, than: Sensor) -> float:
    return (sensor.full_scale_bar * sensor.accuracy_fs) / (than.full_scale_bar * than.accuracy_fs)


def _diagonal(blocks: list[Array]) -> Array:
    """Blocks along the diagonal of one matrix."""
    n = sum(len(b) for b in blocks)
    whole, at = np.zeros((n, n)), 0
    for b in blocks:
        whole[at : at + len(b), at : at + len(b)] = b
        at += len(b)
    return whole
