"""Circuits around the pump: the thesis' test bench, a separate drain line, the acceptance stand."""

from collections.abc import Mapping

from twin.parameters import Circuit, Quantity, block

_TABLE = "Mkadara 2020, table 3-4"
_SLOPE = f"{_TABLE}: the change from 50 to 100 degC, taken as linear (our choice; two points)"
_REFERENCE = Quantity(323.15, "K", "the 50 degC column of table 3-4")

SHARED_RETURN: Mapping[str, Quantity] = {
    "shared": Quantity(1.0, "-", "Mkadara 2020, figure 3-20: drain and load share the return line"),
    "k_c": Quantity(0.290, "bar/(L/min)", _TABLE, 0.2),
    "k_c_slope": Quantity((0.300 / 0.290 - 1.0) / 50.0, "1/K", _SLOPE),
    "w_nu": Quantity(0.0, "-", "equation 3-3: laminar with a constant coefficient", 0.4),
    "w_Q": Quantity(0.0, "-", "equation 3-3: laminar with a constant coefficient", 0.4),
    "Q_ref": Quantity(1.0, "L/min", "case flow at which the weights of the drain law are counted (definition)"),
    "k_inf": Quantity(0.00206, "bar/(L/min)^2", _TABLE),
    "k_inf_slope": Quantity((0.00158 / 0.00206 - 1.0) / 50.0, "1/K", _SLOPE),
    "K": Quantity(22.8, "L/min", _TABLE),
    "K_slope": Quantity((32.8 / 22.8 - 1.0) / 50.0, "1/K", _SLOPE),
    "gamma": Quantity(1.0, "-", _TABLE),
    "T_ref": _REFERENCE,
}

SEPARATE_DRAIN: Mapping[str, Quantity] = {
    **SHARED_RETURN,
    "shared": Quantity(0.0, "-", "the drain has its own line to the reservoir"),
    "k_c": Quantity(0.337, "bar/(L/min)", f"{_TABLE}, k_cr: the same resistance from case to reservoir", 0.2),
    "k_c_slope": Quantity((0.352 / 0.337 - 1.0) / 50.0, "1/K", _SLOPE),
}

_SHEET = "fitted to case pressures 0.8 and 0.4 bar at 1.39 and 0.83 L/min, inlet 0.1 bar, annex A-4 (each +-0.05 bar)"

ACCEPTANCE_STAND: Mapping[str, Quantity] = {
    **SEPARATE_DRAIN,
    "k_c": Quantity(0.5036, "bar/(L/min)", _SHEET, 0.1),
    "k_c_slope": Quantity(0.0, "1/K", "one temperature measured"),
    "w_Q": Quantity(0.703, "-", _SHEET, 0.2),
    "Q_ref": Quantity(1.39, "L/min", "case flow at zero flow of annex A-4"),
}

CIRCUIT_QUANTITIES: Mapping[str, Mapping[str, Quantity]] = {
    "shared_return": SHARED_RETURN,
    "separate_drain": SEPARATE_DRAIN,
    "acceptance_stand": ACCEPTANCE_STAND,
}
CIRCUITS: Mapping[str, Circuit] = {name: block(Circuit, q) for name, q in CIRCUIT_QUANTITIES.items()}
