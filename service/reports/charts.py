"""Trend charts as SVG: interval band, values, baseline at zero or a limit."""

from collections.abc import Sequence
from datetime import UTC, datetime

from detectors.drawing.svg import ACCENT, BAND, QUIET, Frame, Scale, axes, document, line, padded, path, text
from service.answers.pumps import TrendPoint

WIDTH, HEIGHT = 820, 250
_SPARK = (120, 28)


def trend_svg(title: str, scale: Scale, items: Sequence[TrendPoint], limit: float | None = None) -> str:
    """Chart of one metric over time with its 90 % interval; ``limit`` is drawn as a dashed line.

    Values and limit are in our unit; ``scale`` says how they are written.
    """
    unit = scale.word
    instants = [datetime.fromisoformat(item["at"]).timestamp() for item in items]
    values = [v for item in items for v in (item["value"], item["low"], item["high"])]
    low, high = padded([*values, *([] if limit is None else [limit])])
    start, end = padded(instants, share=0.02, smallest=43_200.0)
    frame = Frame(64, 40, WIDTH - 20, HEIGHT - 44, start, end, low, high)
    body = axes(frame, "", f"{title} [{unit}]", _dates(start, end), y_scale=scale)
    upper = [(frame.x(t), frame.y(i["high"])) for t, i in zip(instants, items, strict=True)]
    lower = [(frame.x(t), frame.y(i["low"])) for t, i in zip(instants, items, strict=True)]
    middle = [(frame.x(t), frame.y(i["value"])) for t, i in zip(instants, items, strict=True)]
    body.append(f'<path d="{path(upper + lower[::-1], close=True)}" fill="{BAND}" fill-opacity="0.8"/>')
    body.append(f'<path d="{path(middle)}" fill="none" stroke="{ACCENT}" stroke-width="2"/>')
    if low < 0.0 < high:
        body.append(line(frame.left, frame.y(0.0), frame.right, frame.y(0.0), QUIET))
    if limit is not None:
        y = frame.y(limit)
        body.append(line(frame.left, y, frame.right, y, "#8a1c1c", 1.5, 'stroke-dasharray="6 4"'))
        words = f"limit {scale.written(limit):.4g} {unit}"
        body.append(text(frame.right, y - 5, words, anchor="end", colour="#8a1c1c"))
    last, lowest, highest = (scale.written(v) for v in (items[-1]["value"], items[-1]["low"], items[-1]["high"]))
    return document(
        WIDTH,
        HEIGHT,
        f"Trend of {title}",
        f"{len(items)} values; the newest is {last:.3g} {unit} ({lowest:.3g} to {highest:.3g}).",
        body,
    )


def sparkline_svg(values: Sequence[float], label: str) -> str:
    """Tiny line for a table cell."""
    width, height = _SPARK
    low, high = padded(values, smallest=0.05)
    frame = Frame(2, 3, width - 5, height - 3, 0.0, max(len(values) - 1, 1), low, high)
    points = [(frame.x(i), frame.y(v)) for i, v in enumerate(values)]
    x, y = points[-1]
    return (
        f'<svg class="spark" viewBox="0 0 {width} {height}" width="{width}" height="{height}" role="img">'
        f'<title>{label}</title><path d="{path(points)}" fill="none" stroke="{ACCENT}" stroke-width="1.5"/>'
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.5" fill="{ACCENT}"/></svg>'
    )


def _dates(start: float, end: float) -> list[tuple[float, str]]:
    count = 6
    step = (end - start) / count
    places = [start + step * (k + 0.5) for k in range(count)]
    return [(p, f"{datetime.fromtimestamp(p, tz=UTC):%d %b %Y}") for p in places]
