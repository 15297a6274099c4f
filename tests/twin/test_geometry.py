"""A parameter set that cannot be a pump is refused with every fault in one message."""

import pytest

from twin.condition import Condition
from twin.parts.geometry import geometry_faults
from twin.pumps import PUMP_TYPES, circuit_parameters, pump_type
from twin.simulation.run import simulate
from twin.simulation.scenario import Scenario

PUMP = pump_type("h225").pump


@pytest.mark.parametrize("name", PUMP_TYPES)
def test_shipped_sets_are_pumps(name: str) -> None:
    assert geometry_faults(pump_type(name).pump) == []


def test_every_fault_is_named_with_its_unit() -> None:
    pump = PUMP._replace(
        piston=PUMP.piston._replace(b=-1e-6, l_mean=4e-3, n=9.5),
        slipper=PUMP.slipper._replace(diameter_ratio=0.9, h_retainer=1e-7),
        swashplate=PUMP.swashplate._replace(alpha_min=0.3),
    )
    with pytest.raises(ValueError, match="diameter_ratio") as caught:
        simulate(pump, circuit_parameters("shared_return"), Scenario(0.1, Condition(-5, 50)), step_s=1.0)
    for words in ("piston.b = -1 um", "piston.n = 9.5", "h_retainer = 0.1 um", "alpha_min", "step_s", "speed_rpm"):
        assert words in str(caught.value)


def test_a_stroke_longer_than_the_bore_and_numbers_that_are_none() -> None:
    short = PUMP._replace(piston=PUMP.piston._replace(l_mean=4e-3))
    assert "leave its bore" in geometry_faults(short)[0]
    broken = PUMP._replace(
        piston=PUMP.piston._replace(R=float("nan")), volumes=PUMP.volumes._replace(case=float("inf"))
    )
    assert geometry_faults(broken) == ["piston.R is not a finite number", "volumes.case is not a finite number"]


def test_a_fluid_that_is_none_is_refused_with_every_number() -> None:
    fluid = PUMP.fluid._replace(rho_ref=80.0, B_slope=-2.0e7, astm_a=4.0, alpha_p=-1e-8, air=0.3, air_exponent=0.5)
    faults = geometry_faults(PUMP._replace(fluid=fluid))
    for words in ("fluid.rho_ref", "fluid.B_ref", "fluid.astm_a", "fluid.alpha_p", "fluid.air ", "fluid.air_exponent"):
        assert any(fault.startswith(words) for fault in faults), words
    assert len(faults) == 6
