"""A simulation that the API was asked for: checked as a whole, bounded in size, run piece by piece into JSON."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.errors import Fault, Invalid
from service.studies.simulation.consumers import leaking
from twin.condition import CONDITION_INPUTS, HEALTH_INPUTS, Condition, Health
from twin.parameters import PumpType
from twin.pumps import PUMP_TYPES
from twin.pumps.circuit_sets import CIRCUIT_SETS, CircuitSet
from twin.pumps.fluids import FLUIDS, with_fluid
from twin.recording import TIME
from twin.simulation.mapped_slippers import metamodel_faults
from twin.simulation.run import SLIPPER_GAPS, simulate, stepping
from twin.simulation.scenario import GAP_INPUTS, Scenario, Schedule, Value

LONGEST_S = 10.0
MOST_SAMPLES = 30_000
"""Three seconds at 10 kHz, or ten at 3 kHz: about half a second of work."""
MOST_INSTANTS = 1000
DEFAULT_TEMPERATURE_DEGC = 50.0
LOAD = "load_conductance_lpm_per_sqrt_bar"
SCHEDULED: tuple[str, ...] = (*CONDITION_INPUTS, LOAD)
"""What a schedule may hold: where the pump runs, and its load as a flow or as an opening."""
HEALTHS: tuple[str, ...] = (*HEALTH_INPUTS, "spool_jamming_force_n", "swashplate_friction_nm", *GAP_INPUTS)
Number = float | Sequence[float]


@dataclass(frozen=True, slots=True)
class Asked:
    """What was asked for, before it is checked; ``health`` holds constants, or times with their values.

    ``fluid`` is a product; None for the pump type's own.
    """

    pump_type: str
    circuit: str
    duration_s: float
    sample_rate_hz: float
    schedule_time_s: Sequence[float] | None
    schedule: Mapping[str, Number]
    health: Mapping[str, float | tuple[Sequence[float], Sequence[float]]]
    fluid: str | None = None
    slipper_gaps: str = SLIPPER_GAPS[0]


@dataclass(frozen=True, slots=True)
class Checked:
    """A scenario that can run."""

    kind: PumpType
    circuit: CircuitSet
    fluid: str | None
    scenario: Scenario
    sample_rate_hz: float
    slipper_gaps: str


def checked(
    asked: Asked,
    types: Mapping[str, PumpType] = PUMP_TYPES,
    circuits: Mapping[str, CircuitSet] = CIRCUIT_SETS,
) -> Checked:
    """Scenario of a request; what the circuit's consumers let through adds to its system leakage.

    Raises
    ------
    Invalid
        naming every fault: unknown names, unequal lengths, values out of range, a run that is too long.
    """
    named = [("pump_type", asked.pump_type, types), ("circuit", asked.circuit, circuits)]
    named += [("fluid", asked.fluid, FLUIDS)] if asked.fluid is not None else []
    faults = [
        Fault(where, f"{value!r} is not one of {', '.join(sorted(known))}")
        for where, value, known in named
        if value not in known
    ]
    faults += _size_faults(asked)
    changes, wrong = _changes(asked)
    faults += wrong
    kind = types.get(asked.pump_type, PUMP_TYPES["h225"])
    if asked.slipper_gaps == SLIPPER_GAPS[1] and not faults:
        faults += [Fault("slipper_gaps", words) for words in metamodel_faults(with_fluid(kind, asked.fluid).pump)]
    condition = Condition(
        kind.nominal_speed_rpm, DEFAULT_TEMPERATURE_DEGC, reservoir_pressure_bar=kind.nominal_reservoir_pressure_bar
    )
    duration = asked.duration_s if 0.0 < asked.duration_s <= LONGEST_S else 1.0
    circuit = circuits.get(asked.circuit, CIRCUIT_SETS["shared_return"])
    scenario = leaking(Scenario(duration, condition, Health(), changes), circuit.leak_lpm)
    try:
        scenario.table(int(kind.pump.piston.n))
    except ValueError as problem:
        words = str(problem).removeprefix("the scenario cannot run: ").split("; ")
        faults += [_placed(asked, w) for w in words]
    if not faults and stepping(scenario, asked.sample_rate_hz, 1.0)[0] > duration:
        faults.append(Fault("sample_rate_hz", f"{asked.sample_rate_hz:g} Hz give no sample within {duration:g} s"))
    if faults:
        raise Invalid(f"the simulation has {len(faults)} fault(s)", faults)
    filled = circuit.around(with_fluid(kind, asked.fluid))
    return Checked(filled, circuit, asked.fluid, scenario, asked.sample_rate_hz, asked.slipper_gaps)


def simulated_json(asked: Checked) -> bytes:
    """Run it: a JSON document of its channels; to be called in a worker thread.

    Raises
    ------
    Invalid
        when there is no operating point to start from, or the run stops on its way, with what to do.
    """
    try:
        run = simulate(
            asked.kind.pump,
            asked.circuit.circuit,
            asked.scenario,
            sample_rate_hz=asked.sample_rate_hz,
            slipper_gaps=asked.slipper_gaps,
        )
    except ValueError as problem:
        raise Invalid(str(problem), [Fault("schedule", str(problem))]) from None
    if not run.status.ok:
        raise Invalid(run.status.advice, [Fault("schedule", run.status.advice)])
    about = {
        "pump_type": asked.kind.name,
        "circuit": asked.circuit.name,
        "fluid": asked.fluid,
        "duration_s": asked.scenario.duration_s,
        "sample_rate_hz": asked.sample_rate_hz,
        "pressure_reference": "gauge",
        **({"outside": list(run.status.outside)} if run.status.outside else {}),
    }
    # channel by channel, so that other threads get their turn in between
    channels = (f'"{name}":{_numbers(samples)}' for name, samples in run.recording.channels.items())
    return f'{json.dumps(about)[:-1]},"channels":{{{",".join(channels)}}}}}'.encode()


def _numbers(samples: NDArray[np.float64]) -> str:
    whole = np.isfinite(samples).all()
    values = samples.tolist() if whole else [v if math.isfinite(v) else None for v in samples.tolist()]
    return json.dumps(values, allow_nan=False, separators=(",", ":"))


def _size_faults(asked: Asked) -> list[Fault]:
    faults = []
    duration, rate = asked.duration_s, asked.sample_rate_hz
    if not 0.0 < duration <= LONGEST_S:
        words = f"{duration:g} s; allowed: above 0 to {LONGEST_S:g} s. Longer runs: casedrain simulate"
        faults.append(Fault("duration_s", words))
    if not 1.0 <= rate <= 100_000.0:
        faults.append(Fault("sample_rate_hz", f"{rate:g} Hz; allowed: 1 to 100000 Hz"))
    elif duration > 0.0 and duration * rate > MOST_SAMPLES * (1.0 + 1e-9):
        words = f"{duration * rate:.0f} samples; at most {MOST_SAMPLES} are simulated in one request"
        faults.append(Fault("duration_s", f"{words}: make it shorter or sample more slowly"))
    return faults


def _changes(asked: Asked) -> tuple[dict[str, Value], list[Fault]]:
    """Constants and schedules by their names, those that are well formed, and what is wrong with the others."""
    changes: dict[str, Value] = {}
    faults: list[Fault] = []
    time = asked.schedule_time_s
    if time is not None and len(time) > MOST_INSTANTS:
        faults.append(Fault(f"schedule.{TIME}", f"{len(time)} instants; at most {MOST_INSTANTS} are taken"))
    for name, value in asked.schedule.items():
        where = f"schedule.{name}"
        if name not in SCHEDULED:
            faults.append(Fault(where, f"is not known; known: {', '.join(SCHEDULED)}"))
        elif isinstance(value, int | float):
            changes[name] = float(value)
        elif time is None:
            faults.append(Fault(where, f"is a list without schedule.{TIME}"))
        elif len(value) != len(time):
            faults.append(Fault(where, f"has {len(value)} values for {len(time)} instants"))
        elif len(time) <= MOST_INSTANTS:
            changes[name] = Schedule(tuple(time), tuple(value))
    for name, given in asked.health.items():
        where = f"health.{name}"
        if name.partition("[")[0] not in HEALTHS:
            faults.append(Fault(where, f"is not known; known: {', '.join(HEALTHS)}"))
        elif not isinstance(given, tuple):
            changes[name] = float(given)
        elif len(given[0]) > MOST_INSTANTS:
            faults.append(Fault(where, f"{len(given[0])} instants; at most {MOST_INSTANTS} are taken"))
        else:
            changes[name] = Schedule(tuple(given[0]), tuple(given[1]))
    return changes, faults


def _placed(asked: Asked, words: str) -> Fault:
    """A fault that the scenario found, with its place in the request."""
    name = words.partition(":")[0].partition(" = ")[0]
    if name in asked.health:
        return Fault(f"health.{name}", words)
    return Fault(f"schedule.{name}" if name in asked.schedule else "schedule", words)
