"""Tables 2-8 and 2-9, figure 2-20: the compensator's answer to a load step, against the acceptance test's limits."""

import math

from twin.pumps import circuit_parameters, pump_type
from twin.validation.effects import TABLE_2_7
from twin.validation.erosion import erosion
from twin.validation.evidence import FITTED, INDEPENDENT, Curve, Evidence, Plot, Row
from twin.validation.jamming import jamming
from twin.validation.load_step import OPENED_S, SHUT_S, answer, full_flow_opening, load_step

_TABLE = "tables 2-8, 2-9"
PEAK_BAR, SETTLE_S, RESPONSE_S, OSCILLATION_BAR = 257.0, 1.0, 0.05, 20.7
"""Limits of the acceptance test, table 2-8."""
_FULL_FLOW_LPM = 27.17
_PEAK_NOTE = "fitted: discharge volume and stroking piston's area were chosen so that it holds"
_RESPONSE_NOTE = "counted to the first extreme of the pressure; the test does not say what it counts"
_FIGURE_CHANNELS = (
    ("discharge pressure", "bar", "discharge_pressure_bar"),
    ("discharge flow", "L/min", "discharge_flow_lpm"),
    ("swashplate tilt", "deg", "swashplate_angle_deg"),
)
_EVERY = 10
"""Of so many samples the plots keep one."""


def compensator() -> Evidence:
    """Load step of the healthy h225 on the acceptance stand, with the thesis' own model beside it."""
    pump, stand = pump_type("h225").pump, circuit_parameters("acceptance_stand")
    recording = load_step(pump, stand)
    a = answer(recording, OSCILLATION_BAR)
    bench = answer(load_step(pump, circuit_parameters("shared_return")), OSCILLATION_BAR)
    flow = float(recording["discharge_flow_lpm"][recording.time_s < SHUT_S].mean())

    def limit(quantity: str, unit: str, reference: float, value: float, note: str = "", fitted: bool = False) -> Row:
        return Row(_TABLE, quantity, unit, reference, value, 0.0, FITTED if fitted else INDEPENDENT, -1, note)

    def printed(quantity: str, unit: str, reference: float, value: float, note: str = "", limit: int = 0) -> Row:
        """Beside the thesis' own model, within 10 %: a model's numbers, but printed, and nothing was fitted to them."""
        tolerance, missed = (0.0 if limit else 0.1 * reference), bool(note)
        return Row(_TABLE, f"{quantity}: the thesis' own model", unit, reference, value, tolerance, INDEPENDENT,
                   limit, note, missed)  # fmt: skip

    shut, opened = "full to zero flow", "zero to full flow"
    rows = (
        limit(f"peak pressure, {shut}", "bar", PEAK_BAR, a.peak_bar, _PEAK_NOTE, True),
        limit(
            f"peak pressure, {shut}, bench with a shared return line", "bar", PEAK_BAR, bench.peak_bar, _PEAK_NOTE, True
        ),
        printed(f"peak pressure, {shut}", "bar", 223.0, a.peak_bar, "the thesis' capacity is of unknown size"),
        limit(f"time to stay in the rated 173 to 177 bar, {shut}", "s", SETTLE_S, a.settle_shut_s),
        limit(f"time to stay within +-20.7 bar, {shut}", "s", SETTLE_S, a.inside_shut_s),
        printed(f"time to settle, {shut}", "s", 0.35, a.settle_shut_s),
        limit(
            f"time to stay above 90 % of full-flow pressure, {opened}",
            "s",
            SETTLE_S,
            a.settle_open_s,
            "table 2-8 prints 60 %, table 2-9 90 %: the stricter is held",
        ),
        printed(
            f"time to settle, {opened}",
            "s",
            0.02,
            a.settle_open_s,
            "ours falls to half before the plate is back at full tilt",
        ),
        limit(f"response time, {shut}", "s", RESPONSE_S, a.response_shut_s, _RESPONSE_NOTE),
        limit(f"response time, {opened}", "s", RESPONSE_S, a.response_open_s, _RESPONSE_NOTE),
        printed("response time, less than", "s", 0.01, max(a.response_shut_s, a.response_open_s), _RESPONSE_NOTE, -1),
        limit("oscillation's half-width once settled, zero flow", "bar", OSCILLATION_BAR, a.oscillation_shut_bar),
        limit("oscillation's half-width once settled, full flow", "bar", OSCILLATION_BAR, a.oscillation_open_bar),
        printed(
            "oscillation's half-width once settled, at most",
            "bar",
            1.0,
            max(a.oscillation_shut_bar, a.oscillation_open_bar),
            limit=-1,
        ),
        Row(
            "table 2-7",
            "effects in the model, of 24",
            "-",
            16.0,
            float(len(TABLE_2_7)),
            math.nan,
            note=f"beside the most complete published model; {sum(e.healthy for e in TABLE_2_7)} act in the healthy set",
        ),
        Row(_TABLE, "lowest pressure after opening", "bar", math.nan, a.trough_bar, math.nan, note="not specified"),
        Row(
            "figure 2-19",
            "flow at full tilt",
            "L/min",
            _FULL_FLOW_LPM,
            flow,
            0.5,
            INDEPENDENT,
            note="net flow of the thesis' ideal pump at 160 bar, within half of what table 2-1 leaves between 27 and 28; ours "
            "has the tilt that static points 3 to 5 ask for, 1.5 % more than table 2-1 and point 2",
            known_miss=True,
        ),
    )
    time = recording.time_s[::_EVERY]
    plots = tuple(
        Plot(
            f"Figure 2-20: {name} during a load step",
            "time [s]",
            f"{name} [{unit}]",
            (Curve("h225", time, recording[channel][::_EVERY]),),
            f"The load shuts at {SHUT_S:g} s and opens at {OPENED_S:g} s.",
        )
        for name, unit, channel in _FIGURE_CHANNELS
    )
    remarks = (
        f"The load is an opening of {full_flow_opening(pump, stand):.2f} L/min/sqrt(bar) that shuts and opens within "
        "5 ms; at once would raise the peak by 0.2 bar.",
        "The thesis' rig has an ideal pump with a leak and starts without pressure; here the whole pump runs, from its "
        "operating point at full flow, at 4600 rpm and 60 degC with an ideal drive.",
        "The peak validates nothing: pressure rises by delivery over compressibility until the plate is back, and the "
        "volume that sets it is not published.",
    )
    return Evidence("Compensator: load step of the acceptance test", rows, plots, remarks)


__all__ = ["OSCILLATION_BAR", "PEAK_BAR", "RESPONSE_S", "SETTLE_S", "compensator", "erosion", "jamming"]
