"""The H225's pump as the thesis' own simulations show it, not as the acceptance sheet does: for comparison with it.

Only what differs from ``h225`` stands here. Fitted to table 2-13 on the rig of ``twin.validation.slipper_rig``: balance
ratio, throttle and retainer of the slippers, with the repairs of section 2.6.3 off; the three are one solution of
many (a lighter piston asks for another). Fitted to the nominal point of table 4-3: pitch circle (discharge flow),
viscosity (case flow), piston clearance (leakage of the pistons). Table 4-3 has constant gaps: ``variable`` 0 there.
"""

from collections.abc import Mapping
from dataclasses import replace

from twin.laws.fluid import Fluid
from twin.parameters import Piston, Quantity, Slipper, block
from twin.pumps.fluids import MIL_PRF_83282
from twin.pumps.h225 import H225, PISTON, SLIPPER

_FIT_2_13 = "fitted to table 2-13 together with the other two; not unique"
_FIT_4_3 = "fitted to table 4-3"
_PRINTED = "the thesis prints 15 cSt at 50 and 3 cSt at 100 degC (section 3.3.1): ASTM D341 through 14.73 and 3"

THESIS_PISTON: Mapping[str, Quantity] = {
    **PISTON,
    "R": Quantity(17.19, "mm", f"{_FIT_4_3}: 26.87 L/min at static point 2, which its return pressure asks for"),
    "b": Quantity(5.59, "um", f"{_FIT_4_3}: three pistons leak 0.0024 L/min there"),
}
THESIS_SLIPPER: Mapping[str, Quantity] = {
    **SLIPPER,
    "h": Quantity(15.7, "um", "Mkadara 2020, table 3-9 (average of scattered fits)", 0.39),
    "d_throttle": Quantity(0.685, "mm", _FIT_2_13),
    "variable": Quantity(1, "-", "gap by the forces on the slipper, section 2.6.2"),
    "balance": Quantity(1.022759, "-", _FIT_2_13),
    "h_retainer": Quantity(75.703, "um", f"{_FIT_2_13}; several times what a retainer leaves in a real pump"),
    "squeeze": Quantity(0.0, "-", "not in the thesis' model: second repair of section 2.6.3"),
    "pumped_repair": Quantity(0.0, "-", "not in the thesis' model: first repair of section 2.6.3"),
}
THESIS_FLUID: Mapping[str, Quantity] = {
    **MIL_PRF_83282,
    "astm_a": Quantity(12.945338, "-", f"{_PRINTED}; 14.73 is {_FIT_4_3}"),
    "astm_b": Quantity(5.128862, "-", _PRINTED),
}

_CHANGED: Mapping[str, Mapping[str, Quantity]] = {
    "piston": THESIS_PISTON,
    "slipper": THESIS_SLIPPER,
    "fluid": THESIS_FLUID,
}

H225_THESIS = replace(
    H225,
    name="h225_thesis",
    title="H225 main hydraulic pump as simulated in Mkadara 2020",
    pump=H225.pump._replace(
        piston=block(Piston, THESIS_PISTON),
        slipper=block(Slipper, THESIS_SLIPPER),
        fluid=block(Fluid, THESIS_FLUID),
    ),
    quantities={
        **H225.quantities,
        **{f"{part}.{name}": q for part, fields in _CHANGED.items() for name, q in fields.items()},
    },
)
