"""The engineer's page says what the twin's calls say; mappings are written in a table."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from tests.service.guarded import guarded_client, key
from tests.service.test_page_forms import come_in

API = "/api/v1"


@pytest.fixture
def guarded(database_url: str, tmp_path: Path) -> Iterator[TestClient]:
    with guarded_client(database_url, tmp_path) as running:
        yield running


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_an_operating_point_beside_the_healthy_one(client: TestClient) -> None:
    condition = {"speed_rpm": 4600, "fluid_temperature_degc": 72, "reservoir_pressure_bar": 0.5}
    health = {"pump_leakage_scale": 2, "system_leakage_lpm": 1}
    conditions = [condition, {**condition, "health": health}]
    sound, worn = client.post(f"{API}/twin/operating-point", json={"conditions": conditions}).json()["items"]
    query = "&".join(f"{k}={v}" for k, v in {**condition, **health}.items())
    page = client.get(f"/engineer?{query}").text
    for name, word in (("case_pressure_bar", "Case pressure [bar]"), ("case_flow_lpm", "Case flow [L/min]")):
        row = re.findall(rf'{re.escape(word)}</th><td class="number">([^<]+)</td><td class="number">([^<]+)</td>', page)
        assert row == [(f"{sound[name]:.3f}", f"{worn[name]:.3f}")]
    assert page.count("<svg") == 2
    assert page.count('class="marked"') == 1
    assert 'name="pump_leakage_scale" value="2"' in page
    wrong = client.get("/engineer?pump_type=none&speed_rpm=4600")
    assert wrong.status_code == 422
    assert "none" in wrong.text
    bad = client.get("/engineer?speed_rpm=fast&colour=red")
    assert bad.status_code == 422
    assert re.findall(r"<li><strong>([^<]+)</strong>", bad.text) == ["speed_rpm", "colour"]


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_a_study_of_given_sensors(client: TestClient) -> None:
    asked = {"sensors": {"case_pressure_bar": {"accuracy_percent": 2.0}, "reservoir_pressure_bar": None}, "flights": 10}
    found = client.post(f"{API}/twin/isolability", json={**asked, "temperature_range_degc": [30, 60]}).json()
    page = client.get(
        "/engineer?study=true&case_accuracy_percent=2&reservoir=false&flights=10&coldest_degc=30&warmest_degc=60"
    ).text
    for name, fault in found["faults"].items():
        assert f'<th scope="row">{name.replace("_", " ")}</th>' in page
        if fault["smallest_detectable"] is not None:
            assert f"{fault['smallest_detectable']:.3g} {fault['unit']}" in page
    wrong = client.get("/engineer?study=true&coldest_degc=90&warmest_degc=10&flights=0")
    assert wrong.status_code == 422
    assert re.findall(r"<li><strong>([^<]+)</strong>", wrong.text) == ["temperature_range_degc", "flights"]


def test_a_mapping_is_written_in_a_table_and_gets_versions(guarded: TestClient) -> None:
    token = come_in(guarded, "ann", "analyst", "north")
    headers = key(guarded, "viewer", "north")

    def post(**fields: str) -> tuple[int, str]:
        answer = guarded.post("/mappings", data={"csrf_token": token, **fields}, follow_redirects=False)
        return answer.status_code, answer.headers.get("location", answer.text)

    fields = {
        "source.0": "HYD1_P", "channel.0": "discharge_pressure_bar", "unit.0": "psi", "scale.0": "2.5",
        "source.4": "Time", "channel.4": "time_s", "unit.4": "ms",
        "metadata:aircraft": "Tail", "default:position": "LH", "delimiter": "tab", "decimal": ",",
    }  # fmt: skip
    status, page = post(name="no blanks", **{**fields, "unit.0": "furlong", "colour": "red"})
    assert status == 422
    assert re.findall(r"<li><strong>([^<]+)</strong>", page) == ["channels.0", "name", "colour"]
    assert 'name="source.4" maxlength="200" value="Time"' in page
    assert post(name="hums", **fields) == (303, "/mappings?name=hums")
    (stored,) = guarded.get(f"{API}/mappings", headers=headers).json()["items"]
    assert [(c["source"], c["channel"], c["unit"], c["scale"]) for c in stored["channels"]] == [
        ("HYD1_P", "discharge_pressure_bar", "psi", 2.5), ("Time", "time_s", "ms", 1.0),
    ]  # fmt: skip
    assert (stored["metadata"], stored["defaults"], stored["csv"]["delimiter"]) == (
        {"Tail": "aircraft"}, {"position": "LH"}, "\t",
    )  # fmt: skip
    assert post(name="hums", **fields)[0] == 409
    page = guarded.get("/mappings?name=hums").text
    held = {n: v for n, v in re.findall(r'name="([^"]+)"[^>]*? value="([^"]*)"', page) if v}
    assert held["version"] == "1"
    assert (held["source.1"], held["scale.0"], held["metadata:aircraft"]) == ("Time", "2.5", "Tail")
    assert post(name="hums", version="1", **{**fields, "unit.0": "bar"})[0] == 303
    assert post(name="hums", version="1", **fields)[0] == 412
    assert guarded.get(f"{API}/mappings/hums", headers=headers).json()["version"] == 2
    assert guarded.get("/mappings?name=none").status_code == 404
    come_in(guarded, "vic", "viewer", "north")
    page = guarded.get("/mappings").text
    assert "hums" in page
    assert "Store" not in page
    come_in(guarded, "sue", "analyst", "south")
    assert guarded.get("/mappings?name=hums").status_code == 404


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_a_load_step_is_that_of_the_simulation(client: TestClient) -> None:
    run = {
        "duration_s": 0.06,
        "sample_rate_hz": 2000.0,
        "schedule": {
            "time_s": [0.0, 0.02, 0.02, 0.06],
            "discharge_flow_lpm": [0.0, 0.0, 15.0, 15.0],
            "speed_rpm": [4600.0] * 4,
            "fluid_temperature_degc": [50.0] * 4,
            "reservoir_pressure_bar": [0.5] * 4,
        },
        "health": {"pump_leakage_scale": 3.0},
    }
    channels = client.post(f"{API}/twin/simulation", json=run).json()["channels"]
    after = [v for t, v in zip(channels["time_s"], channels["discharge_pressure_bar"], strict=True) if t >= 0.02]
    page = client.get(
        "/engineer?step=true&fluid_temperature_degc=50&pump_leakage_scale=3&flow_after_lpm=15&step_at_s=0.02&run_s=0.06"
    ).text
    row = re.findall(
        r"Discharge pressure \[bar\]</th><td>with these values</td>" + r'<td class="number">([^<]+)</td>' * 4, page
    )
    assert [(r[1], r[2]) for r in row] == [(f"{min(after):.2f}", f"{max(after):.2f}")]
    assert page.count("Load step, ") >= 3
    for query, words in (("run_s=2", "run_s"), ("step_at_s=0", "step_at_s"), ("circuit=none", "circuit")):
        wrong = client.get(f"/engineer?step=true&{query}")
        assert (wrong.status_code, words in wrong.text) == (422, True), query
