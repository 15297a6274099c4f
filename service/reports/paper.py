"""A4 pages that reports are printed on: headings, paragraphs, tables, pictures, lines to sign, page numbers."""

import re
from collections.abc import Sequence
from datetime import datetime
from io import BytesIO

from fpdf import FPDF
from fpdf.enums import TableBordersLayout, XPos, YPos
from fpdf.fonts import FontFace

from service.reading.raster import fonts

_FONT = "DejaVu"
_MARGIN, _FOOT, _HEADER = 15.0, 16.0, 8.0
_INK, _QUIET, _GRID = (27, 36, 48), (77, 88, 102), (215, 221, 228)
_SIZE, _LINE = 9.0, 4.6
"""Type [pt] and height of its lines [mm] (our choice)."""
_ROW = 8.2
"""Height of a row to write on [mm]."""
_UNSEEN = re.compile(r"<(title|desc)>.*?</\1>", re.DOTALL)
_EDGED = re.compile(
    r'(<text [^>]*?)(paint-order="stroke" stroke="#ffffff"[^>]*?stroke-linejoin="round")([^>]*>[^<]*</text>)'
)
"""Words with a white edge; the format paints the edge last, so that the words come once more without it."""


class Paper(FPDF):
    """A document of A4 pages; ``running`` stands at the top of every page but the first, and at the foot of all."""

    def __init__(self, title: str, author: str, made: datetime, running: str) -> None:
        super().__init__(format="A4", unit="mm")
        for style, file in zip(("", "B"), fonts(), strict=True):
            self.add_font(_FONT, style, file)
        self._running = running
        self.set_margins(_MARGIN, _MARGIN)
        self.set_auto_page_break(True, _FOOT + 4.0)
        self.set_title(title)
        self.set_author(author)
        self.set_creator("casedrain")
        self.set_lang("en")
        self.set_creation_date(made)
        self.set_draw_color(*_GRID)
        self.add_page()

    def header(self) -> None:
        """What a page that follows another begins with."""
        if self.page_no() > 1:
            self.para(self._running, size=7.5, colour=_QUIET)
            self.ln(_HEADER - _LINE)

    def footer(self) -> None:
        """Page numbers."""
        self.set_y(-_FOOT)
        self._write(7.5, _QUIET)
        self.cell(self.epw / 2, 8, self._running)
        self.cell(self.epw / 2, 8, f"Page {self.page_no()} of {{nb}}", align="R")

    def _write(self, size: float = _SIZE, colour: tuple[int, int, int] = _INK, bold: bool = False) -> None:
        self.set_font(_FONT, "B" if bold else "", size)
        self.set_text_color(*colour)

    def para(self, words: str, *, size: float = _SIZE, colour: tuple[int, int, int] = _INK, bold: bool = False) -> None:
        """A paragraph over the whole width."""
        self._write(size, colour, bold)
        self.multi_cell(0, _LINE * size / _SIZE, words, align="L", new_x=XPos.LMARGIN, new_y=YPos.NEXT)

    def quiet(self, words: str) -> None:
        """A paragraph of less weight."""
        self.para(words, size=8.0, colour=_QUIET)

    def heading(self, words: str, level: int = 2, before: float = 20.0) -> None:
        """A heading that stays with what follows it, so many millimetres of it."""
        size = {1: 16.0, 2: 12.0, 3: 10.0}[level]
        if self.will_page_break(before + 8.0):
            self.add_page()
        if self.get_y() > self.t_margin + 0.1:
            self.ln({1: 1.5, 2: 4.0, 3: 2.5}[level])
        self.para(words, size=size, bold=True)
        self.ln(0.8)

    def listed(self, items: Sequence[str], mark: str = "•") -> None:
        """Items one below the other, each behind a mark."""
        for item in items:
            height = _LINE * (1 + self.get_string_width(item) // (self.epw - 6.0))
            if self.will_page_break(height):
                self.add_page()
            self._write()
            self.cell(6.0, _LINE, mark)
            self.multi_cell(0, _LINE, item, align="L", new_x=XPos.LMARGIN, new_y=YPos.NEXT)
            self.ln(0.7)

    def rows(self, headings: Sequence[str], rows: Sequence[Sequence[str]], widths: Sequence[float], right: int) -> None:
        """A table whose heading comes again on every page; the last ``right`` columns hold numbers."""
        self._write(8.0)
        align = ["LEFT"] * (len(widths) - right) + ["RIGHT"] * right
        with self.table(
            col_widths=tuple(widths),
            width=min(sum(widths), self.epw),
            align="LEFT",
            text_align=tuple(align),
            v_align="TOP",
            line_height=4.4,
            padding=0.6,
            borders_layout=TableBordersLayout.HORIZONTAL_LINES,
            headings_style=FontFace(emphasis="BOLD", color=_QUIET),
            first_row_as_headings=bool(headings),
        ) as table:
            for row in ([headings] if headings else []) + list(rows):
                written = table.row()
                for text in row:
                    written.cell(text)
        self.ln(2.0)

    def height_of(self, svg: str, share: float) -> float:
        """Height of a picture over a share of the width [mm].

        Raises
        ------
        ValueError
            when it does not say its size.
        """
        found = re.search(r'viewBox="0 0 (\d+) (\d+)"', svg)
        if found is None:
            raise ValueError("the picture does not say its size")
        return share * self.epw * int(found[2]) / int(found[1])

    def picture(self, svg: str, share: float = 1.0) -> None:
        """An SVG over a share of the width, on the next page where it does not fit any more."""
        width, height = share * self.epw, self.height_of(svg, share)
        if self.will_page_break(height):
            self.add_page()
        # what is for those who cannot see a picture has no place in this format, fonts have other names
        drawn = _UNSEEN.sub("", _EDGED.sub(r"\1\2\3\1\3", svg)).replace("system-ui, sans-serif", _FONT)
        self.image(BytesIO(drawn.encode()), x=self.l_margin + 0.5 * (self.epw - width), w=width, h=height)
        self.ln(1.5)

    def blanks(self, rows: Sequence[Sequence[tuple[str, float]]]) -> None:
        """Rows of words with a line to write on behind each; shares of the width, 1 in a row."""
        if self.will_page_break(_ROW * len(rows)):
            self.add_page()
        for row in rows:
            self._write(8.0, _QUIET)
            top = self.get_y()
            x = self.l_margin
            for words, share in row:
                width = share * self.epw
                self.set_xy(x, top + 1.5)
                label = self.get_string_width(words) + 3.0
                self.cell(label, 6.0, words)
                self.set_draw_color(*_QUIET)
                self.line(x + label, top + 6.9, x + width - 3.0, top + 6.9)
                x += width
            self.set_draw_color(*_GRID)
            self.set_xy(self.l_margin, top + _ROW)
