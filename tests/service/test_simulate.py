"""Scenario files become flight records that the project's own ingest takes."""

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from service.command_line.main import app
from service.ingest.decode import DecodedRecord, Limits, decode
from service.ingest.upload_files import content_type_of
from service.studies.simulation.picture import N_BUCKETS, Thinned, drawn
from service.studies.simulation.run import run_file
from service.studies.simulation.scenario_file import ScenarioFaultsError, read_scenario
from service.studies.simulation.writer import ROW_GROUP, record_writer
from twin.pumps import circuit_parameters, pump_type
from twin.pumps.fluids import FLUIDS
from twin.recording import REQUIRED_CHANNELS, Recording
from twin.simulation.run import simulate
from twin.simulation.scenario import Schedule

runner = CliRunner()
EXAMPLES = Path(__file__).resolve().parent.parent.parent / "docs" / "examples"
LIMITS = Limits(512 * 2**20, 5_000_000)
SHORT = """
title = "a short one: with = signs, # marks and [brackets]"
duration_s = 0.6
sample_rate_hz = 2000
[condition]
speed_rpm = 4600
fluid_temperature_degc = 50.5
[health]
system_leakage_lpm = 0.5
[changes]
discharge_flow_lpm = { time_s = [0.1, 0.3], value = [0, 12.5] }
pump_leakage_scale = { flight_hours = [100, 100.0001], value = [1.0, 2.0] }
"slipper_gap_scale[2]" = 1.2
[metadata]
pump_serial = 4711
aircraft = "F-SIMU"
position = "LH"
flight_id = "S 1"
started_at = 2026-05-02T07:11:00Z
"""


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.chdir(tmp_path)


def written(text: str) -> str:
    Path("scenario.toml").write_text(text, encoding="utf-8")
    return "scenario.toml"


def read_back(path: Path) -> DecodedRecord:
    return decode(path.read_bytes(), content_type_of(path), "", {}, LIMITS)


def faults_of(text: str) -> list[str]:
    with pytest.raises(ScenarioFaultsError) as caught:
        read_scenario(text, 9)
    return caught.value.faults


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_a_record_comes_back_through_ingest(suffix: str) -> None:
    pytest.importorskip("pyarrow")
    output = Path("made") / f"flight{suffix}"
    result = runner.invoke(app, ["simulate", written("start_flight_hours = 100\n" + SHORT), "--output", str(output)])
    assert result.exit_code == 0, result.output
    assert "1200 rows" in result.output
    record = read_back(output)
    metadata = record.metadata
    assert (metadata.pump_serial, metadata.aircraft, metadata.position) == ("4711", "F-SIMU", "LH")
    assert (metadata.flight_id, metadata.flight_hours, metadata.pump_type) == ("S 1", 100.0, "h225")
    assert metadata.started_at.isoformat() == "2026-05-02T07:11:00+00:00"
    assert metadata.ambient_pressure_bar == pytest.approx(1.01325)
    assert record.recording.attributes["scenario"] == "a short one: with = signs, # marks and [brackets]"
    scenario = read_scenario("start_flight_hours = 100\n" + SHORT, 9).scenario
    truth = simulate(pump_type("h225").pump, circuit_parameters("shared_return"), scenario, sample_rate_hz=2000.0)
    assert set(REQUIRED_CHANNELS) <= set(record.recording.channels) == set(truth.recording.channels)
    for name, samples in truth.recording.channels.items():
        assert record.recording[name] == pytest.approx(samples, rel=1e-8, abs=1e-12), name
    assert sorted(p.name for p in output.parent.iterdir()) == [output.name]


def test_a_scenario_file_says_what_it_means() -> None:
    file = read_scenario("start_flight_hours = 100\nstep_s = 5e-5\n" + SHORT, 9)
    scenario = file.scenario
    assert (file.sample_rate_hz, file.step_s) == (2000.0, 5e-5)
    assert (scenario.condition.speed_rpm, scenario.condition.reservoir_pressure_bar) == (4600.0, 0.0)
    assert scenario.health.system_leakage_lpm == 0.5
    assert scenario.changes["slipper_gap_scale[2]"] == 1.2
    assert scenario.changes["discharge_flow_lpm"] == Schedule((0.1, 0.3), (0.0, 12.5))
    assert scenario.changes["pump_leakage_scale"] == Schedule((100.0, 100.0001), (1.0, 2.0), flight_hours=True)


