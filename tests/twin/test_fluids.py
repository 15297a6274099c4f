"""Fluids against what their specifications ask for and what fleets report; the twin with another fluid."""

import math

import pytest

from benchmarks import burst_surrogate
from twin.condition import Condition, Health, input_rows
from twin.laws.compressibility import medium_of, relative_density
from twin.laws.fluid import P_ATMOSPHERE, bulk_modulus, density, kinematic_viscosity
from twin.operating_point import operating_point
from twin.orders.surfaces import order_amplitudes, order_surfaces
from twin.pumps import circuit_parameters, pump_type
from twin.pumps.fluids import (
    FLUIDS,
    PRODUCTS,
    USUAL_FREE_AIR,
    fluid_named,
    ln_viscosity_ratio,
    with_fluid,
    with_free_air,
)
from twin.units import SI_PER_UNIT
from twin.version import numbers_hash

PUMP = pump_type("h225")
CIRCUIT = circuit_parameters("shared_return")
ESTER = "AS1241 Type IV/V phosphate ester"
REPORTED: dict[str, tuple[tuple[float, float], tuple[float, float]]] = {
    # cSt at 40 and at 100 degC: lowest and highest that fleets and specifications know
    "MIL-PRF-83282": ((14.0, 14.4), (3.45, 3.6)),
    "MIL-PRF-5606": ((12.4, 14.0), (4.2, 5.3)),
    "MIL-PRF-87257": ((6.0, 7.3), (2.0, 2.6)),
    ESTER: ((9.0, 11.0), (3.1, 3.9)),
}
LARGEST_AT_MINUS_40 = {"MIL-PRF-83282": 2200.0, "MIL-PRF-5606": 600.0, "MIL-PRF-87257": 550.0}
"""Limits of the specifications [cSt]."""


def cst(name: str, celsius: float) -> float:
    return kinematic_viscosity(FLUIDS[name], celsius + 273.15) * 1e6


@pytest.mark.parametrize("name", PRODUCTS)
def test_every_number_has_unit_source_and_range(name: str) -> None:
    product = PRODUCTS[name]
    assert set(product.quantities) == set(FLUIDS[name]._fields)
    for key, quantity in product.quantities.items():
        assert quantity.unit in SI_PER_UNIT
        assert getattr(FLUIDS[name], key) == quantity.si
        assert len(quantity.source) > 3
    assert len(product.why) > 20


@pytest.mark.parametrize("name", PRODUCTS)
@pytest.mark.parametrize(("celsius", "which"), [(40.0, 0), (100.0, 1)])
def test_viscosity_lies_among_the_reported_and_its_spread_holds_them(name: str, celsius: float, which: int) -> None:
    low, high = REPORTED[name][which]
    spread = PRODUCTS[name].viscosity_sd(celsius)
    assert low <= cst(name, celsius) * 1.001 <= high * 1.001
    for reported in (low, high):
        assert abs(math.log(reported / cst(name, celsius))) < 2.2 * spread
    assert spread < 0.12


@pytest.mark.parametrize(("name", "largest"), LARGEST_AT_MINUS_40.items())
def test_no_thicker_in_the_cold_than_allowed(name: str, largest: float) -> None:
    """The curve is extrapolated by 80 K: half a viscosity is all that can be asked of it."""
    assert 0.35 * largest < cst(name, -40.0) < 1.25 * largest


def test_an_improver_flattens_the_curve_and_shears() -> None:
    fall = {name: cst(name, 40.0) / cst(name, 100.0) for name in PRODUCTS}
    assert fall["MIL-PRF-5606"] < fall[ESTER] < fall["MIL-PRF-87257"] < fall["MIL-PRF-83282"]
    assert PRODUCTS["MIL-PRF-5606"].viscosity_sd(100.0) > 1.3 * PRODUCTS["MIL-PRF-83282"].viscosity_sd(100.0)
    assert PRODUCTS["MIL-PRF-5606"].viscosity_sd(100.0) > PRODUCTS["MIL-PRF-5606"].viscosity_sd(40.0)


@pytest.mark.parametrize("name", PRODUCTS)
def test_spread_widens_in_the_cold_and_is_held_beyond_its_ends(name: str) -> None:
    spread = PRODUCTS[name].viscosity_sd
    assert spread(0.0) > spread(20.0) > spread(40.0)
    assert spread(-30.0) == spread(0.0)
    assert spread(130.0) == spread(100.0)


@pytest.mark.parametrize("name", PRODUCTS)
def test_modulus_is_at_least_what_specifications_ask_for(name: str) -> None:
    """1379 MPa isothermal secant from 0 to 276 bar at 40 degC; the secant lies near the tangent at half the pressure."""
    T, half = 313.15, 138.0e5 + P_ATMOSPHERE
    spread = PRODUCTS[name].quantities["B_ref"].uncertainty or 0.0
    assert bulk_modulus(FLUIDS[name], T, half) * (1.0 + spread) > 1379e6


def test_esters_are_heavy_and_hydrocarbons_light() -> None:
    rho = {name: density(FLUIDS[name], 298.15, P_ATMOSPHERE) for name in PRODUCTS}
    assert rho["MIL-PRF-87257"] < rho["MIL-PRF-83282"] < rho["MIL-PRF-5606"] < 880.0
    assert 970.0 < rho[ESTER] < 1060.0


