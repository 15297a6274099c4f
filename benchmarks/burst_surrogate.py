"""Fit the order amplitudes of the transient pump at zero flow, and check them on runs held out.

``python -m benchmarks.burst_surrogate [--points 512] [--held-out 100]`` simulates three pumps at every point of a Sobol
design (even, one slipper worn, one to three pistons worn), fits ``twin.orders.surfaces``' surfaces, writes
``twin/orders/h225.json`` and keeps errors and the table of single changes as
``benchmarks/results/burst_surrogate.json``. Minutes on two cores.
"""

import argparse
import json
import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from benchmarks import keep
from detectors.judgement.version import twin_version
from twin.condition import Condition, Health, input_rows
from twin.orders.surfaces import (
    D_1,
    N_COORDINATES,
    N_FOUND,
    N_TERMS,
    PISTONS_IMAGINARY,
    PISTONS_REAL,
    SLIPPERS_IMAGINARY,
    SLIPPERS_REAL,
    SURFACES,
    OrderSurfaces,
    order_amplitudes,
    write_coordinates,
    write_terms,
)
from twin.parameters import Pump
from twin.pumps import circuit_parameters, pump_type
from twin.simulation.layout import THETA
from twin.simulation.run import DEFAULT_STEP_S, simulate
from twin.simulation.scenario import Scenario, Value

Matrix = NDArray[np.float64]

KIND = pump_type("h225")
CIRCUIT = "shared_return"
N = int(KIND.pump.piston.n)
ORDERS = (1, N - 1, N, N + 1, 2 * N)
SETTLE, KEPT = 45, 6
# speed, temperature, reservoir, ln leakage of slippers, pistons, port plate, bleed, system, setting, ln drain, ln droop,
# throttled leakage, edge rounding
LOW = np.array([4600 * 0.92, 20, 0.0, *np.log([0.3, 0.3, 0.3]), 0, 0, -6, *np.log([0.6, 0.25]), 0, 0])
HIGH = np.array([4600 * 1.08, 105, 3.5, *np.log([4.0, 8.0, 15.0]), 0.8, 6, 6, *np.log([1.8, 4.0]), 1.2, 60])
WORN = ("even", "one slipper", "pistons")


def lines(condition: Condition, health: Health, changes: dict[str, Value]) -> tuple[NDArray[np.complex128], Matrix]:
    """Complex amplitudes of ``ORDERS`` of both pressures, shape (2, 5), and means of P_d, P_c and case flow."""
    period = 60.0 / condition.speed_rpm
    # a whole number of steps per piston: else the step's own error draws a line at order 1
    step = period / (N * math.ceil(period / DEFAULT_STEP_S / N))
    scenario = Scenario(period * (SETTLE + KEPT), condition, health, changes)
    run = simulate(KIND.pump, circuit_parameters(CIRCUIT), scenario, step_s=step, keep_states=True)
    if not run.status.ok:
        raise ValueError(run.status.advice)
    m = round(len(run.recording) / (SETTLE + KEPT)) * KEPT
    theta, turn = run.states[-m:, THETA], m // KEPT
    found = np.empty((2, len(ORDERS)), dtype=np.complex128)
    for i, name in enumerate(("discharge_pressure_bar", "case_pressure_bar")):
        x = run.recording[name][-m:]
        # what has not settled yet is a ramp
        slope = (x[-turn:].mean() - x[:turn].mean()) / (m - turn)
        x = x - x.mean() - slope * (np.arange(m) - 0.5 * (m - 1))
        found[i] = 2.0 / m * np.exp(-1j * np.outer(ORDERS, theta)) @ x
    names = ("discharge_pressure_bar", "case_pressure_bar", "case_flow_lpm")
    return found, np.array([run.mean(name, KEPT) for name in names])


def uneven(gaps: Sequence[float], clearances: Sequence[float]) -> dict[str, Value]:
    """Changes of a scenario for factors per slipper and per piston."""
    both = (("slipper_gap_scale", gaps), ("piston_clearance_scale", clearances))
    return {f"{name}[{k + 1}]": float(v) for name, values in both for k, v in enumerate(values) if v != 1.0}


