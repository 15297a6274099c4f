"""Figure 2-22: the spool jams for a while during a load step; the events that follow, found in the traces."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from twin.laws.metering_edge import MARE
from twin.parameters import Circuit, Pump
from twin.pumps import circuit_parameters, pump_type
from twin.recording import Recording
from twin.simulation.scenario import Schedule
from twin.units import PA_PER_BAR
from twin.validation.erosion import closed_centre
from twin.validation.evidence import Curve, Evidence, Plot, Row
from twin.validation.load_step import last_outside, load_step, revolution_mean, zero_flow_pressure

_FIGURE = "figure 2-22"
JAM_N, JAM_LASTS_S = 500.0, 0.6
"""Force and duration of the jam, section 2.5.3.2."""
_OPENED_S, _END_S = 2.25, 2.75
"""The load opens later than in figure 2-20, to leave time for the recovery at zero flow."""
_ABNORMAL_BAR = 257.0
_DECAYED, _TILTED_DEG, _MOVED_MM = 0.9, 2.5, 0.05
_EVERY = 10
_CHANNELS = (
    ("discharge pressure", "bar", "discharge_pressure_bar"),
    ("control pressure", "bar", "control_pressure_bar"),
    ("swashplate tilt", "deg", "swashplate_angle_deg"),
    ("spool position", "mm", "spool_position_mm"),
)


@dataclass(frozen=True, slots=True)
class Events:
    """What a jam does, in the order that the thesis tells; times from the start of the run [s], NaN for what is missing.

    Attributes
    ----------
    jammed_s, released_s
        Start and end of the jam.
    decayed_s
        Control pressure (mean of a revolution) has lost a tenth since the jam.
    tilted_s
        The tilt has risen by 2.5 degrees since the jam.
    overshot_s
        Discharge pressure passes the largest that the acceptance test allows.
    freed_s
        The spool breaks free: it stands 0.05 mm from where it jammed.
    negative_s
        The tilt turns negative.
    recovered_s
        From here on discharge pressure (mean of a revolution) stays within 1 bar of the regulated one.
    peak_bar, freed_bar, lowest_deg
        Highest discharge pressure, discharge pressure when the spool breaks free, lowest tilt of the jam.
    jammed_mm
        Where the spool jammed.
    regulated_bar
        Mean discharge pressure of the last 0.2 s at zero flow.
    """

    jammed_s: float
    decayed_s: float
    tilted_s: float
    overshot_s: float
    freed_s: float
    negative_s: float
    released_s: float
    recovered_s: float
    peak_bar: float
    freed_bar: float
    lowest_deg: float
    jammed_mm: float
    regulated_bar: float

    @property
    def times(self) -> tuple[tuple[str, float], ...]:
        """Events by name, in the thesis' order."""
        return (
            ("spool jams", self.jammed_s),
            ("control pressure has decayed", self.decayed_s),
            ("tilt has risen", self.tilted_s),
            ("discharge pressure overshoots", self.overshot_s),
            ("spool breaks free", self.freed_s),
            ("tilt turns negative", self.negative_s),
            ("jam ends", self.released_s),
            ("regulated pressure has recovered", self.recovered_s),
        )

    @property
    def in_order(self) -> bool:
        """True when every event happened, each after the one before."""
        instants = [t for _, t in self.times]
        return all(b > a for a, b in pairwise(instants))


def jammed_step(pump: Pump, circuit: Circuit, jammed_s: float) -> Recording:
    """Load step with the spool jammed from ``jammed_s`` on, for ``JAM_LASTS_S``."""
    at = (jammed_s, jammed_s, jammed_s + JAM_LASTS_S, jammed_s + JAM_LASTS_S)
    jam = Schedule(at, (0.0, JAM_N, JAM_N, 0.0))
    return load_step(pump, circuit, {"spool_jamming_force_n": jam}, opened_s=_OPENED_S, end_s=_END_S)


def events(recording: Recording, jammed_s: float, regulated_bar: float) -> Events:
    """Find the events of a jam; ``regulated_bar`` is the zero-flow pressure to come back to [bar]."""
    time, released = recording.time_s, jammed_s + JAM_LASTS_S
    P_d, tilt, x = (recording[name] for _, _, name in (_CHANNELS[0], *_CHANNELS[2:]))
    P_d_mean, P_ctrl = revolution_mean(P_d), revolution_mean(recording["control_pressure_bar"])
    jam = (time >= jammed_s) & (time < released)
    shut = (time >= released) & (time < _OPENED_S - 0.02)
    last = (time >= _OPENED_S - 0.2) & (time < _OPENED_S)
    at_jam = int(np.searchsorted(time, jammed_s))
    x_jam = float(x[at_jam])

    def first(happened: np.ndarray, after: float) -> float:
        at = np.flatnonzero(jam & happened & (time > after))
        return float(time[at[0]]) if len(at) else math.nan

    overshot = first(P_d > _ABNORMAL_BAR, jammed_s)
    freed = first(np.abs(x - x_jam) > _MOVED_MM, jammed_s)
    recovered = last_outside(time[shut], P_d_mean[shut], regulated_bar - 1.0, regulated_bar + 1.0)
    return Events(
        jammed_s=jammed_s,
        decayed_s=first(P_ctrl < _DECAYED * P_ctrl[at_jam], jammed_s),
        tilted_s=first(tilt > tilt[at_jam] + _TILTED_DEG, jammed_s),
        overshot_s=overshot,
        freed_s=freed,
        negative_s=first(tilt < 0.0, freed),
        released_s=released,
        recovered_s=recovered if recovered < time[shut][-1] else math.nan,
        peak_bar=float(P_d[jam].max()),
        freed_bar=float(np.interp(freed, time, P_d)),
        lowest_deg=float(tilt[jam].min()),
        jammed_mm=x_jam,
        regulated_bar=float(P_d[last].mean()),
    )


