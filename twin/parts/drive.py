"""Drive: what turns the shaft. Ports: barrel torque; motor.

An ideal drive keeps the asked speed; one that gives way gains torque by the speed that is missing (figure 3-16).
"""

from twin.compiled import compiled
from twin.parameters import Drive


@compiled
def friction_torque(drive: Drive, mu_ratio: float, omega_ratio: float, dP: float) -> float:
    """Losses of the shaft beside the hydraulic work [N m]: viscous, and Coulomb by the pressure difference."""
    return drive.torque_viscous_ref * mu_ratio * omega_ratio + drive.torque_pressure * dP


@compiled
def speed_after(drive: Drive, omega: float, omega_asked: float, T_start: float, T_pump: float, dt: float) -> float:
    """Shaft speed after ``dt`` under the pump's torque, linearly implicit in the motor's own [rad/s]."""
    gained = T_start + drive.stiffness * omega_asked - T_pump
    return (drive.J * omega + dt * gained) / (drive.J + dt * drive.stiffness)
