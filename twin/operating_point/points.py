"""Operating point: the cycle-averaged steady state of pump plus circuit, for one or for many conditions.

Validated against the acceptance sheet of one real pump (Mkadara 2020, annex A-4) at zero and at full flow and
against the bench of table 3-4 at 50 degC; elsewhere it rests on the laws of sections 2.4 and 3.3.1.
"""

import numpy as np
from numpy.typing import NDArray

from twin.condition import INPUTS, OUTPUTS, RANGES, RESERVOIR_RANGE_BAR, Condition, Health, OperatingPoints, input_rows
from twin.operating_point.derivatives import N_GAUGE
from twin.operating_point.solver import DEMAND_TOO_HIGH, NOT_CONVERGED, NOT_FINITE, OUT_OF_RANGE, solve_batch
from twin.parameters import Circuit, Pump
from twin.parts.slipper_map import NO_MAP, SlipperMap
from twin.slipper_maps import stored_map

BELOW_VACUUM = 5
"""Status of a steady state that would need an absolute pressure below zero."""

PROBLEMS: dict[int, str] = {
    NOT_FINITE: "an input is not a number: give every condition, health value and load as a finite number",
    OUT_OF_RANGE: "an input is outside the model's range",
    DEMAND_TOO_HIGH: "the asked flow is more than the pump delivers at this speed: "
    "ask for less flow, more speed, or give the load as a resistance",
    NOT_CONVERGED: "no steady state was found: check that health values describe a pump that still regulates "
    "and that a load given as a resistance holds some pressure",
    BELOW_VACUUM: "an absolute pressure would lie below zero: fluid cannot be pulled, so there is no such steady state; "
    "ask for less flow or leakage, or give the reservoir more pressure",
}


def slipper_model(pump: Pump) -> SlipperMap:
    """Metamodel of a pump's variable slipper gap as kernels take it; ``NO_MAP`` where the gap is ``slipper.h``."""
    stored = stored_map(pump)
    return NO_MAP if stored is None else stored.model


def evenly_worn(pump: Pump, clearances: NDArray[np.float64]) -> tuple[Pump, float]:
    """A pump whose pistons are equal, in place of one with uneven clearances, and its ``piston_leakage_scale`` [-].

    Leakage goes with the cube of a clearance, the fluid that a piston drags along (2-9) with the clearance itself: the
    equal pistons have the mean clearance, and the scale lifts their leakage to the mean of the cubes.

    Parameters
    ----------
    clearances
        Factors on ``piston.b``, one of each piston, shape (n,), not negative.
    """
    mean = float(np.mean(clearances))
    if mean <= 0.0:
        return pump, 0.0
    scale = float(np.mean((clearances / mean) ** 3))
    return pump._replace(piston=pump.piston._replace(b=pump.piston.b * mean)), scale


def operating_points(
    pump: Pump,
    rows: NDArray[np.float64],
    circuit: Circuit,
    *,
    derivatives: bool = False,
    load_coefficient: NDArray[np.float64] | float = 0.0,
) -> OperatingPoints:
    """Steady states for many conditions at once.

    Parameters
    ----------
    pump
        Kernel parameters of a pump type (``twin.pumps.pump_type("h225").pump``).
    rows
        Conditions and health in the order of ``twin.condition.INPUTS``, shape (n, len(INPUTS)).
    circuit
        What the ports see (``twin.pumps.circuit_parameters``).
    derivatives
        Also give d(output)/d(input), shape (n, len(OUTPUTS), len(INPUTS)).
    load_coefficient
        Where positive, the load is equation 3-2 with this k_d [Pa/(m3/s)^2] and the row's discharge flow is
        ignored; scalar or shape (n,).

    Returns
    -------
    OperatingPoints
        A row without a solution has NaN and a status of ``PROBLEMS``; its neighbours are not touched.

    Raises
    ------
    ValueError
        when ``rows`` has the wrong shape.
    """
    rows = np.array(rows, dtype=np.float64, ndmin=2)
    if rows.ndim != 2 or rows.shape[1] != len(INPUTS):
        raise ValueError(f"rows must have shape (n, {len(INPUTS)}), one column per input; got {rows.shape}")
    n = len(rows)
    k_d = np.ascontiguousarray(np.broadcast_to(np.asarray(load_coefficient, dtype=np.float64), (n,)))
    values = np.empty((n, len(OUTPUTS)))
    slopes = np.empty((n, len(OUTPUTS), len(INPUTS)) if derivatives else (0, 0, 0))
    status = np.zeros(n, dtype=np.int64)
    solve_batch(pump, slipper_model(pump), circuit, rows, k_d, values, np.arange(len(INPUTS)), slopes, status)
    absolute = values[:, :N_GAUGE] + rows[:, [INPUTS.index("ambient_pressure_bar")]]
    pulled = (status == 0) & (absolute < 0.0).any(axis=1)
    status[pulled] = BELOW_VACUUM
    values[pulled] = np.nan
    if derivatives:
        slopes[pulled] = np.nan
    return OperatingPoints(rows, values, slopes if derivatives else None, status)


def operating_point(
    pump: Pump,
    condition: Condition,
    circuit: Circuit,
    health: Health = Health(),  # noqa: B008 - immutable
    *,
    derivatives: bool = False,
    load_coefficient: float = 0.0,
) -> OperatingPoints:
    """One steady state, as ``OperatingPoints`` of length 1; see ``operating_points``."""
    rows = input_rows([condition], [health])
    return operating_points(pump, rows, circuit, derivatives=derivatives, load_coefficient=load_coefficient)


def problem(points: OperatingPoints, index: int) -> str | None:
    """Why row ``index`` has no solution, naming every input out of range; None when it is solved."""
    code = int(points.status[index])
    if code == 0:
        return None
    if code != OUT_OF_RANGE:
        return PROBLEMS[code]
    row = dict(zip(INPUTS, points.inputs[index], strict=True))
    faults = [
        f"{name} = {row[name]:g} (allowed: {low:g} to {high:g})"
        for name, (low, high) in RANGES.items()
        if not low <= row[name] <= high
    ]
    absolute = row["reservoir_pressure_bar"] + row["ambient_pressure_bar"]
    low, high = RESERVOIR_RANGE_BAR
    if not low <= absolute <= high:
        faults.append(f"absolute reservoir pressure = {absolute:g} bar (allowed: {low:g} to {high:g})")
    return f"{PROBLEMS[code]}: {'; '.join(faults)}"
