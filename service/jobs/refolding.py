"""Folding anew what a change touches: a few pumps right after the answer, more of them by the queue; a job either way."""

from fastapi import BackgroundTasks

from service.access.security import Principal
from service.context import Context
from service.jobs import store, work
from service.jobs.requests import ask_for
from service.monitoring.reanalysis import Change, n_pumps
from service.thresholds.layers import Scope

MOST_PUMPS_AT_ONCE = 20


def refold_after(
    change: Change, version: int, context: Context, asker: Principal, background: BackgroundTasks, scope: Scope
) -> None:
    """Have the pumps of a scope folded anew after the change has been stored.

    Parameters
    ----------
    change, version
        What has changed, and the number of what is new: a job is asked for once for each.
    scope
        The pumps that it holds for.
    """
    with context.database.reading() as session:
        n = n_pumps(session, scope)
    operator = scope.id if scope.kind == "operator" else scope.operator
    values = {"scope": scope.kind, "id": scope.id, "operator": scope.operator, "version": version, "change": change}
    if n > MOST_PUMPS_AT_ONCE:
        ask_for(context, asker, "refold", operator, values)
    elif n > 0:
        with context.database.writing() as session:
            owner = asker.operator or operator
            job = store.new_job(session, "refold", owner, asker.owner, {**values, work.AT_ONCE: True})
        background.add_task(work.work_off, context, job.id)
