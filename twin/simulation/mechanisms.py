"""Failure mechanisms 1 to 4 of table 4-1 (Mkadara 2020) as ready-made scenarios.

A run lasts seconds, wear takes hundreds of hours: wear is there from the first instant on, jamming is an event on the
way. Mechanisms 1 and 2 show themselves when the pump must adjust its pressure, so their scenarios open and shut a load;
3 and 4 run at the condition as it is. Severity 1 is the value that is named with each mechanism, 0 the healthy pump in
the same run. Most values are our estimates, the thesis names few; each says which it is and why.
"""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

from twin.condition import Condition
from twin.simulation.scenario import Scenario, Schedule, Value
from twin.units import RAD_PER_S_PER_RPM

FULL_OPENING_LPM_PER_SQRT_BAR = 2.0
"""Estimate: lets 26 L/min through at 172 bar, which is the full flow of the H225 pump."""
_REGULATED_BAR = 172.0
_OPENS, _SHUTS = 0.3, 0.6
"""Load: share of the run when it opens and shuts; each phase is long against the pump's 0.05 s of response."""
_JAMS, _RELEASED = 0.5, 0.8
"""Jam: share of the run when it begins and ends, so that the load shuts while the spool is stuck."""

EROSION_UM = 300.0
JAMMING_FORCE_N = 500.0
BEARING_FRICTION_NM = 20.0
PISTON_CLEARANCE_INCREASE = 1.5
SLIPPER_GAP_INCREASE = 1.0
SHAFT_FRICTION_NM = 2.0
DRIVE_STIFFNESS_NM_S = 0.85

Changes = dict[str, Value]


class _Mechanism(NamedTuple):
    """One mechanism: what it is in a sentence, its changes, and whether its run opens and shuts a load."""

    words: str
    changes: Callable[[Condition, float, float], Changes]
    load_steps: bool


def _compensator_valve_erosion(_condition: Condition, _duration_s: float, severity: float) -> Changes:
    """Rounder metering edges (section 2.5.2.1): more leakage, less pressure gain, a lower setting.

    300 um is our estimate: the thesis gives no radius and finds the effect hard to show, and so do we. This one lowers
    the regulated pressure by 0.3 bar without flow and 1 bar with it, enough for the bench's quantum of 0.085 bar.
    """
    return {"edge_rounding_um": EROSION_UM * severity}


def _compensator_valve_jamming(_condition: Condition, duration_s: float, severity: float) -> Changes:
    """Friction on the spool for a while (equation 2-24): 500 N, which is the thesis' intensity of figure 2-22.

    As there, friction is a steep function of speed: a stuck spool still creeps.
    """
    force = JAMMING_FORCE_N * severity
    start, end = _JAMS * duration_s, _RELEASED * duration_s
    return {"spool_jamming_force_n": Schedule((start, start, end, end), (0.0, force, force, 0.0))}


def _swashplate_bearing_friction(_condition: Condition, _duration_s: float, severity: float) -> Changes:
    """Dry friction in the bearings of the plate.

    20 N m is our estimate, taken from the H225 pump: below 13 N m the plate follows late, from 25 N m on it hardly moves.
    """
    return {"swashplate_friction_nm": BEARING_FRICTION_NM * severity}


def _piston_wear(_condition: Condition, _duration_s: float, severity: float) -> Changes:
    """Wider clearance of pistons 1 to 3, by 150 %: the largest of the thesis' table 4-2; severity 1/3 and 2/3 its others."""
    return {f"piston_clearance_scale[{k}]": 1.0 + PISTON_CLEARANCE_INCREASE * severity for k in (1, 2, 3)}


def _slipper_wear(_condition: Condition, _duration_s: float, severity: float) -> Changes:
    """Wider gap under the first slipper, by 100 %.

    Our estimate: the thesis wears no slipper. The throttle in the piston limits what a lost slipper lets through, and
    twice the gap is where the leakage begins to feel it.
    """
    return {"slipper_gap_scale[1]": 1.0 + SLIPPER_GAP_INCREASE * severity}


