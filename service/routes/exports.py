"""Exports of everything that a key may see, streamed."""

from datetime import datetime
from typing import Annotated

from fastapi import APIRouter, Query
from fastapi.responses import StreamingResponse

from service.context import Asker, ContextOf
from service.errors import Fault, Invalid
from service.exports import exported

router = APIRouter(prefix="/exports", tags=["exports"])
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
    since: Annotated[datetime | None, Query(alias="from")] = None,
    until: Annotated[datetime | None, Query(alias="to")] = None,
) -> StreamingResponse:
    """Rows in event order; ``from`` is inclusive, ``to`` is not."""
    faults = [
        Fault(f"query.{word}", "has no time zone: write Z for UTC")
        for word, instant in (("from", since), ("to", until))
        if instant is not None and instant.tzinfo is None
    ]
    if faults:
        raise Invalid("an instant needs a time zone", faults)
    parts = exported(context.database, asker, name, form, pump=pump, since=since, until=until)
    headers = {"Content-Disposition": f'attachment; filename="{name}.{form}"'}
    return StreamingResponse(parts, media_type=_TYPES[form], headers=headers)
