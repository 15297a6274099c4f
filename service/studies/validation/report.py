"""Comparisons with published evidence as one HTML page that needs nothing else, and as rows of JSON."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TypedDict

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

from detectors.judgement.version import twin_version
from service.identity import sentence
from service.studies.validation.drawing import plot_svg
from twin.pumps import PUMP_TYPES
from twin.validation.evidence import CLASSES, Class, Evidence, Row

_TEMPLATES = Environment(
    loader=PackageLoader("service.studies.validation"),
    autoescape=select_autoescape(),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


@dataclass(frozen=True, slots=True)
class Count:
    """How many rows of one class are met, of how many that promise something."""

    met: int
    promised: int

    @property
    def missed(self) -> int:
        """Rows that promise something and are not met."""
        return self.promised - self.met


@dataclass(frozen=True, slots=True)
class Counts:
    """Rows by class, apart: what nothing was fitted to, what was, what is plausible; and rows that only state."""

    independent: Count
    fitted: Count
    plausible: Count
    stated: int

    @property
    def sentence(self) -> str:
        """All counts in one line, n of m met in each class."""
        parts = [f"{name} {count.met} of {count.promised}" for name, count in self.by_class().items()]
        return f"met: {', '.join(parts)}; {self.stated} only stated"

    def by_class(self) -> dict[Class, Count]:
        """Counts under the name of their class, in the order of ``CLASSES``."""
        return {"independent": self.independent, "fitted": self.fitted, "plausible": self.plausible}


def counts_of(evidence: Mapping[str, Evidence]) -> Counts:
    """Count the rows of all evidence by class."""
    rows = [row for e in evidence.values() for row in e.rows]

    def count(of: Class) -> Count:
        judged = [row.within for row in rows if row.evidence_class == of and row.within is not None]
        return Count(sum(judged), len(judged))

    independent, fitted, plausible = (count(of) for of in CLASSES)
    return Counts(independent, fitted, plausible, sum(row.within is None for row in rows))


def news(evidence: Mapping[str, Evidence]) -> list[str]:
    """Quantities that are not met and not known to be missed: what fails a run. A fitted row fails nothing."""
    rows = (row for e in evidence.values() for row in e.rows)
    return [row.quantity for row in rows if row.within is False and not row.known_miss and not row.fitted]


RowSaid = TypedDict(
    "RowSaid",
    {
        "evidence": str,
        "quantity": str,
        "unit": str,
        "reference": float | None,
        "value": float | None,
        "tolerance": float | None,
        "within": bool | None,
        "fitted": bool,
        "class": Class,
        "known_miss": bool,
        "note": str,
    },
)
"""A row of JSON: what the evidence says and what the twin does, in ``unit``; None is no number."""


def rows_json(evidence: Mapping[str, Evidence]) -> list[RowSaid]:
    """All rows as plain values; what is not a number is None."""
    return [
        {
            "evidence": row.evidence,
            "quantity": row.quantity,
            "unit": row.unit,
            "reference": _number(row.reference),
            "value": _number(row.value),
            "tolerance": _number(row.tolerance),
            "within": row.within,
            "fitted": row.fitted,
            "class": row.evidence_class,
            "known_miss": row.known_miss,
            "note": row.note,
        }
        for e in evidence.values()
        for row in e.rows
    ]


def report_html(evidence: Mapping[str, Evidence]) -> str:
    """The page: summary, then rows, plots and remarks of each comparison."""
    sections = [
        {
            "name": name,
            "title": e.title,
            "counts": counts_of({name: e}),
            "rows": [_cells(row) for row in e.rows],
            "plots": [
                {"title": p.title, "caption": p.caption, "svg": Markup(plot_svg(p, f"{name}-{i}"))}  # noqa: S704 - our own drawing
                for i, p in enumerate(e.plots)
            ],
            "remarks": e.remarks,
            "tables": e.tables,
        }
        for name, e in evidence.items()
    ]
    return _TEMPLATES.get_template("report.html").render(
        sections=sections,
        counts=counts_of(evidence),
        software=sentence(),
        twins=[twin_version(kind) for kind in PUMP_TYPES.values()],
        made=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
    )


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _shown(value: float, digits: int) -> str:
    """Plain decimals with so many significant digits; less than a thousandth with two."""
    if not math.isfinite(value):
        return "–"
    digits = digits if abs(value) >= 1.0e-3 else 2
    rounded = float(f"{value:.{digits - 1}e}")
    places = max(digits - 1 - math.floor(math.log10(abs(rounded))), 0) if rounded else 0
    return f"{rounded:.{places}f}".replace("-", "−")


def _printed(value: float) -> str:
    """A published number as it was typed, without zeros of our own; one that was computed as the twin's are."""
    if not math.isfinite(value):
        return "–"
    text = f"{value:.10f}".rstrip("0").rstrip(".")
    is_typed = len(text.replace(".", "").lstrip("-0")) <= 6
    return text.replace("-", "−") if is_typed else _shown(value, 4)


def _cells(row: Row) -> dict[str, str]:
    """One row in words: the verdict must be readable without colour."""
    within = row.within
    if within is None:
        kind, verdict = "stated", "only stated"
    else:
        kind = "met" if within else "missed"
        verdict = "met" if within else "not met, known" if row.known_miss else "not met"
    bound = {-1: "at most ", 0: "", 1: "at least "}[row.limit]
    tolerance = "–" if within is None or (row.limit and row.tolerance == 0.0) else f"±{_shown(row.tolerance, 2)}"
    return {
        "evidence": row.evidence,
        "quantity": row.quantity,
        "unit": row.unit,
        "reference": bound + _printed(row.reference),
        "value": _shown(row.value, 4),
        "tolerance": tolerance,
        "kind": kind,
        "class": "–" if within is None else row.evidence_class,
        "verdict": verdict,
        "note": row.note,
    }
