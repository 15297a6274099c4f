"""Hydraulic fluids as data: value, unit, source and uncertainty of every constant."""

from collections.abc import Mapping

from twin.laws.fluid import Fluid
from twin.parameters import Quantity, block

_D341 = "ASTM D341 through 14.0 cSt at 40 and 3.45 cSt at 100 degC, the mean of three published curves"
_EXACT_T = "reference temperature of the linear laws"

MIL_PRF_83282: Mapping[str, Quantity] = {
    "astm_a": Quantity(9.1206, "-", _D341, 0.05),
    "astm_b": Quantity(3.6275, "-", _D341),
    "rho_ref": Quantity(819.0, "kg/m3", "published density at 50 degC and 1 bar", 0.005),
    "rho_slope": Quantity(-0.625, "kg/(m3 K)", "slope of the published densities 838, 825, 813, 788 at 20 to 100 degC"),
    "T_ref": Quantity(323.15, "K", _EXACT_T),
    "B_ref": Quantity(14_250.0, "bar", "line through the published tangent moduli without air, 50 degC", 0.05),
    "B_slope": Quantity(-7.7e6, "Pa/K", "slope of 17200, 15020, 13290, 10700 bar at 20 to 100 degC", 0.1),
    "B_pressure_gain": Quantity(9.3, "-", "estimate: tangent modulus 10 to 13 % higher at 175 bar", 0.2),
    "alpha_p": Quantity(1.22e-8, "1/Pa", "pressure-viscosity coefficient at 50 degC, 1.22e-3 per bar", 0.1),
    "c_p": Quantity(2000.0, "J/(kg K)", "estimate: gives the published 11 K of heating from 175 bar", 0.05),
    "air": Quantity(
        0.0, "-", "free air by volume at 1 bar: none assumed in a bled aircraft circuit; 0.005 is usual elsewhere"
    ),
    "air_exponent": Quantity(1.2, "-", "estimate: between isothermal (1) and adiabatic (1.4) bubbles", 0.1),
}
"""Synthetic hydrocarbon fluid of the H225; viscosity within 5 % from 40 to 100 degC, within 20 % at 0 degC."""

FLUIDS: Mapping[str, Fluid] = {"MIL-PRF-83282": block(Fluid, MIL_PRF_83282)}
