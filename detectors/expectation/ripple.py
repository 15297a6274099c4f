"""Lines at orders of the shaft against the twin: order n of both pressures, and what each fault does to it.

Order n of the *case* pressure is drawn by what the slippers let through: half a litre a minute more of it lifts the line
by more than half, where a leak of the circuit or a clogged drain moves it by some per cent. Amplitudes depend on the
volumes and lines of the aircraft: the pump's own ratio to the twin is part of the state, directions come from the twin.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from detectors.expectation.anchor import reference_condition
from detectors.expectation.components import INDEX, N_COMPONENTS
from detectors.expectation.reduced_twin import SLIPPER_VISCOSITY
from twin.condition import INPUTS, Condition, Health, input_rows
from twin.operating_point import operating_points
from twin.orders.surfaces import CHANNELS, OrderSurfaces, order_amplitudes, order_derivatives, order_surfaces
from twin.parameters import Circuit, PumpType

Array = NDArray[np.float64]

RIPPLE_SD = 0.012
CASE_RIPPLE_SD = 0.04
"""What the surfaces miss of order n from flight to flight, as a share (held-out runs: 0.4 and 2.5 % in the median, 1.1
and 9.5 % at the 95 % quantile, the greater part of it a bias that the pump's own ratio takes)."""
LINE_SD_BAR = 0.006
"""Wander of the once-per-turn line of a healthy pump from flight to flight (estimate)."""
_N_LINE = 2
"""Place of order n among the lines of ``twin.orders.surfaces``: 1, n - 1, n, n + 1, 2 n."""
_MOVES = {
    "ln_slipper": "slipper_leakage_scale",
    "ln_laminar": "port_plate_leakage_scale",
    "throttled": "throttled_leakage_lpm",
    "bleed": "control_bleed_lpm",
    "system_orifice": "system_leakage_lpm",
    "setting": "pressure_setting_change_bar",
    "ln_drain": "drain_resistance_scale",
    "ln_droop": "droop_scale",
}


def surfaces_of(pump: PumpType, circuit_name: str = "shared_return") -> OrderSurfaces | None:
    """Surfaces of the pump type, None where none were fitted: its bursts then speak of the once-per-turn line alone."""
    try:
        return order_surfaces(pump.name, circuit_name)
    except ValueError:
        return None


def ripples(
    conditions: Sequence[Condition], pump: PumpType, circuit: Circuit, surfaces: OrderSurfaces, system_law: Array
) -> tuple[Array, Array]:
    """Order n of the nominal pump and its relative slopes.

    Parameters
    ----------
    system_law
        What a laminar leak of the circuit is multiplied with at each condition, shape (m,).

    Returns
    -------
    amplitudes
        Of discharge and case pressure [bar], shape (m, 2).
    slopes
        Relative change per unit of each component, shape (m, 2, N_COMPONENTS).
    """
    rows = input_rows([c._replace(discharge_flow_lpm=0.0) for c in conditions], [Health()] * len(conditions))
    amplitudes = order_amplitudes(surfaces, pump.pump, rows)[:, :, _N_LINE]
    relative = order_derivatives(surfaces, pump.pump, rows)[:, :, _N_LINE] / amplitudes[:, :, None]
    slopes = np.zeros((len(rows), len(CHANNELS), N_COMPONENTS))
    for component, name in _MOVES.items():
        slopes[:, :, INDEX[component]] = relative[:, :, INPUTS.index(name)]
    # thicker fluid lets less through gaps, a little less than in proportion through a throttled slipper
    slopes[:, :, INDEX["ln_viscosity"]] = (
        -SLIPPER_VISCOSITY * slopes[:, :, INDEX["ln_slipper"]] - slopes[:, :, INDEX["ln_laminar"]]
    )
    reference = input_rows([reference_condition(pump)], [Health()])
    at = operating_points(pump.pump, reference, circuit)
    # leakage on top of the nominal one counts at the reference: a share of what leaks there
    slippers, plate = (float(at.value(f"{part}_leakage_lpm")[0]) for part in ("slipper", "port_plate"))
    slopes[:, :, INDEX["slipper_extra"]] = slopes[:, :, INDEX["ln_slipper"]] / slippers
    slopes[:, :, INDEX["laminar_extra"]] = slopes[:, :, INDEX["ln_laminar"]] / plate
    slopes[:, :, INDEX["system_laminar"]] = slopes[:, :, INDEX["system_orifice"]] * system_law[:, None]
    return amplitudes, slopes
