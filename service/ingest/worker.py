"""The process that parses what came from outside, under limits of its own: one request a line, one answer a line.

Started by ``ParserPool`` as ``python -m service.ingest.worker``. It imports no database and no compiled physics, and
hands the channels over as a file of float64, so that neither side copies them through a pipe.
"""

import json
import os
import resource
import signal
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from service.answers.documents import JsonObject
from service.errors import Fault, Problem, StorageFull, TooLarge
from service.ingest.archive_index import write_index
from service.ingest.parse import parsed
from service.ingest.raw import ForeignMetadata, Limits, RawFile, Samples, TextDialect
from service.ingest.worker_words import Answer, ArchiveAsked, Column, FileAsked, FileSaid, Refused, TableSaid

_NICENESS = 10
"""Files are read in the time that answers leave: a reader of others' slow files held every read up for as long as it ran."""
_SCALARS = (str, int, float, bool, type(None))


def main() -> None:
    """Serve requests until standard input ends, as it does with the server; a stop that reaches all processes ends nothing here."""
    for stop in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(stop, signal.SIG_IGN)
    os.nice(_NICENESS)
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what a library prints must not look like an answer
    print(json.dumps({"ready": True}), file=answers, flush=True)
    for line in sys.stdin:
        print(json.dumps(_answer(json.loads(line))), file=answers, flush=True)


def _answer(request: FileAsked | ArchiveAsked) -> Answer:
    _limit_memory(request["memory_bytes"])
    if "archive" in request:
        return _indexed(cast("ArchiveAsked", request))
    return _read(request)


def _read(request: FileAsked) -> Answer:
    limits = Limits(**request["limits"])
    try:
        content = Path(request["path"]).read_bytes()
        dialect = _dialect(request["dialect"])
        raw = parsed(content, request["content_type"], request["content_encoding"], limits, dialect)
    except Problem as problem:
        return _refused(problem)
    except MemoryError:
        return {"problem": TooLarge.__name__, "memory": True}
    try:
        return _handed_over(raw if request["with_texts"] else _without_words(raw), Path(request["output"]))
    except OSError as failed:
        return _full("the channels", failed)


def _indexed(request: ArchiveAsked) -> Answer:
    try:
        return {"members": write_index(Path(request["path"]), request["archive"], Path(request["output"]))}
    except Problem as problem:
        return _refused(problem)
    except MemoryError:
        return {"problem": TooLarge.__name__, "memory": True}
    except OSError as failed:
        return _full("the index", failed)


def _refused(problem: Problem) -> Refused:
    return {"problem": type(problem).__name__, "detail": problem.detail, "errors": _faults(problem.errors)}


def _full(what: str, failed: OSError) -> Refused:
    # NumPy's own says neither number nor name of what the disk said; nothing else stops a file of ours
    return {"problem": StorageFull.__name__, "detail": f"{what} cannot be handed over: {failed}", "errors": []}


def _without_words(raw: RawFile) -> RawFile:
    tables = tuple(replace(table, texts={name: [] for name in table.texts}) for table in raw.tables)
    return replace(raw, tables=tables)


def _dialect(request: JsonObject | None) -> TextDialect | None:
    if request is None:
        return None
    fields: JsonObject = {name: tuple(v) if isinstance(v, list) else v for name, v in request.items()}
    return TextDialect(**fields)


def _limit_memory(allowed: int) -> None:
    """Bound what this request may add to what the process has mapped already."""
    mapped = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (mapped + allowed, hard))


def _handed_over(file: RawFile, output: Path) -> FileSaid:
    with output.open("wb") as numbers:

        def kept(columns: Mapping[str, Samples]) -> list[Column]:
            for samples in columns.values():
                np.ascontiguousarray(samples, dtype=np.float64).tofile(numbers)
            return [(str(name), len(samples)) for name, samples in columns.items()]

        tables: list[TableSaid] = [
            {
                "channels": kept(table.channels),
                "time": None if table.time is None else kept({"": table.time})[0],
                "times": kept(table.times),
                "texts": table.texts,
                "name": table.name,
                "start": None if table.start is None else table.start.isoformat(),
                "units": table.units,
                "attributes": _scalars(table.attributes),
            }
            for table in file.tables
        ]
    return {
        "metadata": _scalars(file.metadata),
        "tables": tables,
        "faults": _faults(file.faults),
        "not_kept": file.not_kept,
        "flags": file.flags,
    }


def _scalars(metadata: ForeignMetadata) -> ForeignMetadata:
    return {str(k): v if isinstance(v, _SCALARS) else repr(v)[:200] for k, v in metadata.items()}


def _faults(faults: Sequence[Any]) -> list[tuple[str, str]]:
    return [(fault.where, fault.problem) for fault in faults if isinstance(fault, Fault)]


if __name__ == "__main__":
    main()
