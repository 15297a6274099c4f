"""Asking for a job: checked, stored, handed to a worker."""

from pydantic import ValidationError
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from service.access import audit
from service.access.security import Principal
from service.access.turns import REFUSED, TooMany
from service.answers.documents import JsonObject
from service.context import Context
from service.errors import Fault, Invalid
from service.jobs import bulk_import, engine, evaluation, preview, report, reprocess, store
from service.jobs.kinds import kind_named
from service.settings import Settings
from service.storage.tables import Job

_RETRY_S = 10
KINDS = (bulk_import, evaluation, preview, report, reprocess)
"""Modules that register kinds of jobs; another kind is another module here."""


def ask_for(context: Context, asker: Principal, kind_name: str, operator: str | None, values: JsonObject) -> Job:
    """Store a job, which whoever is at work takes up; a job that waits to do just this is returned instead.

    Parameters
    ----------
    operator
        Whose data it works on; None works on all that the asker may see.

    Raises
    ------
    Invalid, NotFound, Forbidden
        with every fault of what was asked for.
    """
    kind = kind_named(kind_name)
    asker.require(kind.role)
    if operator is not None:
        operator = asker.operator_of(operator)
    operator = asker.operator or operator
    try:
        parameters = kind.parameters.model_validate(values)
    except ValidationError as error:
        faults = [Fault(".".join(("parameters", *map(str, e["loc"]))), e["msg"]) for e in error.errors()]
        raise Invalid(f"the parameters have {len(faults)} fault(s)", faults) from None
    asker.require(kind.role_for(parameters))
    with context.database.writing() as session:
        complete = kind.prepared(session, parameters, operator).model_dump(mode="json")
        job = store.same_waiting(session, kind.name, operator, asker.owner, complete)
        if job is not None:
            return job
        if context.settings.auth_is_on:
            _check_quotas(session, context.settings, operator, asker)
        job = store.new_job(session, kind.name, operator, asker.owner, complete)
        shown = {k: v for k, v in complete.items() if k not in kind.internal and v is not None}
        details = {"kind": kind.name, "parameters": shown}
        audit.note(session, asker, "job.start", f"job/{job.id}", operator, details)
    engine.submit(job.id)
    return job


def _check_quotas(session: Session, settings: Settings, operator: str | None, asker: Principal) -> None:
    """Refuse a job beyond the quota of jobs that have not ended.

    Raises
    ------
    TooMany
        naming whose quota is used up.
    """
    for whose, name, most in (
        ("key", asker.owner, settings.quota_key_jobs),
        ("operator", operator, settings.quota_operator_jobs),
    ):
        mine = Job.author == name if whose == "key" else Job.operator == name
        query = select(func.count()).select_from(Job).where(Job.status.in_(store.UNFINISHED), mine)
        waiting = int(session.scalar(query) or 0) if most and name is not None else 0
        if waiting >= most > 0:
            REFUSED.labels("quota_jobs").inc()
            raise TooMany(
                f"{waiting} jobs of {whose} {name} have not ended: wait for one of them, or cancel it",
                headers={"Retry-After": str(_RETRY_S)},
            )
