"""The twin at the matching condition: what a window should have shown, and how sure the difference is."""

import math

from detectors.words.observation import Residual, Window, Zero
from twin.condition import Condition, Health, OperatingPoints
from twin.operating_point import operating_point
from twin.parameters import Circuit, PumpType

TEMPERATURE_SD_K = 0.5
"""Estimate: fluid temperature at the pump against what its probe shows in a steady window."""
UNRECORDED_TEMPERATURE_SD_K = 15.0
"""Estimate: fluid temperature against the type's reference one, where nobody records it."""
TWIN_DISCHARGE_SD_BAR = 0.10
TWIN_CASE_SD_BAR = 0.004
TWIN_CASE_SD_RELATIVE = 0.01
"""Estimates: what the mean-value twin misses from flight to flight besides its own parameters."""
LOAD_FLOW_SD_LPM = 0.3
"""Estimate: the flow that a ground run's demand really makes, against what was commanded."""
LOAD_CASE_SD_RELATIVE = 0.03
"""Estimate: what both pressures miss under load from run to run, as a share of case above reservoir pressure (the return
line's own temperature law, which nobody measured)."""


def matching_condition(window: Window, pump: PumpType) -> Condition:
    """Condition of a window; without a reservoir sensor the pump type's nominal reservoir pressure stands in."""
    reservoir = window.means.get("reservoir_pressure_bar")
    commanded = window.means.get("commanded_flow_lpm")
    return Condition(
        speed_rpm=window.means["shaft_speed_rpm"].mean,
        fluid_temperature_degc=window.means["fluid_temperature_degc"].mean,
        reservoir_pressure_bar=pump.nominal_reservoir_pressure_bar if reservoir is None else reservoir.mean,
        discharge_flow_lpm=0.0 if commanded is None else max(commanded.mean, 0.0),
    )


def temperature_sd(pump: PumpType) -> float:
    """One-sigma of a window's fluid temperature [K]; nothing where a measured curve stands in that knows of none."""
    if "fluid_temperature_degc" not in pump.lacks:
        return TEMPERATURE_SD_K
    return UNRECORDED_TEMPERATURE_SD_K if pump.own_twin else 0.0


def discharge_noise_sd(window: Window, pump: PumpType) -> float:
    """One-sigma of a window's mean discharge pressure against the true one, repeatability included [bar].

    What a twin misses is no part of it for a type that has none: its curve has errors of its own.
    """
    sensor = pump.sensors["discharge_pressure_bar"]
    twin = TWIN_DISCHARGE_SD_BAR if pump.own_twin else 0.0
    return math.hypot(window.means["discharge_pressure_bar"].standard_error, sensor.repeatability_bar, twin)


def case_noise_sd(window: Window, pump: PumpType) -> float:
    """One-sigma of a window's mean case pressure, its zero apart [bar]."""
    sensor = pump.sensors["case_pressure_bar"]
    mean = window.means["case_pressure_bar"]
    twin = math.hypot(TWIN_CASE_SD_BAR, TWIN_CASE_SD_RELATIVE * max(mean.mean, 0.0)) if pump.own_twin else 0.0
    return math.hypot(mean.standard_error, sensor.repeatability_bar, twin)


def reservoir_noise_sd(window: Window, pump: PumpType) -> float:
    """One-sigma of the reservoir pressure in a window [bar]; the population's spread where it is not measured."""
    mean = window.means.get("reservoir_pressure_bar")
    if mean is None:
        return pump.population["reservoir_pressure_bar"].value
    sensor = pump.sensors["reservoir_pressure_bar"]
    return math.hypot(mean.standard_error, sensor.repeatability_bar)


def window_residuals(window: Window, zero: Zero, pump: PumpType, circuit: Circuit) -> dict[str, Residual]:
    """Residuals of case and discharge pressure of one window against the nominal healthy twin.

    The zero is taken out of the measured case pressure. ``standard_deviation`` holds sensors, zero, window,
    reservoir and temperature, but not the spread between pumps: that is what the history learns. Empty when
    the twin has no solution at this condition, or the type has none of its own.
    """
    if not pump.own_twin:
        return {}
    point = operating_point(pump.pump, matching_condition(window, pump), circuit, Health(), derivatives=True)
    if point.status[0] != 0:
        return {}
    reservoir = reservoir_noise_sd(window, pump)
    measured, noise = {}, {}
    if "case_pressure_bar" in window.means:
        measured["case_pressure_bar"] = window.means["case_pressure_bar"].mean - zero.offset_bar
        noise["case_pressure_bar"] = math.hypot(case_noise_sd(window, pump), zero.standard_deviation_bar)
    if "discharge_pressure_bar" in window.means:
        measured["discharge_pressure_bar"] = window.means["discharge_pressure_bar"].mean
        noise["discharge_pressure_bar"] = discharge_noise_sd(window, pump)
    return {
        name: Residual(
            measured=measured[name],
            twin=float(point.value(name)[0]),
            residual=measured[name] - float(point.value(name)[0]),
            standard_deviation=math.hypot(
                noise[name],
                _slope(point, name, "fluid_temperature_degc") * temperature_sd(pump),
                _slope(point, name, "reservoir_pressure_bar") * reservoir,
            ),
        )
        for name in measured
    }


def _slope(point: OperatingPoints, output: str, by: str) -> float:
    return float(point.derivative(output, by)[0])
