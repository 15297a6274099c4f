"""The metamodel of a pump's slipper gap as a picture: its error on runs held out, and leakage and gap over the tilt."""

from io import BytesIO

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.metamodel.fit import Fit, predict
from twin.parameters import PumpType
from twin.parts.slipper_map import (
    FROM_DISCHARGE,
    FROM_SUCTION,
    MEAN_GAP,
    OVER_CASE,
    OVER_SUCTION,
    SPEED,
    TEMPERATURE,
    TILT,
)
from twin.units import RAD_PER_DEG

Matrix = NDArray[np.float64]

_PRESSURES_BAR = (80.0, 130.0, 172.0)
_OVER_SUCTION_BAR, _DEGC = 0.8, 50.0


def error_map(kind: PumpType, fit: Fit, suffix: str) -> bytes:
    """Picture of a fit, ``svg`` or ``png``: above the error, below leakage and mean gap at nominal speed and 50 degC."""
    figure = Figure(figsize=(10.0, 7.5), layout="constrained")
    (both, over), (leakage, gap) = figure.subplots(2, 2)
    truth, found = (a[:, FROM_DISCHARGE] + a[:, FROM_SUCTION] for a in (fit.truth, fit.predicted))
    both.plot(truth, found, ".", markersize=4)
    ends = [float(truth.min()), float(truth.max())]
    both.plot(ends, ends, color="0.5", linewidth=0.8)
    both.set(
        xlabel="transient [L/min]",
        ylabel="metamodel [L/min]",
        title=f"Leakage into the case, {len(truth)} runs held out",
    )
    shown = over.scatter(fit.axes[:, TILT], fit.axes[:, OVER_CASE], c=np.abs(found - truth), s=18, cmap="viridis")
    figure.colorbar(shown, ax=over, label="error [L/min]")
    over.set(xlabel="tilt [deg]", ylabel="discharge over case [bar]", title="Where it errs")
    top = kind.pump.swashplate.alpha_max / RAD_PER_DEG
    tilts = np.linspace(0.0, top, 121)
    for pressure, style in zip(_PRESSURES_BAR, ("-", "--", ":"), strict=True):
        axes = np.zeros((len(tilts), fit.axes.shape[1]))
        axes[:, TILT], axes[:, SPEED], axes[:, OVER_CASE] = tilts, kind.nominal_speed_rpm, pressure
        axes[:, OVER_SUCTION], axes[:, TEMPERATURE] = _OVER_SUCTION_BAR, _DEGC
        answers = predict(kind.pump, fit.stored.model, axes)
        label = f"{pressure:g} bar"
        leakage.plot(tilts, answers[:, FROM_DISCHARGE] + answers[:, FROM_SUCTION], style, label=label)
        gap.plot(tilts, answers[:, MEAN_GAP], style, label=label)
    leakage.axhline(0.0, color="0.7", linewidth=0.8)
    leakage.set(xlabel="tilt [deg]", ylabel="all slippers into the case [L/min]", title="Leakage")
    gap.set(xlabel="tilt [deg]", ylabel="mean gap [um]", title="Gap, mean of a revolution")
    leakage.legend(title="discharge over case")
    figure.suptitle(
        f"{kind.name}: {kind.nominal_speed_rpm:g} rpm, {_DEGC:g} degC, case {_OVER_SUCTION_BAR:g} bar over suction"
    )
    buffer = BytesIO()
    metadata = {"Date": None} if suffix == "svg" else None
    figure.savefig(buffer, format=suffix, dpi=110, metadata=metadata)
    return buffer.getvalue()