def test_a_scenario_names_its_fluid_its_air_and_how_slippers_are_found() -> None:
    file = read_scenario('fluid = "MIL-PRF-87257"\nfree_air = 0.005\nslipper_gaps = "metamodel"\n' + SHORT, 9)
    kind = file.filled(pump_type("h225"))
    assert kind.pump.fluid == FLUIDS["MIL-PRF-87257"]._replace(air=0.005)
    assert file.slipper_gaps == "metamodel"
    assert read_scenario(SHORT, 9).filled(pump_type("h225")) is pump_type("h225")
    faults = faults_of('fluid = "olive oil"\nfree_air = 0.5\nslipper_gaps = 3\n' + SHORT)
    assert len(faults) == 3
    assert "MIL-PRF-5606" in next(f for f in faults if f.startswith("fluid"))
    assert "slipper_gaps: is for the transient form" in faults_of(
        'form = "quasi_steady"\nslipper_gaps = "resolved"\n' + SHORT
    )


def test_another_fluid_flows_through_the_simulation() -> None:
    """Half as viscous: the healthy pump leaks more into its case, and the record says with what it was filled."""
    pytest.importorskip("pyarrow")
    flows = {}
    for line in ("", 'fluid = "MIL-PRF-87257"\n'):
        short = SHORT.replace("duration_s = 0.6", "duration_s = 0.1")
        result = runner.invoke(app, ["simulate", written(line + short), "--output", "flight.parquet"])
        assert result.exit_code == 0, result.output
        record = read_back(Path("flight.parquet")).recording
        flows[line] = record["case_flow_lpm"][:100].mean()
        assert record.attributes.get("fluid", "") == line[9:-2]
    assert 1.1 < flows['fluid = "MIL-PRF-87257"\n'] / flows[""] < 2.0


def test_a_mechanism_by_name_and_the_file_wins() -> None:
    text = """
        duration_s = 0.5
        mechanism = "compensator_valve_jamming"
        severity = 0.5
        [condition]
        speed_rpm = 4600
        fluid_temperature_degc = 50
        [health]
        droop_scale = 1.1
    """
    scenario = read_scenario(text, 9).scenario
    assert scenario.changes["spool_jamming_force_n"] == Schedule((0.25, 0.25, 0.4, 0.4), (0.0, 250.0, 250.0, 0.0))
    assert scenario.title == "compensator_valve_jamming, severity 0.5"
    assert scenario.health.droop_scale == 1.1
    other = read_scenario(text + "\n[changes]\nload_conductance_lpm_per_sqrt_bar = 0.7", 9).scenario
    assert other.changes["load_conductance_lpm_per_sqrt_bar"] == 0.7
    assert "spool_jamming_force_n" in other.changes


