"""Plots of the evidence as SVG that can stand inside a page: no foreign address, lines told apart without colour."""

import io
import re
from html import escape

import matplotlib
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from twin.validation.evidence import Plot

_WIDTH_IN, _HEIGHT_IN = 6.0, 3.4
_INK, _GRID = "#1b2430", "#d7dde4"
_DASHES = (0, (6, 2, 1, 2, 1, 2))
_LINES: tuple[tuple[str, str | tuple[int, tuple[int, ...]]], ...] = (
    ("#1f5f99", "-"),
    ("#98181f", "--"),
    ("#1d6b3a", "-."),
    ("#5b3a94", ":"),
    ("#8a4b00", _DASHES),
)
_FEW = 12
"""Up to so many points a curve shows each of them."""
_FONTS = ["DejaVu Sans", "sans-serif"]


def plot_svg(plot: Plot, name: str) -> str:
    """One plot as an ``svg`` element; ``name`` keeps its inner ids apart from those of other plots on the page."""
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": name, "font.family": _FONTS}):
        figure = Figure(figsize=(_WIDTH_IN, _HEIGHT_IN), layout="constrained")
        FigureCanvasSVG(figure)
        axes = figure.add_subplot()
        for i, curve in enumerate(plot.curves):
            colour, style = _LINES[i % len(_LINES)]
            marker = "os^Dv"[i % 5] if len(curve.x) <= _FEW else ""
            axes.plot(curve.x, curve.y, color=colour, linestyle=style, marker=marker, markersize=4, label=curve.label)
        axes.set_xlabel(plot.x_label)
        axes.set_ylabel(plot.y_label)
        axes.grid(visible=True, color=_GRID, linewidth=0.7)
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(colors=_INK)
        axes.margins(x=0.01)
        if len(plot.curves) > 1:
            # above the axes: never on top of a curve
            figure.legend(loc="outside upper left", ncols=2, frameon=False, handlelength=2.6)
        out = io.StringIO()
        figure.savefig(out, format="svg", metadata={"Creator": None, "Date": None, "Format": None, "Type": None})
    return _embedded(out.getvalue(), plot.title, name)


def _embedded(document: str, title: str, name: str) -> str:
    """The ``svg`` element without what only a file of its own needs: prolog, metadata, namespaces, fixed size."""
    body = document[document.index("<svg") :]
    body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL)
    body = re.sub(r"\s*<!--.*?-->", "", body, flags=re.DOTALL)
    view = re.search(r'viewBox="([^"]+)"', body)
    if view is None:
        raise ValueError("the drawing has no viewBox")
    body = body[body.index(">") + 1 :]
    # ids of groups mean nothing and repeat from plot to plot; those that are referred to carry the salt
    used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', body))
    body = re.sub(r' id="([^"]+)"', lambda m: m.group(0) if m.group(1) in used else "", body)
    for identity in sorted(used, key=len, reverse=True):
        body = re.sub(rf'((?:href="#|url\(#|id=")){re.escape(identity)}(?=[")])', rf"\g<1>{name}-{identity}", body)
    return f'<svg viewBox="{view.group(1)}" role="img" aria-label="{escape(title)}">{body}'
