"""Jobs: asked for, watched, cancelled; and the reports that some of them leave."""

from typing import Annotated, Literal

from fastapi import APIRouter, Query, Request
from fastapi.responses import HTMLResponse, Response

from service.answers.documents import JsonObject
from service.web.dashboard.forms import SentForm, checked, done
from service.web.dashboard.frame import PageRoute, html_page
from service.web.dashboard.links import address
from service.web.dependencies import Asker, ContextOf
from service.web.routes import jobs

job_router = APIRouter(include_in_schema=False, route_class=PageRoute)
_PER_PAGE = 50
_ITEMS = 200
KIND_WORDS = {
    "report": "report",
    "reprocess": "reprocessing",
    "preview": "preview of thresholds",
    "bulk-import": "import of an archive",
    "evaluation": "detection study",
}
_PARAMETERS = ("pump", "pump_type", "since", "until", "only", "dry_run")
_ONLY = ("everything", "verdicts")


@job_router.get("/jobs", response_class=HTMLResponse)
def jobs_page(
    request: Request,
    context: ContextOf,
    asker: Asker,
    kind: str | None = None,
    status: jobs.Status | None = None,
    cursor: str | None = None,
) -> Response:
    """Jobs, the newest first, and forms that ask for one."""
    found = jobs.listed(context, asker, kind=kind, status=status, limit=_PER_PAGE, cursor=cursor)
    filters = {"kind": kind, "status": status}
    statuses = ("queued", "running", "succeeded", "failed", "cancelled")
    values = {
        "request": request,
        "jobs": found["items"],
        "filters": filters,
        "kind_words": KIND_WORDS,
        "chips": [
            (word or "all", address("jobs", query={**filters, "status": word}), word == (status or ""))
            for word in ("", *statuses)
        ],
        "next": address("jobs", query={**filters, "cursor": found["next"]}) if found["next"] else None,
        "first": address("jobs", query=filters) if cursor else None,
        "only": _ONLY,
        "may_reprocess": asker.may("analyst"),
        "sees_all": asker.operator is None,
    }
    return html_page("jobs.html", 200, values)


@job_router.post("/jobs")
def ask(form: SentForm) -> Response:
    """Ask for a job and go to it; a report is shown where it will be."""
    form.goes_back_to(form.text("back") if form.text("back").startswith("/pumps/") else "/jobs")
    parameters: JsonObject = {name: form.text(name) for name in _PARAMETERS if form.text(name)}
    parameters |= {name: form.instant(name) for name in ("since", "until") if form.text(name)}
    if form.text("kind") == "report":
        parameters["units"] = form.system.name
    if "dry_run" in parameters:
        parameters["dry_run"] = True
    values = form.filled(without=(*_PARAMETERS, "back")) | {"parameters": parameters}
    job = jobs.make(checked(jobs.NewJob, values, "job"), Response(), form.context, form.who)
    return done(address("reports" if job["kind"] == "report" else "jobs", job["id"]))


@job_router.get("/jobs/{job_id}", response_class=HTMLResponse)
def job_page(
    request: Request, job_id: str, context: ContextOf, asker: Asker, cursor: str | None = Query(default=None)
) -> Response:
    """One job: how far it is, what became of each item, what it left."""
    job = jobs.one(job_id, context, asker)
    items = jobs.items(job_id, context, asker, limit=_ITEMS, cursor=cursor)
    values = {
        "request": request,
        "job": job,
        "items": items["items"],
        "next": address("jobs", job_id, query={"cursor": items["next"]}) if items["next"] else None,
        "first": address("jobs", job_id) if cursor else None,
        "kind_words": KIND_WORDS,
        "is_living": job["status"] in ("queued", "running"),
        "may_cancel": asker.may("analyst") or job["kind"] == "report",
    }
    return html_page("job.html", 200, values)


@job_router.post("/jobs/{job_id}/cancel")
def cancel(job_id: str, form: SentForm) -> Response:
    """Stop a job between two items."""
    form.goes_back_to(address("jobs", job_id))
    jobs.cancel(job_id, form.context, form.who)
    return done(address("jobs", job_id))


@job_router.get("/reports/{job_id}", response_class=HTMLResponse)
def report_page(
    request: Request,
    job_id: str,
    context: ContextOf,
    asker: Asker,
    form: Annotated[Literal["html", "pdf"], Query(alias="format")] = "html",
) -> Response:
    """The document that a job has left, to print; until then how far it is."""
    job = jobs.one(job_id, context, asker)
    kept = job["result"].get("files", {}) if job["result"] is not None else {}
    if form in kept:
        return jobs.result(job_id, context, asker, form)
    values = {"request": request, "job": job, "is_living": job["status"] in ("queued", "running")}
    return html_page("report.html", 200, values)
