"""Apply one change at a time to a copy of the tree and see whether the tests that own the line notice.

``python -m benchmarks.mutants``; results so far are kept, what has one is not run again unless ``--again``.
"""

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path
from typing import Any

# imported for the forks
import alembic.command  # noqa: F401
import fastapi.testclient  # noqa: F401
import hypothesis  # noqa: F401
import numba
import pytest
import scipy.stats  # noqa: F401
import sqlalchemy.orm  # noqa: F401
import structlog  # noqa: F401

from benchmarks.mutants import judge, physics, quality, service
from benchmarks.mutants.catalogue import ROOT, Mutant, faults, file_of

MUTANTS: tuple[Mutant, ...] = (*physics.MUTANTS, *judge.MUTANTS, *service.MUTANTS, *quality.MUTANTS)
RESULTS = ROOT / "benchmarks" / "results" / "mutants.json"
TARGET = 0.95
LIMIT_S = 300.0
_QUIET = ("-W", "ignore::pytest.PytestAssertRewriteWarning")
"""What was imported for the forks is not ours to rewrite."""
_OURS = ("twin", "detectors", "service", "tests", "benchmarks")
_FAILED = 1
"""What pytest ends with where tests ran and at least one failed."""


def copied(into: Path) -> None:
    """Copy what belongs to the repository, so that nobody's own files are changed."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],  # noqa: S607 - whichever git there is
        cwd=ROOT,
        capture_output=True,
        check=True,
    )
    for name in listed.stdout.decode().splitlines():
        if (ROOT / name).is_file() and not (ROOT / name).is_symlink():
            (into / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, into / name)


def outcome(tree: Path, mutant: Mutant) -> str:
    """``killed``, ``survived``, ``timed out``, or ``error`` where no test ran.

    Tests run in a fork of this process, which has imported everything but the repository: most of a test's time else.
    """
    child = os.fork()
    if child == 0:
        ended = 3
        try:
            ended = _tested(tree, mutant)
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            os._exit(ended)
    until = time.monotonic() + LIMIT_S
    while time.monotonic() < until:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return {0: "survived", _FAILED: "killed"}.get(os.waitstatus_to_exitcode(status), "error")
        time.sleep(0.05)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return "timed out"


def _tested(tree: Path, mutant: Mutant) -> int:
    """What pytest ends with in the tree; silent, in a process group of its own."""
    os.setpgid(0, 0)
    files = [str(file_of(test)) for test in mutant.tests]
    os.chdir(tree)
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)
    os.dup2(silence, 2)
    for name in [n for n in sys.modules if n.split(".")[0] in _OURS]:
        del sys.modules[name]
    sys.path[:] = [str(tree), *(p for p in sys.path if Path(p or ".").resolve() != ROOT)]
    os.environ["PYTHONPATH"] = str(tree)
    if mutant.plain:
        os.environ["NUMBA_DISABLE_JIT"] = "1"
        numba.config.DISABLE_JIT = 1
    chosen = ["-k", mutant.select] if mutant.select else []
    return int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", *_QUIET, *files, *chosen]))


def changed(tree: Path, mutant: Mutant) -> str:
    """Outcome with the change, which is taken back afterwards."""
    file = tree / file_of(mutant.module)
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace(mutant.fragment, mutant.replacement), encoding="utf-8")
    try:
        return outcome(tree, mutant)
    finally:
        file.write_text(text, encoding="utf-8")


def summary(found: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Results with their counts, in the catalogue's order, as they are written."""
    rows = [found[m.name] for m in MUTANTS if m.name in found]
    counts = Counter(row["outcome"] for row in rows)
    noticed = counts["killed"] + counts["timed out"]
    return {
        "command": "python -m benchmarks.mutants",
        "mutants": len(rows),
        "share_killed": round(noticed / len(rows), 3) if rows else None,
        "target": TARGET,
        "outcomes": dict(counts),
        "rows": rows,
    }


def table(rows: list[dict[str, Any]]) -> str:
    """Outcomes by area, and every change that nobody noticed."""
    areas = list(dict.fromkeys(row["area"] for row in rows))
    lines = [f"{'area':<14}{'changes':>8}{'noticed':>8}"]
    for area in areas:
        mine = [row for row in rows if row["area"] == area]
        noticed = sum(row["outcome"] in ("killed", "timed out") for row in mine)
        lines.append(f"{area:<14}{len(mine):>8}{noticed:>8}")
    lines += [
        f"{row['outcome']}: {row['module']}: {row['fragment']} -> {row['replacement']}"
        for row in rows
        if row["outcome"] not in ("killed", "timed out")
    ]
    return "\n".join(lines)


def main() -> int:
    """Run what has no result yet; 0 when the target is reached."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--again", action="store_true", help="run every change, also those with a result")
    parser.add_argument("--only", default="", help="changes whose module or fragment holds this text")
    asked = parser.parse_args()
    wrong = faults(MUTANTS)
    if wrong:
        print("\n".join(wrong), file=sys.stderr)
        return 2
    found: dict[str, dict[str, Any]] = {}
    if RESULTS.exists():
        rows = json.loads(RESULTS.read_text(encoding="utf-8"))["rows"]
        found = {f"{row['module']}: {row['fragment']} -> {row['replacement']}": row for row in rows}
    known = {name for name, row in found.items() if row["outcome"] != "error" and not asked.again}
    due = [m for m in MUTANTS if m.name not in known and asked.only in m.name]
    sound: dict[tuple[Any, ...], str] = {}
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        tree = Path(folder)
        copied(tree)
        for mutant in due:
            tests = (mutant.tests, mutant.select, mutant.plain)
            if tests not in sound:
                sound[tests] = outcome(tree, mutant)
            started = time.monotonic()
            # tests that fail or do not run without the change say nothing about it
            ended = changed(tree, mutant) if sound[tests] == "survived" else "error"
            found[mutant.name] = {
                "area": mutant.area,
                "module": mutant.module,
                "fragment": mutant.fragment,
                "replacement": mutant.replacement,
                "outcome": ended,
                "seconds": round(time.monotonic() - started, 1),
            }
            print(f"{ended:<10} {mutant.name}", flush=True)
            RESULTS.write_text(json.dumps(summary(found), indent=1) + "\n", encoding="utf-8")
    written = summary(found)
    print(table(written["rows"]))
    return 0 if (written["share_killed"] or 0.0) >= TARGET else 1


if __name__ == "__main__":
    sys.exit(main())
