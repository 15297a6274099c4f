"""The image and the compose file on a real engine: start, auth, the demo's fleet, restarts."""

import json
import os
import time
from collections.abc import Iterator

import httpx2
import pytest

from service.client import Client, RefusedError
from service.demo.fleet import PUMPS, fleet_records, is_right
from tests.containers.engine import CannotRunHereError, Engine, engine, probe

ADDRESS = "http://127.0.0.1:18000"
N_FLIGHTS = 40
IMAGE = "casedrain:latest"
SEALED = ("--read-only", "--tmpfs", "/tmp", "--cap-drop", "ALL")
KERNELS = """
import gc, json
from numba.core.registry import cpu_target
import detectors.warm_up
detectors.warm_up.warm_up()
stats = [k.stats for k in gc.get_objects() if hasattr(type(k), "nopython_signatures") and k.stats.cache_path]
hits = sum(sum(s.cache_hits.values()) for s in stats)
misses = [f"{s.cache_path}: {n}" for s in stats if (n := sum(s.cache_misses.values()))]
print(json.dumps([hits, misses, cpu_target.target_context.codegen().magic_tuple()[1:]]))
"""
"""Kernels that the warm-up loads, those that it compiles, and the processor that they are written for."""
READY = "import urllib.request as u; print(u.urlopen('http://127.0.0.1:8000/readyz', timeout=5).status)"
pytestmark = [pytest.mark.containers, pytest.mark.timeout(2400)]


@pytest.fixture(scope="module")
def running() -> Iterator[Engine]:
    try:
        probe()
    except CannotRunHereError as reason:
        if os.environ.get("REQUIRE_CONTAINERS"):
            pytest.fail(f"CONTAINERS-SKIPPED: {reason}; here that is an error")
        pytest.skip(f"CONTAINERS-SKIPPED: {reason}")
    with engine() as started:
        started.compose("build", "api")
        if not started.compose("up", "-d", check=False):
            print(started.compose("ps", check=False), started.compose("logs", "--tail", "40", check=False))
        wait_until_healthy(started)
        yield started


@pytest.fixture(scope="module")
def key(running: Engine) -> str:
    return running.compose("exec", "-T", "api", "casedrain", "keys", "create", "--role", "admin").strip()


def wait_until_healthy(running: Engine, seconds: float = 180.0) -> None:
    """Wait for the image's own health check, not for a port."""
    give_up = time.monotonic() + seconds
    container = ""
    while time.monotonic() < give_up:
        container = running.compose("ps", "-q", "api", check=False).strip()
        if container:
            state = running.docker("inspect", "-f", "{{.State.Health.Status}}", container, check=False).strip()
            if state == "healthy":
                return
        time.sleep(1.0)
    raise AssertionError(f"the api did not get healthy:\n{running.compose('logs', '--tail', '60', check=False)}")


def test_runs_as_nobody_special(running: Engine) -> None:
    assert running.compose("exec", "-T", "api", "id", "-u").strip() == "10001"


def test_read_only_and_as_its_user_it_compiles_nothing(running: Engine) -> None:
    hits, misses, processor = json.loads(running.docker("run", "--rm", *SEALED, IMAGE, "python", "-c", KERNELS))
    assert hits > 15  # kernels that Python calls; the others are linked into them
    assert misses == []
    assert processor == ["generic", ""]  # or another machine would compile them again


def test_read_only_and_on_a_volume_it_gets_ready(running: Engine) -> None:
    container = running.docker("run", "-d", *SEALED, "-v", "casedrain-test-sealed:/var/lib/casedrain", IMAGE).strip()
    try:
        assert ready_in(running, container) is True
        said = running.docker("logs", container, streams="both")
        assert "compiled kernels are not kept" not in said
        assert "Traceback" not in said
    finally:
        running.docker("rm", "-f", "-v", container, check=False)
        running.docker("volume", "rm", "casedrain-test-sealed", check=False)


def ready_in(running: Engine, container: str, seconds: float = 60.0) -> bool:
    """Whether ``/readyz`` in a container answers with 200 in a time that leaves no room for compiling."""
    give_up = time.monotonic() + seconds
    while time.monotonic() < give_up:
        if running.docker("exec", container, "python", "-c", READY, check=False).strip() == "200":
            return True
        time.sleep(0.5)
    raise AssertionError(
        f"not ready:\n{running.docker('logs', '--tail', '60', container, streams='both', check=False)}"
    )


def test_without_a_key_nothing_is_told(running: Engine) -> None:
    answer = httpx2.get(f"{ADDRESS}/api/v1/pumps")
    assert answer.status_code == 401
    assert answer.headers["content-type"] == "application/problem+json"
    with Client(ADDRESS, "cd_not-a-key") as client, pytest.raises(RefusedError, match="no such key"):
        list(client.pumps())


def test_the_demo_fleet_gets_its_verdicts(running: Engine, key: str) -> None:
    with Client(ADDRESS, key) as client:
        for record in fleet_records(N_FLIGHTS, seed=1):
            assert client.upload(record.content)["status"] == "analysed"
        verdicts = {pump.serial: client.verdict(pump.serial) for pump in PUMPS}
    for pump in PUMPS:
        if pump.truth.words == "healthy":
            assert verdicts[pump.serial]["state"] == "healthy", pump.serial
    worn_or_leaking = [p for p in PUMPS if p.truth.candidate in ("pump_degradation", "system_leakage")]
    for pump in worn_or_leaking:
        assert is_right(pump.truth, verdicts[pump.serial]), (pump.serial, verdicts[pump.serial])


def test_a_viewer_reads_and_does_not_write(running: Engine, key: str) -> None:
    headers = {"Authorization": f"Bearer {key}"}
    body = {"owner": "reader", "role": "viewer"}
    made = httpx2.post(f"{ADDRESS}/api/v1/keys", json=body, headers=headers)
    assert made.status_code == 201
    with Client(ADDRESS, made.json()["key"]) as client:
        assert len(list(client.pumps())) == len(PUMPS)
        with pytest.raises(RefusedError, match="needs the role analyst"):
            client.upload(b"time_s\n1\n")


def test_verdicts_survive_restarts_of_both(running: Engine, key: str) -> None:
    with Client(ADDRESS, key) as client:
        before = {pump.serial: client.verdict(pump.serial) for pump in PUMPS}
    running.compose("restart", "-t", "10", "postgres")
    running.compose("restart", "-t", "10", "api")
    wait_until_healthy(running)
    with Client(ADDRESS, key) as client:
        assert {pump.serial: client.verdict(pump.serial) for pump in PUMPS} == before


def test_readiness_tells_a_lost_database(running: Engine) -> None:
    running.compose("stop", "-t", "5", "postgres")
    try:
        answer = httpx2.get(f"{ADDRESS}/readyz", timeout=30.0)
        assert answer.status_code == 503
        assert answer.json()["checks"]["database"] != "ok"
        assert httpx2.get(f"{ADDRESS}/healthz", timeout=10.0).status_code == 200
    finally:
        running.compose("start", "postgres")
    wait_until_healthy(running)
