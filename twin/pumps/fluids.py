"""Hydraulic fluids as data: value, unit, source and uncertainty of every constant, by the name of the product.

Viscosity is ASTM D341 through two points. What a product leaves open is stated apart: the curve itself, batches and
brands of one specification, and what service does to it. Limits of the specifications are quoted as such; where no
published value is at hand the source says "estimate".
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from twin.laws.fluid import P_ATMOSPHERE, Fluid, gap_viscosity, kinematic_viscosity
from twin.numbers import ZERO_FLOW_PRESSURE
from twin.parameters import PumpType, Quantity, block
from twin.parts.geometry import MOST_FREE_AIR
from twin.units import KELVIN_AT_0_DEGC

_EXACT_T = "reference temperature of the linear laws"
_T_REF = Quantity(323.15, "K", _EXACT_T)
_NO_AIR = Quantity(
    0.0, "-", "free air by volume at 1 bar: none assumed in a bled aircraft circuit; 0.005 is usual elsewhere"
)
USUAL_FREE_AIR = Quantity(
    0.005,
    "-",
    "estimate: free air by volume at 1 bar in a circuit that was not bled; dissolved air does not count",
    0.5,
)
"""What ``with_free_air`` is asked with where nothing else is known; the products themselves hold none."""
_AIR_EXPONENT = Quantity(1.2, "-", "estimate: between isothermal (1) and adiabatic (1.4) bubbles", 0.1)
SPREAD_DEGC: tuple[float, ...] = (0.0, 40.0, 100.0)
"""Temperatures at which a product's spreads of viscosity are stated [degC]."""
Spread = tuple[float, float, float]
_COLDEST, _HOTTEST, _SAME_K = 223.15, 423.15, 1e-6
"""Where a temperature of equal viscosity is looked for, and how closely [K]."""


@dataclass(frozen=True, slots=True)
class Product:
    """A fluid as its specification and its makers describe it.

    Attributes
    ----------
    name
        As aircraft documents name it; key of ``FLUIDS``.
    quantities
        Every constant of ``twin.laws.fluid.Fluid``; uncertainty is relative, one sigma.
    curve_sd, batch_sd, service_sd
        Relative one-sigma spreads of viscosity at ``SPREAD_DEGC``: of the published curve, between batches and brands
        that meet the specification, and by what service does (shear, absorbed water) [-].
    why
        Where the three spreads come from.
    """

    name: str
    quantities: Mapping[str, Quantity]
    curve_sd: Spread
    batch_sd: Spread
    service_sd: Spread
    why: str

    @property
    def fluid(self) -> Fluid:
        """The constants in SI, as kernels take them."""
        return block(Fluid, self.quantities)

    def viscosity_sd(self, celsius: float) -> float:
        """Relative one-sigma uncertainty of viscosity in an aircraft that names this product [-]; ends are held."""
        parts = (np.interp(celsius, SPREAD_DEGC, sd) for sd in (self.curve_sd, self.batch_sd, self.service_sd))
        return math.hypot(*(float(p) for p in parts))


def _through(at_40: float, at_100: float, source: str) -> dict[str, Quantity]:
    """ASTM D341 constants of the curve through two viscosities at 40 and 100 degC [cSt]."""
    warm, hot = 40.0 + KELVIN_AT_0_DEGC, 100.0 + KELVIN_AT_0_DEGC
    high, low = (math.log10(math.log10(nu + 0.7)) for nu in (at_40, at_100))
    slope = (high - low) / math.log10(hot / warm)
    words = f"ASTM D341 through {at_40:g} cSt at 40 and {at_100:g} cSt at 100 degC: {source}"
    # how far viscosity is uncertain stands with the product: a spread of these constants would say nothing readable
    return {
        "astm_a": Quantity(high + slope * math.log10(warm), "-", words),
        "astm_b": Quantity(slope, "-", words),
    }


_D341 = "ASTM D341 through 14.0 cSt at 40 and 3.45 cSt at 100 degC, the mean of three published curves"

MIL_PRF_83282: Mapping[str, Quantity] = {
    "astm_a": Quantity(9.1206, "-", _D341, 0.05),
    "astm_b": Quantity(3.6275, "-", _D341),
    "rho_ref": Quantity(819.0, "kg/m3", "published density at 50 degC and 1 bar", 0.005),
    "rho_slope": Quantity(-0.625, "kg/(m3 K)", "slope of the published densities 838, 825, 813, 788 at 20 to 100 degC"),
    "T_ref": _T_REF,
    "B_ref": Quantity(14_250.0, "bar", "line through the published tangent moduli without air, 50 degC", 0.05),
    "B_slope": Quantity(-7.7e6, "Pa/K", "slope of 17200, 15020, 13290, 10700 bar at 20 to 100 degC", 0.1),
    "B_pressure_gain": Quantity(9.3, "-", "estimate: tangent modulus 10 to 13 % higher at 175 bar", 0.2),
    "alpha_p": Quantity(1.22e-8, "1/Pa", "pressure-viscosity coefficient at 50 degC, 1.22e-3 per bar", 0.1),
    "c_p": Quantity(2000.0, "J/(kg K)", "estimate: gives the published 11 K of heating from 175 bar", 0.05),
    "air": _NO_AIR,
    "air_exponent": _AIR_EXPONENT,
}
"""Synthetic hydrocarbon fluid of the H225; viscosity within 5 % from 40 to 100 degC, within 20 % at 0 degC."""

