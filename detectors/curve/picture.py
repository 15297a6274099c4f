"""The damage identification curve as a picture: the plane of the curve above, case pressure over temperature below."""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from detectors.curve.labels import Box, Label, Labels
from detectors.curve.points import Curve, CurvePoint, Direction, Reading
from detectors.curve.temperatures import SHIFTED_BAR, Scales, cross, temperature_panel
from detectors.drawing.svg import ACCENT, BAND, INK, QUIET, Frame, Scale, axes, document, line, padded, path, text
from detectors.words.numbers import Z_90

WIDTH, HEIGHT = 820, 800
"""Of the picture [px]: a page of a printed report in width, both panels one above the other."""
_PLANE_BOTTOM, _SECOND_TOP = 446, 552
NAMES: Mapping[str, str] = {
    "pump_degradation": "worn pump",
    "compensator_fault": "setting",
    "system_leakage": "leak in the circuit",
    "drain_restriction": "restricted drain",
}
_ARROW = 9.0
"""Length of an arrow's wings [px]."""
_CHI_90 = math.sqrt(4.605)
"""Half axes of the ellipse that holds 90 % of a plane's normal distribution, in standard deviations."""
_N_AROUND = 48
_SHOWN = 40
"""Newest points and readings that are drawn; the data hold all."""
_LABELLED = (4.0, 6.0, 10.0)
"""Demands that are written along the curve [L/min]."""
_LEAST_DEMAND = 4.0
"""Up to here the curve is drawn, whatever the pump shows [L/min]."""
MARK = "#b4552d"
"""Of the pump's own points."""
OWN_SCALES: Scales = {"bar": Scale("bar"), "L/min": Scale("L/min"), "degC": Scale("°C")}
"""Numbers as everything here holds them."""


def curve_svg(curve: Curve, title: str, scales: Scales = OWN_SCALES) -> str:
    """Draw this pump's reference with its band, the pump's points in time order, and the fault directions.

    ``title`` names the pump; ``scales`` say by our unit how numbers are written. Older points are pale, the newest is filled,
    with its 90 % ellipse. The second panel shows the case pressure beyond the reference over fluid temperature, with the laws
    that could explain it.
    """
    frame = _frame(curve)
    conditions = curve.conditions
    bar, warmth = scales["bar"], scales["degC"]
    where = (
        f"{conditions['speed_rpm']:.0f} rpm, {warmth.written(conditions['fluid_temperature_degc']):.0f} {warmth.word}, "
        f"reservoir {bar.written(conditions['reservoir_pressure_bar']):.2f} {bar.word}"
    )
    body = [text(frame.left, 24, title, extra='font-weight="600"')]
    body.append(text(frame.right, 24, f"brought to {where}", anchor="end", colour=QUIET))
    body.append(text(frame.right, 44, _legend(curve), anchor="end", colour=QUIET))
    body += _band(curve, frame)
    x_title, y_title = f"discharge pressure [{bar.word}]", f"case minus reservoir pressure [{bar.word}]"
    body += axes(frame, x_title, y_title, x_scale=bar, y_scale=bar)
    labels = Labels(Box(frame.left + 2, frame.top + 2, frame.right - 2, frame.bottom - 2))
    body += _reference(curve, frame, labels, scales)
    body += _readings(curve, frame)
    body += _points(curve, frame, labels)
    body += _arrows(curve, frame, labels, scales)
    body.append(text(frame.right, frame.bottom + 58, _marks(curve), anchor="end", colour=QUIET))
    body += temperature_panel(curve, Frame(frame.left, _SECOND_TOP, frame.right, HEIGHT - 52, 0, 1, 0, 1), scales)
    return document(WIDTH, HEIGHT, f"Damage identification curve of {title}", _description(curve, where, bar), body)


def _legend(curve: Curve) -> str:
    if curve.baseline.records == 0:
        return "line: a pump of the type, growing demand; band: 90 %"
    return f"line: this pump without a fault, growing demand; band: 90 %; {curve.baseline.records} records here"


def _marks(curve: Curve) -> str:
    words = "dots: records; circles: the judge after each; filled: now, 90 %"
    return f"{words}; ×: with the sensor's first zero" if any(_with_first_zero(r) for r in curve.readings) else words


