"""A metric over time or flight hours as a picture that can be read closely: events, sibling, fleet, limit, one scale."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import pairwise

from detectors.drawing.svg import AS_DRAWN, Frame, Scale, axes, document, line, padded, text, ticks

WIDTH, HEIGHT = 820, 262
_LEFT, _TOP, _RIGHT, _BOTTOM = 64, 52, WIDTH - 20, HEIGHT - 44
LETTERS = {"exchange": "X", "maintenance": "M", "finding": "F", "alarm": "A", "baseline": "B", "thresholds": "T"}
"""What stands over an event's line."""
_CLOSE = 11.0
"""Pixels within which letters of neighbouring events are written as one group."""
_DAY_S = 86_400.0


@dataclass(frozen=True, slots=True)
class Series:
    """One line: places on the horizontal axis, values, and an interval where there is one."""

    x: Sequence[float]
    value: Sequence[float]
    low: Sequence[float] = ()
    high: Sequence[float] = ()


@dataclass(frozen=True, slots=True)
class TrendChart:
    """What a chart shows; horizontally seconds since 1970 (UTC), or flight hours where ``in_hours``.

    ``sibling`` is the pump at the other position, ``band`` the middle of the fleet, ``events`` pairs of a place and a kind.
    Values are in our unit; ``scale`` says how they are written, in ``unit``.
    """

    title: str
    unit: str
    own: Series
    start: float
    end: float
    in_hours: bool = False
    limit: float | None = None
    sibling: Series | None = None
    band: tuple[float, float] | None = None
    events: Sequence[tuple[float, str]] = field(default=())
    scale: Scale = AS_DRAWN


def chart_svg(chart: TrendChart) -> str:
    """The picture; classes name what things are, the style sheet of the page colours them.

    The group ``panel`` says its axes (``data-x0`` ... in the chart's units, ``data-left`` ... in pixels), so that a cursor
    can read values off the lines.
    """
    values = [*chart.own.value, *chart.own.low, *chart.own.high, *(chart.band or ())]
    values += [] if chart.limit is None else [chart.limit]
    values += chart.sibling.value if chart.sibling else []
    low, high = padded(values)
    frame = Frame(_LEFT, _TOP, _RIGHT, _BOTTOM, chart.start, max(chart.end, chart.start + 1e-6), low, high)
    labels = [(v, f"{v:g}") for v in ticks(frame.x_low, frame.x_high)] if chart.in_hours else _dates(frame)
    body = [_panel(frame, chart)]
    body += axes(frame, "flight hours [h]" if chart.in_hours else "", "", labels, y_scale=chart.scale)
    if chart.band is not None:
        top, bottom = frame.y(chart.band[1]), frame.y(chart.band[0])
        body.append(
            f'<rect class="fleet" x="{_LEFT}" y="{top:.1f}" width="{_RIGHT - _LEFT}" height="{max(bottom - top, 1):.1f}"/>'
        )
    body += _lines(frame, chart)
    if low < 0.0 < high:
        body.append(f'<path class="zero" d="M {_LEFT} {frame.y(0.0):.1f} H {_RIGHT}"/>')
    if chart.limit is not None:
        y = frame.y(chart.limit)
        body.append(line(_LEFT, y, _RIGHT, y, "#8a1c1c", 1.5, 'stroke-dasharray="6 4"'))
        words = f"limit {chart.scale.written(chart.limit):.4g} {chart.unit}"
        body.append(text(_RIGHT, y - 5, words, anchor="end", colour="#8a1c1c"))
    body += _events(frame, chart.events)
    body.append("</g>")
    body.append(text(_LEFT, 16, f"{chart.title} [{chart.unit}]"))
    return document(WIDTH, HEIGHT, f"Trend of {chart.title}", _said(chart), body)


