"""Slippers against section 2.6: the land's law (table 2-10) and the variable gap (table 2-13, figures 2-31 to 2-33)."""

import math
from functools import partial

import numpy as np
from numpy.typing import NDArray

from twin.laws.gap import land_flow
from twin.parameters import Pump
from twin.pumps import pump_type
from twin.units import M3_PER_S_PER_LPM, PA_PER_BAR
from twin.validation.evidence import FITTED, INDEPENDENT, Curve, Evidence, Plot, Row
from twin.validation.slipper_rig import STEPS_PER_TURN, RigCase, RigRun, rig_run

Vector = NDArray[np.float64]

TABLE_2_13: tuple[tuple[float, float], ...] = ((0.0, 1.567), (5.0, 0.846), (15.15, -0.56))
"""Tilt [deg] and mean leakage of nine slippers [L/min]."""
FULL_TILT_DEG = 15.15
REPAIRED_RETAINER_UM = 20.0
"""Clearance of a fixed retainer: some 10 to 20 um in real pumps; here above the hydrostatic gap of 17 um."""
_N = 9
_RATIO, _GAP_UM = 1.45, 17.0
_DISCHARGE_BAR, _SUCTION_BAR, _CASE_BAR = 160.0, 1.8, 3.0
_MU, _MU_PRINTED = 0.0148, 0.02
_STRIDE = STEPS_PER_TURN // 400


def thesis_pump(**slipper: float) -> Pump:
    """Pump of table 2-13 with some of the slipper's fields changed (SI)."""
    pump = pump_type("h225_thesis").pump
    return pump._replace(slipper=pump.slipper._replace(**slipper))


def repaired_pump(**slipper: float) -> Pump:
    """The same with one area for force and swept volume, film damping, and a close retainer."""
    repairs = {"pumped_repair": 1.0, "squeeze": 1.0, "h_retainer": REPAIRED_RETAINER_UM * 1.0e-6}
    return thesis_pump(**{**repairs, **slipper})


def mean_leakage(pump: Pump, tilt_deg: float) -> float:
    """Mean leakage of nine slippers under the pressures of table 2-13 [L/min]."""
    return rig_run(pump, RigCase(tilt_deg)).leakage(_N)


def constant_gap_flow(pocket_bar: float, mu: float) -> float:
    """Leakage of one slipper of table 2-10 by equation 2-26, without throttle [L/min]."""
    P_p, P_c = pocket_bar * PA_PER_BAR, _CASE_BAR * PA_PER_BAR
    return land_flow(P_p, P_c, mu, _GAP_UM * 1.0e-6, _RATIO) / M3_PER_S_PER_LPM


def _constant_gap_rows() -> list[Row]:
    high, low = (constant_gap_flow(p, _MU) for p in (_DISCHARGE_BAR, _SUCTION_BAR))
    row = partial(Row, "table 2-10", unit="L/min")
    return [
        row(
            quantity="one slipper at discharge",
            reference=0.4417,
            value=high,
            tolerance=0.01 * 0.4417,
            evidence_class=FITTED,
            note="0.0148 Pa s was chosen to meet this row; the two below then follow",
        ),
        row(
            quantity="one slipper at suction",
            reference=-0.0034,
            value=low,
            tolerance=0.01 * 0.0034,
            evidence_class=INDEPENDENT,
        ),
        row(
            quantity="mean of nine slippers",
            reference=1.960,
            value=_N * 0.5 * (high + low),
            tolerance=0.01 * 1.960,
            evidence_class=INDEPENDENT,
            note="the printed flows of one slipper add up to 1.972",
        ),
        row(
            quantity="one slipper at discharge with the printed 0.02 Pa s",
            reference=0.4417,
            value=constant_gap_flow(_DISCHARGE_BAR, _MU_PRINTED),
            tolerance=0.01 * 0.4417,
            evidence_class=INDEPENDENT,
            known_miss=True,
            note="a quarter too low: the law is inverse in viscosity, so 0.02 can only be a rounded print",
        ),
    ]


def _table_rows() -> list[Row]:
    pump = thesis_pump()
    return [
        Row(
            "table 2-13",
            f"mean of nine slippers at {tilt:g} deg",
            "L/min",
            reference,
            mean_leakage(pump, tilt),
            0.05,
            evidence_class=FITTED,
            note="balance ratio, throttle and retainer fitted to the three rows together",
        )
        for tilt, reference in TABLE_2_13
    ]


def _stated(quantity: str, unit: str, value: float, note: str = "", evidence: str = "section 2.6.3") -> Row:
    return Row(evidence, quantity, unit, math.nan, value, math.nan, note=note)


