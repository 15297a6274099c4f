"""The detection study: fleets that differ from the judge, over every row, with the targets beside.

``python -m benchmarks.detection [STUDY OPTIONS]`` writes ``benchmarks/results/detection.json`` and ``.html``; it is
``casedrain evaluate`` with these two files, and takes the same options (``--quick``, ``--workers``, ``--resume`` …).
"""

import sys

from benchmarks import RESULTS
from service.command_line.main import app


def main(options: list[str]) -> None:
    """Run the study."""
    places = ["--json", str(RESULTS / "detection.json"), "--html", str(RESULTS / "detection.html")]
    app(["evaluate", *places, *options])


if __name__ == "__main__":
    main(sys.argv[1:])
