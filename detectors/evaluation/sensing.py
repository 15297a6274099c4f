"""What the aircraft's sensors make of simulated flights: histories as the judge receives them."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np
from numpy.typing import NDArray

from detectors.evaluation.ground_runs import GroundRuns, loaded_windows, pressures_under_load
from detectors.evaluation.reality import Flights, drawn_by_aircraft
from detectors.words.observation import (
    MOST_VALUES,
    Behaviour,
    History,
    Mean,
    Observation,
    Reduction,
    Window,
    WindowKind,
    Zero,
)
from detectors.words.signature import ChannelSpectrum, OrderLine, Spectrum
from twin.condition import Health
from twin.orders.burst import measured_amplitudes
from twin.orders.surfaces import CHANNELS, order_amplitudes, order_surfaces
from twin.parameters import PumpType

Array = NDArray[np.float64]

HOURS_PER_FLIGHT = 2.0
"""Estimate: a crew change flight to an offshore platform."""
START = datetime(2026, 1, 5, 8, 0, tzinfo=UTC)
"""Any Monday: nothing depends on it."""
_SAMPLES = 60
"""Samples of a window: one minute at 1 Hz."""


@dataclass(frozen=True, slots=True)
class Sensing:
    """Which sensors an aircraft has and how well they see; spreads are one sigma, pressures in bar."""

    zero_measured: bool = True
    reservoir_measured: bool = True
    discharge_repeatability: float = 0.35
    case_repeatability: float = 0.005
    case_zero_drift_per_flight: float = 0.0035
    case_zero_step: float = 0.0
    case_span: float = 1.0
    discharge_span: float = 1.0
    reservoir_added: float = 0.0
    step_at: int = 0
    discharge_drift_per_flight: float = 0.008
    missing_zero: float = 0.05
    dropout: float = 0.05
    outlier: float = 0.003
    burst: bool = False
    """A burst of 2 s at 10 kHz in the zero-flow window: 12-bit converters over 350 and 5 bar, white noise of 0.15 bar
    and 3 mbar, which dithers the coarser step of 85 mbar."""
    ground_runs: GroundRuns | None = None

    @property
    def has_fault(self) -> bool:
        """Whether a sensor fails at ``step_at``: its zero, its span, or another reference."""
        return (self.case_zero_step, self.case_span, self.discharge_span, self.reservoir_added) != (0.0, 1.0, 1.0, 0.0)


def histories(
    flights: Flights,
    pump: PumpType,
    sensing: Sensing,
    rng: np.random.Generator,
    moved_at: int | None = None,
    *,
    exchanged: bool = False,
) -> list[History]:
    """One history per pump; flights that dropped out are missing from it.

    From flight ``moved_at`` on the pump is seen by another aircraft's sensors; by those of another pump of the fleet where
    they are ``exchanged`` (``reality.fleet``), which are then named alike in both histories.
    """
    shape = flights.discharge.shape
    n_pumps, n_flights = shape
    normal = rng.normal

    def by_aircraft(draw: Callable[[], Array]) -> Array:
        return drawn_by_aircraft(draw, n_flights, moved_at, exchanged=exchanged)

    def drifted(per_flight: float) -> Array:
        drift = np.cumsum(normal(0.0, per_flight, shape), axis=1)
        # a sensor that drifts stays where it is
        return by_aircraft(lambda: drift) if exchanged else drift

    offset = by_aircraft(lambda: normal(0.0, 0.03, (n_pumps, 1)))
    offset = offset + drifted(sensing.case_zero_drift_per_flight)
    failed = np.arange(n_flights) >= sensing.step_at
    offset += sensing.case_zero_step * failed
    # a span that was lost shows at rest as well, where the case holds the reservoir's pressure
    lost = (sensing.case_span - 1.0) * failed
    discharge = flights.discharge + normal(0.0, sensing.discharge_repeatability, shape)
    discharge += drifted(sensing.discharge_drift_per_flight)
    case = flights.case + offset + normal(0.0, sensing.case_repeatability, shape)
    jumped = rng.uniform(size=shape) < sensing.outlier
    case += np.where(jumped, rng.uniform(-1.0, 1.0, shape), 0.0)
    jumped = rng.uniform(size=shape) < sensing.outlier
    discharge += np.where(jumped, rng.uniform(-30.0, 30.0, shape), 0.0)
    full_scale = pump.sensors["case_pressure_bar"].full_scale_bar
    case = np.minimum(case + lost * flights.case, full_scale)
    discharge *= np.where(failed, sensing.discharge_span, 1.0)
    probe = by_aircraft(lambda: normal(0.0, 0.7, (n_pumps, 1))) + normal(0.0, 0.4, shape)
    zero = offset + lost * flights.reservoir + normal(0.0, 0.006, shape)
    reservoir_error = by_aircraft(lambda: normal(0.0, 0.01, (n_pumps, 1))) + normal(0.0, 0.004, shape)
    reservoir_error = reservoir_error + sensing.reservoir_added * failed
    has_zero = sensing.zero_measured & (rng.uniform(size=shape) >= sensing.missing_zero)
    flown = rng.uniform(size=shape) >= sensing.dropout
    zero = (
        zero - reservoir_error
        if sensing.reservoir_measured
        else zero + flights.reservoir - pump.nominal_reservoir_pressure_bar
    )
    lines = _burst_lines(flights, pump, rng) if sensing.burst else None
    scatter, ripple, frequency = _regulation(flights, rng.spawn(1)[0])
    discharge += scatter / np.sqrt(_SAMPLES) * rng.spawn(1)[0].normal(size=shape)
    runs = sensing.ground_runs
    under_load = _under_load(runs, flights, pump, sensing, offset, rng.spawn(1)[0], moved_at) if runs else None
    result = []
    for i in range(n_pumps):
        observations = []
        for j in np.flatnonzero(flown[i]):
            means = {
                "discharge_pressure_bar": Mean(float(discharge[i, j]), float(scatter[i, j]) / _SAMPLES**0.5),
                "case_pressure_bar": Mean(float(case[i, j]), 0.001),
                "shaft_speed_rpm": Mean(float(flights.speed[i, j]), 1.0),
                "fluid_temperature_degc": Mean(float(flights.temperature[i, j] + probe[i, j]), 0.02),
            }
            if sensing.reservoir_measured:
                means["reservoir_pressure_bar"] = Mean(float(flights.reservoir[i, j] + reservoir_error[i, j]), 0.001)
            window = Window(WindowKind.ZERO_FLOW, 60.0, 120.0, True, None, means, float(scatter[i, j]))
            windows: tuple[Window, ...] = (window,)
            if runs and under_load and j % runs.every == 0:
                windows += loaded_windows(window, runs.flows_lpm, under_load[0][i, j], under_load[1][i, j])
            found = Zero(0.0, pump.population["case_zero_bar"].value, False)
            if has_zero[i, j]:
                found = Zero(float(zero[i, j]), 0.008 if sensing.reservoir_measured else 0.1, True)
            observations.append(
                Observation(
                    record_id=f"{j:05d}" if not exchanged else f"{j:05d}-{i}",
                    at=START + timedelta(hours=28.0 * int(j)),
                    aircraft=_aircraft(i, int(j), n_pumps, moved_at, exchanged=exchanged),
                    position="LH",
                    flight_id=str(j),
                    reduction=Reduction(
                        found,
                        windows,
                        None,
                        behaviours=_saturated(float(case[i, j]), full_scale),
                        spectrum=None
                        if lines is None
                        else _spectrum(lines, i, int(j), pump, float(ripple[i, j]), float(frequency[i, j])),
                    ),
                    flight_hours=HOURS_PER_FLIGHT * int(j),
                )
            )
        result.append(History(tuple(observations)))
    return result


def _aircraft(i: int, j: int, n_pumps: int, moved_at: int | None, *, exchanged: bool) -> str:
    """Name of the aircraft of pump ``i`` on flight ``j``."""
    moved = moved_at is not None and j >= moved_at
    if exchanged:
        return f"A{(i + n_pumps // 2) % n_pumps if moved else i}"
    return "B" if moved else "A"


def _saturated(case_bar: float, full_scale_bar: float) -> dict[str, Behaviour]:
    """What a reduction says of a case sensor at its full scale; nothing of one below it."""
    if case_bar < full_scale_bar:
        return {}
    return {"case_pressure_bar": Behaviour(MOST_VALUES, MOST_VALUES, 5 * _SAMPLES, 0.9)}


def _under_load(
    runs: GroundRuns,
    flights: Flights,
    pump: PumpType,
    sensing: Sensing,
    offset: Array,
    rng: np.random.Generator,
    moved_at: int | None,
) -> tuple[Array, Array]:
    """Measured discharge and case pressure of the ground runs, shapes (n_pumps, n_flights, n_flows)."""
    discharge, case = pressures_under_load(runs, flights, pump, rng, moved_at)
    discharge += rng.normal(0.0, sensing.discharge_repeatability, discharge.shape)
    return discharge, case + offset[..., None] + rng.normal(0.0, sensing.case_repeatability, case.shape)


def _regulation(flights: Flights, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Measured scatter of a 1 Hz window [bar], and ripple [bar] and frequency [Hz] of a burst, shapes (n_pumps, n_flights).

    Sixty samples of 1 Hz catch the ripple at any phase, beside the sensor's white noise; two seconds hold a few tens of
    its periods, which gives their level to 10 % and their frequency to 4 % (pieces of transient runs).
    """
    shape = flights.ripple.shape
    lines = 0.05 / np.sqrt(2.0)
    variance = flights.ripple**2 + 0.15**2 + (350.0 / 4096) ** 2 / 12.0 + lines**2
    scatter = np.sqrt(variance * rng.chisquare(_SAMPLES - 2, shape) / (_SAMPLES - 2))
    ripple = flights.ripple * np.exp(rng.normal(0.0, 0.1, shape))
    return scatter, ripple, flights.frequency * np.exp(rng.normal(0.0, 0.04, shape))


