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
