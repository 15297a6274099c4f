"""The one place where units are converted.

Inside ``twin`` everything is SI with absolute pressures; bar (gauge), L/min, rpm and degC live at the edge
only, in names that carry the unit. Factors multiply an edge value to give the SI value; they are exact
except for the standard atmosphere, which is exact by definition (ISO 2533).
"""

import math

PA_PER_BAR = 1.0e5
M3_PER_S_PER_LPM = 1.0e-3 / 60.0
RAD_PER_S_PER_RPM = 2.0 * math.pi / 60.0
RAD_PER_DEG = math.pi / 180.0
KELVIN_AT_0_DEGC = 273.15
M2_PER_S_PER_CST = 1.0e-6
STANDARD_ATMOSPHERE_BAR = 1.01325

SI_PER_UNIT: dict[str, float] = {
    "-": 1.0,
    "m": 1.0,
    "mm": 1.0e-3,
    "um": 1.0e-6,
    "mm2": 1.0e-6,
    "cm3": 1.0e-6,
    "mm3": 1.0e-9,
    "L": 1.0e-3,
    "bar": PA_PER_BAR,
    "MPa": 1.0e6,
    "Pa": 1.0,
    "rad": 1.0,
    "deg": RAD_PER_DEG,
    "kg m2": 1.0,
    "g": 1.0e-3,
    "N": 1.0,
    "N/m": 1.0,
    "N/mm": 1.0e3,
    "N m": 1.0,
    "N m s": 1.0,
    "N s/m": 1.0,
    "N m/rad": 1.0,
    "K": 1.0,
    "kg/m3": 1.0,
    "kg/(m3 K)": 1.0,
    "Pa/K": 1.0,
    "1/Pa": 1.0,
    "1/um": 1.0e6,
    "mm/s": 1.0e-3,
    "rad/s": 1.0,
    "1/K": 1.0,
    "J/(kg K)": 1.0,
    "W/K": 1.0,
    "bar/(L/min)": PA_PER_BAR / M3_PER_S_PER_LPM,
    "bar/(L/min)^2": PA_PER_BAR / M3_PER_S_PER_LPM**2,
    "L/min": M3_PER_S_PER_LPM,
    "L/min/bar": M3_PER_S_PER_LPM / PA_PER_BAR,
    "rpm": RAD_PER_S_PER_RPM,
}
"""Factors of the units in which parameter sets are written; temperatures there are in K."""
