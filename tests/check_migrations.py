"""`alembic upgrade head && alembic check` on a fresh SQLite file and on a fresh Postgres cluster."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from tests.postgres import binary, cluster, create_database

ROOT = Path(__file__).resolve().parent.parent


def check(url: str) -> None:
    """Upgrade and check one database; raises when tables and migrations differ."""
    environment = {**os.environ, "CASEDRAIN_DATABASE_URL": url}
    for words in (("upgrade", "head"), ("check",), ("downgrade", "base"), ("upgrade", "head")):
        subprocess.run([sys.executable, "-m", "alembic", *words], check=True, cwd=ROOT, env=environment)


def main() -> int:
    """Check both databases; a missing Postgres is an error where REQUIRE_POSTGRES is set."""
    with tempfile.TemporaryDirectory() as folder:
        print("SQLite:", flush=True)
        check(f"sqlite:///{folder}/check.sqlite")
    if binary("initdb") is None:
        print("SKIPPED: Postgres, its binaries (initdb, postgres) are not installed", flush=True)
        return 1 if os.environ.get("REQUIRE_POSTGRES") else 0
    with cluster() as url:
        print("Postgres:", flush=True)
        check(create_database(url, "check"))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
