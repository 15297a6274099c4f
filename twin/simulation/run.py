"""Run a scenario: typed shell round the compiled loop. One run, a stream of pieces, or a batch on all cores."""

import math
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypedDict, Unpack

import numpy as np
from numpy.typing import NDArray

from twin import columns as at
from twin.condition import Condition, Health
from twin.operating_point.validity import GAP_MODEL
from twin.parameters import Circuit, Pump
from twin.parts.geometry import geometry_faults
from twin.recording import Recording
from twin.simulation.averages import ANGLE, BEGUN, ENDED, N_REVOLUTION, STOPPED_AT, TAKEN, Account
from twin.simulation.layout import (
    ALPHA,
    FIRST_MEAN,
    N_MEAN,
    N_SHARED,
    N_STATE_MEANS,
    N_VOLUMES,
    P_C,
    P_D,
    P_I,
    THETA,
    state_name,
)
from twin.simulation.loop import (
    CAVITATED,
    DIVERGED,
    N_SAMPLE,
    RUNNING,
    Inputs,
    Pace,
    run_loop,
    workspace,
)
from twin.simulation.mapped_slippers import FIRST_OUTSIDE, NO_GAPS, OUTSIDE, by_metamodel, metamodel_faults
from twin.simulation.output import MEANS, cycle_means, recording_of
from twin.simulation.scenario import STEP_RANGE_S, Scenario, Value
from twin.simulation.start import starting_state
from twin.units import RAD_PER_S_PER_RPM

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Progress = Callable[[float], None]

DEFAULT_STEP_S = 58.5e-6
FULL_STEP_RPM = 4600.0
VARIABLE_GAP_STEP_S = 10.0e-6
SLIPPER_GAPS = ("resolved", "metamodel")
"""How the gap of a slipper that follows from the forces is found."""
_PIECE_S = 0.25
"""Longest piece between two calls of the compiled loop [s]: progress, and memory of a stream."""

ADVICE: dict[int, str] = {
    RUNNING: "ran to its end",
    DIVERGED: "the solution left the numbers: take a shorter step and look at what happens there",
    CAVITATED: "a volume ran dry: its absolute pressure would lie below zero, the asked flow is more than the pump "
    "delivers; give the load as an opening instead",
}


class Options(TypedDict, total=False):
    """Options of a run, as ``pieces`` explains them."""

    sample_rate_hz: float | None
    step_s: float | None
    extrapolate: bool
    keep_states: bool
    initial_state: Vector | None
    piece_s: float
    slipper_gaps: str


@dataclass(frozen=True, slots=True)
class Status:
    """How a run ended.

    Attributes
    ----------
    code
        0 when it went through, else a code of ``ADVICE``.
    time_s
        Where it ended [s].
    worst_state
        The state farthest from its place when it failed, in words; empty when it went through.
    n_steps
        Steps taken.
    outside_s, outside_from_s
        How long the metamodel of the slippers was asked beyond its runs, and from when first [s]; 0 and infinity where it
        never was, or was not asked.
    """

    code: int
    time_s: float
    worst_state: str
    n_steps: int
    outside_s: float = 0.0
    outside_from_s: float = math.inf

    @property
    def ok(self) -> bool:
        """True when the run went through."""
        return self.code == RUNNING

    @property
    def outside(self) -> tuple[str, ...]:
        """What of the run lies outside what was validated, by the operating point's name; empty where nothing is known."""
        return (GAP_MODEL,) if self.outside_s > 0.0 else ()

    @property
    def advice(self) -> str:
        """What happened and what to do, in a sentence."""
        if self.ok and self.outside_s > 0.0:
            return (
                f"{ADVICE[RUNNING]}, {self.outside_s:.3g} s of it, from {self.outside_from_s:.3g} s on, outside "
                f"({GAP_MODEL}): the metamodel of the slippers was asked beyond its runs, resolve their gaps instead"
            )
        if self.ok:
            return ADVICE[RUNNING]
        return f"stopped at {self.time_s:.6g} s ({self.worst_state}): {ADVICE[self.code]}"


@dataclass(frozen=True, slots=True)
class Run:
    """What a simulation gives: everything up to where it ended.

    Attributes
    ----------
    recording
        Channels over time (``twin.simulation.output``).
    means
        Means over each whole revolution: name of ``MEANS`` to shape (n_revolutions,), and ``end_s``.
    states
        All states at every sample where they were asked for, shape (m, n_states), SI, absolute; else (0, n_states).
    """

    recording: Recording
    means: dict[str, Vector]
    status: Status
    states: Matrix

    def mean(self, name: str, revolutions: int = 1) -> float:
        """Mean over the last whole revolutions."""
        return float(self.means[name][-revolutions:].mean())


