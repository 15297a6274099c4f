"""Fault magnitudes in an operator's units, averaged over the hypotheses by their evidence."""

import math

import numpy as np
from numpy.typing import NDArray

from detectors.filter_bank import Bank
from detectors.state_model import FAULT, FAULT_KINDS, INDEX, Scene, resolved, twin_rows
from detectors.verdict import Estimate
from twin.condition import Condition, Health, input_rows
from twin.laws.fluid import kinematic_viscosity
from twin.operating_point import operating_points
from twin.parameters import Circuit, PumpType
from twin.units import KELVIN_AT_0_DEGC

Array = NDArray[np.float64]

Z_90 = 1.645
WIDENING = 1.12
"""Intervals are widened by an eighth: what a study against foreign realities asked for honest coverage."""
_ODDS_TO_FIND = 11.0
"""Log evidence that a fault must gather: the alarm level plus the prior against it [nat]."""


def laminar_ratio(pump: PumpType, temperature_degc: float) -> float:
    """Viscosity at 50 degC over viscosity at ``temperature_degc``: how much more a laminar leak flows here [-]."""
    fluid = pump.pump.fluid
    there = kinematic_viscosity(fluid, temperature_degc + KELVIN_AT_0_DEGC)
    return float(kinematic_viscosity(fluid, 50.0 + KELVIN_AT_0_DEGC) / there)


def reference_scene(pump: PumpType) -> Scene:
    """The pump type's reference condition: nominal speed, zero flow, the acceptance sheet's temperature."""
    temperature = pump.limits["reference_temperature_k"].value - KELVIN_AT_0_DEGC
    condition = Condition(pump.nominal_speed_rpm, temperature, pump.nominal_reservoir_pressure_bar)
    return Scene(np.array(condition), laminar_ratio(pump, temperature), reservoir_measured=True)


def nominal_leakage_lpm(pump: PumpType, circuit: Circuit) -> float:
    """Leakage past pistons, slippers and port plate of the nominal pump at the reference condition [L/min]."""
    scene = reference_scene(pump)
    points = operating_points(pump.pump, input_rows([Condition(*scene.condition)], [Health()]), circuit)
    return float(sum(points.value(f"{part}_leakage_lpm")[0] for part in ("piston", "slipper", "port_plate")))


def estimates(
    bank: Bank, weights: Array, pump: PumpType, circuit: Circuit, leakage_lpm: float
) -> tuple[dict[str, Estimate], dict[str, float]]:
    """Changes since the baseline with 90 % intervals, and the smallest change that would be found.

    Before the baseline is set a change is as unknown as its prior, and nothing has a smallest size yet.

    ``weights`` are the filters' posterior shares, shape (m,); ``leakage_lpm`` is ``nominal_leakage_lpm``.
    """
    found, smallest = {}, {}
    quantities = {
        "pump_leakage_change_lpm": ("leakage, laminar", "leakage, throttled"),
        "system_leakage_change_lpm": ("system leakage, orifice", "system leakage, laminar"),
        "pressure_setting_change_bar": ("setting",),
        "drain_resistance_change_percent": ("drain restriction",),
    }
    number = {k.name: i for i, k in enumerate(FAULT_KINDS)}
    for quantity, kinds in quantities.items():
        places = np.flatnonzero(np.isin(bank.kind, [number[k] for k in kinds]))
        means, sds = _in_units(bank, quantity, leakage_lpm)
        resolution = _resolution(bank, number[kinds[0]], sds)
        if resolution is None:
            resolution = _prior_spread(quantity, FAULT_KINDS[number[kinds[0]]].scale, leakage_lpm)
        else:
            smallest[quantity] = math.sqrt(2.0 * _ODDS_TO_FIND) * resolution
        rest = 1.0 - float(weights[places].sum())
        mean = float(weights[places] @ means[places])
        second = float(weights[places] @ (sds[places] ** 2 + means[places] ** 2)) + rest * resolution**2
        found[quantity] = _interval(mean, math.sqrt(max(second - mean**2, 0.0)))
    found["case_flow_at_reference_lpm"] = _case_flow(bank, weights, pump, circuit)
    return found, smallest


