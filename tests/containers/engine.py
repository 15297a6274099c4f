"""A container engine of our own, with base images made from the distribution's packages: no registry is needed.

What is tested with it: our Dockerfile, its user, health check and start, and the wiring of the compose file. What
is not: the official base images.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
_PACKAGES = ("docker.io", "docker-compose", "mmdebstrap", "iptables")
_POSTGRES_ENTRY = """#!/bin/sh
set -e
export PGDATA=/var/lib/postgresql/data
export PATH=$(echo /usr/lib/postgresql/*/bin):$PATH
mkdir -p "$PGDATA" /run/postgresql && chown -R postgres:postgres /var/lib/postgresql /run/postgresql && chmod 700 "$PGDATA"
if [ ! -s "$PGDATA/PG_VERSION" ]; then
  printf '%s' "$POSTGRES_PASSWORD" > /tmp/pw && chown postgres /tmp/pw
  setpriv --reuid=postgres --regid=postgres --init-groups \
    initdb -D "$PGDATA" -U "$POSTGRES_USER" -E UTF8 --locale=C -A scram-sha-256 --pwfile=/tmp/pw >/dev/null
  rm /tmp/pw
  echo "host all all all scram-sha-256" >> "$PGDATA/pg_hba.conf"
  echo "CREATE DATABASE \\"$POSTGRES_DB\\";" | setpriv --reuid=postgres --regid=postgres --init-groups \
    postgres --single -D "$PGDATA" postgres >/dev/null
fi
exec setpriv --reuid=postgres --regid=postgres --init-groups postgres -D "$PGDATA" -c listen_addresses='*'
"""


class CannotRunHereError(Exception):
    """The machine lacks what an engine needs; raised by the probe only."""


@dataclass(frozen=True)
class Engine:
    """A running engine with the base images of the test in it."""

    environment: Mapping[str, str]

    def docker(self, *words: str, check: bool = True, streams: str = "output") -> str:
        """Run the docker client and return what it printed; with ``both`` streams its complaints too."""
        return self._run(["/usr/bin/docker", *words], check, streams)

    def compose(self, *words: str, check: bool = True) -> str:
        """Run docker-compose with the project's files and return what it printed."""
        files = ["-f", "docker-compose.yml", "-f", "docker-compose.ci.yml", "-p", "casedrain-test"]
        return self._run(["/usr/bin/docker-compose", *files, *words], check)

    def _run(self, command: list[str], check: bool, streams: str = "output") -> str:
        done = subprocess.run(
            command, cwd=ROOT, env=dict(self.environment), capture_output=True, text=True, check=False
        )
        if check and done.returncode != 0:
            raise AssertionError(f"{' '.join(command)} failed:\n{done.stdout[-4000:]}\n{done.stderr[-4000:]}")
        return done.stdout + (done.stderr if streams == "both" else "")


def probe() -> None:
    """Raise ``CannotRunHereError`` with the reason unless an engine can run here."""
    if os.geteuid() != 0:
        raise CannotRunHereError("an engine of our own needs root")
    if shutil.which("apt-get") is None:
        raise CannotRunHereError("the base images are made from Debian's packages, and apt-get is not here")


def install() -> None:
    """Install engine, compose and mmdebstrap where they are missing."""
    needed = ("/usr/sbin/dockerd", "/usr/bin/docker", "/usr/bin/docker-compose", "/usr/bin/mmdebstrap")
    if all(Path(path).exists() for path in needed) and shutil.which("iptables"):
        return
    wait = ("-o", "DPkg::Lock::Timeout=300")
    subprocess.run(["apt-get", *wait, "update", "-qq"], check=True)
    command = ["apt-get", *wait, "install", "-y", "-qq", "--no-install-recommends", *_PACKAGES]
    subprocess.run(command, check=True, env={**os.environ, "DEBIAN_FRONTEND": "noninteractive"})


@contextmanager
def engine() -> Iterator[Engine]:
    """Run an engine on a private socket while the block runs; everything of it is gone afterwards."""
    install()
    folder = Path(tempfile.mkdtemp(prefix="cd-engine-"))
    socket = f"unix://{folder}/docker.sock"
    (folder / "daemon.json").write_text(
        json.dumps({"bip": "10.213.0.1/24", "default-address-pools": [{"base": "10.214.0.0/16", "size": 24}]})
    )
    log = (folder / "dockerd.log").open("w")
    daemon = subprocess.Popen(
        [
            "/usr/sbin/dockerd",
            f"--config-file={folder}/daemon.json",
            f"--data-root={folder}/data",
            f"--exec-root={folder}/exec",
            f"--pidfile={folder}/docker.pid",
            "-H",
            socket,
        ],
        stdout=log,
        stderr=log,
    )
    password = {"POSTGRES_PASSWORD": "only-for-this-test", "CASEDRAIN_PORT": "127.0.0.1:18000"}
    running = Engine({**os.environ, "DOCKER_HOST": socket, "DOCKER_BUILDKIT": "0", **password})
    try:
        _wait(running, daemon, folder / "dockerd.log")
        _base_images(running, folder)
        yield running
    finally:
        running.compose("down", "-v", "--remove-orphans", "-t", "5", check=False)
        daemon.terminate()
        try:
            daemon.wait(timeout=60)
        except subprocess.TimeoutExpired:
            daemon.kill()
        log.close()
        _unmount_below(folder)
        shutil.rmtree(folder, ignore_errors=True)


def _wait(running: Engine, daemon: "subprocess.Popen[bytes]", log: Path) -> None:
    for _ in range(150):
        if daemon.poll() is not None:
            break
        if running.docker("info", "--format", "{{.ServerVersion}}", check=False).strip():
            return
        time.sleep(0.2)
    raise AssertionError(f"the engine did not start:\n{log.read_text()[-4000:]}")


def _base_images(running: Engine, folder: Path) -> None:
    """Make the two base images: Python with a wheelhouse, and Postgres with a small entry point."""
    wheels = folder / "wheelhouse"
    download = [sys.executable, "-m", "pip", "download", "-qq", "--only-binary=:all:", "--dest", str(wheels)]
    subprocess.run([*download, "hatchling>=1.27,<2", *_dependencies()], check=True, cwd=folder)
    suite = _suite()
    packages = "python3,python3-venv,python3-pip,python-is-python3,ca-certificates"
    _debootstrap(suite, packages, folder / "python.tar")
    running.docker("import", str(folder / "python.tar"), "ci-python-bare:latest")
    context = folder / "python"
    context.mkdir()
    shutil.move(str(wheels), context / "wheelhouse")
    (context / "pip.conf").write_text("[global]\nno-index = true\nfind-links = /wheelhouse\n")
    (context / "Dockerfile").write_text(
        "FROM ci-python-bare:latest\nCOPY wheelhouse /wheelhouse\nCOPY pip.conf /etc/pip.conf\n"
        "RUN rm -f /usr/lib/python3*/EXTERNALLY-MANAGED\n"
    )
    running.docker("build", "-q", "-t", "ci-python:latest", str(context))
    _debootstrap(suite, "postgresql", folder / "postgres.tar")
    running.docker("import", str(folder / "postgres.tar"), "ci-postgres-bare:latest")
    context = folder / "postgres"
    context.mkdir()
    (context / "entry.sh").write_text(_POSTGRES_ENTRY)
    (context / "Dockerfile").write_text(
        "FROM ci-postgres-bare:latest\nCOPY entry.sh /entry.sh\nRUN chmod +x /entry.sh\n"
        "RUN ln -sf /usr/lib/postgresql/*/bin/pg_isready /usr/local/bin/pg_isready\n"
        'ENTRYPOINT ["/entry.sh"]\n'
    )
    running.docker("build", "-q", "-t", "ci-postgres:latest", str(context))


def _dependencies() -> list[str]:
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    return list(project["dependencies"])


def _suite() -> str:
    for line in Path("/etc/os-release").read_text().splitlines():
        if line.startswith("VERSION_CODENAME="):
            return line.partition("=")[2].strip('"')
    raise AssertionError("this distribution does not say its codename")


def _debootstrap(suite: str, packages: str, target: Path) -> None:
    command = ["mmdebstrap", "--quiet", "--variant=minbase", f"--include={packages}", suite, str(target)]
    sources = Path("/etc/apt/sources.list")
    if sources.exists() and sources.read_text().strip():
        command.append(str(sources))
    subprocess.run(command, check=True)


def _unmount_below(folder: Path) -> None:
    mounts = [line.split()[1] for line in Path("/proc/mounts").read_text().splitlines()]
    for mount in sorted((m for m in mounts if m.startswith(str(folder))), reverse=True):
        subprocess.run(["umount", "-l", mount], check=False)
