"""The job card of a pump as PDF: one document for the maintenance file, in the reader's units."""

from datetime import UTC, datetime, timedelta

from fastapi import APIRouter, Request
from fastapi.responses import Response

from service.errors import NotFound
from service.reading import queries
from service.reports.content import Period, pump_chapter, pump_curve
from service.reports.pdf import job_card_pdf
from service.web.dashboard.frame import PageRoute
from service.web.dashboard.preferences import system_of
from service.web.dependencies import Asker, ContextOf

card_router = APIRouter(include_in_schema=False, route_class=PageRoute)
_PERIOD = timedelta(days=365)
"""What a card tells of; the last year, as a report without dates does."""


@card_router.get("/pumps/{serial}/job-card.pdf")
def job_card(request: Request, serial: str, context: ContextOf, asker: Asker, operator: str | None = None) -> Response:
    """Verdict, steps, evidence, pictures, versions and lines to sign, as they stand now."""
    now, system = datetime.now(UTC), system_of(request)
    with context.database.reading() as session:
        row = queries.pump(session, asker, serial, operator)
        curve = pump_curve(session, row, context.archive, system)
        if curve is None:
            raise NotFound(f"pump {serial} has no analysed record yet")
        chapter = pump_chapter(session, asker, row, Period(now - _PERIOD, now + timedelta(days=1)))
    document = job_card_pdf({**chapter, "curve": curve}, asker.owner, system)
    headers = {
        "Content-Disposition": 'inline; filename="job-card.pdf"',
        "X-Content-Type-Options": "nosniff",
        "Cache-Control": "private, no-store",
    }
    return Response(document, media_type="application/pdf", headers=headers)
