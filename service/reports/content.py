"""What a report says, as plain data in the words of the API."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy.orm import Session

from detectors.curve.picture import curve_svg
from service.access.security import Principal
from service.alarms import reading
from service.answers.job_documents import FleetOverview, ReportedPump
from service.answers.words import instant
from service.history.archive import Archive
from service.history.knowledge import entries
from service.monitoring.succession import taken_over
from service.reading import queries
from service.reading.agreement import judged_findings, rates
from service.reading.curve import curve_of
from service.reading.fleet import pump_documents, pumps_standing
from service.reading.forecast import forecast_of, with_crossing
from service.reading.ranking import ranked
from service.reading.trend import points_of, thinned
from service.registry import findings
from service.storage.tables import Finding, Pump
from service.thresholds.layers import thresholds_of
from service.units import METRIC, UnitSystem

TRENDS = ("case_flow_at_reference_lpm", "system_leakage_change_lpm")
"""Metrics that a report draws for each pump: the pump's own wear, and its circuit's."""
_POINTS = 200


@dataclass(frozen=True, slots=True)
class Period:
    """From ``since`` on and before ``until``."""

    since: datetime
    until: datetime

    def holds(self, at: datetime) -> bool:
        """True for an instant within it."""
        return self.since <= at < self.until


def overview(
    session: Session, principal: Principal, rows: Sequence[Pump], period: Period, system: UnitSystem = METRIC
) -> FleetOverview:
    """The fleet as it stands now, ranked with reasons, and how often the workshop agreed; alarms of the period.

    The words of the reasons have the reader's units; numbers are as the API has them.
    """
    ranking = ranked(session, rows, *pumps_standing(session, rows), system)
    ids = {row.id for row in rows}
    found = [
        reading.shown(alarm, serial, kind)
        for alarm, serial, kind in session.execute(reading.alarms(principal))
        if alarm.pump_id in ids and period.holds(alarm.raised_at)
    ]
    return {
        "by_state": dict(Counter(item["state"] for item in ranking)),
        "ranking": ranking,
        "silent": [item["serial"] for item in ranking if item["silent"]],
        "alarms": found,
        "findings": rates(judged_findings(session, principal)),
    }


def pump_curve(session: Session, row: Pump, archive: Archive, system: UnitSystem) -> str | None:
    """The damage identification curve of a pump as SVG, its numbers in the reader's units; None before its first record."""
    if not queries.newest_assessments(session, row.id, 1):
        return None
    found = curve_of(session, row, None, None, None, taken_over(session, row, archive))
    return curve_svg(found.curve, f"pump {row.serial}", system.scales())


def pump_chapter(session: Session, principal: Principal, row: Pump, period: Period) -> ReportedPump:
    """One pump: verdict now, forecast, trends, changes of verdict, alarms and findings of the period."""
    assessments = list(session.scalars(queries.assessments(row.id)))
    limit = thresholds_of(session, row.operator, row.serial, row.pump_type).values["case_flow_limit_lpm"]
    alarms = session.execute(reading.alarms(principal, reading.Wanted(serial=row.serial, operator=row.operator)))
    trends = {m: thinned(points_of(assessments, m, period.since, period.until), _POINTS) for m in TRENDS}
    return {
        "pump": pump_documents(session, [row])[0],
        "verdict": with_crossing(session, row, queries.verdict(session, row)),
        "forecast": forecast_of(session, row),
        "case_flow_limit_lpm": limit,
        "trends": {metric: points for metric, points in trends.items() if points},
        "changes": [
            {"at": instant(a.at), "state": a.state, "advice": a.verdict["advice"]}
            for a in queries.verdict_changes(session, row)
            if period.holds(a.at)
        ],
        "alarms": [reading.shown(a, serial, kind) for a, serial, kind in alarms if period.holds(a.raised_at)],
        "findings": [
            findings.document(f)
            for f in sorted(entries(session, Finding, row.id), key=lambda f: f.at)
            if period.holds(f.at)
        ],
    }
