"""Documents that a job leaves behind: made in a folder of its own, kept in the raw store, told of in its result."""

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from service.answers.jobs import JobFile
from service.errors import Conflict, NotFound
from service.jobs.kinds import Work
from service.storage.tables import SUCCEEDED, Job


def folder_of(work: Work[Any]) -> Path:
    """Folder of a job on this machine, for what its items prepare.

    Another worker that takes the job up finds it empty: whatever is put together from it must do without.
    """
    folder = work.context.settings.data_dir.resolve() / "jobs" / work.job_id
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def keep(work: Work[Any], documents: Mapping[str, str | bytes]) -> dict[str, JobFile]:
    """Put a job's finished documents, by format, into the raw store, and what the job's result says of them.

    The job's folder is removed.
    """
    files: dict[str, JobFile] = {}
    for form, document in documents.items():
        content = document.encode() if isinstance(document, str) else document
        files[form] = {"content_hash": work.context.raw_store.put(content), "bytes": len(content)}
    shutil.rmtree(folder_of(work), ignore_errors=True)
    return files


def digest_of(job: Job, form: str) -> str:
    """Hash of a job's document in one format.

    Raises
    ------
    Conflict
        while the job has not come to its end.
    NotFound
        when jobs of this kind leave no such document.
    """
    if job.status != SUCCEEDED:
        raise Conflict(f"job {job.id} is {job.status}: it has no document")
    files = job.result.get("files", {}) if job.result else {}
    if form not in files:
        there = f"there is {', '.join(sorted(files))}" if files else f"a job {job.kind} leaves none"
        raise NotFound(f"job {job.id} has no document in the format {form}: {there}")
    return str(files[form]["content_hash"])
