"""The test programme by name: steady points that an identification reads, records that the readers take, one error if wrong."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from service.command_line.main import app
from service.studies.bench_points import read_points
from service.studies.programme import run_test
from twin.pumps import pump_type
from twin.pumps.circuit_sets import CIRCUIT_SETS

runner = CliRunner()


def test_steady_points_are_a_file_that_identify_reads(tmp_path: Path) -> None:
    ran = runner.invoke(app, ["test-programme", "A2", "--output", str(tmp_path), "--json"])
    assert ran.exit_code == 0, ran.output
    document = json.loads(ran.stdout)
    assert (document["test"], document["pump_type"], len(document["points"])) == ("A2", "h225", 25)
    points = read_points((tmp_path / "A2.csv").read_text(encoding="utf-8"))
    assert len(points) == 25
    for point, told in zip(points, document["points"], strict=True):
        assert point.condition.speed_rpm == told["speed_rpm"]
        assert point.measured["case_flow_lpm"].value == pytest.approx(told["case_flow_lpm"], rel=1e-8)


def test_a_pump_that_cannot_hold_a_point_says_so_and_keeps_the_others(tmp_path: Path) -> None:
    kind = pump_type("h225")
    weak = kind.pump.compensator._replace(F_preload=0.7 * kind.pump.compensator.F_preload)
    ran = run_test(
        "A2", replace(kind, pump=kind.pump._replace(compensator=weak)), CIRCUIT_SETS["shared_return"], tmp_path
    )
    missed = [point for point in ran.points if point["problem"]]
    assert {point["point"] for point in missed} == {"167 bar"}
    assert "no load of the bench holds 167 bar" in missed[0]["problem"]
    assert len(read_points((tmp_path / "A2.csv").read_text(encoding="utf-8"))) == 25 - len(missed)


def test_a_wrong_name_or_pump_is_one_error_and_no_file(tmp_path: Path) -> None:
    for words in (["A9"], ["A2", "--pump", "nothing"], ["A2", "--circuit", "nothing"]):
        ran = runner.invoke(app, ["test-programme", *words, "--output", str(tmp_path / "new")])
        assert ran.exit_code == 2
        assert not (tmp_path / "new").exists()


@pytest.mark.study
def test_dynamic_tests_write_eight_records(tmp_path: Path) -> None:
    ran = run_test("B2", pump_type("h225"), CIRCUIT_SETS["shared_return"], tmp_path)
    assert [path.name for path in ran.files] == [f"B2-{i}.csv" for i in range(1, 9)]
    assert not ran.stopped
    assert (tmp_path / "B2-1.csv").read_text(encoding="utf-8").startswith("# scenario: test B2, number 1 of annex A-1")
