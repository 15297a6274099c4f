"""The detection study over rows of strange worlds: shape x size x onset, sensors that lie, pumps that move.

``python -m benchmarks.strange_worlds [STUDY OPTIONS]`` writes ``benchmarks/results/strange_worlds.json`` and ``.html``; it is
``casedrain evaluate`` with these two files and these rows, beside healthy pumps, and takes the same options.
"""

import sys

from benchmarks import RESULTS
from detectors.evaluation.rows import HEALTHY
from detectors.evaluation.strange import STRANGE_ROWS
from service.command_line.main import app

BESIDE = (HEALTHY, "pump leakage 0.6 L/min", "system leakage 3 L/min", "drain +30 %", "worn on arrival", "uneven wear")
"""Rows of the usual study that are run beside them, with and without bursts."""


def main(options: list[str]) -> None:
    """Run the study."""
    places = ["--json", str(RESULTS / "strange_worlds.json"), "--html", str(RESULTS / "strange_worlds.html")]
    rows = [argument for name in (*BESIDE, *(r.name for r in STRANGE_ROWS)) for argument in ("--rows", name)]
    app(["evaluate", *places, *rows, *options])


if __name__ == "__main__":
    main(sys.argv[1:])
