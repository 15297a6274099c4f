"""Records: upload, list, look up, fetch back."""

from collections.abc import Mapping
from typing import Annotated, Literal

from fastapi import APIRouter, BackgroundTasks, Query, Request, Response
from starlette.concurrency import run_in_threadpool

from service.access.account import current_account
from service.access.security import Principal
from service.answers import records as answers
from service.answers.words import Page, instant
from service.context import Context
from service.errors import Fault, Invalid, NotFound
from service.identity import release_of
from service.ingest.file_formats import CONTENT_TYPES
from service.ingest.file_names import named_by
from service.ingest.mapping_version import MappingVersion
from service.ingest.mappings import mapping_version
from service.ingest.metadata import KNOWN
from service.jobs import engine
from service.monitoring.acceptance import Upload
from service.monitoring.withdrawal import withdraw_record
from service.reading import queries
from service.registry.fields import Instant, Reason
from service.storage.tables import ANALYSED, Record, Refusal
from service.web.addresses import location
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf
from service.web.paging import DEFAULT_ITEMS, MOST_ITEMS, page, place_of
from service.web.sent_file import FileName, file_name_of

router = APIRouter(prefix="/records", tags=["records"], route_class=AnswerRoute)
METADATA_PARAMETERS = [
    {
        "name": name,
        "in": "query",
        "required": False,
        "schema": {"type": "string"},
        "description": f"Metadata `{name}`: wins over what the file says",
    }
    for name in KNOWN
]
Status = Literal["stored", "analysed", "refused", "superseded", "withdrawn"]


@router.post(
    "",
    status_code=201,
    summary="Upload one flight record",
    responses={200: {"description": "Known already"}, 202: {"description": "Stored, not analysed yet"}},
    openapi_extra={
        "parameters": METADATA_PARAMETERS,
        "requestBody": {
            "required": True,
            "content": {kind: {} for kind in CONTENT_TYPES},
        },
    },
)
async def upload(
    request: Request,
    response: Response,
    background: BackgroundTasks,
    context: ContextOf,
    asker: Asker,
    wait: Annotated[bool, Query(description="Answer after the analysis")] = True,
    supersedes: Annotated[str | None, Query(description="Id of the record that this one replaces")] = None,
    mapping: Annotated[str | None, Query(description="Name of the channel mapping that the file needs")] = None,
    file_name: FileName = None,
) -> answers.Record:
    """Take the body as one record; metadata may come as query parameters and win over those of the file."""
    asker.require("analyst")
    overrides = overrides_of(request)
    named = await run_in_threadpool(mapping_of, context, asker, overrides, mapping)
    overrides = named_by(named.mapping.name_pattern if named else None, file_name_of(request, file_name), overrides)
    declared = request.headers.get("content-length", "")
    account, uploads = current_account(), context.crowd.uploads
    if wait:
        uploads.check(account)  # before its bytes are taken
    async with context.spool.received(request.stream(), declared, context.settings.max_upload_bytes) as file:
        new = Upload(
            file=file,
            content_type=request.headers.get("content-type", ""),
            content_encoding=request.headers.get("content-encoding", ""),
            overrides=overrides,
            supersedes=supersedes,
            mapping=named,
            is_waited_for=wait,
        )
        if wait:
            async with uploads.entered_by_task(account):
                accepted = await run_in_threadpool(context.acceptance.accept, new, asker)
        else:
            accepted = await run_in_threadpool(context.acceptance.store, new, asker)
    answer = await run_in_threadpool(_answer, context, asker, accepted.record_id)
    response.status_code = 200 if accepted.known else (201 if wait and not accepted.waiting else 202)
    response.headers["Location"] = location("records", accepted.record_id)
    if not wait and answer["status"] == "stored":
        background.add_task(engine.acknowledged, context, accepted.record_id)
    return answer


@router.get("", summary="List records, the newest first")
def listed(
    context: ContextOf,
    asker: Asker,
    pump: str | None = None,
    since: Annotated[Instant | None, Query(alias="from")] = None,
    until: Annotated[Instant | None, Query(alias="to")] = None,
    status: Status | None = None,
    limit: Annotated[int, Query(ge=1, le=MOST_ITEMS)] = DEFAULT_ITEMS,
    cursor: str | None = None,
) -> Page[answers.RecordSummary]:
    """Page through the records that this key may see."""
    query = {"pump": pump, "from": since, "to": until, "status": status, "list": "records"}
    after = place_of(query, cursor)
    wanted = queries.records(asker, serial=pump, since=since, until=until, status=status, after=after)
    with context.database.reading() as session:
        rows = session.execute(wanted.limit(limit + 1)).all()
        return page(
            rows,
            limit,
            query,
            lambda row: [row[0].received_at.isoformat(), row[0].id],
            lambda row: _summary(row[0], row[1], row[2]),
        )


