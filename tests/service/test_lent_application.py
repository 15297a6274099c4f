"""What tests share hides nothing: an application that is lent again knows nothing of the test before."""

from collections.abc import Callable

from service.jobs import state
from service.settings import Settings
from service.storage.tables import Base, Job
from tests.service.finished_job import finished
from tests.service.lent_application import lent
from tests.service.records import body

API = "/api/v1"
JSON = {"content-type": "application/json"}


def test_the_next_one_starts_from_nothing(new_settings: Callable[..., Settings]) -> None:
    for auth in ("off", "on", "off"):
        settings = new_settings("sqlite", auth)
        with lent(settings) as client:
            assert client.app.state.context.settings is settings  # type: ignore[attr-defined]
            database = client.app.state.context.database  # type: ignore[attr-defined]
            with database.reading() as session:
                held = {t.name for t in Base.metadata.sorted_tables if session.execute(t.select()).first()}
                # every installation has a key for its cursors and the head of an empty log
                assert held <= {"audit_heads", "installation_values"}
            answer = client.post(f"{API}/records", content=body(), headers=JSON)
            assert answer.status_code == (401 if auth == "on" else 201)
            client.cookies.set("left", "behind")
        with lent(new_settings("sqlite")) as client:
            assert not client.cookies


def test_two_at_once_are_two(new_settings: Callable[..., Settings]) -> None:
    with lent(new_settings("sqlite")) as outer, lent(new_settings("sqlite")) as inner:
        assert outer.app is not inner.app
        assert inner.post(f"{API}/records", content=body(), headers=JSON).status_code == 201
        assert outer.get(f"{API}/records").json()["items"] == []
        assert len(inner.get(f"{API}/records").json()["items"]) == 1


def test_jobs_run_on_the_database_of_their_test(new_settings: Callable[..., Settings]) -> None:
    for _ in range(2):
        with lent(new_settings("sqlite")) as client:
            assert state.running is None
            client.post(f"{API}/records", content=body(), headers=JSON)
            job = client.post(f"{API}/jobs", json={"kind": "reprocess", "parameters": {"dry_run": True}}).json()["id"]
            assert finished(client, job)["status"] == "succeeded"
            with client.app.state.context.database.reading() as session:  # type: ignore[attr-defined]
                assert session.query(Job).count() == 1
    assert state.running is None