def test_unknown_products_are_refused_with_those_that_exist() -> None:
    with pytest.raises(KeyError, match=r"olive oil.*MIL-PRF-5606.*MIL-PRF-83282"):
        fluid_named("olive oil")
    with pytest.raises(KeyError, match="MIL-PRF-87257"):
        with_fluid(PUMP, "olive oil")


def test_a_filled_pump_type_tells_its_fluid_with_sources_and_version() -> None:
    thin = with_fluid(PUMP, "MIL-PRF-87257")
    assert thin.pump.fluid == fluid_named("MIL-PRF-87257")
    assert thin.quantities["fluid.rho_ref"].si == thin.pump.fluid.rho_ref
    assert thin.pump._replace(fluid=PUMP.pump.fluid) == PUMP.pump
    assert numbers_hash(thin) != numbers_hash(PUMP)
    assert with_fluid(PUMP, None) is PUMP
    assert numbers_hash(with_fluid(PUMP, "MIL-PRF-83282")) == numbers_hash(PUMP)


def test_free_air_is_asked_for_and_softens_the_fluid() -> None:
    """Equation 2-1 in plain numbers: half a per cent of polytropic bubbles at 1.4 bar absolute, where the case stands."""
    airy = with_free_air(PUMP, USUAL_FREE_AIR.value)
    assert airy.quantities["fluid.air"].value == 0.005
    assert airy.pump._replace(fluid=PUMP.pump.fluid) == PUMP.pump
    P, T, d = 1.4e5, 323.15, 10.0
    m = medium_of(airy.pump.fluid, T)
    slope = (relative_density(m, P + d) - relative_density(m, P - d)) / (2.0 * d)
    ratio = 0.005 / 0.995 * (P_ATMOSPHERE / P) ** (1.0 / 1.2)
    expected = (1.0 / bulk_modulus(airy.pump.fluid, T, P) + ratio / (1.2 * P)) / (1.0 + ratio)
    assert slope / relative_density(m, P) == pytest.approx(expected, rel=1e-3)
    for share in (-0.1, 0.5):
        with pytest.raises(ValueError, match="free_air"):
            with_free_air(PUMP, share)


def test_laminar_leakage_goes_as_one_over_dynamic_viscosity() -> None:
    """Same gaps, same pressures: the pistons' share of case flow tells the viscosity in them."""
    condition = Condition(4600.0, 60.0, 0.5)
    own = operating_point(PUMP.pump, condition, CIRCUIT)
    other = operating_point(with_fluid(PUMP, "MIL-PRF-87257").pump, condition, CIRCUIT)
    ratio = float(other.value("piston_leakage_lpm")[0] / own.value("piston_leakage_lpm")[0])
    thin = math.exp(-ln_viscosity_ratio("MIL-PRF-87257", "MIL-PRF-83282", 60.0)) * 813.0 / 799.5
    assert ratio == pytest.approx(thin, rel=0.04)
    assert float((other.value("case_pressure_bar") - own.value("case_pressure_bar"))[0]) > 0.05


@pytest.mark.parametrize("name", PRODUCTS)
@pytest.mark.parametrize("health", [Health(), Health(slipper_leakage_scale=2.0), Health(throttled_leakage_lpm=0.8)])
def test_the_reference_condition_asks_for_wear_and_not_for_the_fluid(name: str, health: Health) -> None:
    """The acceptance limit of case flow was written for one fluid: another one is asked where it is as viscous."""
    acceptance = PUMP.limits["reference_temperature_k"].value - 273.15
    filled = with_fluid(PUMP, name)
    reference = filled.limits["reference_temperature_k"].value - 273.15
    on_the_stand = operating_point(PUMP.pump, Condition(4600.0, acceptance), CIRCUIT, health).value("case_flow_lpm")[0]
    here = operating_point(filled.pump, Condition(4600.0, reference), CIRCUIT, health).value("case_flow_lpm")[0]
    # flow through throttles goes by density, which no temperature makes equal: a fifth for the ester, a tenth of its root
    assert here == pytest.approx(on_the_stand, rel=0.04)
    again = with_fluid(filled, "MIL-PRF-83282").limits["reference_temperature_k"].value
    assert again - 273.15 == pytest.approx(acceptance, abs=1e-3)
    if name == "MIL-PRF-87257":
        same_temperature = operating_point(filled.pump, Condition(4600.0, acceptance), CIRCUIT, health)
        assert float(same_temperature.value("case_flow_lpm")[0]) > 1.25 * on_the_stand


@pytest.mark.parametrize("name", PRODUCTS)
def test_order_surfaces_follow_another_fluid(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """They were fitted with MIL-PRF-83282 in coordinates of leakage, which hold for any fluid: as good as their own."""
    kind = with_fluid(PUMP, name)
    monkeypatch.setattr(burst_surrogate, "KIND", kind)
    surfaces = order_surfaces("h225", "shared_return")
    for celsius, health in ((35.0, Health()), (85.0, Health()), (60.0, Health(slipper_leakage_scale=1.8))):
        condition = Condition(4600.0, celsius, 0.5)
        transient = abs(burst_surrogate.lines(condition, health, {})[0][:, 2])
        surface = order_amplitudes(surfaces, kind.pump, input_rows([condition], [health]))[0][:, 2]
        assert surface[0] == pytest.approx(transient[0], rel=0.03)
        assert surface[1] == pytest.approx(transient[1], rel=0.08)
