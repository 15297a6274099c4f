"""Drive: what turns the shaft, and what its losses warm. Ports: barrel torque; motor; heat into films and case.

An ideal drive keeps the asked speed; one that gives way gains torque by the speed that is missing (figure 3-16).
"""

from twin.compiled import compiled
from twin.laws.fluid import P_ATMOSPHERE, Fluid, dynamic_viscosity, throttling_heating
from twin.parameters import Drive
from twin.units import KELVIN_AT_0_DEGC, RAD_PER_S_PER_RPM

T_REF, OMEGA_REF = KELVIN_AT_0_DEGC + 50.0, 4600.0 * RAD_PER_S_PER_RPM
"""Where the viscous torque is ``torque_viscous_ref``: 50 degC [K] and 4600 rpm [rad/s]."""
_ROUNDS = 40


@compiled
def viscous_torque(drive: Drive, fluid: Fluid, T: float, omega: float) -> float:
    """Viscous drag of the shaft [N m] at fluid temperature T [K] and speed omega [rad/s].

    The sliding films warm themselves by their own friction until ``film_conductance`` carries it off: cold fluid
    drags less than its viscosity says. Heat and temperature are one equation, ``G dT = torque(T + dT) omega``.
    """
    ref, G = drive.torque_viscous_ref, drive.film_conductance
    warmed_ref = ref * OMEGA_REF / G
    per_mu = ref * omega / OMEGA_REF / dynamic_viscosity(fluid, T_REF + warmed_ref, P_ATMOSPHERE)
    c = per_mu * omega / G
    if c <= 0.0:
        return per_mu * dynamic_viscosity(fluid, T, P_ATMOSPHERE)
    # the film's warming less the friction's grows and bends downwards: bounds that Newton may not leave
    low, high = 0.0, c * dynamic_viscosity(fluid, T, P_ATMOSPHERE)
    warmed = min(warmed_ref * (omega / OMEGA_REF) ** 2, high)
    for _ in range(_ROUNDS):
        friction = c * dynamic_viscosity(fluid, T + warmed, P_ATMOSPHERE)
        error = warmed - friction
        if error > 0.0:
            high = warmed
        else:
            low = warmed
        slope = 1.0 + (friction - c * dynamic_viscosity(fluid, T + warmed + 0.01, P_ATMOSPHERE)) * 100.0
        following = warmed - error / slope
        if not low <= following <= high:
            following = 0.5 * (low + high)
        moved = abs(following - warmed)
        warmed = following
        if moved < 1.0e-9:
            break
    return per_mu * dynamic_viscosity(fluid, T + warmed, P_ATMOSPHERE)


@compiled
def friction_torque(drive: Drive, viscous: float, dP: float) -> float:
    """Losses of the shaft beside the hydraulic work [N m]: viscous, and Coulomb by the pressure difference."""
    return viscous + drive.torque_pressure * dP


@compiled
def case_temperature(drive: Drive, fluid: Fluid, T: float, dP: float, Q_c: float, friction: float) -> float:
    """Temperature of the case's fluid [K] by a lumped balance of its heat.

    Parameters
    ----------
    T
        Of the fluid at the inlet [K].
    dP
        Discharge over case pressure [Pa]: the leakage is throttled by it.
    Q_c
        Case flow [m3/s]; what flows in through the drain carries nothing off.
    friction
        Power of the shaft's friction [W]; ``heat_share`` of it goes into the case, which gives it to the case flow and, by
        ``case_conductance``, to housing and through-flow.
    """
    carried = (fluid.rho_ref + fluid.rho_slope * (T - fluid.T_ref)) * fluid.c_p * max(Q_c, 0.0)
    return T + throttling_heating(fluid, T, dP, 0.0) + drive.heat_share * friction / (carried + drive.case_conductance)


@compiled
def speed_after(drive: Drive, omega: float, omega_asked: float, T_start: float, T_pump: float, dt: float) -> float:
    """Shaft speed after ``dt`` under the pump's torque, linearly implicit in the motor's own [rad/s]."""
    gained = T_start + drive.stiffness * omega_asked - T_pump
    return (drive.J * omega + dt * gained) / (drive.J + dt * drive.stiffness)
