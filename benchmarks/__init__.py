"""Studies and measurements: speed side by side, convergence, agreement of both twins; results under ``results/``."""

import json
from collections.abc import Mapping
from pathlib import Path

RESULTS = Path(__file__).parent / "results"


def keep(name: str, found: Mapping[str, object]) -> None:
    """Print what a study found and keep it as ``results/NAME.json``."""
    text = json.dumps(found, indent=1)
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / f"{name}.json").write_text(text + "\n", encoding="utf-8")
    print(text)
