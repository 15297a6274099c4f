"""Which quantity stands in which column: names for the rows of inputs and outputs that kernels take and give.

Plain whole numbers, so that a compiled kernel sees a constant.
"""

from twin.condition import INPUTS, OUTPUTS

# conditions
SPEED = INPUTS.index("speed_rpm")
TEMPERATURE = INPUTS.index("fluid_temperature_degc")
RESERVOIR = INPUTS.index("reservoir_pressure_bar")
ASKED_FLOW = INPUTS.index("discharge_flow_lpm")
AMBIENT = INPUTS.index("ambient_pressure_bar")

# health
PUMP_SCALE = INPUTS.index("pump_leakage_scale")
SLIPPER_SCALE = INPUTS.index("slipper_leakage_scale")
PISTON_SCALE = INPUTS.index("piston_leakage_scale")
PORT_PLATE_SCALE = INPUTS.index("port_plate_leakage_scale")
CONTROL_BLEED = INPUTS.index("control_bleed_lpm")
SYSTEM_LEAKAGE = INPUTS.index("system_leakage_lpm")
SETTING_CHANGE = INPUTS.index("pressure_setting_change_bar")
DRAIN_SCALE = INPUTS.index("drain_resistance_scale")
DRAIN_VISCOSITY_CHANGE = INPUTS.index("drain_viscosity_weight_change")
DRAIN_FLOW_CHANGE = INPUTS.index("drain_flow_weight_change")
DROOP_SCALE = INPUTS.index("droop_scale")
THROTTLED_LEAKAGE = INPUTS.index("throttled_leakage_lpm")
EDGE_ROUNDING = INPUTS.index("edge_rounding_um")

# outputs
DISCHARGE_PRESSURE = OUTPUTS.index("discharge_pressure_bar")
CASE_PRESSURE = OUTPUTS.index("case_pressure_bar")
RETURN_PRESSURE = OUTPUTS.index("return_pressure_bar")
CONTROL_PRESSURE = OUTPUTS.index("control_pressure_bar")
SWASHPLATE_ANGLE = OUTPUTS.index("swashplate_angle_deg")
DISCHARGE_FLOW = OUTPUTS.index("discharge_flow_lpm")
CASE_FLOW = OUTPUTS.index("case_flow_lpm")
SHAFT_TORQUE = OUTPUTS.index("shaft_torque_nm")
PISTON_LEAKAGE = OUTPUTS.index("piston_leakage_lpm")
SLIPPER_LEAKAGE = OUTPUTS.index("slipper_leakage_lpm")
PORT_PLATE_LEAKAGE = OUTPUTS.index("port_plate_leakage_lpm")
COMPENSATOR_LEAKAGE = OUTPUTS.index("compensator_leakage_lpm")
SUCTION_FLOW = OUTPUTS.index("suction_flow_lpm")
CASE_TEMPERATURE = OUTPUTS.index("case_temperature_degc")