MIL_PRF_5606: Mapping[str, Quantity] = {
    **_through(
        13.1,
        4.7,
        "half way between fresh fluid (13.8 and 5.1; MIL-PRF-5606H asks for 13.2 and 4.90 at least) and fluid sheared in "
        "service (estimate: 12.4 and 4.2)",
    ),
    "rho_ref": Quantity(837.0, "kg/m3", "estimate: 0.860 to 0.875 at 15 degC, brought to 50 degC", 0.01),
    "rho_slope": Quantity(-0.70, "kg/(m3 K)", "estimate: expansion of a light mineral oil, 8.4e-4 per K", 0.1),
    "T_ref": _T_REF,
    "B_ref": Quantity(
        13_800.0,
        "bar",
        "estimate: near the least isothermal secant modulus of MIL-PRF-5606H, 1379 MPa at 40 degC",
        0.07,
    ),
    "B_slope": Quantity(-7.7e6, "Pa/K", "estimate: that of MIL-PRF-83282", 0.2),
    "B_pressure_gain": Quantity(9.3, "-", "estimate: that of MIL-PRF-83282", 0.2),
    "alpha_p": Quantity(1.4e-8, "1/Pa", "estimate: a naphthenic base thickens more under pressure", 0.2),
    "c_p": Quantity(2000.0, "J/(kg K)", "estimate: light mineral oil at 50 degC", 0.05),
    "air": _NO_AIR,
    "air_exponent": _AIR_EXPONENT,
}
"""Mineral fluid with a viscosity improver that shears in service: fresh and old fluid differ by a tenth and more."""

MIL_PRF_87257: Mapping[str, Quantity] = {
    **_through(
        6.8, 2.3, "middle of what fleets report, 6 to 7.3 and 2.0 to 2.6; MIL-PRF-87257 asks for 6.7 and 2.0 at least"
    ),
    "rho_ref": Quantity(806.0, "kg/m3", "estimate: 0.83 at 15 degC, brought to 50 degC", 0.01),
    "rho_slope": Quantity(-0.65, "kg/(m3 K)", "estimate: a little above MIL-PRF-83282, being the lighter base", 0.1),
    "T_ref": _T_REF,
    "B_ref": Quantity(
        13_500.0,
        "bar",
        "estimate: near the least isothermal secant modulus of MIL-PRF-87257, 1379 MPa at 40 degC",
        0.07,
    ),
    "B_slope": Quantity(-7.7e6, "Pa/K", "estimate: that of MIL-PRF-83282", 0.2),
    "B_pressure_gain": Quantity(9.3, "-", "estimate: that of MIL-PRF-83282", 0.2),
    "alpha_p": Quantity(1.15e-8, "1/Pa", "estimate: a little below MIL-PRF-83282, being the lighter base", 0.2),
    "c_p": Quantity(2050.0, "J/(kg K)", "estimate: polyalphaolefin at 50 degC", 0.05),
    "air": _NO_AIR,
    "air_exponent": _AIR_EXPONENT,
}
"""Synthetic hydrocarbon fluid for low temperatures: half as viscous as MIL-PRF-83282."""

AS1241_PHOSPHATE_ESTER: Mapping[str, Quantity] = {
    **_through(10.0, 3.5, "middle of the qualified fluids of Type IV and V, 9 to 11 and 3.1 to 3.9"),
    "rho_ref": Quantity(983.0, "kg/m3", "estimate: 0.98 to 1.06 at 25 degC, brought to 50 degC", 0.025),
    "rho_slope": Quantity(-0.87, "kg/(m3 K)", "estimate: expansion of 8.8e-4 per K", 0.1),
    "T_ref": _T_REF,
    "B_ref": Quantity(14_900.0, "bar", "estimate: isothermal tangent modulus without air, 50 degC", 0.08),
    "B_slope": Quantity(-8.0e6, "Pa/K", "estimate: a little steeper than MIL-PRF-83282", 0.2),
    "B_pressure_gain": Quantity(9.3, "-", "estimate: that of MIL-PRF-83282", 0.2),
    "alpha_p": Quantity(1.1e-8, "1/Pa", "estimate: alkyl phosphates thicken little under pressure", 0.25),
    "c_p": Quantity(1750.0, "J/(kg K)", "estimate: makers state 0.42 cal/(g K) near 50 degC", 0.05),
    "air": _NO_AIR,
    "air_exponent": _AIR_EXPONENT,
}
"""Fire-resistant fluids of SAE AS1241, Type IV and V together: an aircraft's documents allow either, and mixtures."""

