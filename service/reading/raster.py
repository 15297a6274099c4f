"""Pictures as PNG: drawn once, as SVG, and rastered from that."""

from functools import cache
from pathlib import Path

import resvg_py

_ZOOM = 2.0
"""Pixels of the PNG per pixel of the drawing, so that a printed page stays sharp (our choice)."""


def png_of(svg: str) -> bytes:
    """A drawing as PNG, with the fonts that come along: the same on every machine.

    Raises
    ------
    ValueError
        when the text is no SVG.
    """
    return bytes(
        resvg_py.svg_to_bytes(
            svg_string=svg,
            font_files=list(fonts()),
            skip_system_fonts=True,
            font_family="DejaVu Sans",
            sans_serif_family="DejaVu Sans",
            zoom=_ZOOM,
        )
    )


@cache
def fonts() -> tuple[str, ...]:
    """Files of DejaVu Sans, plain and bold, as matplotlib ships it."""
    import matplotlib  # noqa: PLC0415 - heavy, and only here

    folder = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    return tuple(str(folder / name) for name in ("DejaVuSans.ttf", "DejaVuSans-Bold.ttf"))