class Design:
    """Points of a design with what the transient pump shows there: even, one slipper worn, pistons worn."""

    def __init__(self, points: int, seed: int) -> None:
        rng = np.random.default_rng(seed)
        share = qmc.Sobol(len(LOW), rng=seed).random_base2(math.ceil(math.log2(points)))[:points]
        # faults that start at zero are small more often than large
        share[:, [6, 7, 11, 12]] **= 1.5
        p = LOW + (HIGH - LOW) * share
        conditions = [Condition(u[0], u[1], u[2]) for u in p]
        healths = [
            Health(1.0, *np.exp(u[3:6]), u[6], u[7], u[8], math.exp(u[9]), 0, 0, math.exp(u[10]), u[11], u[12])
            for u in p
        ]
        self.rows = input_rows(conditions, healths)
        self.gaps, self.clearances = np.ones((points, len(WORN), N)), np.ones((points, len(WORN), N))
        self.gaps[:, 1, 0] = rng.uniform(1.2, 2.2, points)
        for i in range(points):
            worn = int(rng.integers(1, 4))
            self.clearances[i, 2, :worn] = rng.uniform(1.3, 2.5, worn)
        jobs = [
            (conditions[i], healths[i], uneven(self.gaps[i, v], self.clearances[i, v]))
            for i in range(points)
            for v in range(len(WORN))
        ]
        with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
            found = list(pool.map(lambda job: lines(*job)[0], jobs))
        self.lines = np.array(found).reshape(points, len(WORN), 2, len(ORDERS))

    def coordinates(self, v: int) -> Matrix:
        """Coordinates and sums of one of ``WORN``."""
        return order_coordinates(KIND.pump, self.rows, self.gaps[:, v], self.clearances[:, v])


def order_coordinates(pump: Pump, rows: Matrix, slipper_gaps: Matrix, piston_clearances: Matrix) -> Matrix:
    """Coordinates and vector sums of uneven leakage, as the surfaces are fitted in, shape (m, N_FOUND).

    The last four are real and imaginary part of the slippers' and of the pistons' sum [L/min].
    """
    found = np.empty((len(rows), N_FOUND))
    for i in range(len(rows)):
        write_coordinates(pump, rows[i], slipper_gaps[i], piston_clearances[i], found[i])
    return found


def order_terms(coordinates: Matrix) -> Matrix:
    """Terms of the polynomial at coordinates (m, N_COORDINATES), shape (m, N_TERMS)."""
    found = np.empty((len(coordinates), N_TERMS))
    for i in range(len(coordinates)):
        write_terms(np.ascontiguousarray(coordinates[i]), found[i])
    return found


def fitted(design: Design) -> OrderSurfaces:
    """Surfaces by least squares: commutation's lines from all runs, unevenness' from the worn slipper."""
    u = np.concatenate([design.coordinates(v) for v in range(len(WORN))])
    A, every = order_terms(u[:, :N_COORDINATES]), np.concatenate([design.lines[:, v] for v in range(len(WORN))])
    d, c = every[:, 0], every[:, 1]
    # the line of the case crosses zero where two causes cancel: its parts are smooth there, its length is not
    turned = c[:, 2] * np.conj(d[:, 2]) / np.abs(d[:, 2])
    targets = [np.log(np.abs(d[:, 2])), np.log(np.abs(d[:, 4])), np.log(np.abs(c[:, 4])), turned.real, turned.imag]
    rows = [np.linalg.lstsq(A, y, rcond=None)[0] for y in targets]
    worn = design.coordinates(1)
    B, difference = order_terms(worn[:, :N_COORDINATES]), design.lines[:, 1] - design.lines[:, 0]
    per_flow = np.log(np.abs(difference) / np.hypot(worn[:, SLIPPERS_REAL], worn[:, SLIPPERS_IMAGINARY])[:, None, None])
    rows += [np.linalg.lstsq(B, per_flow[:, k, j], rcond=None)[0] for k in range(2) for j in (0, 1, 3)]
    pistons, u_p = design.lines[:, 2, 0, 0] - design.lines[:, 0, 0, 0], design.coordinates(2)
    drawn = np.exp(order_terms(u_p[:, :N_COORDINATES]) @ rows[D_1]) * np.hypot(
        u_p[:, PISTONS_REAL], u_p[:, PISTONS_IMAGINARY]
    )
    share = float(np.abs(pistons) @ drawn / (drawn @ drawn))
    return OrderSurfaces(
        KIND.name, CIRCUIT, twin_version(KIND), np.array(rows),
        u[:, :N_COORDINATES].min(axis=0), u[:, :N_COORDINATES].max(axis=0), share,
    )  # fmt: skip


def errors(surfaces: OrderSurfaces, design: Design) -> dict[str, dict[str, float]]:
    """Median and 95 % of the error over held-out runs, relative and in mbar, per line and kind of wear."""
    found = {}
    for v, worn in enumerate(WORN):
        told = order_amplitudes(surfaces, KIND.pump, design.rows, design.gaps[:, v], design.clearances[:, v])
        for k, name in enumerate(("discharge", "case")):
            for j, order in enumerate(("1", "n-1", "n", "n+1", "2n")):
                true = np.abs(design.lines[:, v, k, j])
                off = np.abs(told[:, k, j] - true)
                row = {"median_mbar": 1e3 * float(np.median(true)), "error_median_mbar": 1e3 * float(np.median(off)),
                       "error_95_mbar": 1e3 * float(np.percentile(off, 95))}  # fmt: skip
                if v > 0 or order in {"n", "2n"}:
                    row |= {
                        "error_median": float(np.median(off / true)),
                        "error_95": float(np.percentile(off / true, 95)),
                    }
                found[f"{worn}: {name} {order}"] = row
    return found


