"""Channels of one record as a picture: one panel per quantity over one time axis, windows shaded, the twin beside.

A second record may lie over it, and stretches that engineers have marked stand at the foot of every panel.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from xml.sax.saxutils import escape

from detectors.drawing.svg import Frame, Scale, axes, document, padded, path, text, ticks
from service.answers.history import RecordMark
from service.answers.records import ChannelSamples, RecordChannels, Window
from service.units import METRIC, UnitSystem

WIDTH, PANEL, _GAP, _HEAD, _FOOT = 920, 150, 34, 40, 20
_LEFT, _RIGHT = 70, WIDTH - 16
_LEAST_RANGE = {"bar": 0.05, "rpm": 50.0, "degc": 1.0, "lpm": 0.5}
"""Half of the smallest range that a panel shows: noise of a steady channel does not fill it (our choice)."""


@dataclass(frozen=True, slots=True)
class _Panel:
    title: str
    unit: str
    channels: Sequence[ChannelSamples]


@dataclass(frozen=True, slots=True)
class Overlay:
    """Another record drawn over the first, its times moved by ``shift_s`` to the first one's."""

    found: RecordChannels
    shift_s: float = 0.0

    def channel(self, name: str) -> ChannelSamples | None:
        """Its channel of that name at the first record's times; None where it has none."""
        held = next((c for c in self.found["channels"] if c["channel"] == name), None)
        return None if held is None else {**held, "time_s": [t + self.shift_s for t in held["time_s"]]}


def record_svg(
    found: RecordChannels,
    title: str,
    first: int = 1,
    marks: Sequence[RecordMark] = (),
    overlay: Overlay | None = None,
    system: UnitSystem = METRIC,
) -> str:
    """Picture of a stretch of a record, its numbers written in the reader's units.

    Windows are shaded over every panel and carry the number that they have in the table beside the picture; ``first``
    is the number of the first one. Those that the analysis rejected are hatched. Of an ``overlay``, channels that the
    record has as well are drawn. Classes name what things are; the style sheet of the page colours them.
    """
    panels = _panels(found["channels"], system)
    height = _HEAD + len(panels) * (PANEL + _GAP) + _FOOT
    start, end = found["start_s"], max(found["end_s"], found["start_s"] + 1e-6)
    body = [
        '<defs><pattern id="rejected" width="8" height="8" patternUnits="userSpaceOnUse" '
        'patternTransform="rotate(45)"><path class="hatch" d="M 0 0 V 8"/></pattern></defs>'
    ]
    for i, panel in enumerate(panels):
        top = _HEAD + i * (PANEL + _GAP)
        others = [o for c in panel.channels if overlay is not None and (o := overlay.channel(c["channel"])) is not None]
        frame = Frame(_LEFT, top, _RIGHT, top + PANEL, start, end, *_range(panel, found, others))
        is_last = i == len(panels) - 1
        scale = system.scale(panel.unit)
        body.append(_opened(frame, panel.unit, scale))
        body += _shades(frame, found["windows"], first if i == 0 else None)
        # the axis is the same for all: its numbers stand under the last panel
        labels = [(at, f"{at:g}" if is_last else "") for at in ticks(start, end)]
        x_title = "time from the start of the record [s]" if is_last else ""
        body += axes(frame, x_title, panel.title, labels, y_scale=scale)
        body += [_marked(frame, mark) for mark in marks if mark["start_s"] < end and mark["end_s"] > start]
        for other in others:
            name = escape(f"{_words(other['channel'])}, other record", {'"': "&quot;"})
            body += [f'<path class="other" data-name="{name}" d="{d}"/>' for d in _lines(frame, other)]
        for k, channel in enumerate(panel.channels):
            kind, name = "p2" if k else "p", escape(_words(channel["channel"]), {'"': "&quot;"})
            body += [f'<path class="{kind}" data-name="{name}" d="{d}"/>' for d in _lines(frame, channel)]
        names = [c["channel"] for c in panel.channels]
        for value in found["twin"]:
            if value["channel"] in names:
                left, right = (min(max(value[side], start), end) for side in ("start_s", "end_s"))
                ends = [(frame.x(t), frame.y(value["as_measured"])) for t in (left, right)]
                body.append(f'<path class="twin" d="{path(ends)}"/>')
        body.append("</g>")
    n = len(found["windows"])
    words = f"{len(panels)} panels from {start:g} to {found['end_s']:g} s with {n} window{'' if n == 1 else 's'}."
    if overlay is not None:
        words += f" A second record lies over it, {overlay.shift_s:+g} s moved."
    return document(WIDTH, height, title, words, body)


