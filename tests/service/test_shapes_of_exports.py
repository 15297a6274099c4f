"""Ten shapes of real exports become the flight that they are by a mapping alone; what is proposed for them is right."""

import io
import zipfile
from contextlib import suppress
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient

from service.answers.mappings import MappingSuggestion
from service.errors import Problem
from service.ingest.decode import DecodedRecord, decode
from service.ingest.file_names import named_by
from service.ingest.mapping import ChannelMapping
from service.ingest.mapping_files import MappingFile, mapping_of_file
from service.ingest.parse import parsed
from service.ingest.suggesting import proposed
from service.ingest.upload_files import content_type_of
from tests.service.exports import EXPORTS, FOLDER, LIMITS, START, truth
from tests.service.finished_job import finished

API = "/api/v1"
# what rounding and units leave: half of the last digit that each file writes
NEAR = {
    "discharge_pressure_bar": 0.006,
    "case_pressure_bar": 1e-4,
    "shaft_speed_rpm": 0.5,
    "fluid_temperature_degc": 0.06,
    "reservoir_pressure_bar": 1e-4,
}
RIG, COARSE, BENCH = "rig-without-speed.csv", "coarse-clock.csv", "computed.csv"
CHANNELS = {  # which column of each file is which channel, for who has not the mapping
    "engine-logger.csv": ("HYD1 P", "HYD1 C", "HYD1 N", "HYD1 T", "HYD1 R"),
    "data-logger.csv": (
        "Pump outlet pressure",
        "Case drain pressure",
        "Shaft speed",
        "Oil temperature",
        "Tank pressure",
    ),
    "flight-test-structs.mat": ("PHYD1", "PCASE", "NHYD1", "THYD1", "PTANK"),
    "acquisition.tdms": ("Discharge", "Case", "Speed", "Temperature", "Reservoir"),
    "space-separated.csv": ("2", "3", "4", "5", None),
    "german.csv": (
        "Systemdruck [bar]",
        "Gehäusedruck [bar]",
        "Drehzahl [1/min]",
        "Öltemperatur [°C]",
        "Behälterdruck [bar]",
    ),
    "F-HCAA_SN-0412_317_20260317-0949.csv": (
        *("System pressure (mbar)", "Case pressure (bar)", "Pump speed (rpm)", "Fluid temp (degC)"),
        "Reservoir pressure (bar)",
    ),
    "coarse-clock.csv": ("P discharge", "P case", "N pump", "T fluid", "P reservoir"),
}


def mapping_for(name: str) -> MappingFile:
    stem = "spreadsheet" if name.startswith("F-HCAA") else name.partition(".")[0]
    return mapping_of_file(FOLDER / f"{stem}.mapping.json")


def decoded(name: str) -> DecodedRecord:
    path, mapping = FOLDER / name, mapping_for(name).mapping
    named = named_by(mapping.name_pattern, name, {})
    return decode(path.read_bytes(), content_type_of(path), "", named, LIMITS, mapping=mapping)


def suggested(path: Path) -> MappingSuggestion:
    content, kind = path.read_bytes(), content_type_of(path)
    return proposed(path, kind, "", lambda dialect: parsed(content, kind, "", LIMITS, dialect))


@pytest.mark.parametrize("name", EXPORTS)
def test_an_export_is_the_flight_that_it_is(name: str) -> None:
    found, wanted = decoded(name), truth()
    time = found.recording.time_s
    runs = np.flatnonzero(wanted["shaft_speed_rpm"] > 4500.0)
    kept = runs if name == RIG else np.arange(len(wanted["time_s"]))
    kept = np.repeat(kept, 2) if name == COARSE else kept
    assert len(time) == len(kept)
    step = 0.5 if name == COARSE else 1.0
    assert time == pytest.approx(
        np.arange(len(kept)) * step if name != RIG else wanted["time_s"][kept] - runs[0], abs=2e-3
    )
    for channel, near in NEAR.items():
        if channel == "reservoir_pressure_bar" and name == "space-separated.csv":
            assert channel not in found.recording
            continue
        if (name, channel) == (RIG, "shaft_speed_rpm"):
            assert (found.recording[channel] == 4619.0).all()
            continue
        samples, true = found.recording[channel], wanted[channel][kept]
        there = np.isfinite(samples)
        assert there.mean() > 0.98, channel
        slack = 0.2 if (name, channel) == ("acquisition.tdms", "fluid_temperature_degc") else near
        assert samples[there] == pytest.approx(true[there], abs=slack), channel
    metadata = found.metadata
    assert (metadata.pump_serial, metadata.aircraft, metadata.position) == ("SN-0412", "F-HCAA", "LH")
    begins = {
        RIG: START + timedelta(seconds=float(runs[0])),
        COARSE: datetime.fromisoformat("2026-03-18T23:58:30Z"),
        "F-HCAA_SN-0412_317_20260317-0949.csv": START.replace(day=17, second=0),
    }
    assert metadata.started_at == begins.get(name, START)


