"""A file as it is sent: the body, or a part of a form; its name is a parameter, the form's, or Content-Disposition's."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from email.message import Message
from pathlib import Path
from typing import Annotated, Any

from fastapi import Query, Request
from starlette.datastructures import UploadFile

from service.context import Context
from service.errors import Fault, Invalid, TooLarge
from service.ingest.file_formats import ANY_TYPE

FileName = Annotated[
    str | None,
    Query(
        max_length=255,
        description="Name of the file, which a channel mapping may read metadata from; default: Content-Disposition's",
    ),
]


def file_name_of(request: Request, given: str | None) -> str | None:
    """The parameter, else the header's file name, else None."""
    if given is not None:
        return given
    header = request.headers.get("content-disposition")
    if header is None:
        return None
    message = Message()
    message["Content-Disposition"] = header
    return message.get_filename()


_FORM_OVERHEAD = 2**20 + 2**16


@dataclass(frozen=True, slots=True)
class SentFile:
    """Where it lies while the request lasts, what it is said to be, its name, and the form's part ``mapping``."""

    path: Path
    kind: str
    encoding: str
    name: str | None
    mapping: str | None = None


@asynccontextmanager
async def sent_file(request: Request, context: Context, file_name: str | None) -> AsyncIterator[SentFile]:
    """The file of a request: its body, or the part ``file`` of a form beside an optional part ``mapping``.

    Raises
    ------
    TooLarge, Invalid
        for what is too long, and a form without its length or without a file.
    """
    limit = context.settings.max_upload_bytes
    declared = request.headers.get("content-length", "")
    if not request.headers.get("content-type", "").lower().startswith("multipart/form-data"):
        kind, encoding = request.headers.get("content-type", ANY_TYPE), request.headers.get("content-encoding", "")
        async with context.spool.received(request.stream(), declared, limit) as file:
            yield SentFile(file.path, kind, encoding, file_name_of(request, file_name))
        return
    # the form's parser has no bound of its own
    if not declared.isdigit():
        raise Invalid("a form needs its length", [Fault("content-length", "is missing")])
    if int(declared) > limit + _FORM_OVERHEAD:
        raise TooLarge(f"the form is larger than {limit} bytes")
    async with request.form(max_files=1, max_fields=1, max_part_size=2**20) as form:
        part, words = form.get("file"), form.get("mapping")
        if not isinstance(part, UploadFile) or isinstance(words, UploadFile):
            raise Invalid("the form needs a file", [Fault("file", "is missing, or the mapping is sent as a file")])
        async with context.spool.received(_parts(part), str(part.size or ""), limit) as file:
            yield SentFile(file.path, part.content_type or ANY_TYPE, "", file_name or part.filename, words)


async def _parts(part: UploadFile) -> Any:
    while piece := await part.read(1 << 20):
        yield piece