def _shaft_bearing_damage(condition: Condition, _duration_s: float, severity: float) -> Changes:
    """Misaligned shaft: the barrel tilts on the port plate, and its bearings brake the drive.

    The gap of a barrel tilted by e h leaks by the mean of (1 + e cos phi)^3 = 1 + 1.5 e^2 times as much; severity 1 is
    the tilt that touches the plate (e = 1), and beyond it the gap grows with the tilt. Bearing friction is our
    estimate: 2 N m, nearly as much as the whole healthy pump takes without flow (2.4 N m, acceptance sheet). It lowers
    the speed as the drive of the thesis' bench gives way, 0.85 N m s (figure 3-16); a main gear box would not notice.

    What the hydraulic model shows is this leakage and this speed. It cannot show the rest of table 4-1: this bearing's
    friction is no part of ``shaft_torque_nm``, its heat does not warm the case, and there is no debris, no seal that drips
    and no shaft that breaks. One shaft turn's swing of the tilted gap is not followed either, only its mean.
    """
    leakage = 1.0 + 1.5 * min(severity, 1.0) ** 2
    slower_rpm = SHAFT_FRICTION_NM * severity / DRIVE_STIFFNESS_NM_S / RAD_PER_S_PER_RPM
    return {
        "port_plate_gap_scale": leakage ** (1.0 / 3.0) * max(severity, 1.0),
        "speed_rpm": condition.speed_rpm - slower_rpm,
    }


_MECHANISMS: dict[str, _Mechanism] = {
    "compensator_valve_erosion": _Mechanism(
        "Eroded metering edges of the compensator's valve: pressure is adjusted lower and less stiffly (mechanism 1).",
        _compensator_valve_erosion,
        True,
    ),
    "compensator_valve_jamming": _Mechanism(
        "The compensator's spool jams while the load shuts: pressure adjustment is lost (mechanism 1).",
        _compensator_valve_jamming,
        True,
    ),
    "swashplate_bearing_friction": _Mechanism(
        "Friction in the swashplate's bearings: the plate follows late or not at all, flow is missing (mechanism 2).",
        _swashplate_bearing_friction,
        True,
    ),
    "piston_wear": _Mechanism(
        "Three pistons with wider clearance: more leakage into the case (mechanism 3).",
        _piston_wear,
        False,
    ),
    "slipper_wear": _Mechanism(
        "One slipper with a wider gap: more leakage into the case, once per turn (mechanism 3).",
        _slipper_wear,
        False,
    ),
    "shaft_bearing_damage": _Mechanism(
        "A misaligned shaft: the port plate's gap widens and the drive slows down (mechanism 4).",
        _shaft_bearing_damage,
        False,
    ),
}

MECHANISMS: Mapping[str, str] = {name: each.words for name, each in _MECHANISMS.items()}
"""Name of each mechanism to what it is, in a sentence."""


def mechanism(name: str, condition: Condition, duration_s: float, severity: float = 1.0) -> Scenario:
    """Scenario of one failure mechanism.

    Parameters
    ----------
    name
        One of ``MECHANISMS``.
    condition
        Where the pump runs. Where the scenario steps the load, ``discharge_flow_lpm`` is what the open load takes at
        172 bar, and 0 asks for full flow.
    duration_s
        Length of the run [s]; a second shows each phase of a load step settled.
    severity
        Share of the mechanism's own value [-]: 0 healthy, 1 as named there, more is worse.

    Raises
    ------
    ValueError
        when the name is unknown, naming those that exist, or the severity is not finite or below 0.
    """
    faults = []
    if name not in _MECHANISMS:
        faults.append(f"no failure mechanism {name!r}; known: {', '.join(MECHANISMS)}")
    if not (math.isfinite(severity) and severity >= 0.0):
        faults.append(f"severity = {severity:g} (allowed: 0 and more)")
    if faults:
        raise ValueError("; ".join(faults))
    chosen = _MECHANISMS[name]
    changes = chosen.changes(condition, duration_s, severity)
    if chosen.load_steps:
        flow = condition.discharge_flow_lpm
        opening = flow / math.sqrt(_REGULATED_BAR) if flow > 0.0 else FULL_OPENING_LPM_PER_SQRT_BAR
        opens, shuts = _OPENS * duration_s, _SHUTS * duration_s
        load = Schedule((opens, opens, shuts, shuts), (0.0, opening, opening, 0.0))
        changes["load_conductance_lpm_per_sqrt_bar"] = load
        condition = condition._replace(discharge_flow_lpm=0.0)
    return Scenario(duration_s, condition, changes=changes, title=f"{name}, severity {severity:g}")
