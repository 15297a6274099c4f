"""Reports and job cards as PDF: A4, what the verdict says, pictures, versions, lines to sign, numbered pages."""

import io
import re
from typing import Any

import pytest
from fastapi.testclient import TestClient
from pypdf import PdfReader

from service.reports.sentences import in_units
from service.units import SYSTEMS, US, unit_of
from tests.service.finished_job import finished
from tests.service.records import body

API = "/api/v1"
ORIGIN = {"origin": "http://localhost"}
A4_PT = (595.28, 841.89)
"""ISO 216: 210 mm by 297 mm."""


def pages(content: bytes) -> list[str]:
    reader = PdfReader(io.BytesIO(content))
    for page in reader.pages:
        assert (float(page.mediabox.width), float(page.mediabox.height)) == pytest.approx(A4_PT, abs=0.1)
    return [re.sub(r"\s+", " ", page.extract_text()) for page in reader.pages]


def report(client: TestClient, **parameters: Any) -> dict[str, Any]:
    asked = client.post(f"{API}/jobs", json={"kind": "report", "parameters": parameters})
    assert asked.status_code == 202, asked.text
    job = finished(client, asked.json()["id"])
    assert job["status"] == "succeeded", job
    return job


@pytest.mark.parametrize("worn_settings", ["sqlite"], indirect=True)
def test_a_job_card_says_what_the_verdict_says(worn_client: TestClient) -> None:
    client = worn_client
    (pump,) = client.get(f"{API}/pumps").json()["items"]
    serial = pump["serial"]
    verdict = client.get(f"{API}/pumps/{serial}/verdict").json()
    assert f"/pumps/{serial}/job-card.pdf" in client.get(f"/pumps/{serial}").text
    for system, word in (("metric", "bar"), ("us", "psi")):
        client.cookies.set("casedrain_units", system)
        answer = client.get(f"/pumps/{serial}/job-card.pdf")
        assert (answer.status_code, answer.headers["content-type"]) == (200, "application/pdf")
        found = pages(answer.content)
        first, whole = found[0], " ".join(found)
        told = in_units(verdict["advice"], SYSTEMS[system])
        for words in (told, f"Pump {serial}", "Work order", "Signature", "Inspected by"):
            assert words in first, words
        assert f"twin {verdict['twin_version']}, thresholds {verdict['threshold_version']}" in first
        for k, page in enumerate(found, 1):
            assert f"Page {k} of {len(found)}" in page
        # the pictures' own words
        assert f"discharge pressure [{word}]" in whole
        assert f"pressure setting, change [{word}]" in whole
    for name, estimate in verdict["estimates"].items():
        assert US.figure(estimate["mean"], unit_of(name), 2) in whole
    assert client.get("/pumps/nobody/job-card.pdf").status_code == 404
    # a report of one pump is a card as well, over the API in our units unless others are asked for
    job = report(client, pump=serial)
    assert job["parameters"]["units"] == "metric"
    kept = client.get(f"{API}/jobs/{job['id']}/result?format=pdf")
    assert kept.headers["content-type"] == "application/pdf"
    text = " ".join(pages(kept.content))
    assert "condition report" in text
    assert "discharge pressure [bar]" in text
    page = client.get(f"/reports/{job['id']}").text
    for words in ("Done and signed", verdict["twin_version"], "Steps", "[bar]"):
        assert words in page
    assert client.get(f"/reports/{job['id']}?format=pdf").content == kept.content
    numbers = client.get(f"{API}/jobs/{job['id']}/result?format=json").json()
    in_psi = report(client, pump=serial, units="us")
    html = client.get(f"{API}/jobs/{in_psi['id']}/result").text
    assert "[psi]" in html
    assert not re.search(r"\[bar\]|\[L/min\]", html)
    again = client.get(f"{API}/jobs/{in_psi['id']}/result?format=json").json()
    assert {k: v for k, v in again.items() if k not in ("since", "until")} == {
        k: v for k, v in numbers.items() if k not in ("since", "until")
    }


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_a_report_is_made_in_the_units_of_who_asks_on_a_page(client: TestClient) -> None:
    client.post(f"{API}/records", content=body(), headers={"content-type": "application/json"})
    form = {"kind": "report", "units": "us"}
    link = client.post("/jobs", data=form, headers=ORIGIN, follow_redirects=False).headers["location"]
    job = finished(client, link.removeprefix("/reports/"))
    assert (job["status"], job["parameters"]["units"]) == ("succeeded", "us")
    (first, second) = pages(client.get(f"{link}?format=pdf").content)
    assert "Which" not in first
    assert "Pressures in psi gauge" in first
    assert "Pump P-1" in second
    assert "Signature" not in second
    assert f"{link}?format=pdf" in client.get(f"/jobs/{job['id']}").text
    wrong = client.post(f"{API}/jobs", json={"kind": "report", "parameters": {"units": "cubits"}})
    assert (wrong.status_code, wrong.json()["errors"][0]["where"]) == (422, "parameters.units")