def table(surfaces: OrderSurfaces) -> list[dict[str, object]]:
    """Change of mean case pressure and of lines by single changes at 4600 rpm, 50 degC and a tank at 0.5 bar [mbar]."""
    ones = [1.0] * N
    changes: list[tuple[str, Health, list[float], list[float], tuple[float, ...] | None]] = [
        ("healthy", Health(), ones, ones, None),
        ("uniform slipper leakage +0.45 L/min", Health(slipper_leakage_scale=1.83), ones, ones, (152, 0, 3.7, 0)),
        ("one slipper gap x1.8", Health(), [1.8, *ones[1:]], ones, (73, 260, 1.7, 14)),
        ("three pistons +150 %", Health(), ones, [2.5] * 3 + ones[3:], (19, 57, 0.5, 2.9)),
        ("drain resistance +30 %", Health(drain_resistance_scale=1.3), ones, ones, (96, 0, 0.0, 0)),
        ("system leakage +3 L/min", Health(system_leakage_lpm=3.0), ones, ones, (142, 0, 5.5, 0)),
        ("port-plate gap x3", Health(port_plate_leakage_scale=27.0), ones, ones, (111, 0, 0.7, 0)),
        ("setting +1 bar", Health(pressure_setting_change_bar=1.0), ones, ones, (1, 0, 0.4, 0)),
    ]
    condition, rows = Condition(4600, 50, 0.5), []
    base: tuple[Matrix, Matrix, Matrix] | None = None
    for name, health, gaps, clearances, other in changes:
        true, mean = lines(condition, health, uneven(gaps, clearances))
        told = order_amplitudes(
            surfaces, KIND.pump, input_rows([condition], [health]), np.array(gaps), np.array(clearances)
        )[0]
        now = 1e3 * np.abs(true), 1e3 * told, mean
        base = base or now
        amplitude, surrogate = now[0] - base[0], now[1] - base[1]
        rows.append({
            "change": name,
            "case_flow_lpm": round(float(mean[2] - base[2][2]), 3),
            "mean_case_mbar": round(1e3 * float(mean[1] - base[2][1]), 1),
            **{f"{line}_mbar": [round(float(amplitude[k, j]), 2), round(float(surrogate[k, j]), 2)]
               for line, k, j in (("discharge_1", 0, 0), ("discharge_n", 0, 2), ("discharge_2n", 0, 4),
                                  ("case_1", 1, 0), ("case_n", 1, 2))},
            "another_rebuild_mean_case_discharge_1_n_case_1_mbar": other,
        })  # fmt: skip
    return rows


def write(surfaces: OrderSurfaces, points: int) -> None:
    """Write the surfaces as the twin's data."""
    document = {
        "source": f"benchmarks/burst_surrogate.py: least squares on {len(WORN) * points} runs of the transient pump",
        "circuit": surfaces.circuit,
        "fitted_to": surfaces.fitted_to,
        "surfaces": list(SURFACES),
        "piston_share": round(surfaces.piston_share, 5),
        "low": [float(f"{v:.6g}") for v in surfaces.low],
        "high": [float(f"{v:.6g}") for v in surfaces.high],
        "coefficients": [[float(f"{v:.6g}") for v in row] for row in surfaces.coefficients],
    }
    path = Path(__file__).parent.parent / "twin" / "orders" / f"{surfaces.pump_type}.json"
    lines_of = [f" {json.dumps(key)}: {json.dumps(value)}" for key, value in document.items()]
    path.write_text("{\n" + ",\n".join(lines_of).replace("], [", "],\n  [") + "\n}\n", encoding="utf-8")


def main() -> None:
    """Simulate, fit, check, keep."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=512)
    parser.add_argument("--held-out", type=int, default=100)
    asked = parser.parse_args()
    surfaces = fitted(Design(asked.points, seed=1))
    write(surfaces, asked.points)
    held_out = errors(surfaces, Design(asked.held_out, seed=7))
    keep(
        "burst_surrogate",
        {
            "fitted_to": surfaces.fitted_to,
            "runs": len(WORN) * asked.points,
            "held_out_runs": len(WORN) * asked.held_out,
            "piston_share": surfaces.piston_share,
            "errors on held-out runs": held_out,
            "single changes [transient, surrogate]": table(surfaces),
        },
    )


if __name__ == "__main__":
    main()