def _repair_rows() -> list[Row]:
    close = REPAIRED_RETAINER_UM * 1.0e-6
    single = (
        ("one area for force and flow", thesis_pump(pumped_repair=1.0), "does not help alone"),
        ("film damping (squeeze)", thesis_pump(squeeze=1.0), "alone it removes the negative flow"),
        (
            "film damping and one area, contact from 4 um on",
            thesis_pump(squeeze=1.0, pumped_repair=1.0, h_min=4.0e-6),
            "and fails where roughness or oil wedge hold the slipper farther off the plate",
        ),
        ("retainer at 20 um", thesis_pump(h_retainer=close), "lets in a thirtieth; the sign stays"),
    )
    rows = [
        _stated(f"full tilt, only {name}", "L/min", mean_leakage(p, FULL_TILT_DEG), note) for name, p, note in single
    ]
    repaired = repaired_pump()
    variants = [(f"all three repairs at {tilt:g} deg", repaired, tilt) for tilt, _ in TABLE_2_13]
    variants += [
        ("all three at full tilt, contact from 4 um on", repaired_pump(h_min=4.0e-6), FULL_TILT_DEG),
        ("all three at full tilt, balance ratio 1.05", repaired_pump(balance=1.05), FULL_TILT_DEG),
    ]
    rows += [
        Row(
            "section 2.6.3",
            name,
            "L/min",
            0.0,
            mean_leakage(pump, tilt),
            0.0,
            limit=1,
            note="must not be negative",
        )
        for name, pump, tilt in variants
    ]
    return rows


def _sampled(label: str, run: RigRun, y: Vector) -> Curve:
    return Curve(label, run.angle_deg[::_STRIDE], y[::_STRIDE])


def _gap_plot(title: str, pump: Pump, caption: str) -> Plot:
    curves = []
    for tilt, _ in TABLE_2_13:
        run = rig_run(pump, RigCase(tilt))
        curves.append(_sampled(f"{tilt:g} deg", run, run.gap_um))
    return Plot(title, "shaft angle [deg], discharge from 0 to 180", "gap [um]", tuple(curves), caption)


def _viscosity_plot() -> Plot:
    mu = np.linspace(0.010, 0.022, 61)
    flow = np.array([constant_gap_flow(_DISCHARGE_BAR, float(m)) for m in mu])
    return Plot(
        "Table 2-10: leakage of one slipper over viscosity",
        "viscosity [Pa s]",
        "leakage at discharge [L/min]",
        (Curve("equation 2-26", mu, flow), Curve("printed flow 0.4417", mu, np.full(len(mu), 0.4417))),
        "The law meets the printed flow at 0.0148 Pa s, not at the printed 0.02 Pa s.",
    )


def _balance_plot() -> Plot:
    ratios = np.linspace(1.005, 1.050, 19)
    curves = tuple(
        Curve(f"{tilt:g} deg", ratios, np.array([mean_leakage(thesis_pump(balance=float(r)), tilt) for r in ratios]))
        for tilt, _ in TABLE_2_13
    )
    return Plot(
        "Sensitivity to the balance ratio",
        "balance ratio S_eq over the piston's area [-]",
        "mean leakage of nine slippers [L/min]",
        curves,
        "Lift during discharge needs a ratio above 1/cos(tilt), that is 1, 1.004 and 1.036, and in the thesis' model a "
        "little more against the push of the case.",
    )


def _retainer_plot() -> Plot:
    clearances = np.array([15.0, 20.0, 30.0, 40.0, 60.0, 80.0, 100.0, 120.0])
    models = {
        "as in the thesis": {},
        "one area": {"pumped_repair": 1.0},
        "one area, film damping": {"pumped_repair": 1.0, "squeeze": 1.0},
        "the same, contact from 4 um on": {"pumped_repair": 1.0, "squeeze": 1.0, "h_min": 4.0e-6},
    }
    curves = tuple(
        Curve(
            label,
            clearances,
            np.array([mean_leakage(thesis_pump(**m, h_retainer=float(c) * 1.0e-6), FULL_TILT_DEG) for c in clearances]),
        )
        for label, m in models.items()
    )
    return Plot(
        "What lets the case's fluid in at full tilt",
        "retainer clearance [um]",
        "mean leakage of nine slippers [L/min]",
        curves,
        "Negative: the slippers draw fluid out of the case. Each model lifts off during suction up to its retainer, "
        "except where film damping holds a slipper that came close to the plate.",
    )


def _pressure_plots() -> tuple[Plot, Plot]:
    run = rig_run(thesis_pump(), RigCase(0.0))
    ideal = np.array([constant_gap_flow(float(p), _MU) for p in run.chamber_bar[::_STRIDE]])
    label = "shaft angle [deg], discharge from 0 to 180"
    pocket = Plot(
        "Figure 2-32: pressure in the pocket, 0 deg",
        label,
        "pressure [bar]",
        (_sampled("simulated", run, run.pocket_bar), _sampled("ideal: the chamber's", run, run.chamber_bar)),
        "The throttle takes the part of the pressure by which the pocket's area exceeds the piston's.",
    )
    flow = Plot(
        "Figure 2-32: leakage of one slipper, 0 deg",
        label,
        "leakage [L/min]",
        (_sampled("simulated", run, run.land_lpm), Curve("ideal: 17 um", run.angle_deg[::_STRIDE], ideal)),
        "The forces leave a gap of 16 um instead of 17; through suction the slipper lies on the plate.",
    )
    return pocket, flow


