"""Requests that are wrong in any place: no answer is a mistake of ours, and every status is one that the document has.

The long run is `python -m benchmarks.wrong_requests`.
"""

import asyncio
from itertools import islice
from pathlib import Path
from unittest import mock

import pytest

from service.web.api_document.document import openapi_document
from tests.service.guarded import guarded_client, key
from tests.service.matrix import seeded
from tests.service.mutations import Mutations, Referee, answered

N_CASES = 250


@pytest.mark.postgres_in_study
def test_wrong_requests_are_refused_as_the_document_says(
    database_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("service.notifications.guard._resolved", lambda *_: ["93.184.215.14"])
    with guarded_client(database_url, tmp_path) as client, mock.patch("service.jobs.engine.submit"):
        names = seeded(client, "north", "P-1")
        document = openapi_document(client.app)  # type: ignore[arg-type]
        keys = [key(client, "admin", operator)["Authorization"].encode() for operator in (None, "north")]
        referee, faults = Referee(document), []

        async def asked() -> None:
            for case in islice(Mutations(20261130, names, keys, document), N_CASES):
                fault = referee.fault(case, await asyncio.wait_for(answered(client.app, case), 20.0))
                if fault is not None:
                    faults.append((fault, case))

        assert client.portal is not None
        client.portal.call(asked)
    assert faults == []