def test_every_fault_is_in_one_message() -> None:
    result = runner.invoke(
        app,
        [
            "simulate",
            written(
                """
                duration_s = -1
                sample_rate_hz = 1e9
                step_s = 1.0
                adaptive = true
                colour = "red"
                severity = 2
                [condition]
                speed_rpm = 99999
                reservoir_pressure_bar = nan
                altitude = 3
                [health]
                droop_scale = true
                [changes]
                spin = 1.0
                pump_leakage_scale = { time_s = [1, 0], value = [1, 2] }
                system_leakage_lpm = { time_s = [0], flight_hours = [0], value = [1] }
                drain_resistance_scale = { time_s = [0, 1], value = ["a", inf] }
                droop_scale = { time_s = [0, 1], value = 3 }
                "slipper_gap_scale[12]" = 2.0
                [metadata]
                started_at = 2026-05-02T07:11:00
                flight_hours = -3
                mood = "good"
                """
            ),
            *("--output", "flight.txt", "--picture", "p.bmp", "--pump", "x", "--circuit", "y", "--sensors", "z"),
        ],
    )
    assert result.exit_code == 2
    for words in (
        "duration_s = -1 (allowed: above 0 to 3600 s)",
        "sample_rate_hz = 1e+09 (allowed: 0.1 to 1e+06 Hz)",
        "step_s = 1 (allowed: 1e-07 to 0.0001 s)",
        "adaptive: unknown key",
        "colour: unknown key (known: title, duration_s",
        "severity: needs a mechanism",
        "speed_rpm = 99999 (allowed: 200 to 8000 rpm)",
        "condition.fluid_temperature_degc: is missing",
        "condition.reservoir_pressure_bar: is not a finite number",
        "condition.altitude: unknown key",
        "health.droop_scale: is true or false, not a number",
        "unknown input 'spin'",
        "pump_leakage_scale: instants must not fall",
        "changes.system_leakage_lpm: needs value and one of time_s, flight_hours",
        "changes.drain_resistance_scale.value[0]: is a text, not a number",
        "changes.drain_resistance_scale.value[1]: is not a finite number",
        "changes.droop_scale.value: is a number, not a list of numbers",
        "slipper_gap_scale[12]: this pump has pistons 1 to 9",
        "metadata.started_at: '2026-05-02T07:11:00' has no time zone",
        "metadata.flight_hours: '-3' is not a number between 0 and 1e+06",
        "metadata.mood: unknown key",
        "--output flight.txt: ends neither in .parquet nor in .csv",
        "--picture p.bmp: ends neither in .svg nor in .png",
        "--pump x: is not known (known: h225",
        "--circuit y: is not known (known: ",
        "--sensors z: is not known (known: none, helicopter, test_bench)",
    ):
        assert words in result.output, words
    # one line each, and none twice
    lines = [line for line in result.output.splitlines() if line.startswith("  ")]
    assert f"has {len(lines)} fault(s)" in result.output
    assert len(lines) == len(set(lines)) == 26
    assert not Path("flight.txt").exists()


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("duration_s = ", r"not a TOML file: .*line 1"),
        ("duration_s = 1\ncondition = 3", r"condition: is a number, not a table"),
        ("duration_s = 1\nmechanism = 'rust'", r"mechanism = 'rust' \(known: compensator_valve_erosion"),
        ("duration_s = 1\nmechanism = 'piston_wear'\nseverity = -1", r"severity = -1 \(allowed: 0 and more\)"),
        (
            "duration_s = 1\nmechanism = 'piston_wear'\nseverity = 99",
            r"piston_clearance_scale\[1\] = 149.5 \(allowed: 0",
        ),
        ("duration_s = 1" + "0" * 400, r"duration_s: is not a finite number"),
        ("duration_s = 0.001\nsample_rate_hz = 10", r"sample_rate_hz = 10 gives no sample within duration_s = 0.001"),
    ],
)
def test_single_faults(text: str, fault: str) -> None:
    condition = "" if "condition" in text else "\n[condition]\nspeed_rpm = 4600\nfluid_temperature_degc = 50"
    assert any(re.match(fault, found) for found in faults_of(text + condition)), faults_of(text + condition)


def test_a_run_that_stops_keeps_its_rows() -> None:
    """More flow than the pump has: the discharge volume runs dry on the way."""
    text = SHORT.replace("[0, 12.5]", "[0, 90.0]").replace("flight_hours = [100, 100.0001]", "time_s = [0, 1]")
    result = runner.invoke(app, ["simulate", written(text), "--output", "dry.parquet", "--picture", "dry.svg"])
    assert result.exit_code == 1
    words = re.search(
        r"stopped at ([\d.]+) s \((.+?)\): a volume ran dry: .+ What was computed until then", result.output
    )
    assert words is not None, result.output
    assert "discharge" in words[2]
    recording = read_back(Path("dry.parquet")).recording
    assert 0.1 < recording.time_s[-1] <= float(words[1]) < 0.6
    assert len(recording) == round(recording.time_s[-1] * 2000)
    assert Path("dry.svg").read_text(encoding="utf-8").count("<svg") == 1


