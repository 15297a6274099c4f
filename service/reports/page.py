"""A report as one printable HTML page that needs nothing else."""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

from detectors.words.verdict import CAUSES, TREND_METRICS
from service.identity import sentence
from service.reports.charts import trend_svg
from service.reports.content import Period
from service.reports.remarks import remarks, steps
from service.reports.words import ESTIMATE_NAMES, FILTERS, MARKS, WORDS
from service.units import METRIC, UnitSystem

_TEMPLATES = Environment(
    # the pages of all reports look alike
    loader=ChoiceLoader([PackageLoader("service.reports"), PackageLoader("service.studies.validation")]),
    autoescape=select_autoescape(default=True, default_for_string=True),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
_TEMPLATES.filters |= FILTERS
_TEMPLATES.globals |= {
    "words": WORDS,
    "marks": MARKS,
    "estimate_names": ESTIMATE_NAMES,
    "units": TREND_METRICS,
}


def report_html(
    subject: str,
    period: Period,
    whole: Mapping[str, Any],
    chapters: Sequence[Mapping[str, Any]],
    author: str,
    system: UnitSystem = METRIC,
) -> str:
    """The page in the reader's units; chapters come in the order of the ranking.

    A chapter with a ``curve``, an SVG, is a job card as well: it shows it, its evidence, steps and lines to sign.
    """
    ordered = in_order(whole, chapters)
    return _TEMPLATES.get_template("report.html").render(
        subject=subject,
        period=period,
        whole=whole,
        chapters=[
            {
                **chapter,
                "curve": Markup(chapter["curve"]) if chapter.get("curve") else None,  # noqa: S704
                "figures": [Markup(svg) for svg in trend_figures(chapter, system)],  # noqa: S704 - made by us
                "remarks": remarks(chapter["verdict"], system),
                "steps": steps(chapter["verdict"], system),
            }
            for chapter in ordered
        ],
        author=author,
        system=system,
        causes=CAUSES,
        made=datetime.now(UTC),
        software=sentence(),
        twins=sorted({c["verdict"]["twin_version"] for c in chapters}),
        counts=counts_by_state(whole),
    )


def counts_by_state(whole: Mapping[str, Any]) -> list[tuple[str, int]]:
    """States that pumps of the report are in, in the order in which they are told, with how many are."""
    return [(state, whole["by_state"][state]) for state in WORDS if state in whole["by_state"]]


def in_order(whole: Mapping[str, Any], chapters: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Chapters in the order of the ranking."""
    place = {(item["operator"], item["serial"]): item["rank"] for item in whole["ranking"]}
    return sorted(chapters, key=lambda c: place[c["pump"]["operator"], c["pump"]["serial"]])


def trend_figures(chapter: Mapping[str, Any], system: UnitSystem) -> list[str]:
    """Pictures of a chapter's trends as SVG."""
    figures = []
    for metric, points in chapter["trends"].items():
        limit = chapter["case_flow_limit_lpm"] if metric == "case_flow_at_reference_lpm" else None
        figures.append(trend_svg(ESTIMATE_NAMES[metric], system.scale(TREND_METRICS[metric]), points, limit))
    return figures
