"""Webhooks and mails: signed, guarded, written with the change, delivered at least once."""

import base64
import hashlib
import hmac
import json
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select, update

from service.notifications import webhook_call
from service.notifications.guard import Blocked, is_public, target_of
from service.notifications.worker import BACKOFF_S, Postman, forget_old
from service.settings import Settings
from service.storage.tables import Delivery, Message, Webhook
from service.web.app import create_app
from tests.service.guarded import guarded_client, key
from tests.service.histories import write_history
from tests.service.receivers import NEVER, Inbox, mail_server, webhook_receiver

HOOKS = "/api/v1/webhooks"


@pytest.fixture
def inbox() -> Iterator[Inbox]:
    with webhook_receiver() as running:
        yield running


@pytest.fixture
def guarded(database_url: str, tmp_path: Path) -> Iterator[TestClient]:
    """No postman walks here: the tests turn his round themselves, so that nothing depends on time."""
    with guarded_client(database_url, tmp_path, webhook_allowed_hosts="localhost") as running:
        yield running


@pytest.fixture
def admin(guarded: TestClient) -> dict[str, str]:
    return key(guarded, "admin", "north")


def postman(client: TestClient, **changes: Any) -> Postman:
    context = client.app.state.context  # type: ignore[attr-defined]
    return Postman(context.database, context.settings.model_copy(update=changes))


def hook(client: TestClient, who: dict[str, str], url: str, **body: Any) -> dict[str, Any]:
    made = client.post(HOOKS, json={"url": url, **body}, headers=who)
    assert made.status_code == 201, made.text
    document: dict[str, Any] = made.json()
    return document


def write(client: TestClient, letters: str, **names: str) -> None:
    with client.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
        write_history(session, letters, **names)


def make_due(client: TestClient) -> None:
    with client.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
        session.execute(update(Delivery).values(due_at=datetime.now(UTC) - timedelta(seconds=1)))


class TestSignature:
    def test_a_receiver_can_verify_what_arrives(self, guarded: TestClient, admin: dict[str, str], inbox: Inbox) -> None:
        secret = hook(guarded, admin, inbox.url)["secret"]
        write(guarded, "hi")
        assert postman(guarded).turn() == 1
        path, headers, body = inbox.requests[0]
        assert path == "/hook?from=casedrain"
        signed = f"{headers['webhook-id']}.{headers['webhook-timestamp']}.".encode() + body
        expected = hmac.new(base64.b64decode(secret.removeprefix("whsec_")), signed, hashlib.sha256).digest()
        assert headers["webhook-signature"] == "v1," + base64.b64encode(expected).decode()
        document = json.loads(body)
        assert document["type"] == "alarm.raised"
        assert document["timestamp"].endswith("Z")
        assert document["data"]["pump_serial"] == "P-1"


