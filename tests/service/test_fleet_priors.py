"""Learning priors from a stored fleet, up to the pump type that is added with them."""

import json
import tomllib
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from typer.testing import CliRunner

from detectors.judgement.version import twin_version
from service.command_line.main import app
from service.errors import Invalid
from service.settings import Settings
from service.studies.fleet_priors import learn
from tests.detectors.fleet import FAULTS, history
from tests.service.stored_records import store
from twin.pumps import pump_type

API = "/api/v1"


@pytest.mark.study
def test_a_fleet_becomes_a_pump_type_of_its_own(
    client: TestClient, settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    context = client.app.state.context  # type: ignore[attr-defined]
    for seed in range(8):
        store(context, history(seed, 30).observations, f"P-{seed}", "north")
    store(context, history(9, 30, FAULTS["worn"]).observations, "P-worn", "north")
    store(context, history(10, 12).observations, "P-new", "north")
    # what the workshop found is a case in 282 records; that it found nothing is none
    for serial, found in (("P-worn", "pump_degradation"), ("P-1", "no_fault_found")):
        entry = {"at": "2026-03-01T00:00:00Z", "found": found}
        assert client.post(f"{API}/pumps/{serial}/findings?operator=north", json=entry).status_code == 201
    with pytest.raises(Invalid) as refused:
        learn(context.database, context.archive, "h225", "h225-south", "south")
    assert "0 healthy pumps" in refused.value.errors[0].problem
    with pytest.raises(Invalid, match="nothing was learnt"):
        learn(context.database, context.archive, "h225", "h225_thesis", "north")

    monkeypatch.setenv("CASEDRAIN_DATABASE_URL", settings.database_url)
    monkeypatch.setenv("CASEDRAIN_DATA_DIR", str(settings.data_dir))
    output = tmp_path / "fleet.toml"
    done = CliRunner().invoke(
        app, ["learn-priors", "--id", "h225-north", "--operator", "north", "--output", str(output)]
    )
    assert done.exit_code == 0, done.output
    assert "8 of 10 pumps" in done.output
    document = tomllib.loads(output.read_text())
    assert "learnt from 8 healthy pumps of north" in document["changes"]["population.pressure_setting_bar"]["source"]

    onsets = {n: c for n, c in document["changes"].items() if n.endswith("_onsets")}
    assert onsets["population.pump_degradation_onsets"]["value"] == pytest.approx((5 + 1) / 5.282, rel=1e-3)
    assert onsets["population.drain_restriction_onsets"]["value"] == pytest.approx(5 / 5.282, rel=1e-3)
    assert "1 of 1 findings in 282 records of north" in onsets["population.pump_degradation_onsets"]["source"]
    assert len(onsets) == 5

    added = client.post(f"{API}/pump-types", content=json.dumps(document), headers={"content-type": "application/json"})
    assert added.status_code == 201, added.text
    version = added.json()["twin_version"]
    assert version.startswith("h225-north-")
    assert version != twin_version(pump_type("h225"))
    # frozen: the same fleet gives the same numbers, and pumps of the type are judged with them
    again = learn(context.database, context.archive, "h225", "h225-other", "north")
    assert {k: v["value"] for k, v in again.document["changes"].items()} == {
        k: v["value"] for k, v in document["changes"].items()
    }
    assert client.patch(f"{API}/pumps/P-1?operator=north", json={"pump_type": "h225-north"}).status_code in (200, 503)