def test_no_operating_point_leaves_no_file() -> None:
    text = SHORT.replace("time_s = [0.1, 0.3], value = [0, 12.5]", "time_s = [0], value = [90.0]")
    result = runner.invoke(app, ["simulate", written(text), "--output", "none.csv"])
    assert result.exit_code == 2
    assert "no operating point to start from" in result.output
    assert [p.name for p in Path().iterdir()] == ["scenario.toml"]


def test_a_write_that_fails_leaves_nothing_behind() -> None:
    piece = Recording({"time_s": np.arange(3.0)})
    with pytest.raises(KeyError), record_writer(Path("x.csv"), ["time_s", "a"], {}) as writer:
        writer.append(piece)
    assert list(Path().iterdir()) == []


def test_parquet_is_written_by_row_groups_and_time_increases() -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    rate, n = 10_000.0, 3 * ROW_GROUP
    for suffix in (".parquet", ".csv"):
        with record_writer(Path(f"long{suffix}"), ["time_s"], {"title": "two\nlines\u2028or three"}) as writer:
            for start in range(0, n, 2500):
                writer.append(Recording({"time_s": 3000.0 + np.arange(start, min(start + 2500, n)) / rate}))
    file = parquet.ParquetFile("long.parquet")
    assert file.num_row_groups == 3
    assert file.metadata.num_rows == n
    lines = Path("long.csv").read_text(encoding="utf-8").splitlines()
    assert lines[:2] == ["# title: two lines or three", "time_s"]
    assert (np.diff([float(line) for line in lines[2:]]) > 0).all()


def test_sensors_show_quanta_and_another_seed_is_another_recording() -> None:
    kind = pump_type("h225")
    file = read_scenario(SHORT, 9)
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        run_file(file, kind, "shared_return", "test_bench", seed, Path(f"{name}.csv"))
    assert Path("a.csv").read_bytes() == Path("b.csv").read_bytes() != Path("c.csv").read_bytes()
    recording = read_back(Path("a.csv")).recording
    quanta = recording["case_flow_lpm"] / 0.00127
    assert quanta == pytest.approx(np.round(quanta), abs=1e-4)
    # 0.6 s hold 46 updates of a meter that takes 13.15 ms
    assert 20 < np.count_nonzero(np.diff(recording["discharge_flow_lpm"])) <= 46
    assert np.unique(recording["swashplate_angle_deg"]).size > 1000


def test_thinning_keeps_extremes_gaps_and_the_rest() -> None:
    n = 10 * N_BUCKETS + 7
    samples = np.zeros(n)
    samples[4321], samples[-1] = 9.0, -3.0
    samples[100:300] = np.nan
    thinned = Thinned(n)
    for part in np.split(np.arange(n), [1, 777, 5000]):
        thinned.append(Recording({"time_s": part * 1e-3, "case_pressure_bar": samples[part]}))
    low, mean, high = thinned.rows("case_pressure_bar").T
    assert len(low) == len(thinned.rows("time_s")) <= N_BUCKETS
    assert (low.min() if not np.isnan(low).any() else np.nanmin(low)) == -3.0
    assert np.nanmax(high) == 9.0
    assert np.isnan(mean).sum() in (17, 18)
    picture = drawn(thinned, "costs $5 & <more>", "svg").decode()
    assert "low pressure [bar]" in picture
    assert "tilt" not in picture
    assert "costs $5 &amp; &lt;more&gt;" in picture


@pytest.mark.parametrize("name", ["load-step", "piston-wear"])
def test_the_examples_run(name: str) -> None:
    text = (EXAMPLES / f"{name}.toml").read_text(encoding="utf-8").replace("duration_s = 60.0", "duration_s = 5.0")
    call = ["simulate", written(text), "--output", f"{name}.csv", "--picture", f"{name}.png"]
    result = runner.invoke(app, [*call, "--sensors", "helicopter"])
    assert result.exit_code == 0, result.output
    assert Path(f"{name}.png").read_bytes().startswith(b"\x89PNG")
    if name == "piston-wear":
        assert read_back(Path(f"{name}.csv")).metadata.flight_hours == 820.0
    else:
        assert "pump_serial, aircraft, position, flight_id, started_at" in result.output