def _frame(curve: Curve) -> Frame:
    drawn = _along(curve)
    xs = [p.x + s * 2.2 * math.sqrt(p.covariance[0][0]) for p in drawn for s in (-1, 1)]
    ys = [p.y + s * 2.2 * math.sqrt(p.covariance[1][1]) for p in drawn for s in (-1, 1)]
    for point in curve.points[-_SHOWN:]:
        xs += [point.x + s * 2.2 * math.sqrt(point.covariance[0][0]) for s in (-1, 1)]
        ys += [point.y + s * 2.2 * math.sqrt(point.covariance[1][1]) for s in (-1, 1)]
    shown = curve.readings[-_SHOWN:]
    if shown:
        # one wild record must not make everything else small
        xs += np.quantile([r.x for r in shown], (0.05, 0.95)).tolist()
        ys += np.quantile([v for r in shown for v in (r.y, *_with_first_zero(r))], (0.04, 0.96)).tolist()
    if curve.curve:
        foot = curve.curve[0]
        for _, dx, dy in _drawn(curve.directions):
            xs.append(foot.x + dx)
            ys.append(foot.y + dy)
    x_low, x_high = padded(xs, smallest=0.5)
    y_low, y_high = padded(ys, smallest=0.05)
    return Frame(64, 76, WIDTH - 24, _PLANE_BOTTOM, x_low, x_high, y_low, y_high)


def _along(curve: Curve) -> Sequence[CurvePoint]:
    """As much of the reference as the pump needs: further on, an unknown droop makes the band as wide as the picture."""
    last = 0
    for i, point in enumerate(curve.curve):
        before = curve.curve[i - 1]
        # a leak of the circuit goes left and up
        asked = bool(curve.points) and before.x > curve.points[-1].x and before.y < curve.points[-1].y
        if point.system_leakage_lpm <= _LEAST_DEMAND or asked:
            last = i
    return curve.curve[: last + 1]


def _with_first_zero(reading: Reading) -> tuple[float, ...]:
    """Where the record would be with the sensor's first zero, when that is far off."""
    return (reading.y_first_zero,) if abs(reading.y_first_zero - reading.y) > SHIFTED_BAR else ()


def _band(curve: Curve, frame: Frame) -> list[str]:
    """Every place that the reference may be at with 90 %: the ellipses of its points, and what lies between them."""
    if not curve.curve:
        return []
    rings = [_ellipse((p.x, p.y), p.covariance, frame) for p in _along(curve)]
    shapes = [f'<path d="{path(ring, close=True)}"/>' for ring in rings]
    for one, other in pairwise(rings):
        shapes.append(f'<path d="{path(_hull([*one, *other]), close=True)}"/>')
    return [f'<g fill="{BAND}" opacity="0.8">{"".join(shapes)}</g>']


def _reference(curve: Curve, frame: Frame, labels: Labels, scales: Scales) -> list[str]:
    if not curve.curve:
        return []
    drawn = _along(curve)
    pixels = [(frame.x(p.x), frame.y(p.y)) for p in drawn]
    out = [f'<path d="{path(pixels)}" fill="none" stroke="{ACCENT}" stroke-width="2"/>']
    for start, end in pairwise(pixels):
        labels.keep_off_line(start, end)
    if curve.measured:
        bench = [(frame.x(x), frame.y(y)) for x, y in curve.measured if frame.x_low < x < frame.x_high]
        out += [_diamond(x, y) for x, y in bench]
        if bench:
            label = labels.place("measured on a bench", *bench[0], away=(-1.0, 1.0))
            out.append(_written(label, "measured on a bench", ACCENT))
    for point, (x, y) in zip(drawn, pixels, strict=True):
        if point.system_leakage_lpm not in (0.0, *_LABELLED):
            continue
        out.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.5" fill="{ACCENT}"/>')
        if point.system_leakage_lpm > 0.0:
            flow = scales["L/min"]
            words = f"demand {flow.written(point.system_leakage_lpm):.3g} {flow.word}"
            out.append(_written(labels.place(words, x, y, away=(-1.0, 1.0)), words, ACCENT))
    return out


def _readings(curve: Curve, frame: Frame) -> list[str]:
    """Records as measured, and where the case sensor's zero has moved also with its first."""
    out = []
    for reading in curve.readings[-_SHOWN:]:
        x, y = frame.x(reading.x), frame.y(reading.y)
        if not frame.left < x < frame.right:
            continue
        if frame.top < y < frame.bottom:
            out.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2" fill="{QUIET}" fill-opacity="0.6"/>')
        out += [cross(x, frame.y(v), 0.7) for v in _with_first_zero(reading) if frame.top < frame.y(v) < frame.bottom]
    return out


def _points(curve: Curve, frame: Frame, labels: Labels) -> list[str]:
    shown = curve.points[-_SHOWN:]
    if not shown:
        return []
    pixels = [(frame.x(p.x), frame.y(p.y)) for p in shown]
    out = [f'<path d="{path(pixels)}" fill="none" stroke="{MARK}" stroke-opacity="0.35"/>'] if len(pixels) > 1 else []
    for i, (x, y) in enumerate(pixels[:-1]):
        share = 0.25 + 0.6 * i / max(len(pixels) - 1, 1)
        out.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.5" fill="none" stroke="{MARK}" stroke-opacity="{share:.2f}"/>'
        )
    last = shown[-1]
    ring = _ellipse((last.x, last.y), last.covariance, frame)
    out.append(f'<path d="{path(ring, close=True)}" fill="{MARK}" fill-opacity="0.14" stroke="{MARK}"/>')
    for at in pixels:
        labels.keep_off(*at, 3.5)
    x, y = pixels[-1]
    out.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5.5" fill="{MARK}"/>')
    labels.keep_off(x, y, 8.0)
    words = "now"
    out.append(_written(labels.place(words, x, y, away=(1.0, 1.0)), words, MARK, bold=True))
    return out


