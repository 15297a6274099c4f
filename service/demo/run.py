"""Run the demo: serve, simulate, upload through the API, compare verdicts with the truth."""

import contextlib
import socket
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TypedDict

import uvicorn
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from service.client import Client
from service.demo.fleet import PUMPS, fleet_records, is_right
from service.reports.words import WORDS
from service.settings import Settings
from service.web.app import create_app

START_TIMEOUT_S = 900.0


def free_port(host: str, wanted: int) -> int:
    """``wanted`` if nobody listens there, else a port that is free."""
    with socket.socket() as probe:
        if probe.connect_ex((host, wanted)) != 0:
            return wanted
    with socket.socket() as probe:
        probe.bind((host, 0))
        return int(probe.getsockname()[1])


@contextlib.contextmanager
def served(settings: Settings, host: str, port: int) -> Iterator[str]:
    """Serve the application in a thread while the block runs; gives its address.

    Raises
    ------
    RuntimeError
        when it does not get ready in time.
    """
    config = uvicorn.Config(create_app(settings), host=host, port=port, log_level="warning", access_log=False)
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, name="server", daemon=True)
    thread.start()
    address = f"http://{host}:{port}"
    try:
        with Client(address, retries=0, timeout_s=5.0) as client:
            give_up = time.monotonic() + START_TIMEOUT_S
            while not client.is_ready():
                if time.monotonic() > give_up or not thread.is_alive():
                    raise RuntimeError(f"the server did not get ready on {address}")
                time.sleep(0.1)
        yield address
    finally:
        server.should_exit = True
        thread.join(timeout=10.0)


def upload_fleet(client: Client, n_flights: int, seed: int, console: Console) -> None:
    """Simulate the fleet and upload every record, with a progress bar."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("flights uploaded", total=n_flights * len(PUMPS))
        for record in fleet_records(n_flights, seed):
            client.upload(record.content, metadata={"operator": operator_of(n_flights, seed)})
            progress.advance(task)


def write_fleet(folder: Path, n_flights: int, seed: int) -> int:
    """Write the fleet's flight records as CSV files, one folder per pump; gives their number."""
    n_files = 0
    for record in fleet_records(n_flights, seed):
        path = folder / record.pump.serial / f"{record.flight_id}.csv"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(record.content)
        n_files += 1
    return n_files


def operator_of(n_flights: int, seed: int) -> str:
    """Operator whose name tells one simulated fleet from another: both may be tried on one database.

    The pump's code belongs to it: another release simulates the same flights with other samples, which the service would refuse.
    """
    from twin.sources import package_hash  # noqa: PLC0415 - only the demo asks for it

    return f"demo-{seed}-{n_flights}-{package_hash('twin')[:6]}"


class Compared(TypedDict):
    """A pump's verdict beside its truth in words; the probability is that of the verdict's state (a share, 0 to 1)."""

    serial: str
    aircraft: str
    position: str
    truth: str
    state: str
    candidates: list[str]
    side: str
    probability: float
    agrees: bool


def compared(client: Client, operator: str) -> list[Compared]:
    """Every pump's verdict beside the truth; a pump agrees when its verdict is right for what it is."""
    rows: list[Compared] = []
    for pump in PUMPS:
        verdict = client.verdict(pump.serial, operator)
        rows.append(
            {
                "serial": pump.serial,
                "aircraft": pump.aircraft,
                "position": pump.position,
                "truth": pump.truth.words,
                "state": verdict["state"],
                "candidates": verdict["candidates"],
                "side": verdict["side"],
                "probability": verdict["confidence"],
                "agrees": bool(is_right(pump.truth, verdict)),
            }
        )
    return rows


def is_good(rows: Sequence[Compared]) -> bool:
    """True when no healthy pump is accused and all others are right."""
    return all(row["agrees"] for row in rows)


def table_of(rows: Sequence[Compared]) -> Table:
    """Verdicts beside the truth as a table."""
    table = Table(title="Verdicts beside the truth")
    for heading in ("pump", "where", "truth", "verdict", "side", "probability", "agrees"):
        table.add_column(heading)
    for row in rows:
        words = WORDS[row["state"]]
        if row["candidates"]:
            words += ": " + " or ".join(WORDS[c].lower() for c in row["candidates"])
        where = f"{row['aircraft']} {row['position']}"
        agrees = "yes" if row["agrees"] else "NO"
        table.add_row(row["serial"], where, row["truth"], words, row["side"], f"{row['probability']:.2f}", agrees)
    return table
