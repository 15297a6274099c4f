"""Power spectral densities of both pressures with the thesis' Welch settings, and their cumulative sums (figures 3-4 to 3-13)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from twin.condition import Condition
from twin.pumps import circuit_parameters, pump_type
from twin.simulation.programme import POINTS, steady_tests
from twin.simulation.run import simulate
from twin.simulation.scenario import Scenario
from twin.units import STANDARD_ATMOSPHERE_BAR
from twin.validation.evidence import INDEPENDENT, Curve, Evidence, Plot, Row

Vector = NDArray[np.float64]

SAMPLE_RATE_HZ = 10_000.0
RECORD_S = 2.0
AVERAGES, OVERLAP = 16, 0.20
"""Section 3.2.3: Hanning window, averaging factor 16, overlap of 20 %; records of two seconds (annex A-1)."""
FILTER_HZ = {"discharge": 1500.0, "case": 1000.0}
"""Table 3-3."""
SPEEDS_RPM = (920.0, 3450.0, 4600.0, 5500.0)
_BAND = 0.5
_NF_SHOWN = 40.0
_SETTLE_S = 0.2
_POINT_2 = 1


class Density(NamedTuple):
    """One-sided density [bar^2/Hz] over frequency [Hz], both of shape (m,), and the shaft's frequency [Hz]."""

    frequency: Vector
    density: Vector
    shaft_hz: float

    @property
    def orders(self) -> Vector:
        """Normalised frequency N_f (3-1), shape (m,)."""
        return self.frequency / self.shaft_hz

    @property
    def cumulative(self) -> Vector:
        """Running sum over frequency, 1 at its end, shape (m,)."""
        total: Vector = np.cumsum(self.density)
        shares: Vector = total / total[-1]
        return shares

    def share(self, order: float) -> float:
        """Share of the variance within half an order of one order [-]."""
        near = np.abs(self.orders - order) < _BAND
        return float(self.density[near].sum() / self.density.sum())


def welch_density(samples: Vector, rate_hz: float, shaft_hz: float) -> Density:
    """Density with the thesis' settings: the record is cut into 16 Hann windows that overlap by a fifth, its mean removed."""
    length = int(len(samples) / (1.0 + (AVERAGES - 1) * (1.0 - OVERLAP)))
    frequency, density = signal.welch(
        samples - samples.mean(), rate_hz, "hann", length, int(OVERLAP * length), detrend="constant"
    )
    return Density(np.asarray(frequency), np.asarray(density), shaft_hz)


def densities(condition: Condition, load: float) -> dict[str, Density]:
    """Densities of discharge and case pressure of the simulated h225 at a load [bar/(L/min)^2], 0 at zero flow."""
    opening = 1.0 / np.sqrt(load) if load else 0.0
    changes = {"load_conductance_lpm_per_sqrt_bar": float(opening)}
    scenario = Scenario(RECORD_S + _SETTLE_S, condition, changes=changes)
    run = simulate(pump_type("h225").pump, circuit_parameters("shared_return"), scenario, sample_rate_hz=SAMPLE_RATE_HZ)
    first = round(_SETTLE_S * SAMPLE_RATE_HZ)
    found = {}
    for name, cut in FILTER_HZ.items():
        sections = signal.butter(4, cut, fs=SAMPLE_RATE_HZ, output="sos")
        filtered = np.asarray(signal.sosfiltfilt(sections, run.recording[f"{name}_pressure_bar"]))
        found[name] = welch_density(filtered[first:], SAMPLE_RATE_HZ, condition.speed_rpm / 60.0)
    return found


def frequency() -> Evidence:
    """Cumulative densities over load, tank pressure and speed; which frequencies carry the pulsation."""
    tests = steady_tests("A2", pump_type("h225"), circuit_parameters("shared_return"))
    at = {(t.condition.speed_rpm, t.condition.reservoir_pressure_bar > 1.0, t.point): t for t in tests}
    loads = {
        (raised, point): densities(t.condition, t.load)
        for (speed, raised, point), t in at.items() if speed == 4600.0
    }  # fmt: skip
    speeds = {}
    for speed in SPEEDS_RPM:
        test = at[speed, False, POINTS[_POINT_2]]
        speeds[speed] = loads[False, POINTS[_POINT_2]] if speed == 4600.0 else densities(test.condition, test.load)
    n = int(pump_type("h225").pump.piston.n)
    return Evidence("Frequencies of both pressures", tuple(_rows(loads, speeds, n)), _plots(loads, speeds), _REMARKS)


