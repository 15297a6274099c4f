"""The inbox's memory: which file was seen in which state and what became of it, in an SQLite file that a crash spares."""

import fcntl
import sqlite3
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, Self

Outcome = Literal["stored", "refused"]
_SCHEMA = """
CREATE TABLE IF NOT EXISTS seen (
    name TEXT PRIMARY KEY, state TEXT NOT NULL, since REAL NOT NULL
);
CREATE TABLE IF NOT EXISTS told (
    name TEXT NOT NULL, state TEXT NOT NULL, outcome TEXT NOT NULL, digest TEXT NOT NULL, record_id TEXT,
    problem TEXT, target TEXT, put_away INTEGER NOT NULL, at TEXT NOT NULL, PRIMARY KEY (name, state)
);
"""


@dataclass(frozen=True, slots=True)
class Entry:
    """What became of a file in one state.

    Attributes
    ----------
    name
        Of the file, from the inbox's folder.
    state
        Size and time of change as they were listed.
    outcome
        ``stored``, now or by an earlier attempt, or ``refused``.
    digest
        SHA-256 of its bytes.
    record_id
        As the service calls it; None for what was refused.
    problem
        Problem document of a refusal as JSON.
    target
        Where the file is moved to; None where files stay.
    put_away
        Whether it has been moved, or stays: what lies there in the same state again is to be sent again.
    """

    name: str
    state: str
    outcome: Outcome
    digest: str
    record_id: str | None
    problem: str | None
    target: str | None
    put_away: bool = False


class Journal:
    """Entries by file and state; each is written whole, and before the file is moved. One process at a time.

    Parameters
    ----------
    path
        File of the journal; its folder is made.

    Raises
    ------
    OSError
        when it cannot be written, or another process works with it.
    """

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self._lock = Path(f"{path}.lock").open("w")  # noqa: SIM115 - held as long as the journal
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._lock.close()
            raise OSError(f"another `casedrain watch` works with the journal {path}") from None
        try:
            self._database = sqlite3.connect(path, timeout=30.0, isolation_level=None)
            self._database.execute("PRAGMA synchronous=FULL")
            self._database.executescript(_SCHEMA)
        except sqlite3.Error as error:
            raise OSError(f"the journal {path} cannot be written: {error}") from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._database.close()
        self._lock.close()

    def steady_since(self, states: dict[str, str], now: float) -> dict[str, float]:
        """When each file was first seen in the state that it is in [s]; files that are gone are forgotten.

        Parameters
        ----------
        states
            State by name, of this look.
        now
            Instant of this look [s].
        """
        rows = self._database.execute("SELECT name, state, since FROM seen").fetchall()
        held = {name: (state, since) for name, state, since in rows}
        # a clock may have been set back
        found = {n: min(held[n][1], now) if n in held and held[n][0] == s else now for n, s in states.items()}
        changed = [(n, states[n], since) for n, since in found.items() if held.get(n) != (states[n], since)]
        gone = [(name,) for name in held if name not in states]
        if changed or gone:
            self._database.execute("BEGIN IMMEDIATE")
            self._database.executemany("INSERT OR REPLACE INTO seen VALUES (?, ?, ?)", changed)
            self._database.executemany("DELETE FROM seen WHERE name = ?", gone)
            self._database.execute("COMMIT")
        return found

    def entry(self, name: str, state: str) -> Entry | None:
        """What became of a file in this state; None: nothing yet."""
        row = self._database.execute(
            "SELECT name, state, outcome, digest, record_id, problem, target, put_away FROM told WHERE name = ? AND state = ?",
            (name, state),
        ).fetchone()
        return _entry(row) if row else None

    def entries(self) -> list[Entry]:
        """Everything that was told, oldest first."""
        query = "SELECT name, state, outcome, digest, record_id, problem, target, put_away FROM told ORDER BY rowid"
        return [_entry(row) for row in self._database.execute(query)]

    def note(self, entry: Entry) -> None:
        """Keep what became of a file; it is on disk when this returns."""
        values = (entry.name, entry.state, entry.outcome, entry.digest, entry.record_id, entry.problem, entry.target)
        at = datetime.now(UTC).isoformat()
        self._database.execute(
            "INSERT OR REPLACE INTO told VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)", (*values, entry.put_away, at)
        )


def _entry(row: tuple[Any, ...]) -> Entry:
    *values, put_away = row
    return replace(Entry(*values), put_away=bool(put_away))