class TestGuard:
    @pytest.mark.parametrize(
        "address",
        [
            *("127.0.0.1", "10.1.2.3", "172.16.0.1", "192.168.1.1", "169.254.169.254", "100.64.0.1", "0.0.0.0"),
            *("224.0.0.1", "240.0.0.1", "255.255.255.255", "192.0.2.1", "198.18.0.1"),
            *("::1", "::", "fe80::1", "fe80::1%eth0", "fc00::1", "ff02::1", "2001:db8::1"),
            *("::ffff:127.0.0.1", "::ffff:10.0.0.1", "64:ff9b::7f00:1", "64:ff9b::a9fe:a9fe", "2002:7f00:1::"),
        ],
    )
    def test_internal_addresses_are_not_public(self, address: str) -> None:
        assert not is_public(address)
        with pytest.raises(Blocked, match="not a public one"):
            target_of("https://hooks.example.org/x", frozenset(), lambda *_: [address])
        # one bad address among good ones is enough
        with pytest.raises(Blocked):
            target_of("https://hooks.example.org/x", frozenset(), lambda *_: ["93.184.215.14", address])

    def test_public_addresses_are_taken_as_resolved(self) -> None:
        target = target_of("https://Hooks.Example.org:8443/x?y=1", frozenset(), lambda *_: ["93.184.215.14"])
        assert target.host == "hooks.example.org"
        assert (target.port, target.path, target.address) == (8443, "/x?y=1", "93.184.215.14")
        assert is_public("2606:4700::1111")
        assert is_public("64:ff9b::5db8:d70e")

    @pytest.mark.parametrize(
        "url",
        [
            *("http://hooks.example.org/", "ftp://hooks.example.org/", "hooks.example.org", "https://", "https:///x"),
            *("https://me:secret@hooks.example.org/", "https://hooks.example.org:99999/", "https://[::1/"),
            *("https://2130706433/", "https://0x7f.1/", "https://127.1/", "https://localhost./", "https://[::1]/"),
            "https://hooks.example.org/" + "x" * 2000,
        ],
    )
    def test_what_is_no_target(self, guarded: TestClient, admin: dict[str, str], url: str) -> None:
        # "localhost." with its dot is the allowed host, so it is asked for without the allowance
        with pytest.raises(Blocked):
            target_of(url, frozenset())
        if "localhost" not in url:
            answer = guarded.post(HOOKS, json={"url": url}, headers=admin)
            assert answer.status_code == 422
            assert answer.json()["errors"][0]["where"] == "body.url"
        assert guarded.get(HOOKS, headers=admin).json()["items"] == []

    def test_the_connection_goes_to_the_address_that_was_checked(
        self, inbox: Inbox, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        asked: list[str] = []

        def resolve(host: str, port: int) -> list[str]:
            # a name that answers differently the second time must not be asked a second time
            asked.append(host)
            return ["127.0.0.1"] if len(asked) == 1 else ["127.0.0.2"]

        monkeypatch.setattr("service.notifications.guard._resolved", resolve)
        url = f"http://hooks.example.org:{inbox.port}/x"
        outcome = webhook_call.call(url, "whsec_AAAA", "msg_1", {}, frozenset({"hooks.example.org"}))
        assert outcome.delivered
        assert asked == ["hooks.example.org"]
        assert inbox.requests[0][1]["host"] == f"hooks.example.org:{inbox.port}"

    def test_a_name_that_turns_inward_later_is_not_followed(
        self, guarded: TestClient, admin: dict[str, str], inbox: Inbox, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr("service.notifications.guard._resolved", lambda *_: ["93.184.215.14"])
        made = hook(guarded, admin, "https://hooks.example.org/")
        monkeypatch.setattr("service.notifications.guard._resolved", lambda *_: ["127.0.0.1"])
        write(guarded, "hi")
        postman(guarded).turn()
        (item,) = guarded.get(f"{HOOKS}/{made['id']}/deliveries", headers=admin).json()["items"]
        assert item["status"] == "pending"
        assert "not a public one" in item["outcome"]


class TestDelivery:
    def deliveries(self, client: TestClient, who: dict[str, str], made: dict[str, Any]) -> list[dict[str, Any]]:
        items: list[dict[str, Any]] = client.get(f"{HOOKS}/{made['id']}/deliveries", headers=who).json()["items"]
        return items

    def test_only_what_was_asked_for_and_only_the_own(
        self, guarded: TestClient, admin: dict[str, str], inbox: Inbox
    ) -> None:
        hook(guarded, admin, inbox.url, events=["alarm.cleared"])
        south = hook(guarded, key(guarded, "admin", "south"), inbox.url)
        every = hook(guarded, key(guarded, "admin"), inbox.url, events=["alarm.raised"])
        write(guarded, "hi")
        write(guarded, "hihh")
        while postman(guarded).turn():
            pass
        assert sorted(json.loads(r[2])["type"] for r in inbox.requests) == ["alarm.cleared", "alarm.raised"]
        assert self.deliveries(guarded, key(guarded, "admin", "south"), south) == []
        assert len(self.deliveries(guarded, key(guarded, "admin"), every)) == 1

    def test_actions_are_told_too(self, guarded: TestClient, admin: dict[str, str], inbox: Inbox) -> None:
        made = hook(guarded, admin, inbox.url)
        write(guarded, "hi")
        (alarm,) = guarded.get("/api/v1/alarms", headers=admin).json()["items"]
        until = (datetime.now(UTC) + timedelta(days=1)).isoformat()
        url = f"/api/v1/alarms/{alarm['id']}"
        for what, body in (
            ("acknowledge", None),
            ("shelve", {"reason": "x", "until": until}),
            ("unshelve", None),
            ("close", {"reason": "x"}),
        ):
            assert guarded.post(f"{url}/{what}", json=body, headers=admin).status_code == 200
        write(guarded, "hip")
        write(guarded, "hhh")
        told = [d["event"].removeprefix("alarm.") for d in self.deliveries(guarded, admin, made)][::-1]
        assert told == [
            *("raised", "acknowledged", "shelved", "unshelved", "closed"),
            *("escalated", "reopened", "withdrawn"),
        ]

    def test_a_change_that_fails_tells_nobody(self, guarded: TestClient, admin: dict[str, str], inbox: Inbox) -> None:
        made = hook(guarded, admin, inbox.url)

        def broken() -> None:
            with guarded.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
                write_history(session, "hi")
                raise RuntimeError("halfway")

        with pytest.raises(RuntimeError, match="halfway"):
            broken()
        assert postman(guarded).turn() == 0
        assert self.deliveries(guarded, admin, made) == []

    def test_failures_are_tried_again_later_and_later(
        self, guarded: TestClient, admin: dict[str, str], inbox: Inbox
    ) -> None:
        made = hook(guarded, admin, inbox.url)
        write(guarded, "hi")
        inbox.statuses = [500, 302, 404, 204]
        pauses = []
        for _ in range(3):
            assert postman(guarded).turn() == 1
            (item,) = self.deliveries(guarded, admin, made)
            assert item["status"] == "pending"
            due, tried = (datetime.fromisoformat(item[k]) for k in ("due_at", "tried_at"))
            pauses.append((due - tried).total_seconds())
            assert postman(guarded).turn() == 0, "not before its time"
            make_due(guarded)
        for pause, planned in zip(pauses, BACKOFF_S, strict=False):
            assert planned <= pause <= 1.2 * planned + 60
        assert postman(guarded).turn() == 1
        (item,) = self.deliveries(guarded, admin, made)
        assert (item["status"], item["attempts"], item["outcome"]) == ("delivered", 4, "HTTP 204")
        assert len({r[1]["webhook-id"] for r in inbox.requests}) == 1, "a receiver can tell repetitions"
        assert len(inbox.requests) == 4, "a redirect is not followed"

    def test_it_ends_after_the_last_attempt(self, guarded: TestClient, admin: dict[str, str], inbox: Inbox) -> None:
        made = hook(guarded, admin, inbox.url)
        write(guarded, "hi")
        inbox.statuses = [500] * 50
        for _ in range(len(BACKOFF_S) + 1):
            assert postman(guarded).turn() == 1
            make_due(guarded)
        (item,) = self.deliveries(guarded, admin, made)
        assert (item["status"], item["due_at"]) == ("failed", None)
        assert postman(guarded).turn() == 0

    def test_an_answer_that_drips_in_is_given_up(
        self, guarded: TestClient, admin: dict[str, str], inbox: Inbox, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(webhook_call, "DEADLINE_S", 0.5)
        made = hook(guarded, admin, inbox.url)
        write(guarded, "hi")
        inbox.statuses = [NEVER]
        assert postman(guarded).turn() == 1
        (item,) = self.deliveries(guarded, admin, made)
        assert (item["status"], item["outcome"]) == ("pending", "no answer within 0.5 s")

    def test_gone_ends_the_webhook(self, guarded: TestClient, admin: dict[str, str], inbox: Inbox) -> None:
        hook(guarded, admin, inbox.url)
        write(guarded, "hi")
        inbox.statuses = [410]
        postman(guarded).turn()
        (item,) = guarded.get(HOOKS, headers=admin).json()["items"]
        assert "410" in item["end_reason"]
        write(guarded, "hip")
        assert postman(guarded).turn() == 0

    def test_who_dies_with_it_in_hand_leaves_it_to_be_sent_again(
        self, guarded: TestClient, admin: dict[str, str], inbox: Inbox
    ) -> None:
        made = hook(guarded, admin, inbox.url)
        write(guarded, "hi")
        assert len(postman(guarded)._claimed()) == 1  # claimed, and then nothing more is heard of it
        assert postman(guarded).turn() == 0
        make_due(guarded)  # its lease runs out
        assert postman(guarded).turn() == 1
        assert self.deliveries(guarded, admin, made)[0]["status"] == "delivered"

    def test_several_postmen_send_each_message_once(
        self, guarded: TestClient, admin: dict[str, str], inbox: Inbox
    ) -> None:
        hook(guarded, admin, inbox.url)
        for i in range(30):
            write(guarded, "hi", serial=f"P-{i}")
        with ThreadPoolExecutor(4) as pool:
            list(pool.map(lambda _: [postman(guarded).turn() for _ in range(4)], range(4)))
        ids = [r[1]["webhook-id"] for r in inbox.requests]
        assert len(ids) == len(set(ids)) == 30

    def test_old_deliveries_are_forgotten(self, guarded: TestClient, admin: dict[str, str], inbox: Inbox) -> None:
        made = hook(guarded, admin, inbox.url)
        write(guarded, "hi")
        postman(guarded).turn()
        database = guarded.app.state.context.database  # type: ignore[attr-defined]
        with database.writing() as session:
            session.execute(update(Message).values(created_at=datetime.now(UTC) - timedelta(days=31)))
        forget_old(database, datetime.now(UTC))
        assert self.deliveries(guarded, admin, made) == []
        with database.reading() as session:
            assert session.scalars(select(Message)).all() == []


class TestAdministration:
    def test_the_secret_is_shown_once(self, guarded: TestClient, admin: dict[str, str], inbox: Inbox) -> None:
        secret = hook(guarded, admin, inbox.url)["secret"]
        assert secret.startswith("whsec_")
        listed = guarded.get(HOOKS, headers=admin)
        assert secret not in listed.text
        with guarded.app.state.context.database.reading() as session:  # type: ignore[attr-defined]
            assert session.scalars(select(Webhook.operator)).one() == "north"
        audit = guarded.get("/api/v1/audit", headers=admin)
        assert [e["action"] for e in audit.json()["items"]] == ["webhook.add"]
        assert secret not in audit.text

    def test_removed_is_removed(self, guarded: TestClient, admin: dict[str, str], inbox: Inbox) -> None:
        made = hook(guarded, admin, inbox.url)
        write(guarded, "hi")
        assert guarded.delete(f"{HOOKS}/{made['id']}", headers=admin).status_code == 204
        assert guarded.delete(f"{HOOKS}/{made['id']}", headers=admin).status_code == 204
        postman(guarded).turn()
        assert inbox.requests == []
        (item,) = guarded.get(f"{HOOKS}/{made['id']}/deliveries", headers=admin).json()["items"]
        assert (item["status"], item["outcome"]) == ("failed", "the webhook was removed")

    def test_who_may(self, guarded: TestClient, admin: dict[str, str], inbox: Inbox) -> None:
        made = hook(guarded, admin, inbox.url)
        body = {"url": inbox.url}
        engineer, foreign = key(guarded, "engineer", "north"), key(guarded, "admin", "south")
        for method, path, foreign_status in (
            ("GET", HOOKS, 200),
            ("POST", HOOKS, 201),
            ("GET", f"{HOOKS}/{made['id']}/deliveries", 404),
            ("DELETE", f"{HOOKS}/{made['id']}", 404),
        ):
            sent = {"json": body} if method == "POST" else {}
            assert guarded.request(method, path, **sent).status_code == 401
            assert guarded.request(method, path, headers=engineer, **sent).status_code == 403
            assert guarded.request(method, path, headers=foreign, **sent).status_code == foreign_status
        named = guarded.post(HOOKS, json={**body, "operator": "north"}, headers=foreign)
        assert named.status_code == 403

    def test_bad_bodies(self, guarded: TestClient, admin: dict[str, str]) -> None:
        bad = guarded.post(HOOKS, json={"url": "x", "events": ["alarm.rang"], "mood": 1}, headers=admin)
        assert bad.status_code == 422
        assert {e["where"] for e in bad.json()["errors"]} == {"body.events.0", "body.mood"}
        assert guarded.post(HOOKS, json={"url": "x", "events": []}, headers=admin).status_code == 422


class TestMail:
    def make_user(self, client: TestClient, who: dict[str, str], name: str, **more: Any) -> None:
        body = {"name": name, "password": "a long enough sentence", "role": "analyst", **more}
        assert client.post("/api/v1/users", json=body, headers=who).status_code == 201

    def test_those_who_want_it_get_a_mail(self, guarded: TestClient, admin: dict[str, str]) -> None:
        self.make_user(guarded, admin, "ann", email="ann@example.org", wants_mail=True)
        self.make_user(guarded, admin, "bob", email="bob@example.org")
        south = key(guarded, "admin", "south")
        self.make_user(guarded, south, "sue", email="sue@example.org", wants_mail=True)
        write(guarded, "hi", serial="P-1\r\nBcc: evil@example.org")
        write(guarded, "hihh", serial="P-1\r\nBcc: evil@example.org")
        with mail_server() as server:
            settings = {"smtp_host": "127.0.0.1", "smtp_port": server.port, "smtp_security": "none"}
            assert postman(guarded, **settings).turn() == 1
        ((to, text),) = server.mails
        assert to == ["ann@example.org"]
        head, _, content = text.replace("\r\n ", " ").partition("\r\n\r\n")
        assert "[casedrain] pump P-1 Bcc: evil@example.org: indeterminate, alarm raised" in head
        assert "\nBcc:" not in head
        assert "priority medium" in content

    def test_a_mail_about_case_pressure_says_so_and_accuses_nobody(
        self, guarded: TestClient, admin: dict[str, str]
    ) -> None:
        self.make_user(guarded, admin, "ann", email="ann@example.org", wants_mail=True)
        write(guarded, "hH")
        with mail_server() as server:
            postman(guarded, smtp_host="127.0.0.1", smtp_port=server.port, smtp_security="none").turn()
        ((_, text),) = server.mails
        assert "pump P-1: case pressure, healthy, alarm raised" in text
        assert "Verdict: healthy (side: unknown), priority critical" in text
        assert "whatever the cause" in text

    def test_without_a_server_it_says_so(self, guarded: TestClient, admin: dict[str, str]) -> None:
        self.make_user(guarded, admin, "ann", email="ann@example.org", wants_mail=True)
        write(guarded, "hi")
        assert postman(guarded).turn() == 1
        with guarded.app.state.context.database.reading() as session:  # type: ignore[attr-defined]
            assert "CASEDRAIN_SMTP_HOST" in (session.scalars(select(Delivery.outcome)).one() or "")

    def test_a_server_that_is_away_is_tried_again(self, guarded: TestClient, admin: dict[str, str]) -> None:
        self.make_user(guarded, admin, "ann", email="ann@example.org", wants_mail=True)
        write(guarded, "hi")
        settings = {"smtp_host": "127.0.0.1", "smtp_port": 1, "smtp_security": "none"}
        postman(guarded, **settings).turn()
        with guarded.app.state.context.database.reading() as session:  # type: ignore[attr-defined]
            row = session.scalars(select(Delivery)).one()
        assert (row.status, row.outcome) == ("pending", "no delivery: ConnectionRefusedError")


@pytest.mark.study
def test_the_postman_works_by_itself(database_url: str, tmp_path: Path, inbox: Inbox) -> None:
    settings = Settings(database_url=database_url, data_dir=tmp_path, auth="on", webhook_allowed_hosts="localhost")
    with TestClient(create_app(settings), base_url="http://localhost") as client:
        hook(client, key(client, "admin"), inbox.url)
        write(client, "hi")
        assert inbox.arrived.wait(60)
