"""The test programme of annex A-1 run on the simulated pump: steady points as CSV, dynamic tests as records."""

from dataclasses import dataclass
from pathlib import Path

from service.answers.documents import JsonObject
from service.studies.simulation.writer import record_writer
from twin.condition import Health
from twin.identification import MEASURED
from twin.parameters import PumpType
from twin.pumps.circuit_sets import CircuitSet
from twin.simulation.programme import STEADY, TESTS, DynamicTest, SteadyTest, dynamic_tests, steady_tests
from twin.simulation.run import simulate

SAMPLE_RATE_HZ = 10_000.0
"""Section 3.2.2."""
DEVIATIONS: dict[str, float] = {
    "discharge_pressure_bar": 0.35,
    "case_pressure_bar": 0.017,
    "case_flow_lpm": 0.0052,
    "shaft_torque_nm": 0.01,
}
"""Repeatability of a mean, a tenth of the accuracies of table 3-2: what an identification may take them for."""
_CONDITION = ("speed_rpm", "fluid_temperature_degc", "reservoir_pressure_bar")


@dataclass(frozen=True, slots=True)
class RanTest:
    """What a test gave: its points as plain values, the files written, and which runs stopped early, in words."""

    points: tuple[JsonObject, ...]
    files: tuple[Path, ...]
    stopped: tuple[str, ...]


def run_test(name: str, kind: PumpType, circuit: CircuitSet, folder: Path) -> RanTest:
    """Run a test and write its files into ``folder``.

    Raises
    ------
    ValueError
        for a name that annex A-1 does not have, or a pump that cannot start.
    OSError
        when a file cannot be written.
    """
    if name not in TESTS:
        raise ValueError(f"no test {name!r}; known: {', '.join(TESTS)}")
    folder.mkdir(parents=True, exist_ok=True)
    if name in STEADY:
        tests = steady_tests(name, kind, circuit.circuit, Health(system_leakage_lpm=circuit.leak_lpm))
        path = folder / f"{name}.csv"
        path.write_text(_csv(name, kind, circuit, tests), encoding="utf-8")
        return RanTest(tuple(_point(test) for test in tests), (path,), ())
    return _dynamic(name, kind, circuit, folder)


def _point(test: SteadyTest) -> JsonObject:
    condition = test.condition._asdict()
    values = {} if test.problem else {n: float(test.state.value(n)[0]) for n in ("discharge_flow_lpm", *MEASURED)}
    known = {name: condition[name] for name in _CONDITION}
    return {"number": test.number, "point": test.point, **known,
            **{n: values.get(n) for n in ("discharge_flow_lpm", *MEASURED)}, "problem": test.problem}  # fmt: skip


def _csv(name: str, kind: PumpType, circuit: CircuitSet, tests: list[SteadyTest]) -> str:
    """Points in the shape that ``casedrain identify`` reads; what has no steady state is a remark."""
    header = [*_CONDITION, "discharge_flow_lpm", *(column for n in MEASURED for column in (n, f"{n}_sd"))]
    lines = [f"# test {name} of annex A-1, simulated: {kind.name} in {circuit.name}", ",".join(header)]
    for test in tests:
        point = _point(test)
        if test.problem:
            lines.append(f"# test {test.number}, {test.point}: {test.problem}")
            continue
        cells = [f"{point[n]:.9g}" for n in (*_CONDITION, "discharge_flow_lpm")]
        cells += [cell for n in MEASURED for cell in (f"{point[n]:.9g}", f"{DEVIATIONS[n]:g}")]
        lines.append(",".join(cells))
    return "\n".join(lines) + "\n"


def _dynamic(name: str, kind: PumpType, circuit: CircuitSet, folder: Path) -> RanTest:
    points, files, stopped = [], [], []
    around = circuit.around(kind)
    health = Health(system_leakage_lpm=circuit.leak_lpm)
    for test in dynamic_tests(name, around, circuit.circuit, health):
        run = simulate(around.pump, circuit.circuit, test.scenario, sample_rate_hz=SAMPLE_RATE_HZ)
        path = folder / f"{name}-{test.number}.csv"
        metadata = {
            "scenario": f"test {name}, number {test.number} of annex A-1: {test.change}",
            "pump_type": kind.name,
        }
        with record_writer(path, list(run.recording.channels), metadata) as writer:
            writer.append(run.recording)
        files.append(path)
        problem = None if run.status.ok else run.status.advice
        if problem is not None:
            stopped.append(f"{name}-{test.number}: {problem}")
        points.append(_change(test, problem))
    return RanTest(tuple(points), tuple(files), tuple(stopped))


def _change(test: DynamicTest, problem: str | None) -> JsonObject:
    return {"number": test.number, "change": test.change, "duration_s": test.scenario.duration_s, "problem": problem}