def _burst_lines(flights: Flights, pump: PumpType, rng: np.random.Generator) -> tuple[Array, Array]:
    """Measured amplitudes of orders 1, n - 1, n, n + 1, 2 n and their errors, shape (n_pumps, n_flights, 2, 5).

    The surfaces of the transient pump give the answer to condition and health; each pump has gains of its own
    (volumes and lines of the aircraft, +-20 %), answers to faults up to some 20 % stronger or weaker, and wanders by
    1.5 % from flight to flight.
    """
    n_pumps, n_flights = flights.discharge.shape
    surfaces = order_surfaces(pump.name)
    rows = flights.rows.reshape(-1, flights.rows.shape[-1])
    healthy = rows.copy()
    healthy[:, len(healthy[0]) - len(Health()) :] = Health()
    shape = (n_pumps, n_flights, len(CHANNELS), 5)
    true = order_amplitudes(surfaces, pump.pump, rows).reshape(shape)
    nominal = order_amplitudes(surfaces, pump.pump, healthy).reshape(shape)
    answer = rng.normal(1.0, 0.2, (n_pumps, 1, 1, 1))
    gain = np.exp(rng.normal(0.0, 0.2, (n_pumps, 1, len(CHANNELS), 1)))
    wander = np.exp(rng.normal(0.0, 0.015, shape))
    even = slice(2, 5, 2)
    lines = np.zeros(shape)
    lines[..., even] = (nominal * (true / np.maximum(nominal, 1.0e-9)) ** answer * gain * wander)[..., even]
    once = flights.once * np.exp(rng.normal(0.0, 0.05, flights.once.shape))
    lines[:, :, 0, 0], lines[:, :, 1, 0] = once, 0.05 * once
    return measured_amplitudes(lines, rng)


def _spectrum(lines: tuple[Array, Array], i: int, j: int, pump: PumpType, ripple: float, frequency: float) -> Spectrum:
    n = int(pump.pump.piston.n)
    channels = {}
    for k, name in enumerate(CHANNELS):
        found = tuple(
            OrderLine(order, float(lines[0][i, j, k, m]), float(lines[1][i, j, k, m]), None)
            for m, order in enumerate((1, n - 1, n, n + 1, 2 * n))
        )
        channels[name] = ChannelSpectrum(
            found,
            (0.15, 0.003)[k],
            (ripple, 0.0)[k],
            None,
            (350.0 / 4096, 5.0 / 4096)[k],
            True,
            (frequency, None)[k],
        )
    return Spectrum(60.0, 62.0, pump.nominal_speed_rpm, 150.0, channels)
