"""Bulk upload: many records in one archive, imported by a job."""

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from starlette.concurrency import run_in_threadpool

from service.access.security import Principal
from service.answers import jobs as answers
from service.context import Context
from service.ingest.archive import NDJSON_TYPES, ZIP_TYPES, archive_kind
from service.ingest.mapping_version import MappingVersion
from service.jobs.requests import ask_for
from service.storage.spool import SpooledFile
from service.storage.tables import Job
from service.web.addresses import location
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf
from service.web.routes.jobs import shown
from service.web.routes.records import METADATA_PARAMETERS, mapping_of, overrides_of

router = APIRouter(prefix="/records", tags=["records"], route_class=AnswerRoute)
_HEAD_BYTES = 64


@router.post(
    "/bulk",
    status_code=202,
    summary="Upload many flight records",
    openapi_extra={
        "parameters": METADATA_PARAMETERS,
        "requestBody": {"required": True, "content": {kind: {} for kind in (ZIP_TYPES[0], NDJSON_TYPES[0])}},
    },
)
async def upload_many(
    request: Request,
    response: Response,
    context: ContextOf,
    asker: Asker,
    mapping: Annotated[str | None, Query(description="Name of the channel mapping that the files need")] = None,
) -> answers.Job:
    """Take a ZIP file or NDJSON; the job has a result per member, and sending it again changes nothing."""
    asker.require("analyst")
    overrides = overrides_of(request)
    asker.operator_of(overrides.get("operator"))
    kind = request.headers.get("content-type", "")
    named = await run_in_threadpool(mapping_of, context, asker, overrides, mapping)
    declared = request.headers.get("content-length", "")
    async with context.spool.received(request.stream(), declared, context.settings.max_bulk_bytes) as file:
        job = await run_in_threadpool(asked, context, asker, file, kind, overrides, named)
    response.headers["Location"] = location("jobs", job.id)
    return shown(job)


def asked(
    context: Context,
    asker: Principal,
    file: SpooledFile,
    content_type: str,
    overrides: dict[str, str],
    mapping: MappingVersion | None,
) -> Job:
    """Check the archive as a whole, keep it, and queue its import."""
    with file.path.open("rb") as head:
        kind = archive_kind(content_type, head.read(_HEAD_BYTES))
    context.parser.opened(file.path, kind, context.settings.max_upload_bytes).close()
    context.raw_store.put_file(file.path, file.digest)
    values = {
        "content_hash": file.digest,
        "format": kind,
        "overrides": overrides,
        "mapping": mapping.to_json() if mapping else None,
    }
    return ask_for(context, asker, "bulk-import", asker.operator_of(overrides.get("operator")), values)
