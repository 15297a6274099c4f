"""The public hydraulic rig through the judge: a pump type without a twin, its channels declared, its curve measured.

``python -m benchmarks.rig_judge PATH`` writes ``benchmarks/results/rig_judge.json`` (derived statistics only). PATH is the
archive that ``benchmarks.real_rig`` describes. Every cycle of 60 s is one record: discharge pressure (PS1) and fluid
temperature (TS1) at 1 Hz, and whether the rig's program moves its load valve. There is no case pressure, no shaft speed
and no reservoir pressure: the type says so.

Every judged block is the end of a pump's history: cycles of a healthy pump at every cooler's condition first, then its own.
The healthy curve is measured on blocks of other folds with a healthy pump, whatever their circuit's state. Labels choose those blocks and
count the verdicts, nothing else.
"""

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import keep
from benchmarks.real_rig import (
    COOLER,
    FAULTLESS,
    GRADES,
    N_FOLDS,
    NAMES,
    PLATEAU,
    PUMP,
    REPEATABILITY_BAR,
    UNSTABLE,
)
from detectors.evaluation.scores import proportion
from detectors.expectation.type_correction import HealthyCurve, HealthyPoint
from detectors.judgement.assessment import assess
from detectors.reduction.recording import reduce_recording
from detectors.words.observation import History, Observation, Reduction
from detectors.words.states import State
from detectors.words.thresholds import effective
from detectors.words.verdict import Verdict
from twin.parameters import PumpType
from twin.pumps import circuit_parameters
from twin.pumps.written import pump_type_from
from twin.recording import Recording

Array = NDArray[np.float64]

THRESHOLDS = {"window_minimum_duration_s": 5.0}
"""The circuit is closed for six seconds of every cycle."""
START = datetime(2015, 1, 1, tzinfo=UTC)
_MODEST = {"value": 0.005, "unit": "bar", "source": "open tank of the rig"}
DOCUMENT: Mapping[str, Any] = {
    "id": "hydraulic-rig",
    "title": "Hydraulic test rig (Helwig et al. 2015): main pump, regulated pressure and oil temperature",
    "base": "h225",
    "own_twin": False,
    "lacks": ["case_pressure_bar", "shaft_speed_rpm"],
    "nominal_speed_rpm": 1450.0,
    "sensors": {
        "discharge_pressure_bar": {
            "full_scale_bar": 200.0,
            "accuracy_percent_full_scale": 0.5,
            "repeatability_percent_full_scale": 100.0 * REPEATABILITY_BAR / 200.0,
        }
    },
    "changes": {
        "limits.zero_flow_pressure_low_bar": {"value": 188.0, "unit": "bar", "source": "closed circuit of the rig"},
        "limits.zero_flow_pressure_high_bar": {"value": 193.0, "unit": "bar", "source": "closed circuit of the rig"},
        "population.reservoir_pressure_bar": _MODEST,
    },
}
"""The pump type as ``POST /pump-types`` takes it."""


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Neighbouring cycles of one condition: labels, and pressure and temperature of each, shape (n, 60)."""

    profile: tuple[int, ...]
    pressure: Array
    temperature: Array


@cache
def rig_type() -> PumpType:
    """The rig's pump type."""
    return pump_type_from(DOCUMENT)


def cycles(archive: Mapping[str, NDArray[Any]]) -> list[Block]:
    """Blocks of stable cycles in time order."""
    profile, cycle = archive["profile"], archive["cycle"]
    edges = np.flatnonzero((np.diff(profile, axis=0) != 0).any(axis=1) | (np.diff(cycle) != 1)) + 1
    return [
        Block(tuple(profile[s[0]].tolist()), archive["PS1"][s].astype(float), archive["TS1"][s].astype(float))
        for s in np.split(np.arange(len(profile)), edges)
        if len(s) and profile[s[0], UNSTABLE] == 0
    ]


def channels(pressure: Array, temperature: Array) -> dict[str, Array]:
    """One cycle as the channels of a record: the load valve is left alone while the circuit is closed."""
    time = np.arange(float(len(pressure)))
    moved = np.ones(len(pressure))
    moved[PLATEAU] = 0.0
    return {
        "time_s": time,
        "discharge_pressure_bar": pressure,
        "fluid_temperature_degc": temperature,
        "flight_control_activity": moved,
    }


