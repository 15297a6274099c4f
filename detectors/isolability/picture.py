"""Pictures of an isolability study: every fault's bounds on one scale, and pump leakage over the sensor's accuracy."""

import math
from collections.abc import Sequence

from detectors.drawing.svg import ACCENT, GRID, INK, QUIET, Frame, axes, document, line, path, text
from detectors.isolability.bounds import FaultBound, Isolability
from detectors.isolability.table import Row

_WIDTH, _ROW, _TOP, _LEFT = 860, 30, 70, 190
"""Of the picture, of one fault's line, of the head and of the names [px]."""
_LOWEST = 0.01
_SHARES = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
"""Where the axis begins and has its lines, as shares of a fault's largest size (our choice)."""


def isolability_svg(found: Isolability, title: str) -> str:
    """One line per fault: filled dot where it is detected, ring where it is isolated, as a share of its largest size."""
    bottom = _TOP + _ROW * len(found.faults)
    frame = Frame(_LEFT, _TOP, _WIDTH - 210, bottom, math.log10(_LOWEST), 0.0, 0.0, 1.0)
    body = [text(16, 24, title, extra='font-weight="600"')]
    body.append(text(16, 46, _sentence(found), colour=QUIET))
    for share in _SHARES:
        x = frame.x(math.log10(share))
        body.append(line(x, frame.top, x, frame.bottom, GRID))
        body.append(text(x, frame.bottom + 18, f"{100 * share:g} %", anchor="middle", colour=QUIET))
    words = "size over the largest in the linear model; dot: detectable, ring: isolable"
    body.append(text((frame.left + frame.right) / 2, frame.bottom + 38, words, anchor="middle"))
    for i, fault in enumerate(found.faults):
        body += _fault(frame, fault, _TOP + _ROW * (i + 0.5))
    described = "; ".join(f"{f.name}: {_words(f)}" for f in found.faults)
    return document(_WIDTH, int(bottom) + 52, title, described, body)


def sensor_svg(rows: Sequence[Row], title: str) -> str:
    """Slipper leakage that is detected and isolated over the case sensor's accuracy, with and without zero and burst.

    Rows without a reservoir sensor are left out.
    """
    rows = [r for r in rows if r.reservoir_measured]
    top = 1.1 * max([v for r in rows for v in (r.detectable, r.isolable) if math.isfinite(v)], default=1.0)
    places = sorted({r.accuracy_fs for r in rows})
    logs = [math.log10(a) for a in places]
    frame = Frame(70, 96, _WIDTH - 20, 420, logs[0] - 0.06, logs[-1] + 0.06, 0.0, top)
    labels = [(v, f"{100 * a:g} %") for v, a in zip(logs, places, strict=True)]
    body = axes(frame, "accuracy of the case sensor, share of full scale", "pump leakage [L/min]", labels)
    body.append(text(16, 24, title, extra='font-weight="600"'))
    styles = ((True, False, ""), (False, False, "7 4"), (True, True, "2 3"), (False, True, "9 3 2 3"))
    for k, (zero, burst, dashes) in enumerate(styles):
        chosen = [r for r in rows if (r.zero_measured, r.burst) == (zero, burst)]
        x = 16 + 205 * k
        body.append(line(x, 52, x + 34, 52, INK, 2.0, f'stroke-dasharray="{dashes}"'))
        words = f"{'zero' if zero else 'no zero'}, {'burst' if burst else '1 Hz only'}"
        body.append(text(x + 40, 56, words))
        for name, colour in (("detectable", ACCENT), ("isolable", "#98181f")):
            points = [(frame.x(math.log10(r.accuracy_fs)), frame.y(getattr(r, name))) for r in chosen]
            points = [p for p in points if math.isfinite(p[1])]
            if points:
                body.append(
                    f'<path d="{path(points)}" fill="none" stroke="{colour}" stroke-width="2" '
                    f'stroke-dasharray="{dashes}"/>'
                )
                body += [_mark(x, y, colour, filled=name == "detectable") for x, y in points]
    described = "Filled dots: detectable. Rings: told from every fault of the circuit."
    body.append(text(_WIDTH - 20, 78, described, anchor="end", colour=QUIET))
    return document(_WIDTH, 470, title, described, body)


def _sentence(found: Isolability) -> str:
    plan = found.plan
    low, high = plan.temperature_range_degc
    zero = "with" if plan.sensors.zero_measured else "without"
    tank = "with" if plan.sensors.reservoir is not None else "without"
    return (
        f"{plan.flights} flights after {plan.baseline_flights} of baseline, {low:g} to {high:g} degC, "
        f"case sensor {plan.sensors.case.full_scale_bar:g} bar {100 * plan.sensors.case.accuracy_fs:g} %, {zero} zero, "
        f"{tank} reservoir sensor, {'bursts' if plan.burst else 'no bursts'}"
    )


def _fault(frame: Frame, fault: FaultBound, y: float) -> list[str]:
    out = [text(frame.left - 10, y + 4, fault.name, anchor="end"), line(frame.left, y, frame.right, y, GRID)]
    places = []
    for size, filled in ((fault.smallest_detectable, True), (fault.smallest_isolable, False)):
        if math.isfinite(size):
            places.append(frame.x(math.log10(max(size / fault.largest, _LOWEST))))
            out.append(_mark(places[-1], y, ACCENT, filled=filled))
    if len(places) == 2 and places[1] - places[0] > 12:
        out.append(line(places[0] + 5, y, places[1] - 5, y, ACCENT, 1.5))
    out.append(text(frame.right + 14, y + 4, _words(fault), colour=QUIET))
    return out


def _words(fault: FaultBound) -> str:
    sizes = (fault.smallest_detectable, fault.smallest_isolable)
    detectable, isolable = (f"{v:.3g}" if math.isfinite(v) else "never" for v in sizes)
    return f"{detectable} | {isolable} [{fault.unit}]"


def _mark(x: float, y: float, colour: str, *, filled: bool) -> str:
    return (
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4.5" fill="{colour if filled else "#ffffff"}" stroke="{colour}" '
        'stroke-width="2"/>'
    )
