"""Schemathesis with every check against a running server: cases of the API's own document, summed over seeds.

``python -m benchmarks.contract_cases SEED [seconds] [sqlite|postgres]`` adds a run to
``benchmarks/results/contract_cases.json``. The program `schemathesis` is looked for on the path, or named by the variable
``SCHEMATHESIS``; it brings a tree of packages of its own and is no part of this environment. Keys are
not revoked: the run's own would be.

What it calls a rejected valid request is mostly one: a document cannot say that a cursor must be ours, that a range is empty, or that
a threshold's version exists. They are counted apart, as ``rejected``; ``Allow`` of `/mappings/suggest` names the methods of
`/mappings/{name}`, which answers there too.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import httpx2

from benchmarks import RESULTS, keep
from benchmarks.ingest import await_ready
from benchmarks.overload import server
from service.access.security import new_key
from service.storage.database import Database, upgrade
from tests.postgres import cluster, create_database
from tests.service.records import body

PORT = 8812
URL = f"http://127.0.0.1:{PORT}"
_LIMITLESS = {f"CASEDRAIN_QUOTA_{name}": "0" for name in ("KEY_REQUESTS_PER_MINUTE", "KEY_JOBS", "OPERATOR_JOBS")}
_SECONDS = 240.0
_TOLD = ("ST202 Schema-valid request rejected",)


def run(seed: int, seconds: float, kind: str) -> dict[str, Any]:
    """One run on a fresh database: cases, failures by check and operation, the most memory that the server held."""
    program = os.environ.get("SCHEMATHESIS") or shutil.which("schemathesis")
    if program is None:
        raise SystemExit("schemathesis is not on the path: install it somewhere and name it in SCHEMATHESIS")
    with cluster() if kind == "postgres" else nullcontext("") as base, tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        url = create_database(base, "cases") if base else f"sqlite:///{folder / 'c.sqlite'}"
        upgrade(url)
        with Database(url).writing() as session:
            _, key = new_key(session, "cases", "admin", None, None)
        with server(url, folder, PORT, **_LIMITLESS) as process:
            await_ready(process, URL)
            headers = {"Authorization": f"Bearer {key}", "Content-Type": "application/json"}
            httpx2.post(f"{URL}/api/v1/records", content=body(), headers=headers).raise_for_status()
            report = folder / "report.json"
            command = [program, "run", f"{URL}/openapi.json", "--checks", "all", "--seed", str(seed), "--no-color"]
            command += ["--max-time", f"{seconds:g}", "--max-examples", "10000", "--continue-on-failure", "--no-shrink"]
            command += [
                "-H",
                f"Authorization: Bearer {key}",
                "--request-timeout",
                "30",
                "--generation-database",
                "none",
            ]
            # its own key would be revoked, and the rest of the run answered 401
            command += ["--exclude-path-regex", "/keys/"]
            command += ["--report-json-path", str(report), "--workers", "2"]
            limit = 4 * seconds + 120
            # what it remembers of failures is no part of the tree
            said = subprocess.run(command, capture_output=True, text=True, check=False, timeout=limit, cwd=folder)  # noqa: S603
            (folder.parent / f"casedrain-cases-{seed}.txt").write_text(said.stdout + said.stderr)
            memory = re.search(r"VmHWM:\s+(\d+)", Path(f"/proc/{process.pid}/status").read_text())
        log = (folder / "log").read_text(errors="replace")
    return {
        "seed": seed,
        "database": kind,
        **_counted(said.stdout),
        "unexpected_errors_in_the_log": log.count('"event": "unexpected error"'),
        "server_most_mib": round(int(memory[1]) / 1024.0) if memory else None,
    }


def _counted(text: str) -> dict[str, Any]:
    cases = re.search(r"([\d,]+) generated", text)
    failures = re.findall(r"^\s+❌ (.+?): (\d+)", text, re.MULTILINE)
    return {
        "cases": int(cases[1].replace(",", "")) if cases else 0,
        "failures": {name: int(n) for name, n in failures if name not in _TOLD},
        "rejected": sum(int(n) for name, n in failures if name in _TOLD),
    }


def main() -> None:
    """Run and add to the results."""
    seed = int(sys.argv[1])
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else _SECONDS
    kind = sys.argv[3] if len(sys.argv) > 3 else "sqlite"
    found = run(seed, seconds, kind)
    place = RESULTS / "contract_cases.json"
    runs = json.loads(place.read_text())["runs"] if place.exists() else []
    runs = [r for r in runs if (r["seed"], r["database"]) != (seed, kind)] + [found]
    keep("contract_cases", {"cases": sum(r["cases"] for r in runs), "runs": runs})


if __name__ == "__main__":
    main()
