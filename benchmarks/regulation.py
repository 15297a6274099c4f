"""What erosion and jamming of the compensator's valve change that a record shows, and what else changes it.

``python -m benchmarks.regulation`` runs the transient H225 pump with its own valve and with the thesis' closed-centre
valve: at zero flow under restless consumers (up to 0.3 L/min, anew every 10 ms) and through a step of 10 L/min. Two bursts
of 2 s at 10 kHz are read as the analysis reads them. Kept as ``benchmarks/results/regulation.json``. Minutes on two cores.
"""

import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from benchmarks import keep
from detectors.judgement.version import twin_version
from detectors.reduction.spectrum import spectrum
from twin.condition import Condition, Health
from twin.laws.metering_edge import MARE
from twin.parameters import Pump
from twin.pumps import circuit_parameters, pump_type
from twin.recording import Recording
from twin.simulation.run import simulate
from twin.simulation.scenario import Scenario, Schedule, Value
from twin.validation.erosion import closed_centre

KIND = pump_type("h225")
CIRCUIT = circuit_parameters("shared_return")
N = int(KIND.pump.piston.n)
LOAD = "load_conductance_lpm_per_sqrt_bar"
RATE_HZ = 10_000.0
BURSTS_S = (2.0, 4.0, 6.0)
ROOT_BAR = math.sqrt(174.0)
STEP_LPM, OPENS_S, SHUTS_S, END_S = 10.0, 1.0, 3.0, 5.0
SIXTY = Condition(4600.0, 60.0, 1.0)
BY_PASS = {"system_leakage_lpm": 0.5}


@dataclass(frozen=True)
class Case:
    """One line of the table."""

    name: str
    health: dict[str, float] = field(default_factory=dict)
    friction_n: float = 0.0
    condition: Condition = SIXTY
    restless_lpm: float = 0.3


CASES: tuple[Case, ...] = (
    Case("healthy"),
    Case("edge radius +2 um (x3 of 1 um)", {"edge_rounding_um": 2.0}),
    Case("edge radius +9 um (x10 of 1 um)", {"edge_rounding_um": 9.0}),
    Case("edge radius +45 um (x10 of 5 um)", {"edge_rounding_um": 45.0}),
    *(Case(f"spool friction {f:g} N", friction_n=f) for f in (0.5, 2.0, 5.0, 20.0, 500.0)),
    Case("30 degC", condition=Condition(4600.0, 30.0, 1.0)),
    Case("90 degC", condition=Condition(4600.0, 90.0, 1.0)),
    Case("speed -4 %", condition=Condition(4416.0, 60.0, 1.0)),
    Case("speed +4 %", condition=Condition(4784.0, 60.0, 1.0)),
    Case("consumers a third as restless", restless_lpm=0.1),
    Case("consumers three times as restless", restless_lpm=1.0),
    Case("system leakage +3 L/min", {"system_leakage_lpm": 3.5}),
    Case("slipper leakage x2", {"slipper_leakage_scale": 2.0}),
    Case("drain resistance +30 %", {"drain_resistance_scale": 1.3}),
    Case("setting -3 bar", {"pressure_setting_change_bar": -3.0}),
    Case("bleed +0.2 L/min", {"control_bleed_lpm": 0.2}),
    Case("droop x0.3", {"droop_scale": 0.3}),
    Case("droop x2", {"droop_scale": 2.0}),
)


def restless(amount_lpm: float, end_s: float) -> Schedule:
    """Opening of consumers that ask for another flow every 10 ms."""
    at = np.arange(0.1, end_s, 0.01)
    opening = amount_lpm / ROOT_BAR * np.random.default_rng(3).uniform(0.0, 1.0, len(at))
    opening[0] = 0.0
    return Schedule(tuple(at.tolist()), tuple(opening.tolist()))