def default_step(pump: Pump, scenario: Scenario) -> float:
    """Longest step that keeps means within 0.1 % and order n within 2 % [s], measured against CVODE.

    58.5 us, or 10 us with variable gaps, up to 4600 rpm; above it falls with the fourth power of speed: a step damps the
    plate's vibration, which order n of case pressure, a few millibars, shows first.
    """
    step = VARIABLE_GAP_STEP_S if pump.slipper.variable > 0.5 else DEFAULT_STEP_S
    return step * min(1.0, FULL_STEP_RPM / _fastest(scenario)) ** 4


def _fastest(scenario: Scenario) -> float:
    speed = scenario.changes.get("speed_rpm", scenario.condition.speed_rpm)
    return float(speed) if isinstance(speed, int | float) else max(speed.values)


def stepping(scenario: Scenario, sample_rate_hz: float | None, step_s: float, n: int = 1) -> tuple[float, int]:
    """Step and number of steps per sample.

    A whole number per sample, or per revolution where every step is kept. There it shares no divisor with the n pistons:
    each passes its dead centres elsewhere in a step, so that the steps' errors average out instead of adding up.
    """
    if sample_rate_hz is None:
        period = 2.0 * math.pi / (_fastest(scenario) * RAD_PER_S_PER_RPM)
        per_revolution = math.ceil(period / step_s - 1e-9)
        while math.gcd(per_revolution, n) > 1:
            per_revolution += 1
        return period / per_revolution, 1
    interval = 1.0 / sample_rate_hz
    substeps = max(1, math.ceil(interval / step_s - 1e-9))
    return interval / substeps, substeps


def pieces(
    pump: Pump,
    circuit: Circuit,
    scenario: Scenario,
    *,
    sample_rate_hz: float | None = None,
    step_s: float | None = None,
    extrapolate: bool = True,
    keep_states: bool = False,
    initial_state: Vector | None = None,
    piece_s: float = _PIECE_S,
    slipper_gaps: str = SLIPPER_GAPS[0],
) -> Iterator[Run]:
    """Simulate a scenario piece by piece: every piece is a ``Run`` of its own, so that memory stays bounded.

    Parameters
    ----------
    sample_rate_hz
        Rate of the output [Hz]; None keeps every step, a whole number of them per revolution.
    step_s
        Longest step [s], within ``STEP_RANGE_S``; None takes ``default_step``.
    extrapolate
        Second order by extrapolation; False gives the plain first-order step.
    keep_states
        Keep all states at every sample.
    initial_state
        Start from here instead of from the operating point, shape (n_states,).
    piece_s
        Length of a piece [s].
    slipper_gaps
        Of ``SLIPPER_GAPS``, for a set with variable gaps: ``resolved`` by pockets, gaps and microseconds, or by their
        ``metamodel`` (``twin.simulation.mapped_slippers``), which answers with means of a revolution; where it is asked
        beyond its runs, the status says so.

    Raises
    ------
    ValueError
        naming every fault of the scenario, the step or the rate; or when there is no operating point to start from.
    """
    faults = geometry_faults(pump)
    n = int(pump.piston.n) if not faults else 9
    if slipper_gaps not in SLIPPER_GAPS:
        faults.append(f"slipper_gaps = {slipper_gaps!r} (known: {', '.join(SLIPPER_GAPS)})")
    mapped = slipper_gaps == SLIPPER_GAPS[1]
    if mapped and not faults:
        faults += metamodel_faults(pump)
    low, high = STEP_RANGE_S
    if step_s is not None and not (math.isfinite(step_s) and low <= step_s <= high):
        faults.append(f"step_s = {step_s:g} (allowed: {low:g} to {high:g} s)")
    if sample_rate_hz is not None and not (math.isfinite(sample_rate_hz) and 0.1 <= sample_rate_hz <= 1.0e6):
        faults.append(f"sample_rate_hz = {sample_rate_hz:g} (allowed: 0.1 to 1e6 Hz)")
    if not (math.isfinite(piece_s) and piece_s > 0.0):
        faults.append(f"piece_s = {piece_s:g} (must be above 0 s)")
    try:
        times, table = scenario.table(n)
    except ValueError as problem:
        faults.append(str(problem))
    if faults:
        raise ValueError("; ".join(faults))
    start, T_start = starting_state(pump, circuit, table[0])
    gaps = NO_GAPS
    if mapped:
        pump, gaps = by_metamodel(pump)
        start = start[: N_SHARED + n]
    if initial_state is not None:
        if initial_state.shape != start.shape:
            raise ValueError(f"initial_state must have shape {start.shape}; got {initial_state.shape}")
        start = initial_state.copy()
    y = start
    dt, substeps = stepping(scenario, sample_rate_hz, step_s or default_step(pump, scenario), n)
    interval = dt * substeps
    total = max(1, round(scenario.duration_s / interval))
    per_piece = max(1, round(piece_s / interval))
    ws = workspace(n, len(y), mapped)
    revolution = np.zeros(N_REVOLUTION)
    revolution[ANGLE] = y[THETA]
    revolution[BEGUN : BEGUN + N_STATE_MEANS] = [*y[:N_VOLUMES], y[ALPHA]]
    counts = np.zeros(2, dtype=np.int64)
    fastest = table[:, at.SPEED].max() * RAD_PER_S_PER_RPM * 1.2
    for first in range(0, total, per_piece):
        m = min(per_piece, total - first)
        samples = np.empty((m, N_SAMPLE))
        keep = np.empty((m if keep_states else 0, len(y)))
        means = np.empty((math.ceil(m * interval * fastest / (2 * math.pi)) + 2, FIRST_MEAN + N_MEAN))
        counts[ENDED] = 0
        samples[:, 0] = np.nan
        pace = Pace(first * interval, dt, m, substeps, extrapolate, T_start)
        account = Account(keep, samples, revolution, means, counts)
        code = run_loop(pump, circuit, gaps, Inputs(times, table), y, pace, account, ws)
        done = m if code == RUNNING else int(np.flatnonzero(np.isnan(samples[:, 0]))[0])
        instants = interval * np.arange(first + 1, first + done + 1, dtype=np.float64)
        ended = instants[-1] if code == RUNNING else float(revolution[STOPPED_AT])
        worst = "" if code == RUNNING else _worst(y, n)
        yield Run(
            recording_of(pump, scenario.title, times, table, instants, samples[:done]),
            cycle_means(times, table, means[: min(int(counts[ENDED]), len(means))]),
            Status(code, float(ended), worst, int(counts[TAKEN]), *map(float, ws.gathered[[OUTSIDE, FIRST_OUTSIDE]])),
            keep[:done],
        )
        if code != RUNNING:
            return


