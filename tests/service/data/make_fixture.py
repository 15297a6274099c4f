"""Make a database of one release, with what that release answers, for the test that the next release replays.

Run it with the code of the release that is kept, from a checkout of its commit (see README.md beside this file)::

    python make_fixture.py release-0.1.0/history.tar.xz casedrain serve

It starts the service with the command, enters a history through the HTTP API, asks for every record, pump, alarm and
threshold, and packs database, raw files and answers.
"""

import json
import os
import socket
import sqlite3
import subprocess
import sys
import tarfile
import tempfile
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx2

from service.demo.fleet import PUMPS, DemoRecord, pump_records
from tests.service.bursts import burst_document

SEED = 1
N_FLIGHTS = {"DT-101": 16, "DT-102": 24, "DT-104": 20, "DT-105": 18, "DT-107": 24, "DT-108": 18}
"""Flights of the pumps: healthy, worn, leaking circuit, setting, clogged drain, moved sensor."""
LATE, WRONG, WITHDRAWN = ("DT-101", 9), ("DT-102", 6), ("DT-104", 8)
"""Serial and flight: sent last; first sent with another file's pressures, then superseded; withdrawn."""
DECIMALS = {"discharge_pressure_bar": 2, "case_pressure_bar": 3, "reservoir_pressure_bar": 3}
"""Digits of a recorder a little coarser than the demo's, for a file half the size; others have 2."""
JSON, CSV = {"content-type": "application/json"}, {"content-type": "text/csv"}


def coarser(content: bytes) -> bytes:
    """The same record with fewer digits."""
    lines = content.decode().splitlines()
    head = next(i for i, line in enumerate(lines) if not line.startswith("#"))
    digits = [DECIMALS.get(name, 2) for name in lines[head].split(",")]
    rows = (line.split(",") for line in lines[head + 1 :])
    numbers = (",".join(v and f"{round(float(v), d) + 0.0:.10g}" for v, d in zip(r, digits, strict=True)) for r in rows)
    return ("\n".join([*lines[: head + 1], *numbers]) + "\n").encode()


def burst(record: DemoRecord) -> bytes:
    """A fast record of the same flight."""
    document = burst_document(n=4000)
    channels = {k: [round(x, 4 if k == "time_s" else 2) for x in v] for k, v in document["channels"].items()}
    place = {"pump_serial": record.pump.serial, "aircraft": record.pump.aircraft, "position": record.pump.position}
    at = {"flight_id": record.flight_id, "started_at": f"{record.started_at:%Y-%m-%dT%H:%M:%SZ}"}
    return json.dumps({**document, **place, **at, "channels": channels}).encode()


def enter(api: httpx2.Client) -> None:
    """Everything that happens to the fleet, through the API."""
    pumps = {p.serial: p for p in PUMPS if p.serial in N_FLIGHTS}
    flights = {s: list(pump_records(pumps[s], n, SEED)) for s, n in N_FLIGHTS.items()}
    order = sorted(
        ((s, i) for s, n in N_FLIGHTS.items() for i in range(n)), key=lambda x: flights[x[0]][x[1]].started_at
    )
    ids = {}
    for serial, i in [*(o for o in order if o != LATE), LATE]:
        content = coarser(flights[serial][i].content)
        if (serial, i) == WRONG:
            metadata = [line for line in content.splitlines() if line.startswith(b"#")]
            other = coarser(flights["DT-108"][i].content).splitlines()[len(metadata) :]
            wrong = sent(api, "POST", "/records", content=b"\n".join([*metadata, *other]), headers=CSV)
            found = sent(api, "POST", f"/records?supersedes={wrong['record_id']}", content=content, headers=CSV)
        else:
            found = sent(api, "POST", "/records", content=content, headers=CSV)
        ids[serial, i] = found["record_id"]
    sent(api, "DELETE", f"/records/{ids[WITHDRAWN]}?reason=wrong aircraft")
    sent(api, "POST", "/records", content=burst(flights["DT-101"][5]), headers=JSON)
    at = flights["DT-101"][12].started_at
    event = {"at": f"{at:%Y-%m-%dT00:00:00Z}", "action": "sensor_replaced", "note": "case pressure sensor"}
    sent(api, "POST", "/pumps/DT-101/maintenance", json=event)
    wish = {"values": {"case_flow_limit_lpm": 1.4, "alarm_records": 2}, "reason": "earlier warning"}
    sent(api, "PUT", "/thresholds/pump-type/h225", json=wish, headers={"if-match": "*"})
    while not all(sent(api, "GET", f"/pumps/{s}/verdict")["threshold_version"] for s in N_FLIGHTS):
        time.sleep(0.5)  # the pumps are folded anew after the answer
    for alarm in sent(api, "GET", "/alarms?state=open")["items"]:
        if alarm["pump_serial"] == "DT-102":
            sent(api, "POST", f"/alarms/{alarm['id']}/acknowledge", json={"reason": "ordered a pump"})