def curve_points(training: Sequence[Block]) -> list[HealthyPoint]:
    """One point per block with a healthy pump: medians over its cycles, by the windows that the judge itself takes."""
    points = []
    for block in training:
        windows = [reduction.zero_flow for reduction in reductions(block)]
        means = [(w.means, w.warming_k_per_min or 0.0) for w in windows if w is not None]
        if block.profile[PUMP] == 0 and means:
            discharge = float(np.median([m["discharge_pressure_bar"].mean for m, _ in means]))
            temperature = float(np.median([m["fluid_temperature_degc"].mean for m, _ in means]))
            rate = float(np.median([r for _, r in means]))
            points.append(HealthyPoint(discharge, float("nan"), temperature, float("nan"), rate))
    return points


@cache
def reductions(block: Block) -> tuple[Reduction, ...]:
    """Every cycle of a block, reduced as the service reduces it."""
    kind, thresholds = rig_type(), effective(THRESHOLDS)
    return tuple(
        reduce_recording(Recording(channels(p.copy(), t.copy())), kind, thresholds)
        for p, t in zip(block.pressure, block.temperature, strict=True)
    )


def histories(blocks: Sequence[Block]) -> Iterator[tuple[Block, list[Block], list[Block]]]:
    """Every block with its training blocks, and what the pump has flown before: a healthy block at either cooler's condition."""
    for i, block in enumerate(blocks):
        others = [j for j, b in enumerate(blocks) if j != i and b.profile[PUMP] == 0]
        others.sort(key=lambda j: (j % N_FOLDS != i % N_FOLDS, abs(j - i)))
        levels = sorted({b.profile[COOLER] for b in blocks}, key=lambda level: level == block.profile[COOLER])
        before = [next(j for j in others if blocks[j].profile[COOLER] == level) for level in levels]
        training = [b for j, b in enumerate(blocks) if j % N_FOLDS != i % N_FOLDS and j not in before]
        yield block, training, [blocks[j] for j in before]


def verdicts(block: Block, training: Sequence[Block], before: Sequence[Block]) -> list[Verdict]:
    """Verdicts after each cycle of the healthy blocks and then of the judged one."""
    observations = [
        Observation(f"{i:03d}", START + timedelta(minutes=i), "rig", "MP1", f"cycle-{i:03d}", reduction)
        for i, reduction in enumerate(r for b in (*before, block) for r in reductions(b))
    ]
    found = assess(
        History(tuple(observations)),
        rig_type(),
        circuit_parameters("separate_drain"),
        effective(THRESHOLDS, rig_type()),
        HealthyCurve(tuple(curve_points(training))),
    )
    return [a.verdict for a in found]


def study(archive: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Verdicts at the end of every block, counted by the state that the rig was in."""
    rows: dict[str, list[Verdict]] = {}
    for block, training, before in histories(cycles(archive)):
        said = verdicts(block, training, before)
        rows.setdefault(GRADES[block.profile[PUMP]], []).append(said[-1])
        if block.profile[PUMP] == 0:
            for column, name in NAMES.items():
                if block.profile[column] != FAULTLESS[column]:
                    rows.setdefault(f"none, {name} fault", []).append(said[-1])
    return {
        "command": "python -m benchmarks.rig_judge PATH",
        "by_pump_leakage": {name: _counted(found) for name, found in sorted(rows.items())},
    }


def _counted(found: Sequence[Verdict]) -> dict[str, Any]:
    n = len(found)
    healthy = sum(v.state is State.HEALTHY and not _is_unjudged(v) for v in found)
    outside = sum(_is_unjudged(v) for v in found)
    open_ = sum(v.state is State.INDETERMINATE for v in found)
    named = n - sum(v.state in (State.HEALTHY, State.INDETERMINATE, State.INSUFFICIENT_DATA) for v in found)
    with_pump = sum(State.PUMP_DEGRADATION in (v.state, *v.candidates) for v in found)
    score = proportion(open_, n)
    return {
        "blocks": n,
        "healthy": healthy,
        "undecided": open_,
        "undecided_interval_95": [round(score.low, 4), round(score.high, 4)],
        "pump_among_candidates": with_pump,
        "a_cause_named": named,
        "last_cycles_outside_the_curve": outside,
    }


def _is_unjudged(verdict: Verdict) -> bool:
    return any("are not judged" in spot.because for spot in verdict.blind_spots)


def main() -> None:
    """Judge and keep."""
    if len(sys.argv) != 2:
        raise SystemExit("usage: python -m benchmarks.rig_judge PATH (see this file's first lines)")
    with np.load(sys.argv[1]) as archive:
        arrays = {name: archive[name] for name in archive.files}
    keep("rig_judge", study(arrays))


if __name__ == "__main__":
    main()