def run_of(pump: Pump, case: Case, load: Schedule, end_s: float) -> Recording:
    """Run of one case with a load."""
    changes: dict[str, Value] = {LOAD: load, "spool_jamming_force_n": case.friction_n}
    health = Health(**{**BY_PASS, **case.health})
    run = simulate(pump, CIRCUIT, Scenario(end_s, case.condition, health, changes), sample_rate_hz=RATE_HZ)
    if not run.status.ok:
        raise ValueError(f"{case.name}: {run.status.advice}")
    return run.recording


def at_zero_flow(pump: Pump, case: Case) -> dict[str, float]:
    """Means, order n, ripple and its frequency under restless consumers."""
    recording = run_of(pump, case, restless(case.restless_lpm, BURSTS_S[-1]), BURSTS_S[-1])
    late = recording.between(BURSTS_S[0], BURSTS_S[-1])
    found = [spectrum(recording, a, b, KIND) for a, b in pairwise(BURSTS_S)]
    channels = [s.channels["discharge_pressure_bar"] for s in found if s is not None]
    frequencies = [c.regulation_hz for c in channels if c.regulation_hz is not None]
    return {
        "discharge_bar": float(late["discharge_pressure_bar"].mean()),
        "case_bar": float(late["case_pressure_bar"].mean()),
        "order_n_mbar": 1e3 * float(np.mean([c.line(N).amplitude_bar for c in channels])),
        "ripple_bar": float(np.mean([c.ripple_bar for c in channels])),
        "frequency_hz": float(np.mean(frequencies)) if frequencies else math.nan,
    }


def through_a_step(pump: Pump, case: Case) -> dict[str, float]:
    """Droop, undershoot and overshoot over the new steady pressure, and time until it stays within a tenth of it."""
    opening = STEP_LPM / ROOT_BAR
    load = Schedule((OPENS_S, OPENS_S + 0.02, SHUTS_S, SHUTS_S + 0.02), (0.0, opening, opening, 0.0))
    recording = run_of(pump, case, load, END_S)
    t, p = recording.time_s, recording["discharge_pressure_bar"]
    width = round(60.0 / case.condition.speed_rpm * RATE_HZ)
    smooth = np.convolve(p, np.full(width, 1.0 / width), "same")
    before, during = (t > 0.5) & (t < OPENS_S), (t > SHUTS_S - 0.5) & (t < SHUTS_S)
    opened, shut = (t > OPENS_S) & (t < SHUTS_S), (t > SHUTS_S) & (t < END_S - 0.05)
    loaded, free = float(p[during].mean()), float(p[(t > END_S - 0.55) & (t < END_S - 0.05)].mean())
    return {
        "droop_bar_per_lpm": (float(p[before].mean()) - loaded) / STEP_LPM,
        "undershoot_bar": float(smooth[opened].min()) - loaded,
        "overshoot_bar": float(smooth[shut].max()) - free,
        "recovery_s": recovery(t[shut] - SHUTS_S, smooth[shut] - free),
    }


def recovery(t: NDArray[np.float64], off: NDArray[np.float64]) -> float:
    """Last time outside a tenth of the largest deviation [s]."""
    outside = np.flatnonzero(np.abs(off) > 0.1 * np.abs(off).max())
    return float(t[outside[-1]])


def main() -> None:
    """Run every case with both valves and keep the table."""
    valves = {"own valve": KIND.pump, "closed-centre valve": closed_centre(KIND.pump, CIRCUIT, MARE)}
    jobs = [(valve, case) for valve in valves for case in CASES]
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        still = list(pool.map(lambda job: at_zero_flow(valves[job[0]], job[1]), jobs))
        steps = list(pool.map(lambda job: through_a_step(valves[job[0]], job[1]), jobs))
    table = [
        {"valve": valve, "change": case.name, **{k: round(v, 4) for k, v in {**a, **b}.items()}}
        for (valve, case), a, b in zip(jobs, still, steps, strict=True)
    ]
    keep("regulation", {"twin": twin_version(KIND), "zero flow and a step of 10 L/min": table})


if __name__ == "__main__":
    main()
