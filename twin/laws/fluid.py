"""Properties of a hydraulic fluid as functions of temperature [K] and absolute pressure [Pa]."""

import math
from typing import NamedTuple

from twin.compiled import compiled
from twin.numbers import ZERO_FLOW_PRESSURE

P_ATMOSPHERE = 101_325.0
_LN_10 = math.log(10.0)


class Fluid(NamedTuple):
    """Constants of one fluid, SI; see ``twin.pumps.fluids`` for the sets with units, sources and uncertainty."""

    astm_a: float
    astm_b: float
    rho_ref: float
    rho_slope: float
    T_ref: float
    B_ref: float
    B_slope: float
    B_pressure_gain: float
    alpha_p: float
    c_p: float
    air: float
    air_exponent: float


@compiled
def kinematic_viscosity(fluid: Fluid, T: float) -> float:
    """Kinematic viscosity at ambient pressure by ASTM D341 [m2/s].

    ``nu[cSt] = 10**(10**(A - B log10 T)) - 0.7`` with T in K; validated for the sets' stated range only.
    """
    # written with e instead of 10, half the price: this is the law that the solvers call most
    return (math.exp(_LN_10 * math.exp(_LN_10 * fluid.astm_a - fluid.astm_b * math.log(T))) - 0.7) * 1.0e-6


@compiled
def bulk_modulus(fluid: Fluid, T: float, P: float) -> float:
    """Isothermal tangent bulk modulus of the air-free fluid [Pa], linear in temperature and pressure."""
    return fluid.B_ref + fluid.B_slope * (T - fluid.T_ref) + fluid.B_pressure_gain * (P - P_ATMOSPHERE)


@compiled
def density(fluid: Fluid, T: float, P: float) -> float:
    """Density of the air-free fluid [kg/m3]: linear in temperature at ambient pressure, compressed with the modulus."""
    rho_0 = fluid.rho_ref + fluid.rho_slope * (T - fluid.T_ref)
    return rho_0 * (1.0 + (P - P_ATMOSPHERE) / bulk_modulus(fluid, T, P))


@compiled
def dynamic_viscosity(fluid: Fluid, T: float, P: float) -> float:
    """Dynamic viscosity [Pa s]: ambient value times Barus' exp(alpha (P - P_atm))."""
    rho_0 = fluid.rho_ref + fluid.rho_slope * (T - fluid.T_ref)
    return rho_0 * kinematic_viscosity(fluid, T) * math.exp(fluid.alpha_p * (P - P_ATMOSPHERE))


@compiled
def throttling_heating(fluid: Fluid, T: float, P_0: float, P_1: float) -> float:
    """Temperature rise of fluid throttled from P_0 to P_1 without heat loss or work [K]: dP / (rho c_p)."""
    rho_0 = fluid.rho_ref + fluid.rho_slope * (T - fluid.T_ref)
    return (P_0 - P_1) / (rho_0 * fluid.c_p)


@compiled
def gap_viscosity(fluid: Fluid, T: float, P_0: float, P_1: float) -> float:
    """Effective dynamic viscosity in a gap from P_0 to P_1 fed at temperature T [Pa s].

    Taken at the mean pressure and at the feed temperature plus half of the throttling heating: pressure and
    temperature both fall off linearly along a laminar gap, so their middle stands for the whole.
    """
    T_mean = T + 0.5 * throttling_heating(fluid, T, max(P_0, P_1), min(P_0, P_1))
    return dynamic_viscosity(fluid, T_mean, 0.5 * (P_0 + P_1))


class Film(NamedTuple):
    """Viscosity in gaps at one temperature: ``gap_viscosity`` with its logarithm linear in both pressures.

    ``mu_0`` at ambient pressure [Pa s]; ``slope`` of the logarithm by the pressure difference, with half of the heating,
    and ``barus`` by the pressure where the gap ends [1/Pa].
    """

    mu_0: float
    slope: float
    barus: float


@compiled
def film_of(fluid: Fluid, T: float) -> Film:
    """Film of a fluid fed at temperature T [K]: exact at no pressure difference and at 175 bar."""
    mu_0 = gap_viscosity(fluid, T, P_ATMOSPHERE, P_ATMOSPHERE)
    slope = (
        math.log(gap_viscosity(fluid, T, P_ATMOSPHERE + ZERO_FLOW_PRESSURE, P_ATMOSPHERE) / mu_0) / ZERO_FLOW_PRESSURE
    )
    return Film(mu_0, slope, fluid.alpha_p)


@compiled
def viscosity_factor(x: float) -> float:
    """exp(x) as the eighth power of exp(x/8) by its series, within 1e-13 for |x| < 0.5 and 4e-9 for |x| < 2: viscosity by
    pressure without a division.
    """
    y = 0.125 * x
    e = 1.0 + y * 0.2 * (1.0 + y * (1.0 / 6.0) * (1.0 + y * (1.0 / 7.0)))
    e = 1.0 + y * (1.0 + y * 0.5 * (1.0 + y * (1.0 / 3.0) * (1.0 + y * 0.25 * e)))
    e *= e
    e *= e
    return e * e


@compiled
def film_viscosity(film: Film, P_0: float, P_1: float) -> float:
    """Effective dynamic viscosity in a gap from P_0 to P_1 [Pa s]; fed backwards it counts as unloaded."""
    return film.mu_0 * viscosity_factor(film.slope * max(P_0 - P_1, 0.0) + film.barus * (P_1 - P_ATMOSPHERE))


@compiled
def relative_fluidity(film: Film, P_0: float, P_1: float) -> float:
    """``mu_0`` over ``film_viscosity`` [-]: for kernels that multiply by it several times."""
    return viscosity_factor(-film.slope * max(P_0 - P_1, 0.0) - film.barus * (P_1 - P_ATMOSPHERE))
