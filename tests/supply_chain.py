"""What the program is made of, and what is known against it: ``python tests/supply_chain.py sbom FILE|audit VENV``.

Run by `make supply` with the tools of the extra ``supply`` in an environment of their own, so that they are no part of what
they list. An audit that reached nobody is no audit: it ends with 3 and says why, which `.ci/run` counts as skipped.
"""

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
GOOD, WRONG, SKIPPED = 0, 1, 3
_TIMEOUT_S = 300


def sbom(python: str, output: Path) -> int:
    """Write a CycloneDX bill of materials of an environment; it must hold every dependency that pyproject.toml declares."""
    output.parent.mkdir(parents=True, exist_ok=True)
    tool = [sys.executable, "-m", "cyclonedx_py", "environment", python, "--pyproject", str(ROOT / "pyproject.toml")]
    subprocess.run([*tool, "--output-reproducible", "--of", "JSON", "-o", str(output)], check=True, timeout=_TIMEOUT_S)
    missing = missing_of(json.loads(output.read_text()), declared())
    print(f"{output}: {'lacks ' + ', '.join(missing) if missing else 'holds every declared dependency'}")
    return WRONG if missing else GOOD


def declared() -> list[str]:
    """Names of the dependencies of the program itself, without extras."""
    import tomllib

    names = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    return [normal(name.partition(">")[0].partition("[")[0]) for name in names]


def missing_of(document: dict[str, Any], names: Sequence[str]) -> list[str]:
    """Names that a bill of materials does not list with a version."""
    listed = {normal(part["name"]) for part in document.get("components", []) if part.get("version")}
    return sorted(set(names) - listed)


def normal(name: str) -> str:
    """A package's name as registries compare it."""
    return name.strip().lower().replace("_", "-").replace(".", "-")


def audit(packages: str) -> int:
    """Ask for known vulnerabilities of the packages in a folder."""
    tool = [sys.executable, "-m", "pip_audit", "--path", packages, "-f", "json", "--progress-spinner", "off"]
    try:
        answer = subprocess.run(tool, capture_output=True, text=True, check=False, timeout=_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        print("audit skipped: the list of vulnerabilities did not answer in time")
        return SKIPPED
    status, words = judged(answer.stdout)
    print(words if answer.stdout else f"audit skipped: {answer.stderr.strip().splitlines()[-1:]}")
    return status


def judged(text: str) -> tuple[int, str]:
    """What an audit's output says: exit code and sentence."""
    try:
        packages = json.loads(text)["dependencies"]
    except (ValueError, KeyError, TypeError):
        return SKIPPED, "audit skipped: the list of vulnerabilities cannot be reached"
    asked = [p for p in packages if "skip_reason" not in p]
    found = [f"{p['name']} {p['version']}: {v['id']} (mended in {', '.join(v['fix_versions']) or 'nothing yet'})"
             for p in asked for v in p.get("vulns", ())]  # fmt: skip
    if found:
        return WRONG, "known vulnerabilities:\n" + "\n".join(found)
    if 2 * len(asked) < len(packages):
        return (
            SKIPPED,
            f"audit skipped: nothing is known of {len(packages) - len(asked)} of {len(packages)} packages here",
        )
    return GOOD, f"nothing is known against {len(asked)} of {len(packages)} packages"


if __name__ == "__main__":
    what, where = sys.argv[1:3]
    sys.exit(sbom(sys.argv[3], Path(where)) if what == "sbom" else audit(where))
