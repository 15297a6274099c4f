"""The transient pump as an FMU: a foreign simulator gets the simulation's own numbers from C alone."""

import subprocess
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fmpy import read_model_description, simulate_fmu
from fmpy.validation import validate_fmu
from typer.testing import CliRunner

from service.command_line.main import app
from service.studies.fmu.transient import HEALTH, OUTPUTS, PORTS, at_ports, first_state
from service.studies.fmu.translation import Translation, UntranslatableError
from twin.condition import Condition, Health
from twin.laws.fluid import throttling_heating
from twin.laws.metering_edge import Edge, edge_flow
from twin.pumps import pump_type
from twin.pumps.circuit_sets import CIRCUIT_SETS
from twin.simulation.run import simulate
from twin.simulation.scenario import Scenario, Schedule
from twin.units import KELVIN_AT_0_DEGC

KIND, CIRCUIT = pump_type("h225"), CIRCUIT_SETS["separate_drain"]
NAMES = [name for name, _ in OUTPUTS]
RUN = CliRunner()


@pytest.fixture(scope="module", params=["2.0", "3.0"])
def fmu(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("fmu") / "pump.fmu"
    words = ["--fmi", request.param, "--model", "transient", "--circuit", CIRCUIT.name]
    ran = RUN.invoke(app, ["export-fmu", str(path), *words])
    assert ran.exit_code == 0, ran.output
    return path


def test_ports_health_and_numbers_are_its_variables(fmu: Path) -> None:
    assert validate_fmu(str(fmu)) == []
    described = {v.name: v for v in read_model_description(str(fmu)).modelVariables}
    assert {n for n, v in described.items() if v.causality == "input"} == {name for name, *_ in PORTS}
    parameters = {n for n, v in described.items() if v.causality == "parameter"}
    assert parameters >= {*HEALTH, "piston.b", "slipper.h", "compensator.F_preload", "fluid.astm_a", "circuit.k_c"}
    assert float(described["piston.b"].start) == KIND.pump.piston.b
    with zipfile.ZipFile(fmu) as archive:
        assert "python" not in "".join(archive.read(n).decode() for n in archive.namelist() if n.endswith(".c"))


def test_it_gives_the_simulations_own_numbers(fmu: Path) -> None:
    """Worn, from a pressurised tank, another clearance, the flow in two steps: every sample of every port."""
    asked = {"suction_pressure_bar": 1.0, "case_line_pressure_bar": 1.4, "fluid_temperature_degc": 70.0}
    flow = [(0.0, 4.0), (0.05, 4.0), (0.05, 15.0), (0.1, 15.0)]
    signals = np.array(flow, dtype=[("time", float), ("discharge_flow_lpm", float)])
    found = simulate_fmu(
        str(fmu), stop_time=0.1, output_interval=1.0e-3, input=signals, output=[*NAMES, "status"],
        start_values={**asked, "slipper_leakage_scale": 1.3, "pressure_setting_change_bar": 2.0, "piston.b": 6.0e-6},
    )  # fmt: skip
    pump, around = at_ports(KIND, CIRCUIT)
    start = first_state(pump, around, Condition(KIND.nominal_speed_rpm, 50.0, KIND.nominal_reservoir_pressure_bar))
    condition = Condition(KIND.nominal_speed_rpm, 70.0, 1.0, 4.0)
    start[2] = (1.4 + condition.ambient_pressure_bar) * 1.0e5
    worn = pump._replace(piston=pump.piston._replace(b=6.0e-6))
    health = Health(slipper_leakage_scale=1.3, pressure_setting_change_bar=2.0)
    # the unit holds an input over a communication step
    scenario = Scenario(0.1, condition, health, {"discharge_flow_lpm": Schedule.step(0.05, 4.0, 15.0)})
    run = simulate(worn, around, scenario, sample_rate_hz=1000.0, initial_state=start)
    assert not found["status"].any()
    for name in NAMES[:-1]:
        ours, theirs = run.recording[name], np.asarray(found[name][1:])
        assert theirs == pytest.approx(ours, rel=1e-5, abs=1e-5), name
    P_d, P_c = (run.recording[f"{name}_pressure_bar"][-1] * 1.0e5 for name in ("discharge", "case"))
    heated = 70.0 + throttling_heating(KIND.pump.fluid, 70.0 + KELVIN_AT_0_DEGC, P_d, P_c)
    assert found["case_temperature_degc"][-1] == pytest.approx(heated, abs=1e-3)


def test_what_left_the_numbers_says_so(fmu: Path) -> None:
    from fmpy.fmi1 import FMICallException

    with pytest.raises(FMICallException):
        simulate_fmu(
            str(fmu), stop_time=0.01, output_interval=1.0e-3, start_values={"volumes.discharge": 0.0}, output=NAMES
        )


def test_what_cannot_be_exported_is_said(tmp_path: Path) -> None:
    path = str(tmp_path / "x.fmu")
    for words, told in (
        (["--model", "other"], "operating-point, transient"),
        (["--model", "transient", "--pump", "h225_thesis"], "variable slipper gaps"),
        (["--model", "transient", "--fmi", "1.0"], "is not one of 2.0, 3.0"),
    ):
        ran = RUN.invoke(app, ["export-fmu", path, *words])
        assert ran.exit_code == 2
        assert told in ran.output
        assert not Path(path).exists()


def test_a_translated_law_is_the_law(tmp_path: Path) -> None:
    """Branches, powers, tuples and modulo of Python, run as C."""
    translation = Translation()
    name = translation.add(edge_flow)
    edge = Edge(2.0, 1.0e-3, 5.0e-6, 1.0e-6, 0.7, 7.0e-4, 1000.0, 2.0e6)
    cases = [(law, X, dP) for law in (0.0, 1.0, 2.0, 3.0) for X in (-2.0e-5, 0.0, 3.0e-5) for dP in (-3.0e6, 1.0e5)]
    calls = "".join(
        f'printf("%.17g\\n", {name}({law}, (T_metering_edge_Edge){{{", ".join(map(repr, edge))}}}, {X!r}, {dP}, 820.0, 1e-5));'
        for law, X, dP in cases
    )
    (tmp_path / "law.c").write_text(f"#include <stdio.h>\n{translation.text}\nint main(void) {{ {calls} return 0; }}\n")
    subprocess.run(["cc", "-std=c99", "law.c", "-o", "law", "-lm"], cwd=tmp_path, check=True, capture_output=True)
    said = subprocess.run([str(tmp_path / "law")], check=True, capture_output=True, text=True).stdout.split()
    assert [float(v) for v in said] == pytest.approx([edge_flow(law, edge, X, dP, 820.0, 1e-5) for law, X, dP in cases])


def _foreign(x: float) -> float:
    return sum(x for _ in range(3))


def test_what_has_no_c_is_an_error() -> None:
    with pytest.raises(UntranslatableError, match="_foreign"):
        Translation().add(_foreign)