_REMARKS = (
    "Welch's method with a Hann window, 16 averages and 20 % overlap of two seconds at 10 kHz, after low-pass filters of 1500 "
    "and 1000 Hz (tables 3-2 and 3-3): a line is 13 Hz wide.",
    "The measured case pressure at 0 bar is dominated by order 18 and holds the shaft's order 1; an even model has neither, "
    "with any load and speed. The unpressurised tank changes it, so that what is missing lies on the suction side or in the "
    "shared line, where nothing is modelled between pump and sensor.",
    f"Inlet pressures are those of annex A-1, 1 and 3.5 bar absolute: {1.0 - STANDARD_ATMOSPHERE_BAR:+.3f} and "
    f"{3.5 - STANDARD_ATMOSPHERE_BAR:+.3f} bar over the atmosphere. The measured curves are pictures and are not compared.",
)

Loads = dict[tuple[bool, str], dict[str, Density]]
Speeds = dict[float, dict[str, Density]]


def _rows(loads: Loads, speeds: Speeds, n: int) -> list[Row]:
    rows = []
    for point in POINTS:
        d = loads[False, point]["discharge"]
        rows.append(
            Row("figure 3-7", f"discharge, {point}: share of orders {n} and {2 * n}", "-", 0.5, d.share(n) + d.share(2 * n), 0.0,
                INDEPENDENT, 1, "porting pulsation and its second harmonic are the main frequencies at every load")
        )  # fmt: skip
    for speed, found in speeds.items():
        d = found["discharge"]
        strongest = float(np.round(d.orders[int(np.argmax(d.density))]))
        rows.append(
            Row("figures 3-10, 3-11", f"discharge, {speed:g} rpm: strongest order", "-", float(n), strongest, 0.0, INDEPENDENT,
                note="independent of speed in the measurement")
        )  # fmt: skip
    for raised in (False, True):
        d = loads[raised, POINTS[_POINT_2]]["case"]
        strongest = float(np.round(d.orders[int(np.argmax(d.density))]))
        rows.append(
            Row("figure 3-6", f"case, tank at {'2.5' if raised else '0'} bar, static point 2: strongest order", "-", np.nan,
                strongest, np.nan, note="measured 18 at 0 bar and 9 at 2.5 bar; judged under the orders of both pressures")
        )  # fmt: skip
    return rows


def _plots(loads: Loads, speeds: Speeds) -> tuple[Plot, ...]:
    def over_load(name: str, raised: bool) -> tuple[Curve, ...]:
        return tuple(_cut(point, loads[raised, point][name], cumulative=True, hertz=True) for point in POINTS)

    def over_speed(name: str, cumulative: bool) -> tuple[Curve, ...]:
        return tuple(_cut(f"{s:g} rpm", found[name], cumulative, hertz=False) for s, found in speeds.items())

    hertz, order = "frequency [Hz]", "normalised frequency [-]"
    density, share = "log10 of density [bar2/Hz]", "cumulative density [-]"
    condition = "4600 rpm, 50 degC."
    two = "Static point 2, 50 degC."
    return (
        Plot(
            "Figure 3-7: discharge pressure, influence of load", hertz, share, over_load("discharge", False), condition
        ),
        Plot(
            "Figure 3-8: case pressure, influence of load, tank 0 bar",
            hertz,
            share,
            over_load("case", False),
            condition,
        ),
        Plot(
            "Figure 3-9: case pressure, influence of load, tank 2.5 bar",
            hertz,
            share,
            over_load("case", True),
            condition,
        ),
        Plot("Figure 3-10: density of discharge pressure", order, density, over_speed("discharge", False), two),
        Plot("Figure 3-11: cumulative, discharge pressure", order, share, over_speed("discharge", True), two),
        Plot("Figure 3-12: density of case pressure", order, density, over_speed("case", False), two),
        Plot("Figure 3-13: cumulative, case pressure", order, share, over_speed("case", True), two),
    )


def _cut(label: str, d: Density, cumulative: bool, hertz: bool) -> Curve:
    shown = (d.orders > 0.0) & (d.orders <= _NF_SHOWN)
    y = d.cumulative if cumulative else np.log10(np.maximum(d.density, 1.0e-16))
    x = d.frequency if hertz else d.orders
    return Curve(label, x[shown], y[shown])
