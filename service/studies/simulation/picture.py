"""Picture of a run: pressures, flows and tilt over time, one under the other. Long runs are thinned, extremes stay."""

import io
import math
import warnings
from typing import Any, NamedTuple

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from numpy.typing import NDArray

from twin.recording import TIME, Recording

SUFFIXES = (".svg", ".png")
N_BUCKETS = 1200
"""Stretches that a long run is cut into: about one per pixel of the axes."""
Samples = NDArray[np.float64]


class Panel(NamedTuple):
    """One pair of axes: its label, the shortest span that it shows, its channels with the words for each."""

    label: str
    smallest_span: float
    channels: tuple[tuple[str, str], ...]


PANELS: tuple[Panel, ...] = (
    Panel("high pressure [bar]", 20.0, (("discharge_pressure_bar", "discharge"), ("control_pressure_bar", "control"))),
    Panel(
        "low pressure [bar]",
        0.5,
        (("case_pressure_bar", "case"), ("return_pressure_bar", "return"), ("reservoir_pressure_bar", "reservoir")),
    ),
    Panel("discharge flow [L/min]", 2.0, (("discharge_flow_lpm", "discharge"),)),
    Panel("case flow [L/min]", 0.5, (("case_flow_lpm", "case drain"),)),
    Panel("tilt [deg]", 1.0, (("swashplate_angle_deg", "swashplate"),)),
)
# told apart by colour-blind eyes too (Okabe and Ito)
_COLOURS = ("#0072b2", "#d55e00", "#009e73")
_STYLE: dict[Any, Any] = {"svg.hashsalt": "casedrain", "svg.fonttype": "none", "font.size": 10.0}


class Thinned:
    """Lowest, mean and highest value of each stretch of a run that comes in pieces.

    Parameters
    ----------
    n_samples
        Samples of the whole run.
    """

    def __init__(self, n_samples: int) -> None:
        self._bucket = max(1, math.ceil(n_samples / N_BUCKETS))
        self._rest: dict[str, Samples] = {}
        self._rows: dict[str, list[Samples]] = {}

    def append(self, piece: Recording) -> None:
        """Take the next piece."""
        for name in (TIME, *(channel for panel in PANELS for channel, _ in panel.channels)):
            if name not in piece:
                continue
            samples = np.concatenate((self._rest.get(name, np.empty(0)), piece[name]))
            whole = len(samples) // self._bucket * self._bucket
            self._rest[name] = samples[whole:]
            self._rows.setdefault(name, []).append(_reduced(samples[:whole].reshape(-1, self._bucket)))

    def rows(self, name: str) -> Samples:
        """Lowest, mean, highest of each stretch, shape (m, 3); NaN where all of it is missing."""
        rest = self._rest[name]
        last = [_reduced(rest.reshape(1, -1))] if len(rest) else []
        return np.concatenate(self._rows[name] + last)

    def __contains__(self, name: object) -> bool:
        return name in self._rows


def _reduced(samples: Samples) -> Samples:
    """Lowest, mean and highest of each row, shape (m, 3)."""
    with warnings.catch_warnings():
        # a row of nothing but missing samples stays missing, without a word
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.column_stack((np.nanmin(samples, 1), np.nanmean(samples, 1), np.nanmax(samples, 1)))


def drawn(thinned: Thinned, title: str, kind: str) -> bytes:
    """Draw as ``svg`` or ``png``: the mean as a line, lowest to highest as a band behind it."""
    panels = [panel for panel in PANELS if any(channel in thinned for channel, _ in panel.channels)]
    time = thinned.rows(TIME)[:, 1]
    with rc_context(_STYLE):
        heights = [1.5 if len(panel.channels) > 1 else 1.0 for panel in panels]
        figure = Figure(figsize=(10.0, 1.0 + 1.55 * sum(heights)), layout="constrained")
        axes: Any = figure.subplots(len(panels), 1, sharex=True, height_ratios=heights, squeeze=False)[:, 0]
        for ax, panel in zip(axes, panels, strict=True):
            _fill(ax, panel, thinned, time)
        axes[-1].set_xlabel("time [s]")
        axes[-1].set_xlim(0.0, float(time[-1]))
        figure.align_ylabels()
        if title:
            figure.suptitle(title.replace("$", r"\$"), fontsize=12, x=0.01, ha="left")
        out = io.BytesIO()
        figure.savefig(out, format=kind, dpi=130, metadata={"Date": None} if kind == "svg" else None)
    return out.getvalue()


def _fill(ax: Any, panel: Panel, thinned: Thinned, time: Samples) -> None:
    shown = [(channel, words) for channel, words in panel.channels if channel in thinned]
    for (channel, words), colour in zip(shown, _COLOURS, strict=False):
        low, mean, high = thinned.rows(channel).T
        if (high > low).any():
            ax.fill_between(time, low, high, color=colour, alpha=0.35, linewidth=0.7)
        ax.plot(time, mean, color=colour, linewidth=1.2, label=words)
    ax.set_ylabel(panel.label)
    ax.grid(visible=True, color="#d9d9d9", linewidth=0.6)
    ax.spines[["top", "right"]].set_visible(False)
    ax.margins(y=0.08)
    bottom, top = ax.get_ylim()
    # a ripple of a thousandth must not look like an event
    missing = max(0.0, panel.smallest_span - (top - bottom))
    ax.set_ylim(bottom - 0.5 * missing, top + 0.5 * missing)
    if len(shown) > 1:
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
