"""A study as one HTML page that needs nothing else."""

import math
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import TypedDict

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

from detectors.evaluation.delays import (
    ALARM,
    CHART,
    CHART_FALSE_ALARMS,
    FLOORED,
    INFORMATION,
    INFORMED,
    LEAST_DELAY,
    excess,
    found_by,
    mean_delay,
)
from detectors.evaluation.lives import LAMBDAS, covered_at, error_at, given_at, near_at, near_where_given_at
from detectors.evaluation.operating import DELAY_AT_ONE, DETECTED_AT_ONE, THRESHOLD_AT_ONE
from detectors.evaluation.reality import DIFFERENCES
from detectors.evaluation.rows import BURST
from detectors.evaluation.scores import Score
from detectors.evaluation.scoring import (
    ACCUSED,
    COVERED,
    DELAY_95,
    DELAY_MEDIAN,
    DETECTED,
    FALSE_ALARMS,
    PUMP_FROM_30,
    PUMP_WITHIN_20,
    RIGHT_OR_CANDIDATE,
    RIGHT_SIDE_OR_OPEN,
    SIZE_95,
    SIZE_MEDIAN,
    at_end,
    ever,
    first_call,
)
from detectors.evaluation.summary import (
    ALARMED_ERROR,
    ALL_REALITIES,
    CONFIDENCE_ERROR,
    CONFIDENCE_ERROR_FROM_ONSET,
    EACH_ERROR,
    EACH_ERROR_FROM_ONSET,
    ROC_AREA,
    RowResult,
    side_confusion,
)
from detectors.evaluation.targets import NOT_SIMULATED, Finding, Target
from detectors.judgement.version import twin_version
from detectors.words.verdict import FAULTS, Side, State
from service.identity import sentence
from service.studies.evaluation.plots import Reading, reliability_plot, row_plots
from service.studies.evaluation.run import Results
from service.studies.validation.drawing import plot_svg
from twin.pumps import pump_type
from twin.validation.evidence import Plot