def test_the_files_are_what_is_written() -> None:
    columns = truth()
    for name, export in EXPORTS.items():
        if name.endswith(".csv"):
            assert (FOLDER / name).read_bytes() == export(columns), f"{name}: python -m tests.service.exports"


@pytest.mark.parametrize("name", CHANNELS)
def test_what_is_proposed_finds_every_channel_and_its_unit(name: str) -> None:
    found = suggested(FOLDER / name)
    sources = {row["channel"]: row["source"] for row in found["channels"]}
    assert tuple(sources.get(channel) for channel in NEAR) == CHANNELS[name]
    assert sources["time_s"] or name == "acquisition.tdms"
    assert all(0.0 < row["certainty"] < 1.0 for row in found["channels"])
    # no more than metadata is left to a person
    left = {fault["where"] for fault in found["faults"]}
    assert left <= {"pump_serial", "aircraft", "position", "flight_id", "started_at"}
    assert found["could_not_tell"]


def test_what_nobody_can_tell_is_said() -> None:
    rig = suggested(FOLDER / RIG)
    assert any("shaft_speed_rpm" in line and "constant" in line for line in rig["could_not_tell"])
    bench = suggested(FOLDER / BENCH)
    speed = next(row for row in bench["channels"] if row["channel"] == "shaft_speed_rpm")
    assert any("percent of the nominal speed" in line for line in speed["because"])
    assert any(line.startswith("shaft_speed_rpm") for line in bench["could_not_tell"])
    german = suggested(FOLDER / "german.csv")
    assert any("zone" in line for line in german["could_not_tell"])


def test_a_plain_record_needs_nothing() -> None:
    found = suggested(FOLDER / "plain-record.csv")
    assert found["mapping"] == {}
    assert found["faults"] == []
    assert found["could_not_tell"] == []


def test_an_export_is_suggested_previewed_stored_and_uploaded(client: TestClient) -> None:
    name = "F-HCAA_SN-0412_317_20260317-0949.csv"
    content, headers = (FOLDER / name).read_bytes(), {"content-type": "text/csv"}
    found = client.post(f"{API}/mappings/suggest", content=content, headers=headers, params={"position": "LH"})
    assert found.status_code == 200, found.text
    mapping: dict[str, Any] = found.json()["mapping"]
    mapping |= {"file_name": mapping_for(name).body()["file_name"], "defaults": {"position": "LH"}}
    assert client.get(f"{API}/mappings").json()["items"] == []
    assert client.post(f"{API}/mappings", json={"name": "sheet", **mapping}).status_code == 201
    params = {"mapping": "sheet", "file_name": name}
    shown = client.post(f"{API}/mappings/preview", content=content, headers=headers, params=params).json()
    assert shown["faults"] == []
    assert any(step["part"] == "file_name" and "SN-0412" in step["did"] for step in shown["steps"])
    nameless = client.post(f"{API}/records", content=content, headers=headers, params={"mapping": "sheet"})
    assert nameless.status_code == 422
    assert nameless.json()["errors"][0]["where"] == "file_name"
    named = headers | {"content-disposition": f'attachment; filename="{name}"'}
    stored = client.post(f"{API}/records", content=content, headers=named, params={"mapping": "sheet"})
    assert stored.status_code == 201, stored.text
    assert (stored.json()["pump_serial"], stored.json()["flight_id"]) == ("SN-0412", "317")
    again = client.post(f"{API}/records", content=content, headers=headers, params=params)
    assert (again.status_code, again.json()["record_id"]) == (200, stored.json()["record_id"])
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr(f"day/{name}", content)
        archive.writestr("day/nameless.csv", content)
    headers = {"content-type": "application/zip"}
    job = client.post(f"{API}/records/bulk", content=packed.getvalue(), headers=headers, params={"mapping": "sheet"})
    items = finished(client, job.json()["id"])["items"]
    assert [item["status"] for item in items] == ["known", "refused"]
    assert items[1]["problem"]["errors"][0]["where"] == "file_name"


@pytest.mark.parametrize("seed", range(4))
def test_whatever_a_file_holds_is_proposed_for_or_refused(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    pieces = [b"\n", b",", b";", b'"', b"\x00", b"1e999", b"-", b"\xff", b":", b"%", b"(", b"2026-02-30", b"\x00\n,"]
    for name in ("engine-logger.csv", "german.csv", "space-separated.csv", BENCH):
        content = (FOLDER / name).read_bytes()[: int(rng.choice([400, 2500, 20_000]))]
        for _ in range(int(rng.choice([1, 5, 30]))):
            place = int(rng.integers(len(content)))
            content = (
                content[:place]
                + pieces[int(rng.integers(len(pieces)))]
                + content[place + int(rng.choice([0, 1, 200])) :]
            )
        damaged = tmp_path / name
        damaged.write_bytes(content)
        with suppress(Problem):  # what cannot be read at all is refused; nothing else may happen
            ChannelMapping.model_validate(suggested(damaged)["mapping"])
