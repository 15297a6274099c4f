"""An operator moves: its export is taken in elsewhere, on the other kind of database, beside another operator."""

import json
import shutil
import threading
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from service.keeping.check import check_installation
from service.keeping.installation import installation
from service.keeping.operator_import import import_operator
from service.monitoring.renewal import Renewal
from service.settings import Settings
from tests.service.lent_application import lent
from tests.service.records import document

API = "/api/v1"


def test_an_operator_moves_with_its_history(
    database_url: str, new_database: Callable[[str], str], tmp_path: Path
) -> None:
    place = tmp_path / "north.zip"
    with lent(Settings(database_url=database_url, data_dir=tmp_path / "here")) as client:
        for n, operator in enumerate(("south", "north", "north")):
            sent = document() | {"pump_serial": "P-1", "operator": operator, "flight_id": f"F{n}"}
            sent |= {"started_at": f"2026-05-0{n + 1}T07:11:00Z"}
            answer = client.post(f"{API}/records", json=sent)
            assert answer.status_code == 201, answer.text
        event = {"at": "2026-05-02T12:00:00Z", "action": "filter_changed"}
        assert client.post(f"{API}/pumps/P-1/maintenance?operator=north", json=event).status_code == 201
        put = {"values": {"alarm_records": 4}, "reason": "x"}
        layer = f"{API}/thresholds/pump/P-1?operator=north"
        assert client.put(layer, json=put, headers={"If-Match": "*"}).status_code == 200
        verdict = client.get(f"{API}/pumps/P-1/verdict?operator=north").json()
        place.write_bytes(client.get(f"{API}/operators/north/export").content)

    other = new_database("postgres" if database_url.startswith("sqlite") else "sqlite")
    there = Settings(database_url=other, data_dir=tmp_path / "there")
    with lent(there) as client:
        # somebody is there already, with numbers of his own
        sent = document() | {"pump_serial": "P-1", "operator": "west"}
        assert client.post(f"{API}/records", json=sent).status_code == 201
        context = client.app.state.context  # type: ignore[attr-defined]
        revision = context.database.revision()
        done = import_operator(context.database, context.raw_store, place, revision)
        assert (done["operator"], done["rows"]["records"], done["raw_files"]) == ("north", 2, 2)
        with pytest.raises(ValueError, match=r"operator north has .* here already"):
            import_operator(context.database, context.raw_store, place, revision)
        Renewal(context.database, context.archive).run(threading.Event())
        moved = client.get(f"{API}/pumps/P-1/verdict?operator=north").json()
        for changing in ("threshold_version", "software"):
            verdict.pop(changing)
            moved.pop(changing)
        assert moved == verdict
        entries = client.get(f"{API}/pumps/P-1/maintenance?operator=north").json()["items"]
        assert [e["action"] for e in entries] == ["filter_changed"]
        log = client.get(f"{API}/audit?operator=north").json()["items"]
        assert [e["action"] for e in log] == ["operator.import"]
        # numbers go on behind those that were given
        more = document() | {"pump_serial": "P-2", "operator": "north", "flight_id": "F9"}
        assert client.post(f"{API}/records", json=more).status_code == 201
        assert client.post(f"{API}/pumps/P-1/maintenance?operator=north", json=event).status_code == 201
    with installation(there) as kept:
        assert check_installation(kept).faults == []


def test_what_is_no_whole_export_is_refused(tmp_path: Path, migrated_sqlite: Path) -> None:
    (tmp_path / "data").mkdir()
    shutil.copyfile(migrated_sqlite, tmp_path / "data" / "casedrain.sqlite")
    with lent(Settings(data_dir=tmp_path / "data")) as client:
        assert client.post(f"{API}/records", json=document()).status_code == 201
        context = client.app.state.context  # type: ignore[attr-defined]
        good = client.get(f"{API}/operators/default/export").content
        (tmp_path / "good.zip").write_bytes(good)
        folder = tmp_path / "export"
        zipfile.ZipFile(tmp_path / "good.zip").extractall(folder)
        revision = context.database.revision()

        def refused(why: str, at: str = revision) -> None:
            with pytest.raises(ValueError, match=why):
                import_operator(context.database, context.raw_store, folder, at)

        refused("this installation is at 0001: export it", "0001")
        (raw,) = (folder / "raw").iterdir()
        content = raw.read_bytes()
        raw.write_bytes(content[:-1])
        refused("raw/.* is damaged")
        raw.write_bytes(content)
        pumps = folder / "tables" / "pumps.jsonl"
        pumps.write_text(pumps.read_text().replace("P-1", "P-3"))
        refused("tables/pumps.jsonl is damaged")
        manifest = json.loads((folder / "manifest.json").read_text())
        (folder / "manifest.json").write_text(json.dumps({**manifest, "format": "x"}))
        refused("the export is 'x'")
        (folder / "manifest.json").unlink()
        refused("no export of an operator")
