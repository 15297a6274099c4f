"""From a parameter set to an operating map in twelve lines: delivery limit and case flow over speed."""

import numpy as np

from twin.operating_point.operating_map import operating_map
from twin.pumps import circuit_parameters, pump_type

kind = pump_type("h225")
speeds, flows = np.linspace(2000.0, 5500.0, 8), np.linspace(0.0, 30.0, 16)
found = operating_map(kind, circuit_parameters("shared_return"), speeds, flows, fluid_temperature_degc=60.0)
most = np.where(np.isfinite(found["discharge_pressure_bar"]), flows, 0.0).max(axis=1)
for speed, flow, case in zip(speeds, most, found["case_flow_lpm"][:, 0], strict=True):
    print(f"{speed:.0f} rpm: {flow:.0f} L/min at most, {case:.2f} L/min case flow at zero flow")