def _panel(frame: Frame, chart: TrendChart) -> str:
    low, high = chart.scale.written(frame.y_low), chart.scale.written(frame.y_high)
    held = {
        "x0": f"{frame.x_low:.6f}", "x1": f"{frame.x_high:.6f}", "y0": f"{low:.6g}", "y1": f"{high:.6g}",
        "left": _LEFT, "right": _RIGHT, "top": _TOP, "bottom": _BOTTOM, "unit": chart.unit,
    }  # fmt: skip
    return '<g class="panel" ' + " ".join(f'data-{name}="{value}"' for name, value in held.items()) + ">"


def _lines(frame: Frame, chart: TrendChart) -> list[str]:
    own = chart.own
    out = []
    if own.low and own.high:
        upper = [(frame.x(x), frame.y(v)) for x, v in zip(own.x, own.high, strict=True)]
        lower = [(frame.x(x), frame.y(v)) for x, v in zip(own.x, own.low, strict=True)]
        out.append(f'<path class="band" d="{_short(upper + lower[::-1])} Z"/>')
    if chart.sibling is not None and chart.sibling.x:
        there = zip(chart.sibling.x, chart.sibling.value, strict=True)
        places = [(frame.x(x), frame.y(v)) for x, v in there if frame.x_low <= x <= frame.x_high]
        if places:
            out.append(f'<path class="sibling" data-name="sibling" d="{_short(places)}"/>')
    places = [(frame.x(x), frame.y(v)) for x, v in zip(own.x, own.value, strict=True)]
    if places:
        out.append(f'<path class="own" data-name="this pump" d="{_short(places if len(places) > 1 else places * 2)}"/>')
    return out


def _short(points: Sequence[tuple[float, float]]) -> str:
    """Path data in steps from point to point: half as long as absolute places."""
    whole = [(round(10 * x), round(10 * y)) for x, y in points]
    if not whole:
        return ""
    first = f"M{whole[0][0] / 10:g} {whole[0][1] / 10:g}"
    return first + "".join(f"l{(b[0] - a[0]) / 10:g} {(b[1] - a[1]) / 10:g}" for a, b in pairwise(whole))


def _events(frame: Frame, events: Sequence[tuple[float, str]]) -> list[str]:
    out: list[str] = []
    groups: list[tuple[float, set[str]]] = []
    for x, kind in sorted((frame.x(at), kind) for at, kind in events if frame.x_low <= at <= frame.x_high):
        out.append(f'<path class="event {kind}" d="M{x:.1f} {_TOP}V{_BOTTOM}"/>')
        if groups and x - groups[-1][0] < _CLOSE:
            groups[-1][1].add(LETTERS[kind])
        else:
            groups.append((x, {LETTERS[kind]}))
    for x, letters in groups:
        out.append(text(x, _TOP - 5, "".join(sorted(letters)), anchor="middle"))
    return out


def _dates(frame: Frame) -> list[tuple[float, str]]:
    """Labels at midnights, closer than a day at full minutes."""
    span = frame.x_high - frame.x_low
    pattern = "%d %b %Y" if span > 6 * _DAY_S else "%d %b %H:%M"
    places = [frame.x_low + span * (k + 0.5) / 6 for k in range(6)]
    if span > 6 * _DAY_S:
        places = [_DAY_S * round(p / _DAY_S) for p in places]
    return [(p, f"{datetime.fromtimestamp(p, tz=UTC):{pattern}}") for p in places if frame.x_low <= p <= frame.x_high]


def _said(chart: TrendChart) -> str:
    """The picture in words."""
    own, unit, written = chart.own, chart.unit, chart.scale.written
    if not own.value:
        return "No value in this stretch."
    lowest, highest, newest = (written(v) for v in (min(own.value), max(own.value), own.value[-1]))
    words = f"{len(own.value)} values from {lowest:.3g} to {highest:.3g} {unit}; the newest is {newest:.3g}"
    if own.low and own.high:
        words += f" ({written(own.low[-1]):.3g} to {written(own.high[-1]):.3g})"
    words += f" {unit}."
    if chart.band is not None:
        low, high = (written(v) for v in chart.band)
        words += f" The middle of the fleet is {low:.3g} to {high:.3g} {unit}."
    return words
