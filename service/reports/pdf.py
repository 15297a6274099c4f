"""A report as PDF, made without a browser; a chapter of one pump's report is the job card of its maintenance file."""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from detectors.words.verdict import CAUSES, TREND_METRICS
from service.identity import sentence
from service.reports.content import Period
from service.reports.page import counts_by_state, in_order, trend_figures
from service.reports.paper import Paper
from service.reports.remarks import remarks, steps
from service.reports.sentences import in_units
from service.reports.state_picture import COLOURS
from service.reports.words import ESTIMATE_NAMES, FILTERS, MARKS, WORDS
from service.units import METRIC, UnitSystem

_WIDE = 0.92
"""Share of the width that a picture takes (our choice)."""
_day, _date = FILTERS["day"], FILTERS["date"]


def report_pdf(
    subject: str,
    period: Period,
    whole: Mapping[str, Any],
    chapters: Sequence[Mapping[str, Any]],
    author: str,
    system: UnitSystem = METRIC,
) -> bytes:
    """The document in the reader's units, as ``report_html`` has it; chapters come in the order of the ranking."""
    made = datetime.now(UTC)
    title = f"Hydraulic pumps of {subject}: condition report"
    paper = Paper(title, author, made, f"{title}, {made:%d %b %Y}")
    paper.heading(title, 1)
    paper.quiet(
        f"From {_date(period.since)} to {_date(period.until)}; made on {_day(made)} for {author} by {sentence()}. "
        f"Verdicts are those of today. {_units(system)}"
    )
    _summary(paper, whole, chapters)
    for chapter in in_order(whole, chapters):
        paper.add_page()
        _chapter(paper, chapter, system)
    return bytes(paper.output())


def job_card_pdf(chapter: Mapping[str, Any], author: str, system: UnitSystem = METRIC) -> bytes:
    """The job card of one pump: its chapter, with its ``curve``, for the maintenance file."""
    made = datetime.now(UTC)
    serial = chapter["pump"]["serial"]
    paper = Paper(f"Job card: pump {serial}", author, made, f"Job card of pump {serial}, {made:%d %b %Y}")
    paper.quiet(f"Job card, printed on {_day(made)} for {author}. {_units(system)}")
    _chapter(paper, chapter, system)
    return bytes(paper.output())


def _units(system: UnitSystem) -> str:
    return f"Pressures in {system.word('bar')} gauge, times in UTC, intervals 90 % unless said otherwise."


def _summary(paper: Paper, whole: Mapping[str, Any], chapters: Sequence[Mapping[str, Any]]) -> None:
    paper.heading("Summary")
    counts = counts_by_state(whole)
    n, n_alarms = len(chapters), len(whole["alarms"])
    words = f"{n} pump{'' if n == 1 else 's'}: {', '.join(f'{k} {WORDS[state].lower()}' for state, k in counts)}. "
    words += f"{n_alarms} alarm{'' if n_alarms == 1 else 's'} in the period."
    if whole["silent"]:
        words += f" Nothing was heard for longer than usual from {', '.join(whole['silent'])}."
    paper.para(words)
    paper.ln(2.0)
    paper.rows(
        ("Rank", "Pump", "Aircraft", "Verdict", "Urgency", "Reasons", "Last record"),
        [
            (
                str(item["rank"]),
                item["serial"],
                f"{item['aircraft'] or '–'} {item['position'] or ''}",
                _state(item["state"]),
                item["urgency"],
                "; ".join(item["reasons"]) or "–",
                _date(item["last_record_at"]),
            )
            for item in whole["ranking"]
        ],
        (11, 22, 22, 32, 19, 50, 24),
        0,
    )
    rates = whole["findings"]
    if rates["count"]:
        named = (("false alarms: alarm, nothing found", "false_alarms"), ("missed: fault found, no alarm", "missed"))
        rows = [
            (words, f"{rate['cases']} of {rate['of']}", _share(rate))
            for words, rate in ((w, rates[name]) for w, name in (*named, ("side named rightly", "side_right")))
        ]
        paper.rows(
            (
                f"Agreement with {rates['count']} finding{'' if rates['count'] == 1 else 's'}",
                "Cases",
                "Share, 95 % interval",
            ),
            rows,
            (70, 30, 40),
            2,
        )


