"""Failure mechanisms show what table 4-1 (Mkadara 2020) says of them, against the healthy pump in the same run."""

import pytest

from twin.condition import Condition
from twin.pumps import circuit_parameters, pump_type
from twin.recording import Recording
from twin.simulation.mechanisms import MECHANISMS, mechanism
from twin.simulation.run import Run, simulate

PUMP = pump_type("h225").pump
BENCH = circuit_parameters("shared_return")
ZERO_FLOW = Condition(4600.0, 50.0, 0.5)
POINT_2 = Condition(4600.0, 50.0, 0.5, 25.0)


def ran(name: str, severity: float, condition: Condition = ZERO_FLOW, duration_s: float = 1.0) -> Run:
    run = simulate(PUMP, BENCH, mechanism(name, condition, duration_s, severity), sample_rate_hz=10_000.0)
    assert run.status.ok, run.status.advice
    return run


def pair(name: str) -> tuple[Recording, Recording]:
    """Healthy and faulty run of one mechanism."""
    return ran(name, 0.0).recording, ran(name, 1.0).recording


def mean(recording: Recording, name: str, start_s: float, end_s: float) -> float:
    return float(recording.between(start_s, end_s)[name].mean())


def test_erosion_adjusts_the_pressure_lower_and_leaks_more() -> None:
    healthy, eroded = pair("compensator_valve_erosion")
    without, with_flow = (0.1, 0.3), (0.45, 0.6)
    lower = [
        mean(healthy, "discharge_pressure_bar", *span) - mean(eroded, "discharge_pressure_bar", *span)
        for span in (without, with_flow)
    ]
    # the gain falls with the edge: the pressure that is missing grows with the flow
    assert 0.1 < lower[0] < 0.5 * lower[1]
    assert mean(eroded, "case_flow_lpm", *without) > mean(healthy, "case_flow_lpm", *without) + 0.02


def test_a_jammed_valve_loses_the_pressure_and_finds_it_again() -> None:
    healthy, jammed = pair("compensator_valve_jamming")
    peak = jammed.between(0.6, 0.8)["discharge_pressure_bar"].max()
    assert peak > healthy.between(0.6, 0.8)["discharge_pressure_bar"].max() + 100.0
    # once thrown over, the spool stays: the pressure goes where the plate leaves it
    assert abs(mean(jammed, "discharge_pressure_bar", 0.7, 0.8) - 175.0) > 30.0
    assert jammed["discharge_pressure_bar"][:4999] == pytest.approx(healthy["discharge_pressure_bar"][:4999])
    assert mean(jammed, "discharge_pressure_bar", 0.95, 1.0) == pytest.approx(175.0, abs=10.0)


def test_friction_of_the_plate_costs_flow_and_compensation() -> None:
    healthy, rubbing = pair("swashplate_bearing_friction")
    assert mean(healthy, "discharge_flow_lpm", 0.5, 0.6) == pytest.approx(26.0, abs=0.5)
    assert mean(rubbing, "discharge_flow_lpm", 0.5, 0.6) < 20.0
    assert mean(rubbing, "discharge_pressure_bar", 0.5, 0.6) < 100.0
    assert mean(rubbing, "swashplate_angle_deg", 0.5, 0.6) < mean(healthy, "swashplate_angle_deg", 0.5, 0.6) - 3.0


@pytest.mark.parametrize("name", ["piston_wear", "slipper_wear", "shaft_bearing_damage"])
@pytest.mark.parametrize("condition", [ZERO_FLOW, POINT_2], ids=["zero flow", "25 L/min"])
def test_wear_fills_the_case(name: str, condition: Condition) -> None:
    runs = [ran(name, severity, condition, 0.6) for severity in (0.0, 1.0, 1.5)]
    for channel in ("case_flow_lpm", "case_pressure_bar"):
        healthy, worn, worse = (run.mean(channel, 10) for run in runs)
        assert healthy < worn < worse, channel


def test_piston_wear_is_of_the_size_of_table_4_3() -> None:
    """+150 % of three pistons' clearance: +0.0343 L/min there at 136.5 bar; here at 172 bar, and half as much again."""
    healthy, worn = (ran("piston_wear", severity, POINT_2, 0.6).mean("case_flow_lpm", 10) for severity in (0.0, 1.0))
    assert worn - healthy == pytest.approx(0.0343 * 172.0 / 136.5, rel=0.5)


def test_a_worn_slipper_pulses_once_per_turn() -> None:
    healthy, worn = pair("slipper_wear")
    assert worn["case_flow_lpm"].std() > 3.0 * healthy["case_flow_lpm"].std()


def test_shaft_damage_slows_the_drive_and_tilts_the_barrel() -> None:
    scenario = mechanism("shaft_bearing_damage", ZERO_FLOW, 1.0)
    assert scenario.changes["port_plate_gap_scale"] == pytest.approx(2.5 ** (1 / 3))
    # 2 N m over 0.85 N m s is 2.35 rad/s
    assert scenario.changes["speed_rpm"] == pytest.approx(4600.0 - 22.5, abs=0.1)


def test_the_flow_of_the_condition_sizes_the_load() -> None:
    half = ran("compensator_valve_erosion", 0.0, Condition(4600.0, 50.0, 0.5, 13.0)).recording
    assert mean(half, "discharge_flow_lpm", 0.5, 0.6) == pytest.approx(13.0, abs=0.3)
    assert mean(half, "discharge_flow_lpm", 0.1, 0.3) == 0.0


def test_every_mechanism_says_what_it_is() -> None:
    for name, words in MECHANISMS.items():
        assert words.endswith(").")
        scenario = mechanism(name, ZERO_FLOW, 0.5)
        assert scenario.title.startswith(name)
        scenario.table(int(PUMP.piston.n))


def test_unknown_names_and_severities_are_refused_together() -> None:
    with pytest.raises(ValueError, match=r"no failure mechanism 'rust'; known: compensator_valve_erosion, .*severity"):
        mechanism("rust", ZERO_FLOW, 1.0, -1.0)
    with pytest.raises(ValueError, match="severity = nan"):
        mechanism("piston_wear", ZERO_FLOW, 1.0, float("nan"))