def _opened(frame: Frame, unit: str, scale: Scale) -> str:
    """Begin of a panel's group, which says its axes: a cursor reads values off the lines by it."""
    low, high = scale.written(frame.y_low), scale.written(frame.y_high)
    ends = {"x0": frame.x_low, "x1": frame.x_high, "y0": low, "y1": high}
    edges = {"left": frame.left, "right": frame.right, "top": frame.top, "bottom": frame.bottom}
    said = " ".join(f'data-{name}="{value:.9g}"' for name, value in (ends | edges).items())
    return f'<g class="panel" data-unit="{escape("" if unit == "-" else scale.word)}" {said}>'


def _panels(channels: Sequence[ChannelSamples], system: UnitSystem) -> list[_Panel]:
    """Case and reservoir pressure share a panel, as do flows; everything else has its own."""
    found = []
    for _, group in groupby(sorted(channels, key=_place), key=lambda c: _place(c)[0]):
        held = list(group)
        unit = held[0]["unit"]
        names = [_words(c["channel"]) for c in held]
        drawn = names[0] if len(names) == 1 else f"{names[0]} (line), {', '.join(names[1:])} (dashed)"
        found.append(_Panel(f"{drawn} [{system.word(unit)}]" if unit != "-" else drawn, unit, held))
    return found


_ORDER = (
    ("discharge_pressure_bar",),
    ("case_pressure_bar", "reservoir_pressure_bar"),
    ("shaft_speed_rpm",),
    ("fluid_temperature_degc",),
    ("case_flow_lpm",),
    ("discharge_flow_lpm", "commanded_flow_lpm"),
)


def _place(channel: ChannelSamples) -> tuple[str, int, str]:
    name = channel["channel"]
    for i, names in enumerate(_ORDER):
        if name in names:
            return f"{i}", names.index(name), name
    return f"9{name}", 0, name


def _words(name: str) -> str:
    head, _, tail = name.rpartition("_")
    return (head if tail in _LEAST_RANGE else name).replace("_", " ")


def _marked(frame: Frame, mark: RecordMark) -> str:
    """A bar at the foot of a panel under a stretch that somebody has judged."""
    left, right = (frame.x(min(max(mark[side], frame.x_low), frame.x_high)) for side in ("start_s", "end_s"))
    return (
        f'<rect class="mark {mark["mark"]}" x="{left:.1f}" y="{frame.bottom - 7:.1f}" '
        f'width="{max(right - left, 1.5):.1f}" height="7"/>'
    )


def _range(panel: _Panel, found: RecordChannels, others: Sequence[ChannelSamples]) -> tuple[float, float]:
    values = [v for c in (*panel.channels, *others) for v in c["value"] if v is not None]
    names = {c["channel"] for c in panel.channels}
    values += [t["as_measured"] for t in found["twin"] if t["channel"] in names]
    return padded(values, smallest=_LEAST_RANGE.get(panel.unit, 0.05))


def _lines(frame: Frame, channel: ChannelSamples) -> list[str]:
    """Path data of each stretch without a gap, within the frame."""
    stretches: list[list[tuple[float, float]]] = [[]]
    for at, value in zip(channel["time_s"], channel["value"], strict=True):
        if not frame.x_low <= at <= frame.x_high:
            continue
        if value is None or not math.isfinite(value):
            stretches.append([])
        else:
            stretches[-1].append((frame.x(at), frame.y(value)))
    return [path(points if len(points) > 1 else points * 2) for points in stretches if points]


def _shades(frame: Frame, windows: Sequence[Window], first: int | None) -> list[str]:
    out = []
    for i, window in enumerate(windows, start=first or 1):
        left, right = (frame.x(min(max(t, frame.x_low), frame.x_high)) for t in (window["start_s"], window["end_s"]))
        kind = window["kind"] if window["accepted"] else "rejected"
        out.append(
            f'<rect class="w {kind}" x="{left:.1f}" y="{frame.top:.1f}" width="{max(right - left, 1.0):.1f}" '
            f'height="{frame.bottom - frame.top:.1f}"/>'
        )
        if first is not None:
            # above the panel's own title
            out.append(text(0.5 * (left + right), frame.top - 26, str(i), anchor="middle"))
    return out