def _share(rate: Mapping[str, Any]) -> str:
    if not rate["of"]:
        return "–"
    return f"{100 * rate['share']:.0f} % ({100 * rate['low']:.0f} to {100 * rate['high']:.0f})"


def _state(name: str) -> str:
    return f"{MARKS[name]} {WORDS[name]}"


def _chapter(paper: Paper, chapter: Mapping[str, Any], system: UnitSystem) -> None:
    pump, verdict = chapter["pump"], chapter["verdict"]
    paper.heading(f"Pump {pump['serial']}", 1)
    place = f"{pump['aircraft'] or 'no aircraft'} {pump['position'] or ''}".strip()
    paper.quiet(
        f"{place} · type {pump['pump_type']} · operator {pump['operator']} · {pump['records']} records, the last on "
        f"{_day(pump['last_record_at'])}"
    )
    paper.ln(2.0)
    colour = COLOURS.get(verdict["state"], "#1b2430")
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    paper.para(_state(verdict["state"]), size=13.0, bold=True, colour=(red, green, blue))
    paper.ln(1.0)
    paper.para(
        f"Side: {verdict['side']}; since {_date(verdict['since'])}; probability {_percent(verdict['confidence'])}."
        + (f" Sensor: {verdict['sensor']}." if verdict["sensor"] else "")
    )
    is_card = "curve" in chapter
    if is_card:
        paper.heading("Steps", 3)
        paper.listed(steps(verdict, system), "☐")
    else:
        paper.para(in_units(verdict["advice"], system))
        if verdict["resolving_measurement"]:
            paper.para(in_units(f"What would tell: {verdict['resolving_measurement']}.", system))
    paper.heading("Evidence", 3)
    if is_card:
        shares = sorted(((verdict["probabilities"].get(c, 0.0), WORDS[c]) for c in CAUSES), reverse=True)
        paper.para("Probabilities: " + ", ".join(f"{word.lower()} {_percent(p)}" for p, word in shares) + ".")
        paper.ln(1.5)
    _estimates(paper, verdict, system)
    paper.para(_forecast(chapter["forecast"], system))
    for remark in remarks(verdict, system):
        paper.para(f"{remark.heading}: {'; '.join(remark.sentences)}.", colour=(77, 88, 102))
    figures = trend_figures(chapter, system)
    if is_card:
        # the first page is what somebody signs: the other pictures follow it
        for svg in figures[:1]:
            paper.ln(1.5)
            paper.picture(svg, 0.7)
        _signed(paper, verdict, system)
    _pictures(paper, chapter, figures[1:] if is_card else figures)
    _happened(paper, chapter, system)


def _percent(share: float) -> str:
    """A probability that is never none and never certain."""
    if share < 0.001:
        return "under 0.1 %"
    return "over 99.9 %" if share > 0.999 else f"{100 * share:.1f} %"


def _estimates(paper: Paper, verdict: Mapping[str, Any], system: UnitSystem) -> None:
    rows = []
    for name, estimate in verdict["estimates"].items():
        if estimate["mean"] is None:
            continue
        unit, smallest = TREND_METRICS[name], verdict["minimum_detectable"].get(name)
        low, high = (system.figure(estimate[end], unit, 2) for end in ("low", "high"))
        found = "" if smallest is None else f"from {system.figure(smallest, unit, 2)}"
        title = f"{ESTIMATE_NAMES[name]} [{system.word(unit)}]"
        rows.append((title, system.figure(estimate["mean"], unit, 2), f"{low} to {high}", found))
    if rows:
        paper.rows(("Quantity", "Mean", "90 % interval", "Would be found"), rows, (78, 24, 40, 36), 3)


