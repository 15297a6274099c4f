"""Comparisons with published evidence as one HTML page that needs nothing else, and as rows of JSON."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

from detectors.judgement.version import twin_version
from service.identity import sentence
from service.studies.validation.drawing import plot_svg
from twin.pumps import PUMP_TYPES
from twin.validation.evidence import Evidence, Row

_TEMPLATES = Environment(
    loader=PackageLoader("service.studies.validation"),
    autoescape=select_autoescape(),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


@dataclass(frozen=True, slots=True)
class Counts:
    """How many rows are what: validated ones met or not, fitted ones met or not, and rows that only state."""

    met: int
    not_met: int
    fitted_met: int
    fitted_not_met: int
    stated: int


def counts_of(evidence: Mapping[str, Evidence]) -> Counts:
    """Count the rows of all evidence."""
    rows = [row for e in evidence.values() for row in e.rows]

    def count(within: bool, fitted: bool) -> int:
        return sum(row.within is within and row.fitted is fitted for row in rows)

    stated = sum(row.within is None for row in rows)
    return Counts(count(True, False), count(False, False), count(True, True), count(False, True), stated)


def rows_json(evidence: Mapping[str, Evidence]) -> list[dict[str, Any]]:
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
        verdict = ("met" if within else "not met") + (", fitted" if row.fitted else "")
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
        "verdict": verdict,
        "note": row.note,
    }
