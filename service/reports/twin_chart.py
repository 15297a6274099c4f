"""Curves of the twin as a picture: the healthy pump, the one with other health values, and one marked point."""

from collections.abc import Sequence
from dataclasses import dataclass

from detectors.drawing.svg import AS_DRAWN, Frame, Scale, axes, document, padded, path, text

_WIDTH, _HEIGHT = 560, 330
Place = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Line:
    """A curve; None stands for a condition that has no solution and breaks it."""

    name: str
    points: Sequence[Place | None]


def twin_svg(
    title: str,
    names: tuple[str, str],
    lines: Sequence[Line],
    marked: Place | None,
    margin: float = 0.5,
    scales: tuple[Scale, Scale] = (AS_DRAWN, AS_DRAWN),
) -> str:
    """Picture of curves in one plane; ``names`` are those of both axes, with units, ``margin`` the least of the horizontal one.

    The first line is drawn through, the second dashed; both are named under the title. Places are in our units; ``scales``
    say how they are written.
    """
    known = [p for line in lines for p in line.points if p is not None] + ([marked] if marked else [])
    left, right = padded([x for x, _ in known], smallest=margin)
    low, high = padded([y for _, y in known], smallest=0.05)
    frame = Frame(64, 62, _WIDTH - 14, _HEIGHT - 46, left, right, low, high)
    body = axes(frame, names[0], names[1], x_scale=scales[0], y_scale=scales[1])
    for k, line in enumerate(lines):
        body += [f'<path class="{"p2" if k else "p"}" d="{d}"/>' for d in _stretches(frame, line)]
    legend = "; ".join(f"{'dashed' if k else 'line'}: {line.name}" for k, line in enumerate(lines))
    body.append(text(frame.left, 20, legend))
    if marked is not None:
        body.append(f'<circle class="marked" cx="{frame.x(marked[0]):.1f}" cy="{frame.y(marked[1]):.1f}" r="5"/>')
    words = f"{legend}."
    if marked is not None:
        x, y = (scale.written(v) for scale, v in zip(scales, marked, strict=True))
        words += f" The point asked for lies at {x:.4g}, {y:.4g}."
    return document(_WIDTH, _HEIGHT, title, words, body)


def _stretches(frame: Frame, line: Line) -> list[str]:
    found: list[list[Place]] = [[]]
    for point in line.points:
        if point is None:
            found.append([])
        else:
            found[-1].append((frame.x(point[0]), frame.y(point[1])))
    return [path(points) for points in found if len(points) > 1]
