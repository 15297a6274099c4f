"""Small SVG pictures written by hand: printable, readable without colour, no script, no foreign address."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape

FONT = 'font-family="system-ui, sans-serif" font-size="13"'
INK, QUIET, GRID, BAND, ACCENT = "#1b2430", "#5a6675", "#e1e6ec", "#cfe0f1", "#1f5f99"


@dataclass(frozen=True, slots=True)
class Frame:
    """A plot's area in pixels and the data range that it shows."""

    left: float
    top: float
    right: float
    bottom: float
    x_low: float
    x_high: float
    y_low: float
    y_high: float

    def x(self, value: float) -> float:
        """Pixel of a horizontal data value."""
        return self.left + (value - self.x_low) / (self.x_high - self.x_low) * (self.right - self.left)

    def y(self, value: float) -> float:
        """Pixel of a vertical data value."""
        return self.bottom - (value - self.y_low) / (self.y_high - self.y_low) * (self.bottom - self.top)


@dataclass(frozen=True, slots=True)
class Scale:
    """How numbers stand beside a picture that is drawn in a unit of ours: ``written = factor * value + offset``."""

    word: str = ""
    factor: float = 1.0
    offset: float = 0.0

    def written(self, value: float) -> float:
        """A value in the unit that is written."""
        return self.factor * value + self.offset

    def ticks(self, low: float, high: float, about: int = 6) -> list[tuple[float, float]]:
        """Values of ours, and what is written there: round numbers of the unit that is written."""
        marks = ticks(self.written(low), self.written(high), about)
        return [((mark - self.offset) / self.factor, mark) for mark in marks]


AS_DRAWN = Scale()
"""Numbers as the picture is drawn."""


def ticks(low: float, high: float, about: int = 6) -> list[float]:
    """Round values between ``low`` and ``high``, about as many as asked for."""
    raw = (high - low) / max(about, 1)
    magnitude = 10.0 ** math.floor(math.log10(raw))
    step = next(m * magnitude for m in (1.0, 2.0, 2.5, 5.0, 10.0) if m * magnitude >= raw * 0.999)
    first = math.ceil(low / step - 1e-9)
    return [k * step for k in range(first, math.floor(high / step + 1e-9) + 1)]


def padded(values: Sequence[float], share: float = 0.08, smallest: float = 1e-3) -> tuple[float, float]:
    """Range of the finite values with a margin; a range of ``smallest`` at least."""
    known = [v for v in values if math.isfinite(v)] or [0.0]
    low, high = min(known), max(known)
    margin = max((high - low) * share, smallest)
    return low - margin, high + margin


def text(x: float, y: float, words: str, *, anchor: str = "start", colour: str = INK, extra: str = "") -> str:
    """A line of text."""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{colour}" {FONT} {extra}>{escape(words)}</text>'


def line(x1: float, y1: float, x2: float, y2: float, colour: str, width: float = 1.0, extra: str = "") -> str:
    """A straight line."""
    return (
        f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{colour}" '
        f'stroke-width="{width:g}" {extra}/>'
    )


def path(points: Sequence[tuple[float, float]], *, close: bool = False) -> str:
    """Path data through pixels."""
    steps = " L ".join(f"{x:.1f} {y:.1f}" for x, y in points)
    return f"M {steps}{' Z' if close else ''}"


def axes(
    frame: Frame,
    x_title: str,
    y_title: str,
    x_labels: Sequence[tuple[float, str]] | None = None,
    x_scale: Scale = AS_DRAWN,
    y_scale: Scale = AS_DRAWN,
) -> list[str]:
    """Grid, tick labels and axis titles; the labels are in the units of the scales."""
    out = []
    labels = x_labels
    if labels is None:
        labels = [(v, f"{mark:g}") for v, mark in x_scale.ticks(frame.x_low, frame.x_high)]
    for value, words in labels:
        x = frame.x(value)
        out.append(line(x, frame.top, x, frame.bottom, GRID))
        out.append(text(x, frame.bottom + 18, words, anchor="middle", colour=QUIET))
    for value, mark in y_scale.ticks(frame.y_low, frame.y_high, 5):
        y = frame.y(value)
        out.append(line(frame.left, y, frame.right, y, GRID))
        out.append(text(frame.left - 8, y + 4, f"{mark:g}", anchor="end", colour=QUIET))
    out.append(line(frame.left, frame.bottom, frame.right, frame.bottom, QUIET))
    out.append(line(frame.left, frame.top, frame.left, frame.bottom, QUIET))
    out.append(text((frame.left + frame.right) / 2, frame.bottom + 38, x_title, anchor="middle"))
    out.append(text(frame.left, frame.top - 10, y_title))
    return out


def document(width: int, height: int, title: str, description: str, body: Sequence[str]) -> str:
    """A whole picture with its title and description for those who cannot see it."""
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        f'role="img"><title>{escape(title)}</title><desc>{escape(description)}</desc>'
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>' + "".join(body) + "</svg>"
    )