@router.get("/refusals", summary="Uploads that were refused at once")
def refusals(
    context: ContextOf,
    asker: Asker,
    limit: Annotated[int, Query(ge=1, le=MOST_ITEMS)] = DEFAULT_ITEMS,
    cursor: str | None = None,
) -> Page[answers.Refusal]:
    """Page through the refusals that this key may see, the newest first; `refused` records were stored before."""
    query = {"list": "refusals"}
    wanted = queries.refusals(asker, place_of(query, cursor))
    with context.database.reading() as session:
        rows = list(session.scalars(wanted.limit(limit + 1)))
        return page(rows, limit, query, lambda row: [row.received_at.isoformat(), row.id], _refusal)


@router.get("/{record_id}", summary="Status of one record")
def one(record_id: str, context: ContextOf, asker: Asker) -> answers.Record:
    """Where a record stands, what its windows say, and the verdict as it was right after it."""
    return _answer(context, asker, record_id)


@router.delete("/{record_id}", summary="Withdraw one record")
def withdraw(
    record_id: str,
    context: ContextOf,
    asker: Asker,
    reason: Annotated[Reason, Query(description="Why it shall no longer count")],
) -> answers.Record:
    """Take a record out of its pump's history, which is folded anew; its bytes are kept."""
    asker.require("analyst")
    with context.database.writing() as session:
        withdraw_record(session, asker, record_id, reason, context.archive)
    return _answer(context, asker, record_id)


@router.get("/{record_id}/windows", summary="Windows of one record")
def windows(record_id: str, context: ContextOf, asker: Asker) -> Page[answers.Window]:
    """All windows in time order, the rejected ones with their reason."""
    with context.database.reading() as session:
        return {"items": queries.windows_of(queries.record(session, asker, record_id)), "next": None}


@router.get("/{record_id}/raw", summary="Original bytes of one record", response_class=Response)
def raw(record_id: str, context: ContextOf, asker: Asker) -> Response:
    """The bytes exactly as they were uploaded."""
    with context.database.reading() as session:
        row = queries.record(session, asker, record_id)
    content = context.raw_store.get(row.content_hash)
    headers = {"Content-Disposition": f'attachment; filename="{record_id}"'}
    kind = row.content_type or "application/octet-stream"
    if row.request.get("encoding"):
        headers["X-Original-Content-Encoding"] = row.request["encoding"]
    return Response(content, media_type=kind, headers=headers)


def overrides_of(request: Request) -> dict[str, str]:
    """Metadata among the query parameters."""
    given = [(name, value) for name, value in request.query_params.multi_items() if name in KNOWN]
    names = [name for name, _ in given]
    twice = [Fault(f"query.{name}", "is given twice") for name in dict.fromkeys(names) if names.count(name) > 1]
    if twice:
        raise Invalid("the query is wrong; nothing was stored", twice)
    return dict(given)


def mapping_of(
    context: Context, asker: Principal, overrides: Mapping[str, str], name: str | None
) -> MappingVersion | None:
    """The newest version of a mapping that the upload's operator has."""
    if name is None:
        return None
    with context.database.reading() as session:
        return mapping_version(session, asker.operator_of(overrides.get("operator")), name)


def _answer(context: Context, asker: Principal, record_id: str) -> answers.Record:
    with context.database.reading() as session:
        row, assessment = queries.record_with_assessment(session, asker, record_id)
        document: answers.Record = {
            "record_id": row.id,
            "status": row.status,
            "operator": row.operator,
            "aircraft": row.aircraft,
            "position": row.position,
            "flight_id": row.flight_id,
            "segment": row.segment or None,
            "started_at": instant(row.started_at),
            "received_at": instant(row.received_at),
            "supersedes": row.supersedes,
        }
        if row.ended_at is not None:
            document |= {"ended_at": instant(row.ended_at), "withdrawal": row.withdrawal}
        if row.problem is not None:
            document["problem"] = row.problem
        if row.waits_for is not None:
            document["waits_for_release"] = release_of(row.waits_for)
        if row.status != ANALYSED:
            return document
        if assessment is None:
            raise NotFound(f"record {record_id} has no verdict")
        found, reduction = queries.windows_of(row), row.reduction or {}
        usable = [w["residuals"] for w in found if w["kind"] == "zero_flow" and w["accepted"]]
        return {
            **document,
            "pump_serial": assessment.serial,
            "windows": found,
            "explanation": reduction.get("explanation"),
            "flags": reduction.get("flags", []),
            "residuals": usable[-1] if usable else None,
            "verdict": assessment.verdict,
        }


def _refusal(row: Refusal) -> answers.Refusal:
    return {
        "id": row.id,
        "operator": row.operator,
        "received_at": instant(row.received_at),
        "content_hash": row.content_hash,
        "problem": row.problem,
    }


def _summary(row: Record, serial: str | None, state: str | None) -> answers.RecordSummary:
    return {
        "record_id": row.id,
        "status": row.status,
        "operator": row.operator,
        "pump_serial": serial,
        "aircraft": row.aircraft,
        "position": row.position,
        "flight_id": row.flight_id,
        "segment": row.segment or None,
        "started_at": instant(row.started_at),
        "received_at": instant(row.received_at),
        "state": state if row.status == ANALYSED else None,
        "explanation": (row.reduction or {}).get("explanation"),
        "problem": row.problem,
    }
