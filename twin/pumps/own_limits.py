"""A parameter set held against its own limits: what its healthy pump does must be what its limits allow."""

from twin.condition import Condition
from twin.operating_point import operating_point, problem
from twin.parameters import PumpType
from twin.pumps import circuit_parameters
from twin.units import KELVIN_AT_0_DEGC

_RISING = (
    ("zero_flow_pressure_low_bar", "zero_flow_pressure_high_bar"),
    ("case_flow_low_lpm", "case_flow_lpm"),
)
_REFERENCES_DEGC = (0.0, 120.0)
_SIGMAS = 2.0


def limit_faults(kind: PumpType) -> list[tuple[str, str]]:
    """Faults as (where, what is wrong), none for a set whose healthy pump regulates where its limits say.

    Its zero-flow pressure at the reference temperature must lie within its own limits, give or take two of the
    population's spreads: outside of them no window of such a pump could ever be accepted. Its sensors must reach the
    setting, its speed and reservoir must have a steady state. Of a type without a twin of its own only the limits are asked.
    """
    limits = {name: q.value for name, q in kind.limits.items()}
    faults = [
        (f"limits.{low}", f"{limits[low]:g} is not below {high} = {limits[high]:g}")
        for low, high in _RISING
        if not limits[low] < limits[high]
    ]
    faults += [
        (f"limits.{n}", f"{limits[n]:g} is not above 0") for n in limits if n.endswith("_bar") and limits[n] <= 0
    ]
    reference = limits["reference_temperature_k"] - KELVIN_AT_0_DEGC
    if not _REFERENCES_DEGC[0] <= reference <= _REFERENCES_DEGC[1]:
        faults.append(("limits.reference_temperature_k", f"{reference:g} degC is not between 0 and 120 degC"))
        return faults
    high = limits["zero_flow_pressure_high_bar"]
    full_scale = kind.sensors["discharge_pressure_bar"].full_scale_bar
    if full_scale < high:
        words = f"full scale of {full_scale:g} bar lies below the setting's upper limit of {high:g} bar"
        faults.append(("sensors.discharge_pressure_bar", words))
    if not kind.own_twin:
        return faults
    condition = Condition(kind.nominal_speed_rpm, reference, kind.nominal_reservoir_pressure_bar)
    point = operating_point(kind.pump, condition, circuit_parameters("shared_return"))
    fault = problem(point, 0)
    if fault is not None:
        return [*faults, ("pump", f"at {kind.nominal_speed_rpm:g} rpm, {reference:g} degC and zero flow: {fault}")]
    pressure = float(point.value("discharge_pressure_bar")[0])
    margin = _SIGMAS * kind.population["pressure_setting_bar"].value
    low = limits["zero_flow_pressure_low_bar"]
    if not low - margin <= pressure <= high + margin:
        words = (
            f"{low:g} to {high:g} bar: the pump of these numbers holds {pressure:.1f} bar at zero flow, {reference:g} degC and "
            f"{kind.nominal_speed_rpm:g} rpm; no window of it could pass. Set compensator.F_preload or the limits"
        )
        faults += [(f"limits.zero_flow_pressure_{end}_bar", words) for end in ("low", "high")]
    return faults