def _drawn(directions: Mapping[str, Direction], scales: Scales = OWN_SCALES) -> list[tuple[str, float, float]]:
    """Arrows with their words: one a fault, two where it can go either way."""
    found = []
    for name, direction in directions.items():
        words = NAMES.get(name, name)
        scale = scales.get(direction.unit, Scale(direction.unit))
        per = f"{scale.written(direction.size):.3g} {scale.word}"
        found.append((f"{words} +{per}", direction.dx, direction.dy))
        if direction.both_ways:
            found.append((f"{words} −{per}", -direction.dx, -direction.dy))
    return found


def _arrows(curve: Curve, frame: Frame, labels: Labels, scales: Scales) -> list[str]:
    if not curve.curve:
        return []
    x_0, y_0 = frame.x(curve.curve[0].x), frame.y(curve.curve[0].y)
    ends = [
        (words, frame.x(curve.curve[0].x + dx), frame.y(curve.curve[0].y + dy))
        for words, dx, dy in _drawn(curve.directions, scales)
    ]
    out = []
    for _, x_1, y_1 in ends:
        labels.keep_off_line((x_0, y_0), (x_1, y_1))
        angle = math.atan2(y_1 - y_0, x_1 - x_0)
        wings = [(x_1 - _ARROW * math.cos(angle + turn), y_1 - _ARROW * math.sin(angle + turn)) for turn in (0.4, -0.4)]
        out.append(line(x_0, y_0, x_1, y_1, INK, 1.5, 'stroke-dasharray="6 3"'))
        out.append(
            f'<path d="{path([wings[0], (x_1, y_1), wings[1]])}" fill="none" stroke="{INK}" stroke-width="1.5"/>'
        )
    # the longest arrow first: its label has the least choice
    for words, x_1, y_1 in sorted(ends, key=lambda e: -math.hypot(e[1] - x_0, e[2] - y_0)):
        label = labels.place(words, x_1, y_1, away=(x_1 - x_0, y_1 - y_0))
        far = math.hypot(label.leader[0] - x_1, label.leader[1] - y_1)
        if far > 12.0:
            out.append(line(x_1, y_1, *label.leader, QUIET, 0.8))
        out.append(_written(label, words, INK))
    return out


def _written(label: Label, words: str, colour: str, *, bold: bool = False) -> str:
    """A label, with a white edge that keeps it readable over lines."""
    weight = ' font-weight="600"' if bold else ""
    edge = f'paint-order="stroke" stroke="#ffffff" stroke-width="3" stroke-linejoin="round"{weight}'
    return text(label.x, label.y, words, anchor=label.anchor, colour=colour, extra=edge)


def _diamond(x: float, y: float) -> str:
    return (
        f'<path d="M {x:.1f} {y - 5:.1f} l 5 5 l -5 5 l -5 -5 Z" fill="#ffffff" stroke="{ACCENT}" stroke-width="1.5"/>'
    )


def _ellipse(
    centre: tuple[float, float], covariance: tuple[tuple[float, float], tuple[float, float]], frame: Frame
) -> list[tuple[float, float]]:
    """Outline of the 90 % ellipse in pixels."""
    values, vectors = np.linalg.eigh(np.array(covariance))
    reach = _CHI_90 * np.sqrt(np.maximum(values, 0.0))
    turn = np.linspace(0.0, 2.0 * math.pi, _N_AROUND, endpoint=False)
    ring = (vectors * reach) @ np.vstack((np.cos(turn), np.sin(turn)))
    return [(frame.x(centre[0] + float(dx)), frame.y(centre[1] + float(dy))) for dx, dy in ring.T]


def _hull(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Convex hull (Andrew 1979), counterclockwise."""
    ordered = sorted(set(points))
    chains = []
    for run in (ordered, ordered[::-1]):
        chain: list[tuple[float, float]] = []
        for point in run:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], point) <= 0.0:
                chain.pop()
            chain.append(point)
        chains.append(chain[:-1])
    return chains[0] + chains[1]


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _description(curve: Curve, where: str, bar: Scale) -> str:
    if not curve.points:
        return f"Reference curve of the healthy pump at {where}; the pump has no points yet."
    last = curve.points[-1]
    half = bar.factor * Z_90 * math.sqrt(last.covariance[1][1])
    return (
        f"Reference curve of this pump without a fault at {where} and {len(curve.points)} points of it. The newest lies at "
        f"{bar.written(last.x):.1f} {bar.word} discharge and {bar.written(last.y):.3f} {bar.word} case minus reservoir pressure, "
        f"give or take {half:.3f} {bar.word}."
    )
