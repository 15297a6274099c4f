"""What a simulation is asked: conditions and health, each a constant or a function of time or of flight hours."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from twin.condition import RANGES, RESERVOIR_RANGE_BAR, Condition, Health
from twin.simulation.scene import N_SCENE, SCENE_INPUTS, TRANSIENT_INPUTS

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

GAP_INPUTS: tuple[str, ...] = ("piston_clearance_scale", "slipper_gap_scale", "port_plate_gap_scale")
"""Gap heights as factors. The first two are for all pistons, or for one: ``piston_clearance_scale[3]``, from 1."""
SCENARIO_INPUTS: tuple[str, ...] = SCENE_INPUTS + GAP_INPUTS
_SECONDS_PER_HOUR = 3600.0

TRANSIENT_RANGES: dict[str, tuple[float, float]] = {
    **RANGES,
    "load_conductance_lpm_per_sqrt_bar": (0.0, 50.0),
    "spool_jamming_force_n": (0.0, 1.0e5),
    "swashplate_friction_nm": (0.0, 1.0e3),
    "piston_clearance_scale": (0.0, 20.0),
    "slipper_gap_scale": (0.0, 20.0),
    "port_plate_gap_scale": (0.0, 20.0),
}
QUASI_STEADY_RANGES: dict[str, tuple[float, float]] = {**TRANSIENT_RANGES, "speed_rpm": (0.0, RANGES["speed_rpm"][1])}
LONGEST_RUN_S, LONGEST_FLIGHT_S = 3600.0, 12.0 * 3600.0
"""Longest run of the transient, and of a sequence of operating points [s]."""
_UNITS = {"rpm": "rpm", "degc": "degC", "bar": "bar", "lpm": "L/min", "um": "um", "n": "N", "nm": "N m"}
STEP_RANGE_S = (0.1e-6, 100.0e-6)
"""Steps for which the error was measured."""


@dataclass(frozen=True, slots=True)
class Schedule:
    """A value over time, linear between its points and constant outside; a step is two points at one instant.

    Attributes
    ----------
    at, values
        Instants, shape (m,), not falling, and values, shape (m,).
    flight_hours
        True where ``at`` counts flight hours of the pump instead of seconds of the run.
    """

    at: Sequence[float]
    values: Sequence[float]
    flight_hours: bool = False

    @classmethod
    def of(cls, function: Callable[[float], float], start: float, end: float, n: int = 201) -> "Schedule":
        """Sample a function of time at ``n`` instants."""
        at = np.linspace(start, end, n)
        return cls(tuple(at.tolist()), tuple(float(function(float(t))) for t in at))

    @classmethod
    def step(cls, at: float, before: float, after: float) -> "Schedule":
        """One value before an instant, another from it on."""
        return cls((at, at), (before, after))

    def faults(self) -> list[str]:
        """What is wrong with it, in words."""
        if len(self.at) != len(self.values) or len(self.at) == 0:
            return [f"needs as many values as instants, at least one; got {len(self.values)} for {len(self.at)}"]
        found = []
        if not all(math.isfinite(t) for t in self.at):
            found.append("an instant is not a finite number")
        elif any(b < a for a, b in zip(self.at, self.at[1:], strict=False)):
            found.append("instants must not fall")
        if not all(math.isfinite(v) for v in self.values):
            found.append("a value is not a finite number")
        return found

    def seconds(self, start_flight_hours: float) -> Vector:
        """Instants in seconds of a run that starts at so many flight hours, shape (m,)."""
        at = np.asarray(self.at, dtype=np.float64)
        return (at - start_flight_hours) * _SECONDS_PER_HOUR if self.flight_hours else at


Value = float | Schedule


@dataclass(frozen=True, slots=True)
class Scenario:
    """One run: how long, from which condition and health, and what changes on the way.

    Attributes
    ----------
    duration_s
        Length of the run [s].
    condition, health
        What holds where ``changes`` says nothing else.
    changes
        Name of ``SCENARIO_INPUTS`` to a constant or a ``Schedule``.
    start_flight_hours
        Flight hours of the pump at the start, for schedules over flight hours.
    quasi_steady
        True for a sequence of operating points (``twin.simulation.flight``): longer, and from standstill.
    """

    duration_s: float
    condition: Condition
    health: Health = field(default_factory=Health)
    changes: Mapping[str, Value] = field(default_factory=dict)
    start_flight_hours: float = 0.0
    title: str = ""
    quasi_steady: bool = False

    def table(self, n: int) -> tuple[Vector, Matrix]:
        """Schedule for a pump of n pistons: instants (m,), inputs (m, N_SCENE + 2 n).

        Raises
        ------
        ValueError
            naming every fault: unknown names, values that are not finite or out of range, with their units.
        """
        faults = self._faults(n)
        if faults:
            raise ValueError("the scenario cannot run: " + "; ".join(faults))
        schedules = {
            name: v if isinstance(v, Schedule) else Schedule((0.0,), (float(v),)) for name, v in self.changes.items()
        }
        instants: list[float] = [0.0]
        for schedule in schedules.values():
            at = schedule.seconds(self.start_flight_hours)
            inside = at[(at > 0.0) & (at < self.duration_s)]
            instants += inside.tolist()
        grid = np.unique(np.array([*instants, self.duration_s]))
        # every instant twice, before and after: a step keeps its edge, a ramp gets two equal rows
        times = np.repeat(grid, 2)[1:-1] if len(grid) > 1 else grid
        before = np.zeros(len(times), dtype=bool)
        before[1::2] = True
        base = dict(zip(SCENE_INPUTS, (*self.condition, *self.health, *([0.0] * len(TRANSIENT_INPUTS))), strict=True))
        table = np.ones((len(times), N_SCENE + 2 * n))
        for j, name in enumerate(SCENE_INPUTS):
            table[:, j] = base[name]
        for name, schedule in schedules.items():
            values = _values_at(schedule, self.start_flight_hours, times, before)
            base_name, index = _split(name)
            if base_name == "port_plate_gap_scale":
                table[:, SCENE_INPUTS.index("port_plate_leakage_scale")] *= values**3
            elif base_name in GAP_INPUTS:
                first = N_SCENE + n * GAP_INPUTS.index(base_name)
                columns = slice(first, first + n) if index is None else slice(first + index - 1, first + index)
                table[:, columns] *= values[:, None]
            else:
                table[:, SCENE_INPUTS.index(base_name)] = values
        return times, table

    def _faults(self, n: int) -> list[str]:
        found = []
        longest = LONGEST_FLIGHT_S if self.quasi_steady else LONGEST_RUN_S
        ranges = QUASI_STEADY_RANGES if self.quasi_steady else TRANSIENT_RANGES
        if not (math.isfinite(self.duration_s) and 0.0 < self.duration_s <= longest):
            found.append(f"duration_s = {self.duration_s:g} (allowed: above 0 to {longest:g} s)")
        own = {**self.condition._asdict(), **self.health._asdict()}
        for name, value in own.items():
            if name not in self.changes:
                found += _value_faults(name, name, [value], ranges)
        for name, change in self.changes.items():
            base_name, index = _split(name)
            if base_name not in SCENARIO_INPUTS or (index is not None and base_name not in GAP_INPUTS[:2]):
                found.append(f"unknown input {name!r} (known: {', '.join(SCENARIO_INPUTS)})")
                continue
            if index is not None and not 1 <= index <= n:
                found.append(f"{name}: this pump has pistons 1 to {n}")
            if isinstance(change, Schedule):
                wrong = change.faults()
                found += [f"{name}: {fault}" for fault in wrong]
                if not wrong:
                    found += _value_faults(name, base_name, change.values, ranges)
            else:
                found += _value_faults(name, base_name, [change], ranges)
        load = self.changes.get("load_conductance_lpm_per_sqrt_bar", 0.0)
        flow = self.changes.get("discharge_flow_lpm", self.condition.discharge_flow_lpm)
        if _largest(load) > 0.0 and _largest(flow) > 0.0:
            found.append("the load is given as a flow and as an opening: give discharge_flow_lpm or the conductance")
        return found


def _largest(value: Value) -> float:
    return max(value.values, default=0.0) if isinstance(value, Schedule) else float(value)


def _split(name: str) -> tuple[str, int | None]:
    """``"slipper_gap_scale[2]"`` to its name and number; a broken number comes back as an unknown name."""
    base, bracket, rest = name.partition("[")
    if not bracket:
        return name, None
    number = rest.removesuffix("]")
    return (base, int(number)) if number.isdigit() else (name, None)


def _value_faults(
    name: str, base_name: str, values: Sequence[float], ranges: Mapping[str, tuple[float, float]]
) -> list[str]:
    if not all(math.isfinite(v) for v in values):
        return [f"{name}: a value is not a finite number"]
    if base_name == "reservoir_pressure_bar":
        # gauge: the absolute range less a standard atmosphere's worth on both sides
        low, high = -1.0, RESERVOIR_RANGE_BAR[1]
    else:
        low, high = ranges[base_name]
    wrong = [v for v in values if not low <= v <= high]
    return [f"{name} = {wrong[0]:g} (allowed: {low:g} to {high:g}{_unit(base_name)})"] if wrong else []


def _unit(name: str) -> str:
    """Unit that a name ends with, after a space; empty for a factor."""
    if name.endswith("_lpm_per_sqrt_bar"):
        return " L/min/sqrt(bar)"
    unit = _UNITS.get(name.rpartition("_")[2])
    return f" {unit}" if unit else ""


def _values_at(schedule: Schedule, start_flight_hours: float, times: Vector, before: NDArray[np.bool_]) -> Vector:
    """Values at instants; at a step the earlier value where ``before``, the later one elsewhere."""
    at, values = schedule.seconds(start_flight_hours), np.asarray(schedule.values, dtype=np.float64)
    left = np.interp(times, at, values)
    for i, t in enumerate(times):
        same = np.flatnonzero(at == t)
        if len(same) > 1:
            left[i] = values[same[0] if before[i] else same[-1]]
    return left
