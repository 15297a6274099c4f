"""The thinned copy of a long record that is kept at ingest, a second record over the first, and marks made on the page."""

from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient
from sqlalchemy import update

from service.history.overview import kept_overview, overview_of, stretch_of
from service.storage.tables import Record
from tests.service.records import body, document
from twin.recording import Recording

API = "/api/v1"
JSON = {"content-type": "application/json"}


def thinned_slowly(time: np.ndarray, samples: np.ndarray, points: int) -> list[tuple[float, float | None]]:
    """Bin by bin, as the docstring says it."""
    borders = np.linspace(time[0], time[-1], points // 2 + 1)
    places, gaps = {int(i) for i in np.flatnonzero(np.isfinite(samples))[[0, -1]]}, []
    for k in range(points // 2):
        last = k == points // 2 - 1
        inside = [
            i for i, t in enumerate(time)
            if (t >= borders[k] or k == 0) and (t < borders[k + 1] or last) and np.isfinite(samples[i])
        ]  # fmt: skip
        if inside:
            places |= {min(inside, key=lambda i: samples[i]), min(inside, key=lambda i: -samples[i])}
        else:
            gaps.append((0.5 * (borders[k] + borders[k + 1]), None))
    return sorted([(float(time[i]), float(samples[i])) for i in places] + gaps, key=lambda p: p[0])


@pytest.mark.parametrize("seed", range(6))
def test_thinning_is_that_of_a_slow_referee(seed: int) -> None:
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.exponential(1.0, 300)) + 5.0
    samples = np.round(rng.normal(size=300), 1)  # many are equal
    samples[rng.random(300) < 0.2] = np.nan
    samples[100 : 100 + 20 * seed] = np.nan
    points = int(rng.integers(4, 60)) // 2 * 2
    (found,) = stretch_of(Recording({"time_s": time, "case_pressure_bar": samples}), 0.0, np.inf, points)["channels"]
    expected = thinned_slowly(time, samples, points)
    assert list(zip(found["time_s"], found["value"], strict=True)) == expected


def test_the_copy_says_what_the_record_says() -> None:
    rng = np.random.default_rng(1)
    long = Recording({"time_s": np.arange(12_000) / 10.0, "case_pressure_bar": rng.normal(size=12_000)})
    kept = overview_of(long)
    assert kept is not None
    assert kept_overview(kept) == stretch_of(long, -np.inf, np.inf, 1000)
    assert overview_of(Recording({n: v[:9000] for n, v in long.channels.items()})) is None
    assert kept_overview(None) is None


def long_record() -> dict[str, Any]:
    """The usual record, twenty times as dense."""
    record = document()
    time = np.array(record["channels"]["time_s"])
    dense = np.linspace(time[0], time[-1], 20 * len(time))
    channels = {n: np.interp(dense, time, v).round(6).tolist() for n, v in record["channels"].items()}
    return {**record, "channels": {**channels, "time_s": dense.tolist(), "more_bar": np.sin(dense).tolist()}}


def test_a_first_view_needs_no_bytes_and_goes_with_them(client: TestClient) -> None:
    record_id = client.post(f"{API}/records", content=body(long_record()), headers=JSON).json()["record_id"]
    url = f"{API}/records/{record_id}/channels"
    first = client.get(url).json()
    assert (first["thinned"], first["samples"]) == (True, 3200)
    assert {w["kind"] for w in first["windows"]} >= {"pump_off", "zero_flow"}
    context = client.app.state.context  # type: ignore[attr-defined]
    with context.database.writing() as session:
        kept = session.get_one(Record, record_id).overview
        session.execute(update(Record).values(overview=None))
    assert kept is not None
    assert client.get(url).json() == first
    with context.database.writing() as session:
        session.execute(update(Record).values(overview=kept))
        digest = session.get_one(Record, record_id).content_hash
    content = b"".join(context.raw_store.chunks(digest))
    context.raw_store.remove(digest)
    try:
        assert client.get(url).json() == first
        assert client.get(f"/records/{record_id}").text.count("<svg") >= 1
        assert client.get(f"{url}?points=999").status_code == 503
    finally:
        context.raw_store.put(content)


def test_two_records_lie_over_each_other(client: TestClient) -> None:
    one = client.post(f"{API}/records", content=body(), headers=JSON).json()["record_id"]
    later = document()
    later["channels"]["time_s"] = [t + 7.0 for t in later["channels"]["time_s"]]
    other = {**later, "flight_id": "F2", "started_at": "2026-05-03T07:11:00Z"}
    two = client.post(f"{API}/records", content=body(other), headers=JSON).json()["record_id"]
    alone = client.get(f"/records/{one}").text
    assert 'class="other"' not in alone
    assert f'<option value="{two}"' in alone
    assert f'<option value="{one}"' not in alone
    both = client.get(f"/records/{one}?beside={two}&align=zero_flow").text
    assert both.count('class="other"') == 5
    assert "moved by -7 s" in both
    # alike and aligned, the same pixels
    assert all(f'class="other" d="{d.split(chr(34))[0]}"' in both for d in both.split('class="p" d="')[1:4])
    assert "moved by" not in client.get(f"/records/{one}?beside={two}&align=start").text
    assert client.get(f"/records/{one}?beside={two}&from=20&to=60").status_code == 200
    assert client.get(f"/records/{one}?beside=nothing").status_code == 404
    assert client.get(f"/records/{one}?beside={two}&align=sideways").status_code == 422


def test_marks_are_made_and_taken_back_on_the_page(client: TestClient) -> None:
    record_id = client.post(f"{API}/records", content=body(), headers=JSON).json()["record_id"]
    origin = {"origin": str(client.base_url).rstrip("/")}

    def post(url: str, **fields: str) -> tuple[int, str]:
        answer = client.post(url, data=fields, headers=origin, follow_redirects=False)
        return answer.status_code, answer.text

    url = f"/records/{record_id}/marks"
    assert post(url, start_s="110", end_s="121.5", mark="bad", reason="plug <moved>")[0] == 303
    (made,) = client.get(f"{API}/records/{record_id}/marks").json()["items"]
    assert (made["start_s"], made["end_s"], made["mark"]) == (110.0, 121.5, "bad")
    page = client.get(f"/records/{record_id}").text
    assert "plug &lt;moved&gt;" in page
    assert page.count('class="mark bad"') == page.count('class="panel"') == 4
    for fields, words in (
        ({"start_s": "30", "end_s": "20", "mark": "bad", "reason": "x"}, "not after its start"),
        ({"start_s": "30", "end_s": "40", "mark": "", "reason": "x"}, "mark"),
        ({"start_s": "30", "end_s": "40", "mark": "good", "reason": ""}, "reason"),
    ):
        status, text = post(url, **fields)
        assert (status, words in text) == (422, True), text
    assert post(f"{url}/{made['id']}/withdraw")[0] == 303
    assert client.get(f"{API}/records/{record_id}/marks").json()["items"] == []
    assert post(f"{url}/{made['id']}/withdraw")[0] == 404
