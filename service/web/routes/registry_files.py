"""The registry as CSV files."""

from collections.abc import Iterator
from typing import Annotated

from fastapi import APIRouter, Depends, Request
from fastapi.responses import StreamingResponse
from starlette.concurrency import run_in_threadpool

from service.answers.registry import RegistryFileTaken
from service.errors import TooLarge
from service.registry.csv_files import Kind, exported, imported
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf

router = APIRouter(prefix="/registry", tags=["registry"], route_class=AnswerRoute)


async def _content(request: Request, context: ContextOf) -> bytes:
    """The body, no more of it than an upload may hold."""
    limit = context.settings.max_upload_bytes
    content = bytearray()
    async for part in request.stream():
        content += part
        if len(content) > limit:
            raise TooLarge(f"the file is larger than {limit} bytes: split it")
    return bytes(content)


@router.get("/{kind}.csv", summary="Registry as CSV", response_class=StreamingResponse)
def export(kind: Kind, context: ContextOf, asker: Asker) -> StreamingResponse:
    """Pumps, aircraft or entered installations that this key may see; the same file can be sent back."""

    def lines() -> Iterator[str]:
        with context.database.reading() as session:
            yield from exported(session, asker, kind)

    headers = {"Content-Disposition": f'attachment; filename="{kind}.csv"'}
    return StreamingResponse(lines(), media_type="text/csv; charset=utf-8", headers=headers)


@router.post(
    "/{kind}.csv",
    summary="Take in a registry file",
    openapi_extra={"requestBody": {"required": True, "content": {"text/csv": {}}}},
)
async def take(
    kind: Kind, content: Annotated[bytes, Depends(_content)], context: ContextOf, asker: Asker
) -> RegistryFileTaken:
    """Register and change what the lines say: all of them or, with every fault by line, none."""
    asker.require("engineer")

    def done() -> RegistryFileTaken:
        with context.database.writing() as session:
            taken = imported(session, asker, kind, content, context.archive)
        return {"created": taken.created, "changed": taken.changed, "unchanged": taken.unchanged}

    return await run_in_threadpool(done)
