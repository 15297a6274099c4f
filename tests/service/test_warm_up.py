"""After the warm-up no request compiles anything: no kernel called from Python meets arguments of new types."""

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = '''
import sys
from pathlib import Path

from fastapi.testclient import TestClient

from service.web.app import create_app
from service.demo.fleet import PUMPS, pump_records
from service.settings import Settings

API = "/api/v1"


def compiled():
    """Signatures of every kernel that Python calls, by module and name."""
    return {
        f"{name}.{key}": len(kernel.signatures)
        for name, module in list(sys.modules.items())
        if name.partition(".")[0] in ("twin", "detectors")
        for key, kernel in vars(module).items()
        if hasattr(kernel, "signatures") and hasattr(kernel, "py_func")
    }


settings = Settings(data_dir=Path(sys.argv[1]), database_url="", auth="off")
flights = list(pump_records(PUMPS[0], 16, seed=1))
with TestClient(create_app(settings), base_url="http://localhost") as client:
    before = compiled()
    assert before["twin.simulation.loop.run_loop"] == 1
    assert before["detectors.bank.kernel.step"] == 1
    for flight in flights:
        answer = client.post(f"{API}/records", content=flight.content, headers={"content-type": "text/csv"})
        assert answer.status_code == 201
    serial = flights[0].pump.serial
    for path in (f"/pumps/{serial}", "/", f"{API}/pumps/{serial}/damage-identification-curve", f"{API}/pumps/{serial}/forecast"):
        assert client.get(path).status_code == 200
    for call, body in (
        ("isolability", {"burst": True, "windows_per_flight": 2}),
        ("operating-point", {"conditions": [{"speed_rpm": 4000, "fluid_temperature_degc": 40}]}),
        ("simulation", {"duration_s": 0.05, "schedule": {"time_s": [0, 0.02], "discharge_flow_lpm": [0, 5]}}),
        (
            "simulation",
            {
                "duration_s": 0.05,
                "circuit": "separate_drain",
                "schedule": {"load_conductance_lpm_per_sqrt_bar": 0.5},
                "health": {"slipper_gap_scale[1]": 1.3, "spool_jamming_force_n": 50},
            },
        ),
    ):
        answer = client.post(f"{API}/twin/{call}", json=body)
        assert answer.status_code == 200, answer.text
    after = compiled()
new = {name: n for name, n in after.items() if n != before.get(name, 0)}
assert not new, f"compiled inside a request: {new}"
'''


@pytest.mark.study
def test_no_request_compiles(tmp_path: Path) -> None:
    """In a process of its own: other tests may have compiled what the warm-up forgot."""
    result = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
        cwd=Path(__file__).resolve().parent.parent.parent,
    )
    assert result.returncode == 0, result.stderr[-2000:]
