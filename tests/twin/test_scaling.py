"""Another pump from a base: similarity, the fleet's range, and what is refused with every fault."""

import itertools
from dataclasses import replace

import pytest

from twin.condition import Condition
from twin.operating_point import operating_point, outside
from twin.parameters import PumpType, Quantity
from twin.pumps import circuit_parameters, pump_type
from twin.pumps.own_limits import limit_faults
from twin.pumps.scaling import Wanted, scaled
from twin.pumps.written import ParameterFaultsError, document_of, pump_type_from

BASE, BENCH = pump_type("h225"), circuit_parameters("shared_return")


def value(kind: PumpType, condition: Condition, name: str) -> float:
    return float(operating_point(kind.pump, condition, BENCH).value(name)[0])


def test_the_base_scaled_to_itself_is_the_base() -> None:
    delivery = 28.366
    kind = scaled(BASE, "same", Wanted(delivery, 175.0, 4600.0, 9))
    for part, block in BASE.pump._asdict().items():
        for name, number in block._asdict().items():
            assert getattr(getattr(kind.pump, part), name) == pytest.approx(number, rel=7e-3), (part, name)
    assert kind.limits["case_flow_lpm"].value == pytest.approx(1.5, rel=5e-3)


@pytest.mark.parametrize(
    "wanted",
    [
        Wanted(flow, pressure, speed, pistons)
        for (flow, pressure), (speed, pistons) in itertools.product(
            ((8.0, 103.0), (8.0, 210.0), (60.0, 103.0), (60.0, 210.0), (25.0, 150.0)), ((6000.0, 7), (3500.0, 9))
        )
    ],
)
def test_every_corner_of_the_fleets_range_is_a_pump(wanted: Wanted) -> None:
    kind = scaled(BASE, "corner", wanted)
    idle = Condition(wanted.speed_rpm, 50.0)
    assert value(kind, idle, "discharge_pressure_bar") == pytest.approx(wanted.pressure_bar, abs=0.2)
    # regulated up to nine tenths of its delivery, at the stop beyond it
    most = idle._replace(discharge_flow_lpm=0.9 * wanted.flow_lpm)
    assert value(kind, most, "discharge_pressure_bar") > 0.9 * wanted.pressure_bar
    beyond = operating_point(kind.pump, idle._replace(discharge_flow_lpm=1.1 * wanted.flow_lpm), BENCH)
    assert beyond.status[0] != 0
    low, high = kind.limits["case_flow_low_lpm"].value, kind.limits["case_flow_lpm"].value
    assert low < value(kind, idle._replace(fluid_temperature_degc=60.0), "case_flow_lpm") < high
    assert outside(kind, operating_point(kind.pump, idle, BENCH)) == ((),)
    assert limit_faults(kind) == []
    assert pump_type_from(document_of(kind)) == kind


def test_a_pump_twice_as_fast_is_smaller_by_similarity() -> None:
    slow, fast = (scaled(BASE, "x", Wanted(20.0, 175.0, speed, 9)) for speed in (3000.0, 6000.0))
    length = 2.0 ** (-1.0 / 3.0)
    assert pytest.approx(length) == fast.pump.piston.R / slow.pump.piston.R
    assert fast.pump.piston.d_p / slow.pump.piston.d_p == pytest.approx(length)
    assert pytest.approx(length**5) == fast.pump.swashplate.J / slow.pump.swashplate.J
    assert fast.pump.slipper.h == slow.pump.slipper.h


def test_what_cannot_be_is_refused_with_every_fault() -> None:
    with pytest.raises(ParameterFaultsError) as refused:
        scaled(BASE, "x", Wanted(80.0, 90.0, 500.0, 3))
    assert [where for where, _ in refused.value.faults] == ["flow", "pressure", "speed", "pistons"]


def test_a_103_bar_pump_is_not_held_at_173_to_177() -> None:
    kind = scaled(BASE, "small", Wanted(12.0, 103.0, 4600.0, 7))
    foreign = {n: BASE.limits[n] for n in ("zero_flow_pressure_low_bar", "zero_flow_pressure_high_bar")}
    faults = limit_faults(replace(kind, limits={**kind.limits, **foreign}))
    assert [where for where, _ in faults] == [
        "sensors.discharge_pressure_bar",
        "limits.zero_flow_pressure_low_bar",
        "limits.zero_flow_pressure_high_bar",
    ]
    assert "holds 102.9 bar" in faults[-1][1]
    crossed = {
        "case_flow_low_lpm": Quantity(3.0, "L/min", "x"),
        "zero_flow_pressure_low_bar": Quantity(178.0, "bar", "x"),
    }
    faults = limit_faults(replace(BASE, limits={**BASE.limits, **crossed}))
    assert {where for where, _ in faults} >= {"limits.case_flow_low_lpm", "limits.zero_flow_pressure_low_bar"}