def slippers() -> Evidence:
    """Compare the slippers with tables 2-10 and 2-13 and show the gaps of figures 2-31 to 2-33."""
    slipper = thesis_pump().slipper
    step = 0.001
    low, high = (mean_leakage(thesis_pump(balance=slipper.balance + s), 0.0) for s in (-step, step))
    literature = {
        label: rig_run(thesis_pump(pumped_repair=on, squeeze=on), RigCase(8.0, discharge_bar=100.0))
        for label, on in (("as in the thesis", 0.0), ("one area and film damping", 1.0))
    }
    full = rig_run(thesis_pump(), RigCase(FULL_TILT_DEG))
    on_plate = float(np.mean(full.gap_um[-STEPS_PER_TURN:] < slipper.h_min))
    rows = [
        *_constant_gap_rows(),
        *_table_rows(),
        _stated(
            "change per 1 % of the balance ratio at 0 deg",
            "L/min",
            (high - low) / (2.0 * step) * 0.01 * slipper.balance,
            "one per cent of an area decides about a third of the leakage",
            "table 2-13",
        ),
        _stated(
            "share of a turn on the plate at full tilt", "-", on_plate, "1/cos(tilt) is 1.036: no lift", "figure 2-33"
        ),
        *(
            _stated(
                f"mean gap during discharge at 10 MPa and 8 deg, {label}",
                "um",
                float(run.gap_um[-STEPS_PER_TURN : -STEPS_PER_TURN // 2].mean()),
                "the figure is compared by shape only",
                "figure 2-31",
            )
            for label, run in literature.items()
        ),
        *_repair_rows(),
    ]
    plots = (
        _viscosity_plot(),
        *_pressure_plots(),
        Plot(
            "Figure 2-31: gap at 10 MPa and 8 deg",
            "shaft angle [deg], discharge from 0 to 180",
            "gap [um]",
            tuple(_sampled(label, run, run.gap_um) for label, run in literature.items()),
            "With the thesis' unbalanced area the slipper hardly lifts; with one area it rides at about 9 um. Both go to the "
            "retainer while the piston is drawn back.",
        ),
        _gap_plot(
            "Figure 2-33: gap in the thesis' model",
            thesis_pump(),
            "At full tilt the slipper lies on the plate through discharge and hangs on the retainer through suction.",
        ),
        _gap_plot(
            "The same with the repairs",
            repaired_pump(),
            "The retainer bounds the gap. At full tilt the slipper still does not lift: the film's damping holds it.",
        ),
        _balance_plot(),
        _retainer_plot(),
    )
    return Evidence("Slippers: land and variable gap (section 2.6)", tuple(rows), plots, _REMARKS)


_REMARKS = (
    "Table 2-13 fixes three numbers, and three of the slipper's were fitted to it: balance ratio 1.0228, throttle "
    "0.685 mm, retainer 75.7 um. They are not unique: with a piston of 10 instead of 20 g the fit gives 1.021, 0.71 mm "
    "and 72 um; another rebuild found 1.022, 0.67 mm and 116 um. The rows show that the equations can "
    "give the table, not that the geometry is the pump's.",
    "The negative leakage at full tilt has three causes that must come together. Balance: the ratio stays below 1/cos of "
    "the tilt, so that nothing leaks out during discharge. Inertia, and a case pressure above suction: the slipper is "
    "drawn off the plate during suction. A retainer of 76 um: the case's fluid enters there, limited by the "
    "throttle alone.",
    "Of the four repairs of section 2.6.3: one area for force and flow is right by itself but makes the negative flow "
    "larger, since the thesis' unbalanced area pressed the slipper onto the plate. Film damping removes it as long as "
    "the slipper comes within 3.5 um of the plate, and no more where roughness or an oil wedge keep it farther off. "
    "A close retainer, which the list lacks, lets in a thirtieth. Film damping and a close retainer together never "
    "gave a negative mean here, whatever held the slipper off the plate.",
    "What the repairs do not mend: at full tilt the slipper still runs within some micrometres of the plate. Lift there "
    "needs a balance ratio above 1.036, or a hydrodynamic wedge, which a gap with one dimension cannot have. Thermal "
    "effects (third repair) are not in the rig; they would thin the film, not lift it.",
    "The repaired slippers leak more at 0 and 5 deg than table 2-13 (2.0 and 1.5 L/min): the geometry was fitted "
    "with the repairs off and was not fitted again.",
    "The rig steps the functions of the transient pump itself. The pressure changes over within 5 deg of shaft angle "
    "round each dead centre; the thesis does not say how its own does, and 1 to 20 deg move the row at 5 deg by up to "
    "0.04 L/min.",
    "Figure 2-31 compares shapes without numbers, and so does this page. At 10 MPa the case's 3 bar on the thesis' "
    "unbalanced area, 9.5 N, take up the whole margin of lift at 8 deg; with one area the slipper rides at about 9 um.",
)
