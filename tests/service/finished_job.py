"""Waiting for a job to end."""

import time
from typing import Any

from fastapi.testclient import TestClient

API = "/api/v1"


def finished(client: TestClient, job_id: str) -> dict[str, Any]:
    """The job as it is once it has ended."""
    for _ in range(600):
        job: dict[str, Any] = client.get(f"{API}/jobs/{job_id}").json()
        if job["status"] in ("succeeded", "failed", "cancelled"):
            return job
        time.sleep(0.1)
    raise AssertionError(f"the job has not ended: {job}")
