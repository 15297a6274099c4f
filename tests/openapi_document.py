"""Writes docs/openapi.json; with ``--examples`` the answers in it are recorded anew from a history that the service has folded."""

import json
import sys
import tempfile
from pathlib import Path
from typing import Any
from unittest import mock

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from fastapi.testclient import TestClient

from service.demo.fleet import PUMPS, pump_records
from service.settings import Settings
from service.web.answer_route import Checking
from service.web.api_document.document import openapi_document
from service.web.app import create_app
from tests.service import lent_application
from tests.service.bursts import burst_document
from tests.service.guarded import guarded_client, key
from tests.service.matrix import API, ENDING, MARK, MATRIX, OPEN, PAGE, entered, sent

ROOT = Path(__file__).resolve().parent.parent
DOCUMENT = ROOT / "docs" / "openapi.json"
EXAMPLES = ROOT / "service" / "web" / "api_document" / "examples.json"
MOST_ITEMS = 2
_LAST = ("close", "DELETE")


def document_text() -> str:
    """The document as it is committed."""
    document = openapi_document(create_app(Settings(auth="on")))
    return json.dumps(document, indent=1, ensure_ascii=False, sort_keys=True) + "\n"


def recorded() -> dict[str, Any]:
    """A good answer of every call that answers in JSON, from a worn pump of the demo."""
    worn = next(p for p in PUMPS if "worn" in p.truth.words)
    Checking.is_on = True
    found = {}
    with (
        tempfile.TemporaryDirectory() as folder,
        mock.patch("service.notifications.guard._resolved", return_value=["93.184.215.14"]),
        mock.patch("service.jobs.engine.start"),
        mock.patch("service.jobs.engine.stop"),
        guarded_client(f"sqlite:///{folder}/examples.sqlite", Path(folder)) as client,
    ):
        admin = key(client, "admin", "north", owner="head of north")
        names = _flown(client, worn, admin) | _administered(client, admin, worn.serial)
        # what ends things comes last, and a part before the whole
        for method, path in sorted(MATRIX, key=lambda r: (r == ENDING, _ends(r), -r[1].count("/") * _ends(r), r)):
            entry = MATRIX[method, path]
            # what a job leaves is a document of its kind, no answer of the API
            if path.endswith("/result"):
                continue
            if entry.refused or entry.role == PAGE or (entry.role == OPEN and path not in ("/healthz", "/readyz")):
                continue
            answer = sent(client, method, entry, names, **admin)
            if answer.status_code >= 300:
                raise RuntimeError(f"{method} {path}: {answer.status_code} {answer.text}")
            if (
                answer.content
                and answer.headers["content-type"].startswith("application/json")
                and not path.endswith("/raw")
            ):
                found[f"{method} {path}"] = _shortened(answer.json())
    return found


def _ends(route: tuple[str, str]) -> bool:
    return any(word in (*route[1].split("/"), route[0]) for word in _LAST)


def _flown(client: TestClient, worn: Any, admin: dict[str, str]) -> dict[str, str]:
    """A history of flights as the service itself has folded it, and what was entered beside it."""
    for record in pump_records(worn, 24, seed=1):
        headers = {"content-type": "text/csv", **admin}
        answer = client.post(f"{API}/records", content=record.content, headers=headers)
        if answer.status_code != 201:
            raise RuntimeError(answer.text)
    entries = entered(client, admin, worn.serial, "F-HCAZ")
    marks = f"{API}/records/{answer.json()['record_id']}/marks"
    entries["mark"] = client.post(marks, json=MARK, headers=admin).json()["id"]
    alarms = client.get(f"{API}/alarms", params={"pump": worn.serial}, headers=admin).json()["items"]
    burst = client.post(f"{API}/records", json=burst_document(), headers=admin).json()["record_id"]
    return {
        "operator": "north",
        "aircraft": worn.aircraft,
        "burst": burst,
        "pump": worn.serial,
        "record": answer.json()["record_id"],
        "alarm": alarms[0]["id"],
        **entries,
    }


def _administered(client: TestClient, admin: dict[str, str], serial: str) -> dict[str, str]:
    """What an admin and an engineer of the operator have set up: names for the requests."""

    def made(path: str, body: dict[str, Any]) -> dict[str, Any]:
        answer = client.post(f"{API}{path}", json=body, headers=admin)
        if answer.status_code >= 300:
            raise RuntimeError(f"{path}: {answer.text}")
        found: dict[str, Any] = answer.json()
        return found

    put = {"values": {"alarm_records": 4}, "reason": "fewer flights are enough for us"}
    layer = client.put(f"{API}/thresholds/operator/north", json=put, headers={**admin, "If-Match": "*"}).json()
    channels = [{"source": "HYD1_P", "channel": "discharge_pressure_bar", "unit": "psi"}]
    account = {"name": "m.keller", "password": "a long enough sentence", "role": "viewer"}
    return {
        "webhook": made("/webhooks", {"url": "https://hooks.example.org/casedrain"})["id"],
        "key": made("/keys", {"owner": "hangar office", "role": "viewer"})["id"],
        "user": made("/users", account)["name"],
        "mapping": made("/mappings", {"name": "computer-export", "channels": channels})["name"],
        "job": made("/jobs", {"kind": "reprocess", "parameters": {"pump": serial, "dry_run": True}})["id"],
        "version": str(layer["version"]),
    }


def _shortened(value: Any) -> Any:
    """An answer with its lists cut to what a reader needs."""
    if isinstance(value, dict):
        secrets = {"key": "cd_…", "secret": "whsec_…"}
        return {
            k: secrets[k] if k in secrets and str(v).startswith(secrets[k][:3]) else _shortened(v)
            for k, v in value.items()
        }
    if isinstance(value, list):
        return [_shortened(v) for v in value[:MOST_ITEMS]]
    return round(value, 6) if isinstance(value, float) else value


def main() -> int:
    """Write what was asked for."""
    if "--examples" in sys.argv[1:]:
        try:
            EXAMPLES.write_text(json.dumps(recorded(), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        finally:
            lent_application.close()  # its thread would keep the process
    DOCUMENT.write_text(document_text(), encoding="utf-8")
    print(f"wrote {DOCUMENT.relative_to(ROOT)}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
