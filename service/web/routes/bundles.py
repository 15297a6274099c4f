"""A pump's bundle: inputs, versions and verdict in one file."""

import uuid
from typing import Annotated
from urllib.parse import quote

from fastapi import APIRouter, Query
from fastapi.responses import FileResponse
from starlette.background import BackgroundTask

from service.keeping.bundle import make_bundle
from service.reading import queries
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf

router = APIRouter(prefix="/pumps", tags=["pumps"], route_class=AnswerRoute)


@router.get(
    "/{serial}/bundle",
    summary="All that a verdict rests on, in one file",
    response_class=FileResponse,
    responses={200: {"content": {"application/zip": {}}}},
)
def bundle(
    serial: str,
    context: ContextOf,
    asker: Asker,
    operator: Annotated[
        str | None, Query(description="Needed only where several operators have this serial number")
    ] = None,
) -> FileResponse:
    """A ZIP of the pump's records, entries, thresholds, types and verdict; `casedrain replay` makes the verdict again."""
    asker.require("engineer")
    with context.database.reading() as session:
        pump_id = queries.pump(session, asker, serial, operator).id
    place = context.spool.folder / f"bundle-{uuid.uuid4().hex}.zip"
    make_bundle(context.database, context.raw_store, pump_id, place)
    return FileResponse(
        place,
        media_type="application/zip",
        headers={"Content-Disposition": f"attachment; filename*=UTF-8''{quote(serial, '')}.zip"},
        background=BackgroundTask(place.unlink, missing_ok=True),
    )
