"""The second panel of the curve's picture: case pressure beyond the reference over fluid temperature, and its laws."""

from collections.abc import Mapping
from itertools import pairwise

from detectors.curve.laws import NEWEST, Law
from detectors.curve.points import Curve
from detectors.drawing.svg import ACCENT, INK, QUIET, Frame, Scale, axes, line, padded, path, text
from detectors.words.numbers import Z_90

Scales = Mapping[str, Scale]
"""How numbers are written, by our unit: ``bar``, ``L/min``, ``degC``."""
_SHOWN = 60
"""Newest records that are drawn."""
_MARGIN, _LINE = 232.0, 18.0
"""Room for words beside the panel, and of a line of them [px]."""
_CLEARLY = 6.0
"""Square sum of misfits, in standard deviations, by which the best law must be better (our choice: odds of twenty to one)."""
SHIFTED_BAR = 0.08
"""Shift of the case sensor's zero from which on it is drawn (estimate: 0.06 bar come over some hundred flights)."""
_STROKES: Mapping[str, tuple[str, str]] = {
    "pump_degradation": ("leak of the pump", ""),
    "drain_restriction": ("restricted drain", 'stroke-dasharray="9 4"'),
    "system_leakage": ("leak in the circuit", 'stroke-dasharray="2 4"'),
}
"""Words and strokes of the laws: told apart without colour."""


def cross(x: float, y: float, opacity: float) -> str:
    """Mark of what a record would be with the sensor's first zero."""
    way = f"M {x - 3:.1f} {y - 3:.1f} l 6 6 m 0 -6 l -6 6"
    return f'<path d="{way}" fill="none" stroke="{QUIET}" stroke-opacity="{opacity:.2f}"/>'


def temperature_panel(curve: Curve, place: Frame, scales: Scales) -> list[str]:
    """The panel within ``place``, whose data range is found here; a line of words where there is no record."""
    if not curve.excess:
        return [text(place.left, place.top, "case pressure beyond the reference: no record yet", colour=QUIET)]
    frame = _frame(curve, place)
    bar, warmth = scales["bar"], scales["degC"]
    y_title = f"case pressure beyond this pump's reference [{bar.word}]"
    out = axes(frame, f"fluid temperature [{warmth.word}]", y_title, x_scale=warmth, y_scale=bar)
    out.append(line(frame.left, frame.y(0.0), frame.right, frame.y(0.0), ACCENT, 2.0))
    offsets = _offsets(curve)
    for record in curve.excess[-_SHOWN:]:
        x, y = frame.x(record.fluid_temperature_degc), frame.y(record.residual)
        ink, share = (INK, 0.9) if record.fitted else (QUIET, 0.4)
        if frame.top <= y <= frame.bottom:
            half = Z_90 * record.standard_deviation
            ends = [
                max(min(frame.y(v), frame.bottom), frame.top) for v in (record.residual + half, record.residual - half)
            ]
            out.append(line(x, ends[0], x, ends[1], ink, 1.0, f'stroke-opacity="{0.6 * share:.2f}"'))
            out.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{ink}" fill-opacity="{share:.2f}"/>')
        read = frame.y(record.residual + offsets.get(record.at, 0.0))
        if record.at in offsets and frame.top <= read <= frame.bottom:
            out.append(cross(x, read, share))
    for name, law in _drawn(curve):
        pixels = [(frame.x(t), frame.y(v)) for t, v in law.curve]
        inside = [p for p in pixels if frame.left <= p[0] <= frame.right]
        out.append(f'<path d="{path(inside)}" fill="none" stroke="{INK}" stroke-width="1.8" {_STROKES[name][1]}/>')
    return out + _words(curve, frame, scales)


def _drawn(curve: Curve) -> list[tuple[str, Law]]:
    return [(name, law) for name, law in (curve.laws or {}).items() if len(law.curve) > 1]


def _best(curve: Curve) -> str | None:
    """The law that the newest records fit clearly better than any other; None where none does."""
    ranked = sorted(_drawn(curve), key=lambda one: one[1].misfit)
    fitted = sum(e.fitted for e in curve.excess)
    if len(ranked) < 2 or fitted * (ranked[1][1].misfit ** 2 - ranked[0][1].misfit ** 2) < _CLEARLY:
        return None
    return ranked[0][0]


def _offsets(curve: Curve) -> dict[object, float]:
    """By event time, how far the case sensor's zero had moved from its first, where that is far."""
    return {r.at: r.y_first_zero - r.y for r in curve.readings if abs(r.y_first_zero - r.y) > SHIFTED_BAR}


def _words(curve: Curve, frame: Frame, scales: Scales) -> list[str]:
    """Beside the panel: each law's words at the height where it ends, none over another; below them what marks mean."""
    ends = sorted((frame.y(law.curve[-1][1]), name, law) for name, law in _drawn(curve))
    heights = [y for y, _, _ in ends]
    for i, (one, other) in enumerate(pairwise(range(len(heights)))):
        heights[i + 1] = max(heights[other], heights[one] + _LINE)
    x, out, best = frame.right + 30.0, list[str](), _best(curve)
    for height, (y, name, law) in zip(heights, ends, strict=True):
        end = min(max(y, frame.top), frame.bottom)
        out.append(line(frame.right, end, x - 4.0, height, QUIET, 0.8))
        scale = scales.get(law.unit, Scale(law.unit))
        size = scale.written(law.size)
        words = f"{_STROKES[name][0]} {size:.{0 if size >= 10.0 else 2}f} {scale.word}"
        out.append(text(x, height + 4.5, words, extra='font-weight="600"' if name == best else ""))
    below = [f"dark: the newest {NEWEST}"] if ends else ["nothing stands out"]
    if ends:
        below.append("bold: fits clearly best" if best else "no law fits clearly best")
    if _offsets(curve):
        below.append("× with the sensor's first zero")
    start = max(frame.bottom - _LINE * (len(below) - 1), (heights[-1] if heights else 0.0) + 2.0 * _LINE)
    return out + [text(x, start + _LINE * i, words, colour=QUIET) for i, words in enumerate(below)]


def _frame(curve: Curve, place: Frame) -> Frame:
    shown, offsets = curve.excess[-_SHOWN:], _offsets(curve)
    values = sorted(v for e in shown for v in (e.residual, e.residual + offsets.get(e.at, 0.0)))
    # the two wildest of sixty stay outside
    skipped = len(values) // 40
    values = values[skipped : len(values) - skipped]
    laws = [v for _, law in _drawn(curve) for _, v in law.curve]
    y_low, y_high = padded([*values, *laws, 0.0], smallest=0.04)
    ts = [e.fluid_temperature_degc for e in shown]
    x_low, x_high = padded(ts, share=0.0, smallest=4.0)
    return Frame(place.left, place.top, place.right - _MARGIN, place.bottom, x_low, x_high, y_low, y_high)
