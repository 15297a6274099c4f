"""Jobs: ask for one, watch it, read what became of each item, cancel it."""

from typing import Annotated, Literal, cast

from fastapi import APIRouter, Query, Response
from pydantic import ConfigDict, Field
from sqlalchemy.orm import Session

from service.access import audit
from service.answers import jobs as answers
from service.answers.documents import JsonObject
from service.answers.job_documents import JOB_DOCUMENTS
from service.answers.jobs import DOCUMENT_TYPES
from service.answers.words import Page, instant
from service.bodies import Body
from service.errors import Fault, Invalid
from service.jobs import engine, store
from service.jobs.kinds import kind_named
from service.jobs.products import digest_of
from service.jobs.requests import ask_for
from service.storage.tables import Job, JobItem
from service.web.addresses import location
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf
from service.web.paging import DEFAULT_ITEMS, MOST_ITEMS, page, place_of

router = APIRouter(prefix="/jobs", tags=["jobs"], route_class=AnswerRoute)
Status = Literal["queued", "running", "succeeded", "failed", "cancelled"]
_PAGE_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; frame-ancestors 'none'"
"""Documents carry their own style and nothing that runs."""
_DOCUMENTS = {
    "json": {
        "schema": {"anyOf": [{"$ref": f"#/components/schemas/{kind.__name__}"} for kind in JOB_DOCUMENTS]},
        "example": {"subject": "P-7", "since": "2026-01-01T00:00:00Z", "until": "2026-07-01T00:00:00Z", "pumps": []},
    }
}


class NewJob(Body):
    """A kind of job and its parameters; ``operator`` narrows it to one operator."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {"kind": "reprocess", "parameters": {"pump": "P-1", "dry_run": True}},
                {"kind": "reprocess", "parameters": {"threshold_version": 3, "only": "verdicts", "dry_run": True}},
                {"kind": "report", "operator": "north", "parameters": {"since": "2026-01-01T00:00:00Z"}},
                {"kind": "evaluation", "parameters": {"rows": ["setting 3 bar"], "pumps": 40, "seed": 7}},
            ]
        },
    )
    kind: str
    parameters: JsonObject = Field(default_factory=dict)
    operator: str | None = Field(default=None, min_length=1, max_length=200)


@router.get("", summary="List jobs, the newest first")
def listed(
    context: ContextOf,
    asker: Asker,
    kind: str | None = None,
    status: Status | None = None,
    limit: Annotated[int, Query(ge=1, le=MOST_ITEMS)] = DEFAULT_ITEMS,
    cursor: str | None = None,
) -> Page[answers.Job]:
    """Page through the jobs that this key may see."""
    query = {"list": "jobs", "kind": kind, "status": status}
    after = place_of(query, cursor)
    with context.database.reading() as session:
        rows = list(session.scalars(store.jobs(asker, kind, status, after).limit(limit + 1)))
    return page(rows, limit, query, lambda job: [job.created_at.isoformat(), job.id], shown)


@router.post("", status_code=202, summary="Ask for a job")
def make(body: NewJob, response: Response, context: ContextOf, asker: Asker) -> answers.Job:
    """Queue a job; asking again for one that has not ended gives the same."""
    kind = kind_named(body.kind)
    if not kind.over_api:
        raise Invalid(f"a job {body.kind} is not started here", [Fault("kind", "is started by another call")])
    ours = [Fault(f"parameters.{name}", "is set by the service") for name in kind.internal & body.parameters.keys()]
    if ours:
        raise Invalid(f"the parameters have {len(ours)} fault(s)", ours)
    job = ask_for(context, asker, body.kind, body.operator, body.parameters)
    response.headers["Location"] = location("jobs", job.id)
    return shown(job)


@router.get("/{job_id}", summary="One job")
def one(job_id: str, context: ContextOf, asker: Asker) -> answers.JobWithItems:
    """Status, progress and the first results; the rest is at ``/jobs/{id}/items``."""
    with context.database.reading() as session:
        return _with_items(session, store.job_of(session, asker, job_id))


@router.get("/{job_id}/items", summary="Results of one job, item by item")
def items(
    job_id: str,
    context: ContextOf,
    asker: Asker,
    limit: Annotated[int, Query(ge=1, le=MOST_ITEMS)] = DEFAULT_ITEMS,
    cursor: str | None = None,
) -> Page[answers.JobItem]:
    """Page through the items in their order."""
    query = {"list": "job items", "job": job_id}
    after = place_of(query, cursor)
    with context.database.reading() as session:
        job = store.job_of(session, asker, job_id)
        rows = list(session.scalars(store.items(job.id, after).limit(limit + 1)))
    return page(rows, limit, query, lambda item: item.position, _item)


@router.get(
    "/{job_id}/result",
    summary="Document that a job has left",
    response_class=Response,
    responses={
        200: {"content": {name.partition(";")[0]: _DOCUMENTS.get(form, {}) for form, name in DOCUMENT_TYPES.items()}}
    },
)
def result(
    job_id: str,
    context: ContextOf,
    asker: Asker,
    form: Annotated[
        Literal["html", "json", "pdf"],
        Query(alias="format", description="A page to print, its numbers, or the page as PDF where the job is a report"),
    ] = "html",
) -> Response:
    """A report or a study as its job has left it, once it has succeeded."""
    with context.database.reading() as session:
        digest = digest_of(store.job_of(session, asker, job_id), form)
    headers = {"Content-Security-Policy": _PAGE_POLICY, "X-Content-Type-Options": "nosniff", "ETag": f'"{digest}"'}
    return Response(context.raw_store.get(digest), media_type=DOCUMENT_TYPES[form], headers=headers)


@router.post("/{job_id}/cancel", summary="Cancel a job")
def cancel(job_id: str, context: ContextOf, asker: Asker) -> answers.Job:
    """Stop a job between two items, at once where no worker has it in hand; what it did so far stays."""
    with context.database.reading() as session:
        store.job_of(session, asker, job_id)
    in_hand = engine.is_in_hand(job_id)
    with context.database.writing() as session:
        job = store.job_of(session, asker, job_id)
        asker.require(kind_named(job.kind).role)
        store.ask_to_cancel(session, job, in_hand=in_hand)
        audit.note(session, asker, "job.cancel", f"job/{job.id}", job.operator, {"kind": job.kind})
    return shown(job)


def shown(job: Job) -> answers.Job:
    """A job as the API shows it, without its items."""
    return {
        "id": job.id,
        "job_id": job.id,
        "kind": job.kind,
        "operator": job.operator,
        "status": job.status,
        "progress": {"done": job.done, "total": job.total},
        "parameters": {k: v for k, v in job.parameters.items() if k not in kind_named(job.kind).internal},
        "result": job.result,
        "problem": job.problem,
        "cancel_requested": job.cancel_requested,
        "author": job.author,
        "created_at": instant(job.created_at),
        "started_at": instant(job.started_at),
        "finished_at": instant(job.finished_at),
    }


def _with_items(session: Session, job: Job) -> answers.JobWithItems:
    rows = list(session.scalars(store.items(job.id).limit(store.MOST_SHOWN)))
    return {**shown(job), "items": [_item(row) for row in rows], "items_complete": len(rows) >= job.done}


def _item(row: JobItem) -> answers.JobItem:
    item = {"position": row.position, "name": row.name, "status": row.status, **row.detail}
    return cast("answers.JobItem", item)