_TEMPLATES = Environment(
    # the pages of studies look like those of the validation
    loader=ChoiceLoader([PackageLoader("service.studies.evaluation"), PackageLoader("service.studies.validation")]),
    autoescape=select_autoescape(),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
_SENSING = {False: "windows", True: "with bursts"}
_DETECTORS = (CHART, ALARM, INFORMED)
_PLAIN: Mapping[str, int] = {
    FALSE_ALARMS: 2,
    CONFIDENCE_ERROR: 3,
    EACH_ERROR: 3,
    CONFIDENCE_ERROR_FROM_ONSET: 3,
    EACH_ERROR_FROM_ONSET: 3,
    ALARMED_ERROR: 3,
    ROC_AREA: 3,
    THRESHOLD_AT_ONE: 1,
    INFORMATION: 2,
    LEAST_DELAY: 0,
    CHART_FALSE_ALARMS: 2,
    **{mean_delay(of): 0 for of in _DETECTORS},
    **{excess(of): 2 for of in _DETECTORS},
}
"""Numbers that are no shares, with their decimals."""
_HEADLINES = (
    FALSE_ALARMS,
    DETECTED,
    SIZE_MEDIAN,
    SIZE_95,
    DELAY_MEDIAN,
    DELAY_95,
    RIGHT_OR_CANDIDATE,
    RIGHT_SIDE_OR_OPEN,
    ACCUSED,
    PUMP_FROM_30,
    PUMP_WITHIN_20,
    ROC_AREA,
    DETECTED_AT_ONE,
    DELAY_AT_ONE,
    THRESHOLD_AT_ONE,
    CONFIDENCE_ERROR,
    EACH_ERROR,
    CONFIDENCE_ERROR_FROM_ONSET,
    EACH_ERROR_FROM_ONSET,
    ALARMED_ERROR,
    *COVERED.values(),
    INFORMATION,
    LEAST_DELAY,
    CHART_FALSE_ALARMS,
    FLOORED,
    *(name(of) for of in _DETECTORS for name in (found_by, mean_delay, excess)),
    *(name(share) for share in LAMBDAS for name in (given_at, covered_at, near_at, near_where_given_at, error_at)),
)
_DELAYS = (DELAY_MEDIAN, DELAY_95, DELAY_AT_ONE)
_BY_REALITY = (FALSE_ALARMS, RIGHT_OR_CANDIDATE, at_end(Side.PUMP), at_end(Side.SYSTEM), SIZE_MEDIAN, DELAY_MEDIAN)
_STATES = (State.HEALTHY, *FAULTS, State.INDETERMINATE)


def report_html(results: Results) -> str:
    """The page: targets, probabilities and sides over all rows, then each row with its numbers and curves."""
    study = results.study
    counted = [f.met for f in results.findings]
    pooled = [reliability_plot(results.pools, of) for of in Reading] if results.pools else []
    return _TEMPLATES.get_template("study.html").render(
        software=sentence(),
        twin=twin_version(pump_type(study.pump_type)),
        made=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        study=study,
        n_met=counted.count(True),
        n_asked=len(counted) - counted.count(None),
        findings=[_finding_cells(f) for f in results.findings],
        differences=DIFFERENCES,
        not_simulated=NOT_SIMULATED,
        sides=[s.value for s in Side],
        confusions=_confusions(results),
        pooled_scores=_pooled_cells(results),
        pooled_plots=_drawn(pooled, "pooled"),
        sections=[_section(k, name, rows) for k, (name, rows) in enumerate(_by_fault(results.rows).items())],
    )


def missed(findings: Sequence[Finding]) -> list[str]:
    """A line for each target that is not met."""
    lines = []
    for finding in findings:
        if finding.met is False:
            c = _finding_cells(finding)
            lines.append(f"{c['row']} ({c['sensing']}, {c['scope']}): {c['quantity']} {c['value']}, {c['target']}")
    return lines


def shown(quantity: str, value: float, unit: str = "") -> str:
    """A score in words: shares in percent, sizes in their unit, ``never`` for what was not reached."""
    number, words = _number(quantity, value), _unit(quantity, unit)
    return f"{number} {words}".rstrip() if math.isfinite(value) else number


def interval(quantity: str, score: Score, unit: str = "") -> str:
    """Value with its 95 % interval in words; the unit once."""
    if math.isnan(score.value):
        return "–"
    low, high = (_number(quantity, v) for v in (score.low, score.high))
    return f"{shown(quantity, score.value, unit)} ({low} to {high})"


def _number(quantity: str, value: float) -> str:
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "any" if quantity == FALSE_ALARMS else "never"
    if quantity in (SIZE_MEDIAN, SIZE_95):
        return f"{value:.3g}"
    if quantity in _DELAYS:
        return f"{value:.0f}"
    if quantity in _PLAIN:
        return f"{value:.{_PLAIN[quantity]}f}"
    return f"{100.0 * value:.1f}"


def _unit(quantity: str, unit: str) -> str:
    if quantity in (SIZE_MEDIAN, SIZE_95):
        return unit if unit != "-" else ""
    if quantity in _DELAYS:
        return "flights"
    return "" if quantity in _PLAIN else "%"


class _Drawn(TypedDict):
    """A plot and its words."""

    title: str
    caption: str
    svg: Markup


class _ConfusionLine(TypedDict):
    """How many pumps of a true side were called each side, in the order of ``Side``, and how many there are."""

    truth: str
    pumps: list[int]
    n: int


class _Confusion(TypedDict):
    """A confusion of sides under one sensing."""

    title: str
    lines: list[_ConfusionLine]


class _Section(TypedDict):
    """A row of the study: its tables' cells are texts, one for each sensing."""

    id: str
    title: str
    truth: str
    flights: int
    onset: int | None
    sensings: list[str]
    sizes: list[str]
    headlines: list[tuple[str, list[str]]]
    states: list[tuple[str, list[str]]]
    by_reality: list[tuple[str, str, int, list[str]]]
    by_reality_heads: Sequence[str]
    plots: list[_Drawn]


def _by_fault(rows: Sequence[RowResult]) -> dict[str, dict[str, RowResult]]:
    """Results by fault, then by sensing."""
    found: dict[str, dict[str, RowResult]] = {}
    for result in rows:
        found.setdefault(result.row.name.removesuffix(BURST), {})[_SENSING[result.row.sensing.burst]] = result
    return found


def _finding_cells(finding: Finding) -> dict[str, str]:
    target, score = finding.target, finding.score
    unit = "L/min" if target.quantity in (SIZE_MEDIAN, SIZE_95) else ""
    kind = {True: "met", False: "missed", None: "stated"}[finding.met]
    return {
        "row": target.row,
        "sensing": _SENSING[target.burst],
        "quantity": target.quantity,
        "scope": finding.scope,
        "target": _wish(target, unit),
        "value": interval(target.quantity, score, unit),
        "kind": kind,
        "verdict": {"met": "met", "missed": "not met", "stated": "not counted"}[kind],
        "note": target.note,
    }


def _wish(target: Target, unit: str) -> str:
    low, high = shown(target.quantity, target.low, unit), shown(target.quantity, target.high, unit)
    if math.isinf(target.low):
        return f"at most {high}"
    return f"at least {low}" if math.isinf(target.high) else f"{low} to {high}"


def _confusions(results: Results) -> list[_Confusion]:
    tables: list[_Confusion] = []
    for burst in (False, True):
        table: Mapping[Side, Mapping[Side, int]] = side_confusion(results.rows, burst=burst)
        lines: list[_ConfusionLine] = [
            {"truth": truth.value, "pumps": [line[side] for side in Side], "n": sum(line.values())}
            for truth, line in table.items()
        ]
        if lines:
            tables.append({"title": _SENSING[burst], "lines": lines})
    return tables


def _pooled_cells(results: Results) -> list[tuple[str, str, str]]:
    return [
        (_SENSING[pool.burst], quantity, interval(quantity, score))
        for pool in results.pools
        for quantity, score in pool.scores.items()
    ]


def _section(number: int, name: str, results: Mapping[str, RowResult]) -> _Section:
    first = next(iter(results.values())).row
    everything = [r.scopes[ALL_REALITIES] for r in results.values()]

    def cells(quantity: str) -> list[str]:
        return [interval(quantity, s.scores[quantity], first.unit) if quantity in s.scores else "–" for s in everything]

    return {
        "id": f"row-{number}",
        "title": name,
        "truth": first.truth.value,
        "flights": first.n_flights,
        "onset": first.onset,
        "sensings": list(results),
        "sizes": [f"{s.pumps} pumps, {s.records} judged records" for s in everything],
        "headlines": [(q, cells(q)) for q in _HEADLINES if any(q in s.scores for s in everything)],
        "states": [
            (state.value, [c for name in (at_end(state), ever(state), first_call(state)) for c in cells(name)])
            for state in _STATES
        ],
        "by_reality": [
            (sensing, scope, found.pumps, _scope_cells(found.scores, first.unit))
            for sensing, result in results.items()
            for scope, found in result.scopes.items()
        ],
        "by_reality_heads": _BY_REALITY,
        "plots": _drawn(row_plots(results), f"row-{number}"),
    }


def _scope_cells(scores: Mapping[str, Score], unit: str) -> list[str]:
    return [interval(q, scores[q], unit) if q in scores else "–" for q in _BY_REALITY]


def _drawn(plots: Sequence[Plot], name: str) -> list[_Drawn]:
    return [
        {"title": p.title, "caption": p.caption, "svg": Markup(plot_svg(p, f"{name}-{i}"))}  # noqa: S704 - our own drawing
        for i, p in enumerate(plots)
    ]
