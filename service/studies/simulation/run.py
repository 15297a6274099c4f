"""Run a scenario file: pieces of the simulation through the sensors to the disk, and a picture of them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from service.ingest.metadata import TEXTS_REQUIRED
from service.pump_types.parameter_files import circuit_named_or_written, named_or_written
from service.studies.simulation import picture as pictures
from service.studies.simulation import writer as writers
from service.studies.simulation.consumers import leaking
from service.studies.simulation.picture import Thinned, drawn
from service.studies.simulation.scenario_file import ScenarioFaultsError, ScenarioFile, read_scenario
from service.studies.simulation.writer import record_writer
from twin.parameters import PumpType
from twin.pumps import PUMP_TYPES
from twin.simulation.flight import quasi_steady
from twin.simulation.instrumentation import HELICOPTER, TEST_BENCH, Instrumentation, SensorModel
from twin.simulation.run import Run, Status, pieces

SENSORS: Mapping[str, Mapping[str, SensorModel]] = {"none": {}, "helicopter": HELICOPTER, "test_bench": TEST_BENCH}
"""Sensors by name; channels without one are the truth."""
_AMBIENT_OF_RECORDS_BAR = (0.2, 1.2)


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a run left on the disk.

    Attributes
    ----------
    status
        How the simulation ended.
    n_rows
        Samples written.
    missing
        Metadata that an upload will ask for.
    """

    status: Status
    n_rows: int
    missing: tuple[str, ...]


def asked(
    path: Path, output: Path, picture: Path | None, pump: str, circuit: str, sensors: str
) -> tuple[ScenarioFile, PumpType]:
    """Scenario file and pump type of a call.

    Raises
    ------
    ScenarioFaultsError
        with every fault of the file and of what stands beside it in the call.
    """
    faults = []
    if sensors not in SENSORS:
        faults.append(f"--sensors {sensors}: is not known (known: {', '.join(SENSORS)})")
    if output.suffix.lower() not in writers.SUFFIXES:
        faults.append(f"--output {output}: ends neither in {' nor in '.join(writers.SUFFIXES)}")
    if picture is not None and picture.suffix.lower() not in pictures.SUFFIXES:
        faults.append(f"--picture {picture}: ends neither in {' nor in '.join(pictures.SUFFIXES)}")
    kind = PUMP_TYPES["h225"]
    try:
        kind = named_or_written(pump)
    except ValueError as error:
        faults.insert(0, f"--pump {error}")
    try:
        circuit_named_or_written(circuit)
    except ValueError as error:
        faults.insert(0, f"--circuit {error}")
    try:
        file = read_scenario(path.read_text(encoding="utf-8"), int(kind.pump.piston.n))
    except UnicodeDecodeError:
        raise ScenarioFaultsError([*faults, "not UTF-8 text"]) from None
    except ScenarioFaultsError as error:
        raise ScenarioFaultsError(faults + error.faults) from None
    if faults:
        raise ScenarioFaultsError(faults)
    return file, kind


def run_file(
    file: ScenarioFile,
    kind: PumpType,
    circuit: str,
    sensors: str,
    seed: int,
    output: Path,
    picture: Path | None = None,
    progress: Callable[[float], None] = lambda _share: None,
) -> Outcome:
    """Simulate, write the record and draw the picture; ``progress`` is told the share that is done.

    A run that fails on its way leaves what it has computed; its status says where and why.

    Raises
    ------
    ScenarioFaultsError
        when there is no operating point to start from.
    RuntimeError, OSError
        when the record cannot be written.
    """
    around = circuit_named_or_written(circuit)
    scenario = leaking(file.scenario, around.leak_lpm)
    pump = around.around(file.filled(kind)).pump
    stream = (
        quasi_steady(pump, around.circuit, scenario, file.sample_rate_hz)
        if scenario.quasi_steady
        else pieces(
            pump,
            around.circuit,
            scenario,
            sample_rate_hz=file.sample_rate_hz,
            step_s=file.step_s,
            slipper_gaps=file.slipper_gaps,
        )
    )
    try:
        run: Run | None = next(stream)
    except ValueError as problem:
        raise ScenarioFaultsError([str(problem)]) from None
    instruments = Instrumentation(SENSORS[sensors], 1.0 / file.sample_rate_hz, np.random.default_rng(seed))
    thinned = Thinned(round(scenario.duration_s * file.sample_rate_hz))
    metadata = _metadata(file, kind, circuit, sensors)
    n_rows = 0
    with record_writer(output, list(run.recording.channels) if run else [], metadata) as writer:
        while run is not None:
            status = run.status
            shown = instruments.measured(run.recording)
            writer.append(shown)
            thinned.append(shown)
            n_rows += len(shown)
            progress(min(status.time_s / scenario.duration_s, 1.0))
            run = next(stream, None)
    if picture is not None and n_rows:
        picture.parent.mkdir(parents=True, exist_ok=True)
        picture.write_bytes(drawn(thinned, scenario.title, picture.suffix.lower().removeprefix(".")))
    missing = tuple(name for name in (*TEXTS_REQUIRED, "started_at") if name not in metadata)
    return Outcome(status, n_rows, missing)


def _metadata(file: ScenarioFile, kind: PumpType, circuit: str, sensors: str) -> dict[str, str]:
    """Metadata of the record: the file's own, and what the simulation knows."""
    scenario = file.scenario
    ambient = scenario.condition.ambient_pressure_bar
    known = {"pump_type": kind.name, "pressure_reference": "gauge"}
    low, high = _AMBIENT_OF_RECORDS_BAR
    if "ambient_pressure_bar" not in scenario.changes and low <= ambient <= high:
        known["ambient_pressure_bar"] = f"{ambient:.9g}"
    origin = {
        "source": "simulation",
        "scenario": scenario.title,
        "circuit": circuit_named_or_written(circuit).name,
        "sensors": sensors,
        "fluid": file.fluid or "",
    }
    return {**file.metadata, **known, **{name: value for name, value in origin.items() if value}}
