"""Uploading by hand: files with a mapping, looked at before or taken, each with its result and every fault."""

from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import TypeAlias

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import FormData, UploadFile
from typing_extensions import TypedDict

from service.access.security import EVERYBODY, Principal
from service.answers.mappings import MappingPreview
from service.answers.problems import Problem as ProblemDocument
from service.answers.records import Record
from service.context import Context
from service.errors import Fault, Invalid, Problem, TooLarge
from service.ingest.archive import NDJSON_TYPES, ZIP_TYPES
from service.ingest.file_formats import SUFFIXES
from service.ingest.mapping_version import MappingVersion
from service.ingest.metadata import KNOWN
from service.ingest.preview import preview
from service.ingest.upload_files import content_type_of
from service.monitoring.acceptance import Upload
from service.storage.spool import SpooledFile
from service.web.dashboard.forms import sender, signed_in, texts
from service.web.dashboard.frame import PageRoute, html_page
from service.web.dashboard.links import address
from service.web.dependencies import Asker, ContextOf, context_of
from service.web.routes import bulk, mappings, records

upload_router = APIRouter(include_in_schema=False, route_class=PageRoute)
_MOST_FILES = 200
_MOST_LISTED = 500
_FIELDS = ("pump_serial", "aircraft", "position", "flight_id", "segment", "started_at", "flight_hours")
"""Metadata that a file may lack; what is typed wins over the file."""
_ARCHIVES = {".zip": ZIP_TYPES[0], ".ndjson": NDJSON_TYPES[0], ".jsonl": NDJSON_TYPES[0]}
_PREVIEW_ROWS = 5


class _Became(TypedDict, total=False):
    """What became of a file that was taken: a record (known already or not), or the address of a job, or a preview."""

    record: Record
    known: bool
    job: str
    preview: MappingPreview


class _Result(TypedDict):
    """A file's row: one of record, job, preview and problem is there."""

    name: str
    problem: ProblemDocument | None
    record: Record | None
    known: bool
    job: str | None
    preview: MappingPreview | None


_Work: TypeAlias = Callable[[Context, Principal, str, SpooledFile, dict[str, str], MappingVersion | None], _Became]


@upload_router.get("/upload", response_class=HTMLResponse)
def upload_page(request: Request, context: ContextOf, asker: Asker) -> Response:
    """A form for one or many files."""
    asker.require("analyst")
    return _page(request, context, asker, {}, [])


@upload_router.post("/upload")
async def upload(request: Request) -> Response:
    """Take every file of the form, each for itself; a ZIP file or NDJSON becomes a job."""
    return await _each(request, _taken)


@upload_router.post("/upload/preview")
async def look(request: Request) -> Response:
    """What every file of the form would become; nothing is stored."""
    return await _each(request, _previewed)


async def _each(request: Request, work: _Work) -> Response:
    """The form's files one after the other, each on disk while it is worked on."""
    context, visitor = context_of(request), await run_in_threadpool(signed_in, request)
    asker = visitor.principal if visitor else EVERYBODY
    asker.require("analyst")
    request.state.back = "/upload"
    declared = request.headers.get("content-length", "")
    if not declared.isdigit():
        raise Invalid("a form needs its length", [Fault("content-length", "is missing")])
    if int(declared) > context.settings.max_bulk_bytes:
        raise TooLarge(
            f"the files are larger than {context.settings.max_bulk_bytes} bytes together: send fewer at once"
        )
    async with request.form(max_files=_MOST_FILES, max_fields=100) as form:
        asker = sender(visitor, form)
        files, typed = _files(form), {name: values[0] for name, values in texts(form).items() if values[0]}
        overrides = _overrides(typed)
        chosen = typed.get("mapping")
        mapping = await run_in_threadpool(records.mapping_of, context, asker, overrides, chosen)
        results = [await _one(context, asker, part, overrides, mapping, work) for part in files]
    return await run_in_threadpool(_page, request, context, asker, typed, results)