def breaking_pressure(pump: Pump, jammed_mm: float, case_bar: float) -> float:
    """Discharge pressure that pushes a jammed spool free: spring and jam over the spool's area [bar]."""
    comp = pump.compensator
    force = comp.F_preload + comp.k_spool * jammed_mm * 1.0e-3 + JAM_N
    return force / comp.A_spool / PA_PER_BAR + case_bar


def _rows(name: str, pump: Pump, circuit: Circuit, recording: Recording, jammed_s: float) -> list[Row]:
    regulated = zero_flow_pressure(pump, circuit)
    found = events(recording, jammed_s, regulated)
    case = float(np.interp(found.freed_s, recording.time_s, recording["case_pressure_bar"]))
    rows = [
        Row(_FIGURE, f"{name}: events in order", "-", 1.0, float(found.in_order), 0.0, note="1 when they are"),
    ]
    rows += [
        Row(_FIGURE, f"{name}: {event}", "s", before, at, 0.0, limit=1, note=f"not before: {previous}")
        for (previous, before), (event, at) in pairwise(found.times)
    ]
    rows += [
        Row(
            "section 2.5.3.2",
            f"{name}: pressure when the spool breaks free",
            "bar",
            breaking_pressure(pump, found.jammed_mm, case),
            found.freed_bar,
            10.0,
            note="spring and jam over the spool's area; some bar more until it has moved 0.05 mm",
        ),
        Row(_FIGURE, f"{name}: lowest tilt", "deg", 0.0, found.lowest_deg, 0.0, limit=-1, note="even negative angles"),
        Row(
            _FIGURE,
            f"{name}: peak pressure",
            "bar",
            math.nan,
            found.peak_bar,
            math.nan,
            note="skyrockets; no relief valve",
        ),
        Row(_FIGURE, f"{name}: regulated pressure after recovery", "bar", regulated, found.regulated_bar, 1.0),
    ]
    return rows


def jamming() -> Evidence:
    """A jam of 500 N over 0.6 s: the set's valve jammed in the undershoot, the closed-centre valve as the thesis does."""
    pump, stand = pump_type("h225").pump, circuit_parameters("acceptance_stand")
    closed = closed_centre(pump, stand, MARE)
    cases = (("the set's own valve", pump, 0.3), ("closed-centre valve", closed, 0.5))
    rows: list[Row] = []
    plots: list[Plot] = []
    for name, valve, jammed_s in cases:
        recording = jammed_step(valve, stand, jammed_s)
        rows += _rows(name, valve, stand, recording, jammed_s)
        time = recording.time_s[::_EVERY]
        plots += [
            Plot(
                f"Figure 2-22: {quantity}, {name}",
                "time [s]",
                f"{quantity} [{unit}]",
                (Curve("jammed spool", time, recording[channel][::_EVERY]),),
                f"Jammed from {jammed_s:g} to {jammed_s + JAM_LASTS_S:g} s; the load shuts at 0.25 s, opens at 2.25 s.",
            )
            for quantity, unit, channel in _CHANNELS
        ]
    settled = events(jammed_step(pump, stand, 1.0), 1.0, zero_flow_pressure(pump, stand))
    quantity = "the set's own valve, jammed when settled: highest pressure"
    rows.append(Row(_FIGURE, quantity, "bar", math.nan, settled.peak_bar, math.nan, note="not in the thesis"))
    remarks = (
        "The closed-centre valve (Mare's edges, no bleed) jams at 0.5 s as in figure 2-22. The set's own valve is jammed "
        "at 0.3 s, while the pressure undershoots and the spool vents the control volume.",
        "Jammed in balance, the set's own valve keeps feeding its bleed and pressure wanders without overshoot: a jam "
        "does harm only where the spool vents the control volume or shuts it.",
        "As in the thesis no relief valve acts: a real pump would not outlive the peak.",
    )
    return Evidence("Compensator: jammed spool", tuple(rows), tuple(plots), remarks)
