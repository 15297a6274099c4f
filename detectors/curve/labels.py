"""Where labels of a picture go so that none covers another: the nearest free place round the end of its arrow."""

from collections.abc import Sequence
from dataclasses import dataclass, field

_WIDE, _HIGH = 7.9, 15.0
"""Of a letter, and of a line of text [px]: DejaVu Sans at 13 px, the widest font that the pictures meet."""
_GAP = 7.0
_RINGS = (0.0, 16.0, 32.0, 48.0, 66.0, 88.0, 112.0)
"""How far labels give way [px]."""


@dataclass(frozen=True, slots=True)
class Box:
    """A rectangle in pixels, y downwards."""

    left: float
    top: float
    right: float
    bottom: float

    def meets(self, other: "Box") -> bool:
        """Whether two rectangles share anything."""
        return (
            self.left < other.right and other.left < self.right and self.top < other.bottom and other.top < self.bottom
        )

    def holds(self, other: "Box") -> bool:
        """Whether the other lies inside."""
        inside_x = self.left <= other.left and other.right <= self.right
        return inside_x and self.top <= other.top and other.bottom <= self.bottom


@dataclass(frozen=True, slots=True)
class Label:
    """Words at a place: start of the text's baseline, and where a leader from the arrow's end should stop [px]."""

    x: float
    y: float
    anchor: str
    box: Box
    leader: tuple[float, float]


@dataclass(slots=True)
class Labels:
    """Labels that were placed so far, within a frame; ``taken`` is what they must not cover either."""

    frame: Box
    taken: list[Box] = field(default_factory=list)

    def keep_off(self, x: float, y: float, radius: float = 6.0) -> None:
        """Nothing is written over this spot."""
        self.taken.append(Box(x - radius, y - radius, x + radius, y + radius))

    def keep_off_line(self, start: tuple[float, float], end: tuple[float, float], every: float = 8.0) -> None:
        """Nothing is written over this line."""
        length = max(abs(end[0] - start[0]), abs(end[1] - start[1]))
        n = max(int(length / every), 1)
        for i in range(n + 1):
            share = i / n
            self.keep_off(start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1]), 2.0)

    def place(self, words: str, x: float, y: float, away: tuple[float, float] = (1.0, -1.0)) -> Label:
        """The free place for ``words`` that is nearest to (x, y); ``away`` is the direction that it prefers to give way in.

        The last place that was tried where none is free.
        """
        width = _WIDE * len(words)
        best: Label | None = None
        for ring in _RINGS:
            for label in _candidates(x, y, width, ring, away):
                best = best or label
                if self.frame.holds(label.box) and not any(label.box.meets(box) for box in self.taken):
                    self.taken.append(label.box)
                    return label
        label = best or next(iter(_candidates(x, y, width, 0.0, away)))
        self.taken.append(label.box)
        return label


def _candidates(x: float, y: float, width: float, ring: float, away: tuple[float, float]) -> Sequence[Label]:
    """Places right, left, above and below of a spot, ``ring`` pixels further off, the preferred ones first."""
    side = 1.0 if away[0] >= 0.0 else -1.0
    up = -1.0 if away[1] <= 0.0 else 1.0
    found = []
    for horizontal in (side, -side):
        for vertical in (up * ring, -up * ring) if ring else (0.0,):
            found.append(_beside(x + horizontal * (_GAP + 0.25 * ring), y + vertical, width, horizontal))  # noqa: PERF401
    for vertical in (up, -up):
        middle = y + vertical * (_GAP + 0.5 * _HIGH + ring)
        box = Box(x - 0.5 * width, middle - 0.5 * _HIGH, x + 0.5 * width, middle + 0.5 * _HIGH)
        found.append(Label(x, middle + 4.5, "middle", box, (x, middle - vertical * 0.5 * _HIGH)))
    return found


def _beside(x: float, y: float, width: float, side: float) -> Label:
    left = x if side > 0.0 else x - width
    box = Box(left - 2.0, y - 0.5 * _HIGH, left + width + 2.0, y + 0.5 * _HIGH)
    return Label(x, y + 4.5, "start" if side > 0.0 else "end", box, (x - side * 2.0, y))