def _forecast(forecast: Mapping[str, Any], system: UnitSystem) -> str:
    hours = forecast["flight_hours"]
    if not hours:
        return in_units(f"No forecast: {forecast['reason']}.", system)
    return (
        f"Forecast: case flow reaches its limit of {system.said(forecast['limit'], 'L/min', 2)} in about "
        f"{forecast['median_flight_hours']:.0f} flight hours ({hours['low']:.0f} to {hours['high']:.0f})."
    )


def _pictures(paper: Paper, chapter: Mapping[str, Any], figures: Sequence[str]) -> None:
    """The curve, and trends that are not shown yet."""
    if chapter.get("curve"):
        paper.heading("Damage identification curve", 3, paper.height_of(chapter["curve"], _WIDE))
        paper.picture(chapter["curve"], _WIDE)
    if figures:
        paper.heading("Trends of the period", 3, paper.height_of(figures[0], _WIDE))
    for svg in figures:
        paper.picture(svg, _WIDE)
    if not chapter["trends"]:
        paper.quiet("No record within the period has an estimate.")


def _happened(paper: Paper, chapter: Mapping[str, Any], system: UnitSystem) -> None:
    """Verdicts, alarms and findings of the period."""
    if chapter["changes"]:
        paper.heading("Verdicts", 3)
        said = [(_date(c["at"]), _state(c["state"]), in_units(c["advice"], system)) for c in chapter["changes"]]
        paper.listed([f"{at}: {state} – {advice}" for at, state, advice in said])
    if chapter["alarms"]:
        paper.heading("Alarms", 3)
        paper.listed([_alarm(alarm) for alarm in chapter["alarms"]])
    if chapter["findings"]:
        paper.heading("Findings of the workshop", 3)
        paper.listed([_finding(finding, system) for finding in chapter["findings"]])


def _alarm(alarm: Mapping[str, Any]) -> str:
    words = f"{_date(alarm['raised_at'])}: {alarm['priority']}, {WORDS[alarm['verdict_state']].lower()}"
    words += ", case pressure beyond its rule" if alarm["case_pressure_beyond"] else ""
    words += f"; {alarm['state'].replace('_', ', ')}"
    return words + (f", cleared on {_date(alarm['cleared_at'])}" if alarm["cleared_at"] else "")


def _finding(finding: Mapping[str, Any], system: UnitSystem) -> str:
    words = f"{_date(finding['at'])}: {WORDS.get(finding['found'], 'no fault found').lower()}"
    flow = finding["measured_case_flow_lpm"]
    words += "" if flow is None else f", {system.said(flow, 'L/min', 2)} measured"
    return words + (f": {finding['note']}" if finding["note"] else "")


def _signed(paper: Paper, verdict: Mapping[str, Any], system: UnitSystem) -> None:
    """Versions that the verdict rests on, and lines to sign."""
    paper.heading("Done and signed", 3, 60.0)
    paper.blanks(
        (
            (("Work order", 0.5), ("Aircraft hours", 0.5)),
            (("Found", 1.0),),
            ((f"Case flow measured [{system.word('L/min')}]", 0.5), ("Pump removed, yes or no", 0.5)),
            (("Done, with part numbers", 1.0),),
            (("Done by", 0.4), ("Date", 0.25), ("Signature", 0.35)),
            (("Inspected by", 0.4), ("Date", 0.25), ("Signature", 0.35)),
        )
    )
    software = verdict.get("software")
    made_by = "" if software is None else f", computed by casedrain {software['release']} ({software['sources']})"
    paper.quiet(
        f"Versions: twin {verdict['twin_version']}, thresholds {verdict['threshold_version']}{made_by}; "
        f"{verdict['quality']['records_used']} records used; printed by {sentence()}."
    )
