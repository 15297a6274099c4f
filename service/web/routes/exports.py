"""Exports of everything that a key may see, streamed."""

from typing import Annotated

from fastapi import APIRouter, Query
from fastapi.responses import StreamingResponse

from service.reading.exports import exported
from service.registry.fields import Instant
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf

router = APIRouter(prefix="/exports", tags=["exports"], route_class=AnswerRoute)
_TYPES = {"csv": "text/csv; charset=utf-8", "parquet": "application/vnd.apache.parquet"}


@router.get(
    "/{name}.{form}",
    summary="Trends, verdicts or windows as CSV or Parquet",
    response_class=StreamingResponse,
    responses={200: {"content": {"text/csv": {}, "application/vnd.apache.parquet": {}}}},
)
def export(
    name: str,
    form: str,
    context: ContextOf,
    asker: Asker,
    pump: str | None = None,
    since: Annotated[Instant | None, Query(alias="from")] = None,
    until: Annotated[Instant | None, Query(alias="to")] = None,
) -> StreamingResponse:
    """Rows in event order; ``from`` is inclusive, ``to`` is not."""
    parts = exported(context.database, asker, name, form, pump=pump, since=since, until=until)
    headers = {"Content-Disposition": f'attachment; filename="{name}.{form}"'}
    return StreamingResponse(parts, media_type=_TYPES[form], headers=headers)
