"""Pages of keys, users, webhooks, audit, jobs and the registry: what their forms do, checked over the API."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from tests.service.finished_job import finished
from tests.service.guarded import guarded_client, key
from tests.service.histories import write_history
from tests.service.records import body
from tests.service.test_page_forms import come_in
from tests.service.test_sign_in import sign_in

API = "/api/v1"
Post = Callable[..., tuple[int, str]]
ORIGIN = {"origin": "http://localhost"}


@pytest.fixture
def guarded(database_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[TestClient]:
    monkeypatch.setattr("service.notifications.guard._resolved", lambda *_: ["93.184.215.14"])
    with guarded_client(database_url, tmp_path) as running:
        with running.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
            write_history(session, "hhi")
        yield running


def poster(client: TestClient, token: str) -> Post:
    def post(path: str, **fields: str | list[str]) -> tuple[int, str]:
        names = {name.rstrip("_"): value for name, value in fields.items()}
        answer = client.post(path, data={"csrf_token": token, **names}, follow_redirects=False)
        return answer.status_code, answer.headers.get("location", answer.text)

    return post


def faults(page: str) -> list[str]:
    return re.findall(r"<li><strong>([^<]+)</strong>", page)


def test_keys_are_made_shown_once_and_revoked(guarded: TestClient) -> None:
    post = poster(guarded, come_in(guarded, "ada", "admin", "north"))
    status, page = post("/keys", owner="", role="king", colour="red")
    assert (status, faults(page)) == (422, ["owner", "role", "colour"])
    assert post("/keys", owner="office", role="viewer", operator="south")[0] == 403
    status, page = post("/keys", owner="of<f>ice", role="viewer", expires_at="2199-01-01T00:00")
    assert status == 200
    (secret,) = re.findall(r'<code class="secret">(cd_[^<]+)</code>', page)
    assert "of&lt;f&gt;ice" in page
    headers = {"Authorization": f"Bearer {secret}"}
    assert guarded.get(f"{API}/pumps", headers=headers).json()["items"][0]["operator"] == "north"
    page = guarded.get("/keys").text
    assert secret not in page
    revoke = re.findall(r'of&lt;f&gt;ice.*?action="(/keys/\w+/revoke)"', page, re.DOTALL)[0]
    assert guarded.post(revoke, data={"csrf_token": "guess"}).status_code == 403
    assert post(revoke) == (303, "/keys")
    assert guarded.get(f"{API}/pumps", headers=headers).status_code == 401


def test_users_are_made_changed_and_signed_out(guarded: TestClient) -> None:
    token = come_in(guarded, "ada", "admin", "north")
    post = poster(guarded, token)
    headers = key(guarded, "admin", "north")
    secret = " a sentence with blanks "
    status, page = post("/users", name="bob", password="short", role="viewer", wants_mail="yes")
    assert status == 422
    assert {"password", "wants_mail"} <= {f.removeprefix("body.") for f in faults(page)}
    assert post("/users", name="bob", password=secret, role="viewer") == (303, "/users")

    def bob() -> dict[str, object]:
        users = guarded.get(f"{API}/users", headers=headers).json()["items"]
        return next(u for u in users if u["name"] == "bob")

    assert bob()["operator"] == "north"
    assert post("/users/bob", role="analyst", email="bob@north.example", wants_mail="yes") == (303, "/users")
    assert (bob()["role"], bob()["email"], bob()["wants_mail"], bob()["disabled_at"]) == (
        "analyst", "bob@north.example", True, None,
    )  # fmt: skip
    (change, *_) = guarded.get(f"{API}/audit?action=user.change", headers=headers).json()["items"]
    assert change["details"]["changed"] == ["email", "role", "wants_mail"]
    assert post("/users/bob", role="analyst", email="bob@north.example", wants_mail="yes") == (303, "/users")
    assert len(guarded.get(f"{API}/audit?action=user.change", headers=headers).json()["items"]) == 1
    assert post("/users/bob", role="analyst", disabled="yes") == (303, "/users")
    assert bob()["disabled_at"] is not None
    assert post("/users/bob/sign-out") == (303, "/users")
    assert post("/users/nobody", role="viewer")[0] == 404
    assert post("/users/bob", role="analyst") == (303, "/users")
    assert sign_in(guarded, name="bob", password=secret).status_code == 303


def test_webhooks_are_added_with_a_secret_shown_once_and_removed(guarded: TestClient) -> None:
    post = poster(guarded, come_in(guarded, "ada", "admin", "north"))
    status, page = post("/webhooks", url="ftp://hooks.test")
    assert (status, faults(page)) == (422, ["events"])
    assert post("/webhooks", url="ftp://hooks.test", events="alarm.raised")[0] == 422
    status, page = post("/webhooks", url="https://hooks.test/x", events=["alarm.raised", "alarm.closed"])
    assert status == 200
    (secret,) = re.findall(r'<code class="secret">(whsec_[^<]+)</code>', page)
    page = guarded.get("/webhooks").text
    assert secret not in page
    assert "alarm.raised, alarm.closed" in page
    (hook,) = re.findall(r'action="/webhooks/(\w+)/remove"', page)
    assert "None so far" in guarded.get(f"/webhooks?deliveries={hook}").text
    assert guarded.get("/webhooks?deliveries=none").status_code == 404
    assert post(f"/webhooks/{hook}/remove") == (303, "/webhooks")
    assert "removed by ada" in guarded.get("/webhooks").text
    page = guarded.get("/audit?action=webhook&actor=ada").text
    assert page.count("<code>webhook.") == 2
    assert "Nothing here" in guarded.get("/audit?actor=nobody").text
    assert guarded.get("/audit?from=spring").status_code == 422


def test_the_registry_is_entered_by_hand(guarded: TestClient) -> None:
    post = poster(guarded, come_in(guarded, "eve", "engineer", "north"))
    headers = key(guarded, "viewer", "north")
    status, page = post("/registry/aircraft", aircraft="", circuit="open", fluid="olive oil")
    assert (status, faults(page)) == (422, ["aircraft"])
    link = "/registry?name=F-2&operator=north"
    assert post("/registry/aircraft", aircraft="F-2", circuit="separate_drain") == (303, link)
    assert post("/registry/aircraft", aircraft="F-2")[0] == 409
    sensor = {"channel": "case_pressure_bar", "identity": "SN 1", "full_scale_bar": "5", "since": "2026-01-01T00:00"}
    assert post("/registry/aircraft/F-2/sensors", operator="north", **sensor) == (303, link)
    assert post("/registry/aircraft/F-2/sensors", operator="north", **{**sensor, "identity": "SN 2"})[0] == 422
    assert post("/registry/aircraft/F-2", operator="north", circuit="separate_drain", aircraft_type="H225") == (
        303,
        link,
    )
    found = guarded.get(f"{API}/aircraft/F-2", headers=headers).json()
    assert (found["circuit"], found["aircraft_type"], [s["identity"] for s in found["sensors"]]) == (
        "separate_drain", "H225", ["SN 1"],
    )  # fmt: skip
    assert "SN 1" in guarded.get(link).text
    pump = "/registry?pump=P-9&operator=north"
    assert post("/registry/pumps", serial="P-9", pump_type="h225") == (303, pump)
    assert post("/registry/pumps", serial="P-9", pump_type="none")[0] == 422
    entries = "/registry/pumps/P-9/installations"
    status, page = post(entries, operator="north", aircraft="F-2", position="LH", from_="soon")
    assert (status, faults(page)) == (422, ["from"])
    entry = {"operator": "north", "aircraft": "F-2", "position": "LH", "from_": "2026-01-05T10:00"}
    assert post(entries, **entry) == (303, pump)
    (place,) = guarded.get(f"{API}/pumps/P-9/installations", headers=headers).json()["items"]
    assert (place["from"], place["to"], place["author"]) == ("2026-01-05T10:00:00Z", None, "eve")
    assert post(f"{entries}/{place['id']}", operator="north", to="2026-02-05T10:00") == (303, pump)
    assert "05 Feb 2026 10:00 UTC" in guarded.get(pump).text
    assert post(f"{entries}/{place['id']}", operator="north", withdraw="yes") == (303, pump)
    assert guarded.get(f"{API}/pumps/P-9/installations", headers=headers).json()["items"] == []
    event = {"at": "2026-02-01T10:00", "action": "filter_changed", "back": "registry"}
    assert post("/pumps/P-9/maintenance?operator=north", **event) == (303, f"{pump}#maintenance")
    page = guarded.get(pump).text
    (withdraw,) = re.findall(r'action="(/registry/pumps/P-9/maintenance/\w+/withdraw)"', page)
    assert post(withdraw, operator="north") == (303, pump)
    finding = {"at": "2026-02-01T10:00", "found": "no_fault_found", "back": "registry"}
    assert post("/pumps/P-9/findings?operator=north", **finding) == (303, f"{pump}#findings")
    (withdraw,) = re.findall(r'action="(/registry/pumps/P-9/findings/\w+/withdraw)"', guarded.get(pump).text)
    assert post(withdraw, operator="north") == (303, pump)
    assert "Nothing entered" in guarded.get(pump).text
    assert post("/registry/pumps/P-9", operator="north", pump_type="h225_thesis") == (303, pump)
    page = guarded.get("/registry").text
    assert {"P-1", "P-9", "F-2"} <= set(re.findall(r'<th scope="row"><a href="[^"]+">([^<]+)</a>', page))
    post = poster(guarded, come_in(guarded, "sue", "engineer", "south"))
    assert post("/registry/pumps/P-9", operator="north", pump_type="h225")[0] == 404
    assert post("/registry/pumps/P-9", pump_type="h225")[0] == 404
    assert guarded.get(pump).status_code == 404
    post = poster(guarded, come_in(guarded, "vic", "viewer", "north"))
    assert post(entries, **entry)[0] == 403
    assert "Enter an installation" not in guarded.get(pump).text


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_a_report_is_asked_for_watched_and_shown(client: TestClient) -> None:
    client.post(f"{API}/records", content=body(), headers={"content-type": "application/json"})
    wrong = client.post("/jobs", data={"kind": "report", "since": "soon", "colour": "red"}, headers=ORIGIN)
    assert wrong.status_code == 422
    assert "colour" in wrong.text
    asked = client.post("/jobs", data={"kind": "report", "pump": "P-1"}, headers=ORIGIN, follow_redirects=False)
    link = asked.headers["location"]
    job_id = link.removeprefix("/reports/")
    assert finished(client, job_id)["status"] == "succeeded"
    page = client.get(link)
    assert page.text == client.get(f"{API}/jobs/{job_id}/result").text
    assert "default-src 'none'" in page.headers["content-security-policy"]
    shown = client.get(f"/jobs/{job_id}").text
    assert f'href="{link}"' in shown
    assert "P-1" in shown
    dry = {"kind": "reprocess", "pump": "P-1", "dry_run": "yes", "only": "verdicts"}
    job = client.post("/jobs", data=dry, headers=ORIGIN, follow_redirects=False).headers["location"]
    found = finished(client, job.removeprefix("/jobs/"))
    assert found["parameters"]["dry_run"] is True
    assert "unchanged" in client.get(job).text
    assert client.post(f"{job}/cancel", headers=ORIGIN).status_code == 409
    listed = client.get("/jobs?kind=report").text
    assert job_id in listed
    assert job not in listed
    assert "left no document" in client.get(job.replace("/jobs/", "/reports/")).text
    assert client.get("/reports/none").status_code == 404
