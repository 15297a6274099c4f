"""A Postgres cluster of our own for tests, on a socket in a temporary folder, run by an unprivileged user."""

import glob
import os
import pwd
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


def binary(name: str) -> str | None:
    """Path of a Postgres program: from the PATH, or from where Debian keeps them."""
    found = shutil.which(name)
    if found:
        return found
    installed = sorted(glob.glob(f"/usr/lib/postgresql/*/bin/{name}"))
    return installed[-1] if installed else None


def _as_nobody() -> tuple[list[str], int | None]:
    """Prefix and user for programs that refuse to run as root."""
    if os.geteuid() != 0:
        return [], None
    user = pwd.getpwnam("nobody")
    return ["setpriv", f"--reuid={user.pw_uid}", f"--regid={user.pw_gid}", "--clear-groups"], user.pw_uid


@contextmanager
def cluster() -> Iterator[str]:
    """Run a cluster while the block runs; gives a URL without the database's name, to append one to.

    Raises
    ------
    RuntimeError
        when the binaries are missing.
    """
    initdb, postgres = binary("initdb"), binary("postgres")
    if initdb is None or postgres is None:
        raise RuntimeError("initdb and postgres are not installed")
    prefix, owner = _as_nobody()
    folder = Path(tempfile.mkdtemp(prefix="cd-pg-"))
    if owner is not None:
        os.chown(folder, owner, -1)
    data, socket = folder / "data", folder
    quiet = {"stdout": subprocess.DEVNULL, "cwd": folder}
    try:
        command = [*prefix, initdb, "-D", str(data), "-U", "casedrain", "-A", "trust", "--no-sync", "-E", "UTF8"]
        subprocess.run([*command, "--locale=C"], check=True, **quiet)  # type: ignore[call-overload]
        options = ["-c", "listen_addresses=", "-k", str(socket), "-c", "fsync=off", "-c", "max_connections=100"]
        server = subprocess.Popen(  # type: ignore[call-overload]
            [*prefix, postgres, "-D", str(data), *options], stderr=subprocess.DEVNULL, **quiet
        )
        try:
            _wait(socket)
            yield f"postgresql+psycopg://casedrain@/{{name}}?host={socket}"
        finally:
            server.send_signal(signal.SIGINT)  # fast: it does not wait for clients
            server.wait(timeout=30)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _wait(socket: Path) -> None:
    import time

    import psycopg

    for _ in range(300):
        try:
            psycopg.connect(f"host={socket} user=casedrain dbname=postgres", connect_timeout=2).close()
        except psycopg.OperationalError:
            time.sleep(0.1)
        else:
            return
    raise RuntimeError("Postgres did not start within 30 s")


def create_database(url: str, name: str, template: str = "template1") -> str:
    """Make a database in the cluster, as a copy of another one that nobody is connected to, and give its URL."""
    import psycopg

    socket = url.partition("host=")[2]
    with psycopg.connect(f"host={socket} user=casedrain dbname=postgres", autocommit=True) as connection:
        connection.execute(f'CREATE DATABASE "{name}" TEMPLATE "{template}"')  # type: ignore[arg-type]
    return url.format(name=name)


_OTHERS = """
select (select count(*) from pg_stat_activity where datname = current_database() and pid <> pg_backend_pid()
          and backend_type = 'client backend')
     + (select count(*) from pg_namespace where nspname !~ '^pg_' and nspname not in ('public', 'information_schema'))
"""
_TABLES = "select tablename from pg_tables where schemaname = 'public' order by 1"
_RESTARTED = """
select setval(format('public.%I', sequencename)::regclass, start_value, false)
from pg_sequences where schemaname = 'public' and last_value is not null
"""


class Emptied:
    """Makes a database what it was: rows out, those of the migrated one in. A tenth of what a new database costs.

    ``migrated`` is the URL of a database with all migrations, to which nobody is connected.
    """

    def __init__(self, migrated: str) -> None:
        with _connected(migrated) as connection:
            self._tables = [name for (name,) in connection.execute(_TABLES)]
            self._rows = {name: self._found(connection, name) for name in self._tables}

    def again(self, url: str) -> bool:
        """Whether it could be made so: nobody is connected, it has these tables and this revision, and no schema beside them."""
        with _connected(url) as connection:
            if connection.execute(_OTHERS).fetchone() != (0,):
                return False
            if [name for (name,) in connection.execute(_TABLES)] != self._tables:
                return False
            if self._found(connection, "alembic_version") != self._rows["alembic_version"]:
                return False
            connection.execute("set session_replication_role = replica")
            connection.execute("; ".join(f'delete from "{name}"' for name in self._tables))
            for name, rows in self._rows.items():
                if rows is not None:
                    put = f'insert into "{name}" select * from jsonb_populate_recordset(null::"{name}", %s::jsonb)'
                    connection.execute(put, [rows])
            connection.execute(_RESTARTED)
        return True

    @staticmethod
    def _found(connection: Any, table: str) -> str | None:
        found: str | None = connection.execute(f'select jsonb_agg(t)::text from "{table}" t').fetchone()[0]
        return found


def _connected(url: str) -> Any:
    import psycopg

    return psycopg.connect(url.replace("+psycopg", ""), autocommit=True)
