"""Report: what an operator prints for a maintenance meeting, of all pumps or of one."""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from typing import Any, Literal

from fastapi.encoders import jsonable_encoder
from pydantic import Field
from sqlalchemy.orm import Session

from service.access.security import Principal
from service.answers.job_documents import FleetReport
from service.answers.jobs import JobResult
from service.answers.words import instant
from service.errors import Fault, Invalid, NotFound
from service.jobs.kinds import Item, Kind, Parameters, Work, register
from service.jobs.products import keep
from service.reading import queries
from service.registry.fields import Instant
from service.reports.content import Period, overview, pump_chapter, pump_curve
from service.reports.page import report_html
from service.reports.pdf import report_pdf
from service.storage.tables import Pump
from service.units import METRIC, SYSTEMS

USUAL_PERIOD = timedelta(days=365)


class ReportParameters(Parameters):
    """Which pump, all without one; from when on and before when, the last year without a date."""

    pump: str | None = Field(default=None, min_length=1, max_length=200)
    since: Instant | None = None
    until: Instant | None = None
    units: Literal["metric", "us"] = Field(
        default="metric",
        description="Units of what is printed: bar, L/min and degC, or psi, gpm and degF; JSON has the first",
    )


@register
class Report(Kind[ReportParameters, list[int]]):
    """One item per pump: its state as it goes into the report; at the end the report as HTML and PDF, its numbers as JSON."""

    name = "report"
    role = "viewer"
    parameters = ReportParameters

    def prepared(self, session: Session, parameters: ReportParameters, operator: str | None) -> ReportParameters:
        until = parameters.until or datetime.now(UTC).replace(second=0, microsecond=0) + timedelta(minutes=1)
        since = parameters.since or until - USUAL_PERIOD
        if since >= until:
            raise Invalid("the report has 1 fault", [Fault("parameters.since", f"{since} is not before {until}")])
        if not _pumps(session, _anybody(operator), parameters.pump):
            raise NotFound(
                f"there is no pump {parameters.pump}" if parameters.pump else "there is no pump to report on"
            )
        return parameters.model_copy(update={"since": since, "until": until})

    @contextmanager
    def opened(self, work: Work[ReportParameters]) -> Iterator[list[int]]:
        with work.context.database.reading() as session:
            found = [pump.id for pump in _pumps(session, work.principal, work.parameters.pump)]
        yield found

    def total(self, _work: Work[ReportParameters], pump_ids: list[int]) -> int:
        return len(pump_ids)

    def item(self, work: Work[ReportParameters], pump_ids: list[int], position: int) -> Item:
        with work.context.database.reading() as session:
            pump = session.get_one(Pump, pump_ids[position])
            state = queries.verdict(session, pump)["state"]
        return Item(pump.serial, "reported", {"operator": pump.operator, "state": state})

    def result(self, work: Work[ReportParameters], pump_ids: list[int], counts: dict[str, int]) -> JobResult:
        parameters = work.parameters
        if parameters.since is None or parameters.until is None:
            raise RuntimeError("a report without its period")
        period, system = Period(parameters.since, parameters.until), SYSTEMS[parameters.units]
        # one snapshot of the database, so that summary and chapters agree
        with work.context.database.reading() as session:
            rows = [session.get_one(Pump, pump_id) for pump_id in pump_ids]
            whole = overview(session, work.principal, rows, period)
            said = whole if system is METRIC else overview(session, work.principal, rows, period, system)
            chapters = [pump_chapter(session, work.principal, row, period) for row in rows]
            printed: list[Mapping[str, Any]] = list(chapters)
            if parameters.pump is not None:
                # a picture of the curve costs a fold: one pump's card has it, a fleet's report has not
                curves = [pump_curve(session, row, work.context.archive, system) for row in rows]
                printed = [{**c, "curve": curve} for c, curve in zip(chapters, curves, strict=True)]
        subject = parameters.pump or work.operator or "all operators"
        document: FleetReport = {
            **whole,
            "subject": subject,
            "since": instant(period.since),
            "until": instant(period.until),
            "pumps": chapters,
        }
        told = (subject, period, said, printed, work.principal.owner, system)
        documents: dict[str, str | bytes] = {
            "html": report_html(*told),
            "pdf": report_pdf(*told),
            "json": json.dumps(jsonable_encoder(document), indent=1) + "\n",
        }
        return {"counts": counts, "files": keep(work, documents)}


def _anybody(operator: str | None) -> Principal:
    return Principal("report", Report.role, operator)


def _pumps(session: Session, principal: Principal, serial: str | None) -> list[Pump]:
    found = session.scalars(queries.pumps(principal))
    return [pump for pump in found if serial is None or pump.serial == serial]
