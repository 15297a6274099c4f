"""The damage identification curve as a picture."""

import math
from collections.abc import Mapping

from detectors.curve.points import Curve
from detectors.curve.svg import ACCENT, BAND, INK, QUIET, Frame, axes, document, line, padded, path, text
from detectors.words.numbers import Z_90

WIDTH, HEIGHT = 820, 520
"""Of the picture [px]: half a page of a printed report."""
_NAMES: Mapping[str, str] = {
    "pump_degradation": "worn pump",
    "compensator_fault": "setting",
    "system_leakage": "leak in the circuit",
    "drain_restriction": "restricted drain",
}
_ARROW = 9.0
"""Length of an arrow's wings [px]."""


def curve_svg(curve: Curve, title: str) -> str:
    """Draw reference curve with its band, the pump's points in time order, and the fault directions.

    ``title`` names the pump. Older points are pale, the newest is filled and labelled.
    """
    frame = _frame(curve)
    body = axes(frame, "discharge pressure [bar]", "case minus reservoir pressure [bar]")
    body += _band(curve, frame)
    body += _points(curve, frame)
    body += _directions(curve, frame)
    conditions = curve.conditions
    where = (
        f"{conditions['speed_rpm']:.0f} rpm, {conditions['fluid_temperature_degc']:.0f} °C, "
        f"reservoir {conditions['reservoir_pressure_bar']:.2f} bar"
    )
    body.append(text(frame.left, 24, title, extra='font-weight="600"'))
    body.append(text(frame.right, 44, _legend(curve), anchor="end", colour=QUIET))
    body.append(text(frame.right, 24, f"brought to {where}", anchor="end", colour=QUIET))
    return document(WIDTH, HEIGHT, f"Damage identification curve of {title}", _description(curve, where), body)


def _legend(curve: Curve) -> str:
    if curve.baseline.records == 0:
        return "line: healthy pump of the type, growing demand"
    return f"line: healthy pump, growing demand, through this pump's first {curve.baseline.records} records"


def _frame(curve: Curve) -> Frame:
    xs = [p.x for p in curve.points] + [p.x for p in curve.curve]
    ys = [p.y for p in curve.points] + [v for p in curve.curve for v in (p.low, p.high)]
    if curve.curve:
        start = curve.points[-1] if curve.points else curve.curve[0]
        xs += [start.x + d.dx for d in curve.directions.values()]
        ys += [start.y + d.dy for d in curve.directions.values()]
    x_low, x_high = padded(xs, smallest=0.5)
    y_low, y_high = padded(ys, smallest=0.05)
    return Frame(64, 70, WIDTH - 24, HEIGHT - 60, x_low, x_high, min(y_low, 0.0), y_high)


def _band(curve: Curve, frame: Frame) -> list[str]:
    if not curve.curve:
        return []
    upper = [(frame.x(p.x), frame.y(p.high)) for p in curve.curve]
    lower = [(frame.x(p.x), frame.y(p.low)) for p in reversed(curve.curve)]
    middle = [(frame.x(p.x), frame.y(p.y)) for p in curve.curve]
    out = [
        f'<path d="{path(upper + lower, close=True)}" fill="{BAND}" fill-opacity="0.7"/>',
        f'<path d="{path(middle)}" fill="none" stroke="{ACCENT}" stroke-width="2"/>',
    ]
    for point in curve.curve:
        if point.system_leakage_lpm in (0.0, 3.0, 6.0, 10.0):
            x, y = frame.x(point.x), frame.y(point.y)
            out.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{ACCENT}"/>')
            label = "baseline, no demand" if point.system_leakage_lpm == 0.0 else f"{point.system_leakage_lpm:g} L/min"
            if point.system_leakage_lpm == 0.0:
                out.append(text(x + 6, y + 18, label, colour=ACCENT))
            else:
                out.append(text(x - 8, y + 16, label, anchor="end", colour=ACCENT))
    return out


def _points(curve: Curve, frame: Frame) -> list[str]:
    n = len(curve.points)
    out = []
    for i, point in enumerate(curve.points):
        x, y = frame.x(point.x), frame.y(point.y)
        if i < n - 1:
            share = 0.25 + 0.6 * i / max(n - 1, 1)
            out.append(
                f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="none" stroke="{INK}" stroke-opacity="{share:.2f}"/>'
            )
            continue
        half_x = Z_90 * math.sqrt(point.covariance[0][0])
        half_y = Z_90 * math.sqrt(point.covariance[1][1])
        out.append(line(frame.x(point.x - half_x), y, frame.x(point.x + half_x), y, INK))
        out.append(line(x, frame.y(point.y - half_y), x, frame.y(point.y + half_y), INK))
        out.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="6" fill="{INK}"/>')
    return out


def _directions(curve: Curve, frame: Frame) -> list[str]:
    if not curve.curve:
        return []
    start = curve.points[-1] if curve.points else curve.curve[0]
    x_0, y_0 = frame.x(start.x), frame.y(start.y)
    out = []
    ends = []
    for name, direction in curve.directions.items():
        x_1, y_1 = frame.x(start.x + direction.dx), frame.y(start.y + direction.dy)
        angle = math.atan2(y_1 - y_0, x_1 - x_0)
        wings = [(x_1 - _ARROW * math.cos(angle + turn), y_1 - _ARROW * math.sin(angle + turn)) for turn in (0.4, -0.4)]
        out.append(line(x_0, y_0, x_1, y_1, QUIET, 1.5, 'stroke-dasharray="5 3"'))
        out.append(
            f'<path d="{path([wings[0], (x_1, y_1), wings[1]])}" fill="none" stroke="{QUIET}" stroke-width="1.5"/>'
        )
        ends.append((y_1, x_1, f"{_NAMES.get(name, name)} (+{direction.per})"))
    # labels one under the other, so that close directions stay readable
    floor = -math.inf
    steep = [x for _, x, _ in ends if 0.0 <= x - x_0 < 0.3 * (frame.right - frame.left)]
    for y_1, x_1, words in sorted(ends):
        y = max(y_1 - 6, floor + 17)
        floor = y
        right = x_0 <= x_1 < frame.right - 170
        place = max(steep) + 10 if right and x_1 in steep else x_1 + (8 if right else -8)
        out.append(text(place, y, words, anchor="start" if right else "end", colour=QUIET))
    return out


def _description(curve: Curve, where: str) -> str:
    if not curve.points:
        return f"Reference curve of the healthy pump at {where}; the pump has no points yet."
    last = curve.points[-1]
    return (
        f"Reference curve of the healthy pump at {where} and {len(curve.points)} points of this pump. "
        f"The newest lies at {last.x:.1f} bar discharge and {last.y:.3f} bar case minus reservoir pressure."
    )