def simulate(
    pump: Pump,
    circuit: Circuit,
    scenario: Scenario,
    *,
    progress: Progress | None = None,
    **options: Unpack[Options],
) -> Run:
    """Simulate a scenario in memory; ``options`` as of ``pieces``; ``progress`` is told the share that is done.

    Raises
    ------
    ValueError
        as of ``pieces``. A run that fails on its way raises nothing: see its ``status``.
    """
    parts: list[Run] = []
    for part in pieces(pump, circuit, scenario, **options):
        parts.append(part)
        if progress is not None:
            progress(min(part.status.time_s / scenario.duration_s, 1.0))
    if len(parts) == 1:
        return parts[0]
    names = parts[0].recording.channels
    channels = {name: np.concatenate([p.recording[name] for p in parts]) for name in names}
    means = {name: np.concatenate([p.means[name] for p in parts]) for name in parts[0].means}
    states = np.concatenate([p.states for p in parts])
    return Run(Recording(channels, parts[0].recording.attributes), means, parts[-1].status, states)


def simulate_batch(
    pump: Pump,
    circuit: Circuit,
    scenarios: Sequence[Scenario],
    *,
    n_workers: int | None = None,
    **options: Unpack[Options],
) -> list[Run | ValueError]:
    """Simulate many scenarios on all cores; one that cannot run comes back as its error and costs no neighbour."""

    def one(scenario: Scenario) -> Run | ValueError:
        try:
            return simulate(pump, circuit, scenario, **options)
        except ValueError as problem:
            return problem

    with ThreadPoolExecutor(n_workers or os.cpu_count() or 1) as pool:
        return list(pool.map(one, scenarios))


def steady_run(
    pump: Pump,
    condition: Condition,
    circuit: Circuit,
    health: Health = Health(),  # noqa: B008 - immutable
    *,
    changes: dict[str, Value] | None = None,
    settle_revolutions: int = 12,
    mean_revolutions: int = 4,
    **options: Unpack[Options],
) -> Run:
    """Simulate at constant condition from the operating point for whole revolutions; ``Run.mean`` averages."""
    period = 60.0 / condition.speed_rpm
    duration = period * (settle_revolutions + mean_revolutions)
    return simulate(pump, circuit, Scenario(duration, condition, health, changes or {}), **options)


def _worst(y: Vector, n: int) -> str:
    """Name of the state that has run farthest off."""
    bad = np.flatnonzero(~np.isfinite(y))
    if len(bad):
        return state_name(int(bad[0]), n)
    volumes = (P_D, P_C, P_I)
    if min(y[j] for j in volumes) < 0.0:
        return state_name(min(volumes, key=lambda j: float(y[j])), n)
    chambers = y[N_SHARED : N_SHARED + n]
    return state_name(N_SHARED + int(np.argmax(np.abs(chambers))), n)


__all__ = ["ADVICE", "MEANS", "Run", "Status", "pieces", "simulate", "simulate_batch", "steady_run"]