PRODUCTS: Mapping[str, Product] = {
    product.name: product
    for product in (
        Product(
            "MIL-PRF-83282",
            MIL_PRF_83282,
            curve_sd=(0.10, 0.025, 0.025),
            batch_sd=(0.04, 0.03, 0.03),
            service_sd=(0.0, 0.0, 0.0),
            why="5 % from 40 to 100 degC and 20 % at 0 degC as two sigma; batches an estimate; nothing in it shears",
        ),
        Product(
            "MIL-PRF-5606",
            MIL_PRF_5606,
            curve_sd=(0.15, 0.025, 0.025),
            batch_sd=(0.04, 0.03, 0.03),
            service_sd=(0.03, 0.03, 0.055),
            why="curve and batches as MIL-PRF-83282, but the curve falls behind where the improver thickens in the cold "
            "(estimate); service: from fresh to sheared as a uniform spread, 10 % of viscosity at 40 and 18 % at 100 degC",
        ),
        Product(
            "MIL-PRF-87257",
            MIL_PRF_87257,
            curve_sd=(0.10, 0.05, 0.055),
            batch_sd=(0.05, 0.035, 0.04),
            service_sd=(0.0, 0.0, 0.0),
            why="estimate: reported values as a range of two sigma; nothing in it shears",
        ),
        Product(
            "AS1241 Type IV/V phosphate ester",
            AS1241_PHOSPHATE_ESTER,
            curve_sd=(0.12, 0.03, 0.03),
            batch_sd=(0.08, 0.06, 0.065),
            service_sd=(0.05, 0.05, 0.06),
            why="estimate: qualified fluids of both types as a uniform spread; their improver shears, and water thins",
        ),
    )
}
"""Every product that the twin has properties of."""

FLUIDS: Mapping[str, Fluid] = {name: product.fluid for name, product in PRODUCTS.items()}
"""Their constants by the name of the product."""


def fluid_named(name: str) -> Fluid:
    """Constants of a product.

    Raises
    ------
    KeyError
        naming the products that exist.
    """
    if name not in FLUIDS:
        raise KeyError(f"no fluid {name!r}; known: {', '.join(sorted(FLUIDS))}")
    return FLUIDS[name]


def with_fluid(kind: PumpType, name: str | None) -> PumpType:
    """The pump type filled with a product: its constants, and their sources among the type's quantities.

    The reference condition moves to the temperature at which the gaps see the viscosity of the type's own fluid at its
    own: a limit of the acceptance sheet means wear, and half the viscosity is no wear. None leaves the type's own fluid.

    Raises
    ------
    KeyError
        naming the products that exist.
    """
    if name is None:
        return kind
    fluid = fluid_named(name)
    quantities = {**kind.quantities, **{f"fluid.{key}": q for key, q in PRODUCTS[name].quantities.items()}}
    limits = dict(kind.limits)
    if fluid != kind.pump.fluid:
        acceptance = limits["reference_temperature_k"]
        T = _as_viscous_at(fluid, kind.pump.fluid, acceptance.si)
        source = f"as viscous in the gaps as the type's own fluid at {acceptance.value:g} K; {acceptance.source}"
        limits["reference_temperature_k"] = replace(acceptance, value=T, source=source)
    return replace(kind, pump=kind.pump._replace(fluid=fluid), quantities=quantities, limits=limits)


def with_free_air(kind: PumpType, share: float) -> PumpType:
    """The pump type with so much free air in its fluid, by volume at ambient pressure [-].

    Raises
    ------
    ValueError
        for a share that no liquid with bubbles has.
    """
    if not 0.0 <= share <= MOST_FREE_AIR:
        raise ValueError(f"free_air = {share:g} (allowed: 0 to {MOST_FREE_AIR:g} by volume at 1 bar)")
    air = Quantity(share, "-", "asked for: free air by volume at 1 bar")
    fluid = kind.pump.fluid._replace(air=share)
    return replace(kind, pump=kind.pump._replace(fluid=fluid), quantities={**kind.quantities, "fluid.air": air})


@lru_cache(maxsize=256)
def _as_viscous_at(fluid: Fluid, other: Fluid, T: float) -> float:
    """Temperature [K] at which a fluid has the viscosity in gaps at zero flow that another one has at ``T`` [K]."""
    wanted = _in_gaps(other, T)
    low, high = _COLDEST, _HOTTEST
    # viscosity falls steadily with temperature
    while high - low > _SAME_K:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _in_gaps(fluid, middle) > wanted else (low, middle)
    return 0.5 * (low + high)


def _in_gaps(fluid: Fluid, T: float) -> float:
    return gap_viscosity(fluid, T, P_ATMOSPHERE + ZERO_FLOW_PRESSURE, P_ATMOSPHERE)


def ln_viscosity_ratio(name: str, other: str, celsius: float) -> float:
    """Logarithm of one product's kinematic viscosity over another's at a temperature [degC] and ambient pressure [-].

    Raises
    ------
    KeyError
        naming the products that exist.
    """
    T = celsius + KELVIN_AT_0_DEGC
    return math.log(kinematic_viscosity(fluid_named(name), T) / kinematic_viscosity(fluid_named(other), T))
