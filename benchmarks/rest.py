"""What a server at rest asks of its database: entries of a log of every statement.

``python -m benchmarks.rest`` writes ``benchmarks/results/rest.json``: entries a second that Postgres logs with
``log_statement=all`` over a minute, begun a minute after the start, and bytes that a server on SQLite reads and writes.
"""

import time
from collections import Counter
from pathlib import Path

from benchmarks import keep
from benchmarks.disturbed import installation

BEFORE_S, SECONDS = 60.0, 60.0


def main() -> None:
    """Measure and keep."""
    found: dict[str, object] = {}
    with installation("postgres") as (_, postgres):
        if postgres is None:
            raise RuntimeError("no Postgres")
        postgres.log_all()
        time.sleep(BEFORE_S)
        log = postgres.folder / "log"
        before = len(log.read_text().splitlines())
        time.sleep(SECONDS)
        entries = Counter(line.partition("LOG:")[2].strip()[:60] for line in log.read_text().splitlines()[before:])
        del entries[""]  # further lines of a statement
        found["postgres_log_entries_per_s"] = round(sum(entries.values()) / SECONDS, 2)
        found["postgres_log_entries"] = dict(entries.most_common())
    with installation("sqlite") as ((server,), _):
        time.sleep(BEFORE_S)
        first = _written(server.process.pid if server.process else 0)
        time.sleep(SECONDS)
        found["sqlite_bytes_written_per_s"] = (_written(server.process.pid if server.process else 0) - first) / SECONDS
    keep("rest", found)


def _written(pid: int) -> int:
    fields = dict(line.split(": ") for line in Path(f"/proc/{pid}/io").read_text().splitlines())
    return int(fields["wchar"])


if __name__ == "__main__":
    main()