def _files(form: FormData) -> list[UploadFile]:
    found = [part for part in form.getlist("file") if isinstance(part, UploadFile) and (part.filename or part.size)]
    if not found:
        raise Invalid("nothing was sent", [Fault("file", "is missing: choose one or more files")])
    return found


def _overrides(typed: dict[str, str]) -> dict[str, str]:
    unknown = [
        Fault(name, "is not a field of this form") for name in typed if name not in (*KNOWN, "mapping", "supersedes")
    ]
    if unknown:
        raise Invalid(f"the form has {len(unknown)} fault(s); nothing was stored", unknown)
    return {name: value for name, value in typed.items() if name in KNOWN}


async def _one(
    context: Context,
    asker: Principal,
    part: UploadFile,
    overrides: dict[str, str],
    mapping: MappingVersion | None,
    work: _Work,
) -> _Result:
    """What became of one file; what is wrong with it is its own result and stops none of the others."""
    name = part.filename or "file"
    is_archive = Path(name).suffix.lower() in _ARCHIVES
    limit = context.settings.max_bulk_bytes if is_archive else context.settings.max_upload_bytes
    try:
        async with context.spool.received(_pieces(part), str(part.size or ""), limit) as file:
            found = await run_in_threadpool(work, context, asker, name, file, overrides, mapping)
    except Problem as problem:
        return {
            "name": name,
            "problem": problem.body(),
            "record": None,
            "known": False,
            "job": None,
            "preview": None,
        }
    return {
        "name": name,
        "problem": None,
        "record": found.get("record"),
        "known": found.get("known", False),
        "job": found.get("job"),
        "preview": found.get("preview"),
    }


async def _pieces(part: UploadFile) -> AsyncIterator[bytes]:
    while piece := await part.read(1 << 20):
        yield piece


def _taken(
    context: Context,
    asker: Principal,
    name: str,
    file: SpooledFile,
    overrides: dict[str, str],
    mapping: MappingVersion | None,
) -> _Became:
    kind = _ARCHIVES.get(Path(name).suffix.lower())
    if kind is not None:
        job = bulk.asked(context, asker, file, kind, overrides, mapping)
        return {"job": address("jobs", job.id)}
    new = Upload(
        file=file,
        content_type=content_type_of(Path(name)),
        content_encoding="",
        overrides=overrides,
        supersedes=None,
        mapping=mapping,
    )
    accepted = context.acceptance.accept(new, asker)
    return {"record": records.one(accepted.record_id, context, asker), "known": accepted.known}


def _previewed(
    context: Context,
    _asker: Principal,
    name: str,
    file: SpooledFile,
    overrides: dict[str, str],
    mapping: MappingVersion | None,
) -> _Became:
    if Path(name).suffix.lower() in _ARCHIVES:
        raise Invalid("a ZIP file or NDJSON is not looked at: preview one of its files")
    applied = mapping.mapping if mapping else None
    dialect = applied.dialect if applied else None
    raw = context.parser.parsed(file.path, content_type_of(Path(name)), "", context.limits, dialect)
    found = preview(raw, applied, _PREVIEW_ROWS)
    # what is typed wins, and is not missing
    faults = [fault for fault in found["faults"] if fault["where"] not in overrides]
    return {"preview": {**found, "faults": faults}}


def _page(
    request: Request, context: Context, asker: Principal, typed: dict[str, str], results: list[_Result]
) -> Response:
    values = {
        "request": request,
        "results": results,
        "typed": typed,
        "fields": _FIELDS,
        "mappings": mappings.listed(context, asker, limit=_MOST_LISTED)["items"],
        "sees_all": asker.operator is None,
        "suffixes": ",".join((*SUFFIXES, *_ARCHIVES)),
        "most": context.settings.max_upload_bytes,
        "most_files": _MOST_FILES,
        "taken": sum(r["record"] is not None or r["job"] is not None for r in results),
        "refused": sum(r["problem"] is not None for r in results),
    }
    failed = bool(results) and all(r["problem"] is not None for r in results)
    first = results[0]["problem"] if failed else None
    return html_page("upload.html", first["status"] if first else 200, values)
