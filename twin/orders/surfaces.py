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

from twin.compiled import compiled
from twin.condition import INPUTS
from twin.laws.fluid import P_ATMOSPHERE, density, gap_viscosity
from twin.laws.gap import annular_gap_flow, land_conductance, port_plate_gap_flow, throttled_land_flow
from twin.parameters import Pump
from twin.units import KELVIN_AT_0_DEGC, M3_PER_S_PER_LPM, PA_PER_BAR, STANDARD_ATMOSPHERE_BAR

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

CHANNELS: tuple[str, ...] = ("discharge_pressure_bar", "case_pressure_bar")
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
"""Lines of commutation in bar; those of unevenness in bar per L/min of the vector sum of leakages."""
N_TERMS = 1 + N_COORDINATES + N_COORDINATES * (N_COORDINATES + 1) // 2 + 5
_P_ZERO_FLOW = 175.0
_P_CASE = 1.5 * PA_PER_BAR + P_ATMOSPHERE
_BY = {name: i for i, name in enumerate(INPUTS)}
_FLOW = _BY["discharge_flow_lpm"]
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


def order_coordinates(pump: Pump, rows: Matrix, slipper_gaps: Matrix, piston_clearances: Matrix) -> Matrix:
    """Coordinates and vector sums of uneven leakage, as the surfaces are fitted in, shape (m, N_COORDINATES + 4).

    The last four are real and imaginary part of the slippers' and of the pistons' sum [L/min].
    """
    found = np.empty((len(rows), N_COORDINATES + 4))
    for i in range(len(rows)):
        _coordinates(pump, rows[i], slipper_gaps[i], piston_clearances[i], found[i])
    return found


def order_terms(coordinates: Matrix) -> Matrix:
    """Terms of the polynomial at coordinates (m, N_COORDINATES), shape (m, N_TERMS)."""
    found = np.empty((len(coordinates), N_TERMS))
    for i in range(len(coordinates)):
        _terms(np.ascontiguousarray(coordinates[i]), found[i])
    return found


def _checked(
    pump: Pump, rows: Matrix, slipper_gaps: Matrix | None, piston_clearances: Matrix | None
) -> tuple[Matrix, Matrix, Matrix]:
    rows = np.array(rows, dtype=np.float64, ndmin=2)
    n, faults = int(pump.piston.n), []
    if rows.ndim != 2 or rows.shape[1] != len(INPUTS):
        raise ValueError(f"rows must have shape (m, {len(INPUTS)}), one column per input; got {rows.shape}")
    if np.any(rows[:, _FLOW] != 0.0):
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
def _coordinates(pump: Pump, row: Vector, gaps: Vector, clearances: Vector, u: Vector) -> None:
    """Coordinates and vector sums of one row, into ``u``, shape (N_COORDINATES + 4,)."""
    piston, slipper, plate, fluid = pump.piston, pump.slipper, pump.port_plate, pump.fluid
    n = len(gaps)
    T = row[1] + KELVIN_AT_0_DEGC
    P_d = (_P_ZERO_FLOW + row[11]) * PA_PER_BAR + P_ATMOSPHERE
    mu = gap_viscosity(fluid, T, P_d, _P_CASE)
    rho = density(fluid, T, P_ATMOSPHERE)
    G = land_conductance(mu, slipper.h, slipper.diameter_ratio)
    C_A = slipper.C_q * 0.25 * math.pi * slipper.d_throttle**2
    ring = annular_gap_flow(
        P_d, _P_CASE, mu, piston.d_p, piston.b, piston.l_mean, piston.e_rel * piston.b, 0.0
    )  # fmt: skip
    ring *= row[5] * row[7] / M3_PER_S_PER_LPM
    land = row[5] * row[6] / M3_PER_S_PER_LPM
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
    u[0] = math.log(row[0] / 4600.0) / 0.08
    u[1] = (row[1] - 62.0) / 42.0
    u[2] = (row[2] + row[4] - STANDARD_ATMOSPHERE_BAR - 1.75) / 1.75
    # half of the chambers stand under pressure
    u[3] = 0.5 * lands
    u[4] = 0.5 * rings
    u[5] = row[5] * row[8] * port_plate_gap_flow(P_d, _P_CASE, mu, plate.h, plate.shape) / M3_PER_S_PER_LPM
    u[6] = row[9]
    u[7] = row[10] / 6.0
    u[8] = row[11] / 6.0
    u[9] = math.log(row[12]) / 0.5
    u[10] = math.log(max(row[15], 1.0e-3)) / 1.4
    u[11] = row[16]
    u[12] = row[17] / 60.0
    u[13], u[14], u[15], u[16] = lands_re, lands_im, rings_re, rings_im


@compiled
def _terms(u: Vector, out: Vector) -> None:
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
    out[k] = u[1] ** 3
    out[k + 1] = u[3] ** 3
    out[k + 2] = u[1] ** 2 * u[3]
    out[k + 3] = u[1] * u[3] ** 2
    out[k + 4] = u[7] ** 3


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
    u, terms = np.empty(N_COORDINATES + 4), np.empty(N_TERMS)
    value = np.empty(coefficients.shape[0])
    for i in range(len(rows)):
        _coordinates(pump, rows[i], gaps[i], clearances[i], u)
        for j in range(N_COORDINATES):
            u[j] = min(max(u[j], low[j]), high[j])
        _terms(u, terms)
        for s in range(len(value)):
            total = 0.0
            for j in range(N_TERMS):
                total += coefficients[s, j] * terms[j]
            value[s] = total
        uneven = math.hypot(u[13] + piston_share * u[15], u[14] + piston_share * u[16])
        out[i, 0, 0] = math.exp(value[5]) * uneven
        out[i, 0, 1] = math.exp(value[6]) * uneven
        out[i, 0, 2] = math.exp(value[0])
        out[i, 0, 3] = math.exp(value[7]) * uneven
        out[i, 0, 4] = math.exp(value[1])
        out[i, 1, 0] = math.exp(value[8]) * uneven
        out[i, 1, 1] = math.exp(value[9]) * uneven
        out[i, 1, 2] = math.hypot(value[3], value[4])
        out[i, 1, 3] = math.exp(value[10]) * uneven
        out[i, 1, 4] = math.exp(value[2])