def _in_units(bank: Bank, quantity: str, leakage_lpm: float) -> tuple[Array, Array]:
    """Every filter's fault amplitude and its spread in the quantity's unit, shapes (m,), (m,)."""
    amplitude = bank.mean[:, FAULT]
    sd = np.sqrt(np.maximum(bank.covariance[:, FAULT, FAULT], 0.0))
    if quantity == "pump_leakage_change_lpm":
        laminar = bank.kind == 0
        level = leakage_lpm * np.exp(bank.mean[:, INDEX["ln_leakage"]])
        growth = np.exp(np.clip(amplitude, -3.0, 3.0))
        return np.where(laminar, level * (growth - 1.0), amplitude), np.where(laminar, level * growth * sd, sd)
    if quantity == "drain_resistance_change_percent":
        growth = np.exp(np.clip(amplitude, -3.0, 3.0))
        return 100.0 * (growth - 1.0), 100.0 * growth * sd
    return amplitude, sd


def _prior_spread(quantity: str, scale: float, leakage_lpm: float) -> float:
    """One-sigma size of a fault of this kind before anything is known of it, in the quantity's unit."""
    if quantity == "pump_leakage_change_lpm":
        return leakage_lpm * scale
    return 100.0 * scale if quantity == "drain_resistance_change_percent" else scale


def _resolution(bank: Bank, kind: int, sds: Array) -> float | None:
    """How well a sudden fault of this kind is known since its oldest onset; None before one saw two records."""
    places = np.flatnonzero((bank.kind == kind) & (bank.onset >= 0) & (bank.onset <= bank.records - 2))
    return float(sds[places[np.argmin(bank.onset[places])]]) if len(places) else None


def _case_flow(bank: Bank, weights: Array, pump: PumpType, circuit: Circuit) -> Estimate:
    """Case flow at the reference condition, from the likeliest filters; each filter's spread through its slopes."""
    likely = np.argsort(weights)[::-1][:3]
    states, component = bank.mean[likely], bank.component[likely]
    scene = reference_scene(pump)
    full = resolved(states, component)
    for name in ("case_offset_bar", "reservoir_bar"):
        full[:, INDEX[name]] = 0.0
    rows = twin_rows(full, scene.condition, scene.laminar_ratio)
    points = operating_points(pump.pump, rows, circuit, derivatives=True)
    flow = points.value("case_flow_lpm")
    scale = np.exp(full[:, INDEX["ln_leakage"]])
    slopes = np.zeros_like(states)
    slopes[:, INDEX["ln_leakage"]] = points.derivative("case_flow_lpm", "pump_leakage_scale") * scale
    slopes[:, INDEX["throttled_leakage_lpm"]] = points.derivative("case_flow_lpm", "throttled_leakage_lpm")
    slopes[:, INDEX["bleed_lpm"]] = points.derivative("case_flow_lpm", "control_bleed_lpm")
    faulty = component >= 0
    slopes[faulty, FAULT] = slopes[faulty, component[faulty]]
    variance = np.einsum("mi,mij,mj->m", slopes, bank.covariance[likely], slopes)
    share = weights[likely] / weights[likely].sum()
    solved = np.isfinite(flow)
    if not solved.any():
        return Estimate(math.nan, math.nan, math.nan)
    share, flow, variance = share[solved] / share[solved].sum(), flow[solved], variance[solved]
    mean = float(share @ flow)
    return _interval(mean, math.sqrt(max(float(share @ (variance + flow**2)) - mean**2, 0.0)))


def _interval(mean: float, sd: float) -> Estimate:
    half = Z_90 * WIDENING * sd
    return Estimate(mean, mean - half, mean + half)


def probability_above(estimate: Estimate, limit: float) -> float:
    """Probability that an estimated quantity lies above ``limit`` (normal)."""
    sd = max((estimate.high - estimate.low) / (2.0 * Z_90), 1e-9)
    return 0.5 * math.erfc((limit - estimate.mean) / (sd * math.sqrt(2.0)))