def answers(api: httpx2.Client) -> dict[str, Any]:
    """What the release says of everything."""
    found: dict[str, Any] = {"records": {}, "pumps": {}}
    for item in paged(api, "/records"):
        found["records"][item["record_id"]] = sent(api, "GET", f"/records/{item['record_id']}")
    for serial in N_FLIGHTS:
        lists = ("verdicts", "verdicts/revisions", "maintenance", "installations")
        found["pumps"][serial] = {"verdict": sent(api, "GET", f"/pumps/{serial}/verdict")} | {
            name: sent(api, "GET", f"/pumps/{serial}/{name}")["items"] for name in lists
        }
    found["alarms"] = [sent(api, "GET", f"/alarms/{a['id']}") for a in paged(api, "/alarms")]
    found["thresholds"] = sent(api, "GET", "/thresholds/pump-type/h225/versions")
    return found


def sent(api: httpx2.Client, method: str, path: str, **request: Any) -> dict[str, Any]:
    answer = api.request(method, "/api/v1" + path, **request)
    if answer.status_code >= 300:
        raise SystemExit(f"{method} {path}: {answer.status_code} {answer.text}")
    document: dict[str, Any] = answer.json()
    return document


def paged(api: httpx2.Client, path: str) -> list[dict[str, Any]]:
    items: list[dict[str, Any]] = []
    cursor: str | None = ""
    while cursor is not None:
        page = sent(api, "GET", path, params={"cursor": cursor} if cursor else {})
        items += page["items"]
        cursor = page["next"]
    return items


def main(target: Path, command: list[str]) -> None:
    """Serve, enter, ask, pack."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        environment = {**os.environ, "CASEDRAIN_DATA_DIR": str(folder / "data")}
        server = subprocess.Popen([*command, "--port", str(port)], env=environment)
        try:
            with httpx2.Client(base_url=f"http://127.0.0.1:{port}", timeout=300.0) as api:
                while True:
                    try:
                        if api.get("/readyz").status_code == httpx2.codes.OK:
                            break
                    except httpx2.TransportError:
                        time.sleep(0.5)
                enter(api)
                (folder / "data" / "answers.json").write_text(json.dumps(answers(api)))
        finally:
            server.terminate()
            server.wait(timeout=60)
        with closing(sqlite3.connect(folder / "data" / "casedrain.sqlite", isolation_level=None)) as database:
            # a snapshot is a tenth of a megabyte and of no use to other code; one is left, to be passed over
            database.execute("DELETE FROM fold_snapshots WHERE id > (SELECT min(id) FROM fold_snapshots)")
            database.execute("VACUUM")
        target.parent.mkdir(parents=True, exist_ok=True)
        with tarfile.open(target, "w:xz", preset=9) as packed:
            for part in ("answers.json", "casedrain.sqlite", "raw"):
                packed.add(folder / "data" / part, part)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
