"""Order amplitudes of both pressures at zero flow: response surfaces fitted to the transient pump, in microseconds.

The lines at n and 2 n come from commutation; they follow the leakage that the chambers feel, whoever's it is. The line
at order 1 is drawn by pistons that leak unequally: each one's leakage counts as a vector at its place on the circle,
and the sum passes through an impedance of discharge (and case) that depends on the condition. The same sum draws the
side lines n - 1 and n + 1. ``benchmarks/burst_surrogate.py`` fits the surfaces and says how far they can be trusted.

Not in the surfaces: the drain law's weights (they move the case's mean, not its lines), unevenness of orders 2 to 4.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin import columns as at
from twin.compiled import compiled
from twin.condition import INPUTS
from twin.laws.fluid import P_ATMOSPHERE, density, gap_viscosity
from twin.laws.gap import annular_gap_flow, land_conductance, port_plate_gap_flow, throttled_land_flow
from twin.numbers import ZERO_FLOW_BAR
from twin.parameters import Pump
from twin.units import KELVIN_AT_0_DEGC, M3_PER_S_PER_LPM, PA_PER_BAR, STANDARD_ATMOSPHERE_BAR

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

CHANNELS: tuple[str, ...] = ("discharge_pressure_bar", "case_pressure_bar")
DISCHARGE, CASE = range(2)
L_1, L_BELOW, L_N, L_ABOVE, L_2N = range(5)
N_LINES = 5
"""Lines of each channel: orders 1, n - 1, n, n + 1, 2 n."""
COORDINATES: tuple[str, ...] = (
    "speed",
    "temperature",
    "absolute reservoir pressure",
    "slipper leakage",
    "piston leakage",
    "port-plate leakage",
    "control bleed",
    "system leakage",
    "setting",
    "drain resistance",
    "droop",
    "throttled leakage",
    "edge rounding",
)
"""What the surfaces are polynomials of: flows where a passage leaks, so that temperature and wear meet in one number."""
N_COORDINATES = len(COORDINATES)
(
    C_SPEED, C_TEMPERATURE, C_RESERVOIR, C_SLIPPERS, C_PISTONS, C_PORT_PLATE, C_BLEED, C_SYSTEM, C_SETTING, C_DRAIN,
    C_DROOP, C_THROTTLED, C_EDGES,
) = range(N_COORDINATES)  # fmt: skip
SLIPPERS_REAL, SLIPPERS_IMAGINARY, PISTONS_REAL, PISTONS_IMAGINARY = range(N_COORDINATES, N_COORDINATES + 4)
"""Behind the coordinates: vector sums of uneven leakage [L/min]."""
N_FOUND = N_COORDINATES + 4
SURFACES: tuple[str, ...] = (
    "ln discharge n",
    "ln discharge 2n",
    "ln case 2n",
    "real case n",
    "imaginary case n",
    "ln discharge 1",
    "ln discharge n-1",
    "ln discharge n+1",
    "ln case 1",
    "ln case n-1",
    "ln case n+1",
)
(
    D_N, D_2N, C_2N, C_N_REAL, C_N_IMAGINARY, D_1, D_BELOW, D_ABOVE, C_1, C_BELOW, C_ABOVE,
) = range(len(SURFACES))  # fmt: skip
"""Lines of commutation in bar; those of unevenness in bar per L/min of the vector sum of leakages."""
N_TERMS = 1 + N_COORDINATES + N_COORDINATES * (N_COORDINATES + 1) // 2 + 5
_P_CASE = 1.5 * PA_PER_BAR + P_ATMOSPHERE
_BY = {name: i for i, name in enumerate(INPUTS)}
STEPS: Mapping[str, float] = {
    "speed_rpm": 10.0,
    "fluid_temperature_degc": 0.5,
    "reservoir_pressure_bar": 0.02,
    "ambient_pressure_bar": 0.02,
    **dict.fromkeys(("pump_leakage_scale", "slipper_leakage_scale", "piston_leakage_scale"), 0.01),
    "port_plate_leakage_scale": 0.01,
    "control_bleed_lpm": 0.01,
    "system_leakage_lpm": 0.05,
    "pressure_setting_change_bar": 0.1,
    "drain_resistance_scale": 0.01,
    "droop_scale": 0.01,
    "throttled_leakage_lpm": 0.01,
    "edge_rounding_um": 1.0,
}
"""Steps of the forward differences."""


@dataclass(frozen=True, slots=True)
class OrderSurfaces:
    """Coefficients of all surfaces, for one pump type in one circuit.

    Attributes
    ----------
    coefficients
        Shape (len(SURFACES), N_TERMS).
    low, high
        Range of the coordinates that was fitted, shape (N_COORDINATES,). Outside, the edge's value is taken.
    piston_share
        What a piston's leakage draws at order 1 over what a slipper's of the same size does [-].
    fitted_to
        Twin version whose transient pump was fitted.
    """

    pump_type: str
    circuit: str
    fitted_to: str
    coefficients: Matrix
    low: Vector
    high: Vector
    piston_share: float


@cache
def order_surfaces(pump_type: str = "h225", circuit: str = "shared_return") -> OrderSurfaces:
    """Surfaces of a pump type in a circuit.

    Raises
    ------
    ValueError
        when none were fitted: say which there are and how to fit more.
    """
    source = files("twin.orders") / f"{pump_type}.json"
    found: dict[str, Any] = json.loads(source.read_text(encoding="utf-8")) if source.is_file() else {}
    if found.get("circuit") != circuit:
        raise ValueError(
            f"no order surfaces were fitted for {pump_type!r} in {circuit!r} (there are: 'h225' in 'shared_return'); "
            "fit them with benchmarks/burst_surrogate.py"
        )
    return OrderSurfaces(
        pump_type,
        circuit,
        str(found["fitted_to"]),
        np.array(found["coefficients"], dtype=np.float64),
        np.array(found["low"], dtype=np.float64),
        np.array(found["high"], dtype=np.float64),
        float(found["piston_share"]),
    )


def order_amplitudes(
    surfaces: OrderSurfaces,
    pump: Pump,
    rows: Matrix,
    slipper_gaps: Matrix | None = None,
    piston_clearances: Matrix | None = None,
) -> Matrix:
    """Amplitudes of orders 1, n - 1, n, n + 1 and 2 n of discharge and case pressure at zero flow [bar].

    Parameters
    ----------
    rows
        Conditions and health in the order of ``twin.condition.INPUTS``, shape (m, len(INPUTS)).
    slipper_gaps, piston_clearances
        Factors on each one's gap height, shape (m, n) or (n,); None for an even pump. They come on top of the row.

    Returns
    -------
    numpy.ndarray
        Shape (m, 2, 5).

    Raises
    ------
    ValueError
        naming every wrong shape, a row at another flow than zero, a factor that is not a positive number.
    """
    rows, gaps, clearances = _checked(pump, rows, slipper_gaps, piston_clearances)
    out = np.empty((len(rows), len(CHANNELS), N_LINES))
    _amplitudes(
        pump, surfaces.coefficients, surfaces.low, surfaces.high, surfaces.piston_share, rows, gaps, clearances, out
    )
    return out


def order_derivatives(
    surfaces: OrderSurfaces,
    pump: Pump,
    rows: Matrix,
    slipper_gaps: Matrix | None = None,
    piston_clearances: Matrix | None = None,
) -> Matrix:
    """d(amplitude)/d(input) by forward differences, shape (m, 2, 5, len(INPUTS)), in bar per the input's unit.

    Zero for inputs that the surfaces do not know. Raises as ``order_amplitudes``.
    """
    rows, gaps, clearances = _checked(pump, rows, slipper_gaps, piston_clearances)
    base = order_amplitudes(surfaces, pump, rows, gaps, clearances)
    slopes = np.zeros((*base.shape, len(INPUTS)))
    for name, step in STEPS.items():
        moved = rows.copy()
        moved[:, _BY[name]] += step
        slopes[..., _BY[name]] = (order_amplitudes(surfaces, pump, moved, gaps, clearances) - base) / step
    return slopes


def _checked(
    pump: Pump, rows: Matrix, slipper_gaps: Matrix | None, piston_clearances: Matrix | None
) -> tuple[Matrix, Matrix, Matrix]:
    rows = np.array(rows, dtype=np.float64, ndmin=2)
    n, faults = int(pump.piston.n), []
    if rows.ndim != 2 or rows.shape[1] != len(INPUTS):
        raise ValueError(f"rows must have shape (m, {len(INPUTS)}), one column per input; got {rows.shape}")
    if np.any(rows[:, at.ASKED_FLOW] != 0.0):
        faults.append("discharge_flow_lpm must be 0: order amplitudes are known at zero flow only")
    filled = []
    for name, factors in (("slipper_gaps", slipper_gaps), ("piston_clearances", piston_clearances)):
        given = np.ones(n) if factors is None else np.asarray(factors, dtype=np.float64)
        if given.shape not in {(n,), (len(rows), n)}:
            faults.append(f"{name} must have shape ({n},) or ({len(rows)}, {n}); got {given.shape}")
            continue
        if not np.all(np.isfinite(given) & (given > 0.0)):
            faults.append(f"{name} must be positive numbers: factors on the gap's height")
        filled.append(np.ascontiguousarray(np.broadcast_to(given, (len(rows), n))))
    if faults:
        raise ValueError("; ".join(faults))
    return rows, filled[0], filled[1]


@compiled
def write_coordinates(pump: Pump, row: Vector, gaps: Vector, clearances: Vector, u: Vector) -> None:
    """Coordinates and vector sums of one row, into ``u``, shape (N_FOUND,)."""
    piston, slipper, plate, fluid = pump.piston, pump.slipper, pump.port_plate, pump.fluid
    n = len(gaps)
    T = row[at.TEMPERATURE] + KELVIN_AT_0_DEGC
    P_d = (ZERO_FLOW_BAR + row[at.SETTING_CHANGE]) * PA_PER_BAR + P_ATMOSPHERE
    mu = gap_viscosity(fluid, T, P_d, _P_CASE)
    rho = density(fluid, T, P_ATMOSPHERE)
    G = land_conductance(mu, slipper.h, slipper.diameter_ratio)
    C_A = slipper.C_q * 0.25 * math.pi * slipper.d_throttle**2
    ring = annular_gap_flow(
        P_d, _P_CASE, mu, piston.d_p, piston.b, piston.l_mean, piston.e_rel * piston.b, 0.0
    )  # fmt: skip
    ring *= row[at.PUMP_SCALE] * row[at.PISTON_SCALE] / M3_PER_S_PER_LPM
    land = row[at.PUMP_SCALE] * row[at.SLIPPER_SCALE] / M3_PER_S_PER_LPM
    lands, rings = 0.0, 0.0
    lands_re, lands_im, rings_re, rings_im = 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        flow = land * throttled_land_flow(P_d, _P_CASE, G * gaps[k] ** 3, C_A, rho)
        leak = ring * clearances[k] ** 3
        place = 2.0 * math.pi * k / n
        c, s = math.cos(place), math.sin(place)
        lands += flow
        lands_re += flow * c
        lands_im += flow * s
        rings += leak
        rings_re += leak * c
        rings_im += leak * s
    u[C_SPEED] = math.log(row[at.SPEED] / 4600.0) / 0.08
    u[C_TEMPERATURE] = (row[at.TEMPERATURE] - 62.0) / 42.0
    u[C_RESERVOIR] = (row[at.RESERVOIR] + row[at.AMBIENT] - STANDARD_ATMOSPHERE_BAR - 1.75) / 1.75
    # half of the chambers stand under pressure
    u[C_SLIPPERS] = 0.5 * lands
    u[C_PISTONS] = 0.5 * rings
    u[C_PORT_PLATE] = (
        row[at.PUMP_SCALE]
        * row[at.PORT_PLATE_SCALE]
        * port_plate_gap_flow(P_d, _P_CASE, mu, plate.h, plate.shape)
        / M3_PER_S_PER_LPM
    )
    u[C_BLEED] = row[at.CONTROL_BLEED]
    u[C_SYSTEM] = row[at.SYSTEM_LEAKAGE] / 6.0
    u[C_SETTING] = row[at.SETTING_CHANGE] / 6.0
    u[C_DRAIN] = math.log(row[at.DRAIN_SCALE]) / 0.5
    u[C_DROOP] = math.log(max(row[at.DROOP_SCALE], 1.0e-3)) / 1.4
    u[C_THROTTLED] = row[at.THROTTLED_LEAKAGE]
    u[C_EDGES] = row[at.EDGE_ROUNDING] / 60.0
    u[SLIPPERS_REAL], u[SLIPPERS_IMAGINARY], u[PISTONS_REAL], u[PISTONS_IMAGINARY] = (
        lands_re,
        lands_im,
        rings_re,
        rings_im,
    )


@compiled
def write_terms(u: Vector, out: Vector) -> None:
    """Full quadratic in the coordinates, with the cubic terms of temperature, slipper and system leakage."""
    out[0] = 1.0
    k = 1
    for i in range(N_COORDINATES):
        out[k] = u[i]
        k += 1
    for i in range(N_COORDINATES):
        for j in range(i, N_COORDINATES):
            out[k] = u[i] * u[j]
            k += 1
    out[k] = u[C_TEMPERATURE] ** 3
    out[k + 1] = u[C_SLIPPERS] ** 3
    out[k + 2] = u[C_TEMPERATURE] ** 2 * u[C_SLIPPERS]
    out[k + 3] = u[C_TEMPERATURE] * u[C_SLIPPERS] ** 2
    out[k + 4] = u[C_SYSTEM] ** 3


@compiled
def _amplitudes(
    pump: Pump,
    coefficients: Matrix,
    low: Vector,
    high: Vector,
    piston_share: float,
    rows: Matrix,
    gaps: Matrix,
    clearances: Matrix,
    out: NDArray[np.float64],
) -> None:
    u, terms = np.empty(N_FOUND), np.empty(N_TERMS)
    value = np.empty(coefficients.shape[0])
    for i in range(len(rows)):
        write_coordinates(pump, rows[i], gaps[i], clearances[i], u)
        for j in range(N_COORDINATES):
            u[j] = min(max(u[j], low[j]), high[j])
        write_terms(u, terms)
        for s in range(len(value)):
            total = 0.0
            for j in range(N_TERMS):
                total += coefficients[s, j] * terms[j]
            value[s] = total
        uneven = math.hypot(
            u[SLIPPERS_REAL] + piston_share * u[PISTONS_REAL],
            u[SLIPPERS_IMAGINARY] + piston_share * u[PISTONS_IMAGINARY],
        )
        out[i, DISCHARGE, L_1] = math.exp(value[D_1]) * uneven
        out[i, DISCHARGE, L_BELOW] = math.exp(value[D_BELOW]) * uneven
        out[i, DISCHARGE, L_N] = math.exp(value[D_N])
        out[i, DISCHARGE, L_ABOVE] = math.exp(value[D_ABOVE]) * uneven
        out[i, DISCHARGE, L_2N] = math.exp(value[D_2N])
        out[i, CASE, L_1] = math.exp(value[C_1]) * uneven
        out[i, CASE, L_BELOW] = math.exp(value[C_BELOW]) * uneven
        out[i, CASE, L_N] = math.hypot(value[C_N_REAL], value[C_N_IMAGINARY])
        out[i, CASE, L_ABOVE] = math.exp(value[C_ABOVE]) * uneven
        out[i, CASE, L_2N] = math.exp(value[C_2N])
