"""Every reader on damaged, mixed and made-up files: only problems come out, each within a bound of time and memory.

``python -m benchmarks.fuzz_readers`` writes ``benchmarks/results/fuzz_readers.json``: per format how many inputs were read and
refused, the slowest [s of processor], and by number each one that raised anything but a problem, ended the process, or took
longer than the bound. An input is a function of its number alone. Readers work in a process of its own whose memory is bounded;
it is replaced where an input ends it or holds it up.
"""

import gzip
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from random import Random
from typing import Any

from benchmarks import keep
from benchmarks.watch import mixed_files
from service.errors import Problem
from service.ingest.file_formats import ANY_TYPE, CSV, FORMATS, JSON
from service.ingest.parse import parsed
from service.ingest.raw import Limits, TextDialect

N_INPUTS = 100_000
MOST_S, MOST_BYTES = 2.0, 1 << 30
"""Bounds of one input: seconds of processor, and bytes beyond what the process holds at its start."""
_LIMITS = Limits(50_000_000, 100_000)
_HUNG_S = 60.0
_WORDS = ("time_s", "case_pressure_bar", "0", "1.5", "-1e9", "nan", "N/A", "-", "x", '"', '"a\nb"', "", " ", "é", "1,5", "#",
          "# a: b", "\r", "\n", "\n", "\n", ",", ",", ",", ";", "\t", "{", "}", "[", "]", ":", '"channels"', "null", "\0",
          "9" * 400, "sep=;", "\ufeff", "1_0", "inf", "true", "1.#QNAN")  # fmt: skip
_INTEGERS = (0, 1, 0x7F, 0xFF, 0x7FFFFFFF, 0xFFFFFFFF, 0x80000000, 1 << 40, (1 << 64) - 1)


def seeds() -> dict[str, bytes]:
    """One good file of every format, by suffix."""
    with tempfile.TemporaryDirectory() as folder:
        names = mixed_files(Path(folder), 8, 8)
        return {"".join(Path(name).suffixes): (Path(folder) / name).read_bytes() for name in names}


def input_of(number: int, good: dict[str, bytes]) -> tuple[str, str, bytes, TextDialect | None]:
    """Kind, content type, bytes and dialect of an input."""
    rng = Random(number)  # noqa: S311 - an input by its number
    kind = rng.choice(sorted(good))
    if rng.random() < 0.15:
        kind = rng.choice((".csv", ".json"))
        content = "".join(rng.choice(_WORDS) for _ in range(rng.randint(0, 300))).encode()
    else:
        content = _mutated(good[kind], good, rng)
        if kind == ".csv.gz" and rng.random() < 0.5:
            content = gzip.compress(_mutated(good[".csv"], good, rng), 1)
    named = next((f.content_types[0] for f in FORMATS if kind in f.suffixes), ANY_TYPE)
    content_type = named if rng.random() < 0.7 else rng.choice((ANY_TYPE, CSV.content_types[0], JSON.content_types[0]))
    return kind, content_type, content, _dialect(rng) if rng.random() < 0.3 else None


def _dialect(rng: Random) -> TextDialect:
    return TextDialect(
        delimiter=rng.choice((",", ";", "\t", "|", " ")),
        decimal=rng.choice((".", ",")),
        encoding=rng.choice(("utf-8", "cp1252", "utf-16", "latin-1")),
        thousands=rng.choice(("", "", ",", ".", " ", "'")),
        header_row=rng.choice((None, None, 1, 2, 9, 10_000_000)),
        header_rows=rng.choice((1, 1, 2, 3)),
        no_header=rng.random() < 0.2,
        names=rng.choice(((), (), ("time_s", "x"))),
        units_row=rng.choice((None, None, 2, 8)),
        skip_rows=rng.choice(((), (), (3,), (1, 2, 10_000))),
        comment=rng.choice(("#", "#", "", "//", "0")),
        footer_rows=rng.choice((0, 0, 1, 3)),
        missing=rng.choice(((), ("-9999", "off"))),
    )


def _mutated(content: bytes, good: dict[str, bytes], rng: Random) -> bytes:
    found = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 3, 8))):
        # what says sizes and places stands at the beginning and the end of most formats
        near = rng.choice((len(found), min(512, len(found)), min(4096, len(found))))
        place = rng.randrange(max(1, near))
        place = len(found) - 1 - place if rng.random() < 0.2 else place
        length = rng.choice((1, 4, 16, 256, 4096))
        match rng.randrange(8):
            case 0:
                found[place : place + 1] = bytes([rng.randrange(256)])
            case 1:
                width = rng.choice((1, 2, 4, 8))
                value = rng.choice(_INTEGERS) & ((1 << 8 * width) - 1)
                found[place : place + width] = value.to_bytes(width, rng.choice(("little", "big")))
            case 2:
                del found[place : place + length]
            case 3:
                found[place:place] = found[place : place + length] * rng.choice((1, 2, 50))
            case 4:
                found[place:place] = rng.randbytes(length)
            case 5:
                del found[place:]
            case 6:
                other = good[rng.choice(sorted(good))]
                start = rng.randrange(len(other))
                found[place : place + length] = other[start : start + length]
            case _:
                found[place : place + length] = bytes(length)
        found = found or bytearray(b"\0")
    return bytes(found[:2_000_000])


def worked(first: int, last: int, place: Path) -> None:
    """Read inputs one after the other; a line of JSON for each remarkable one and for what was counted."""
    good = seeds()
    out = os.fdopen(os.dup(1), "w", encoding="utf-8")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)  # what libraries print of damaged files
    os.dup2(nowhere, 2)
    for kind in good:
        parsed(good[kind], ANY_TYPE, "", _LIMITS)  # libraries are imported
    mapped = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (mapped + MOST_BYTES, resource.RLIM_INFINITY))
    counts: Counter[str] = Counter()
    slowest: dict[str, float] = {}
    with place.open("r+b") as at:
        for number in range(first, last):
            kind, content_type, content, dialect = input_of(number, good)
            at.seek(0)
            at.write(b"%-12d" % number)
            at.flush()
            start, what, note = time.process_time(), "read", ""
            try:
                parsed(content, content_type, "", _LIMITS, dialect)
            except Problem:
                what = "refused"
            except BaseException as error:
                what, note = "raised", f"{type(error).__name__}: {error}"[:200]
            seconds = time.process_time() - start
            if seconds > MOST_S and what != "raised":
                note = f"{seconds:.2f} s"
            counts[f"{kind} {what}"] += 1
            slowest[kind] = max(slowest.get(kind, 0.0), seconds)
            if note:
                print(json.dumps({"number": number, "kind": kind, "what": note}), file=out, flush=True)
            if number % 500 == 499 or number == last - 1:
                peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
                tally = {"next": number + 1, "counts": counts, "slowest": slowest, "peak_mib": peak}
                print(json.dumps(tally), file=out, flush=True)
                counts, slowest = Counter(), {}


def fuzzed(n: int, first: int = 0) -> dict[str, Any]:
    """Read ``n`` inputs: counts and everything remarkable."""
    counts: Counter[str] = Counter()
    slowest: dict[str, float] = {}
    remarkable: list[dict[str, Any]] = []
    peak, at, last = 0.0, first, first + n
    with tempfile.NamedTemporaryFile() as place:
        Path(place.name).write_bytes(b" " * 12)
        while at < last:
            command = [sys.executable, "-m", "benchmarks.fuzz_readers", "--work", str(at), str(last), place.name]
            with tempfile.TemporaryFile("w+") as output:
                process = subprocess.Popen(command, stdout=output)  # noqa: S603 - our own
                why = _followed(process, place.name)
                output.seek(0)
                lines = output.read().splitlines()
            for line in lines:
                found = json.loads(line)
                if "next" not in found:
                    remarkable.append(found)
                    continue
                counts.update(found["counts"])
                peak = max(peak, found["peak_mib"])
                for kind, seconds in found["slowest"].items():
                    slowest[kind] = max(slowest.get(kind, 0.0), seconds)
            if process.returncode == 0:
                break
            number = int(Path(place.name).read_bytes())
            kind = input_of(number, seeds())[0]
            remarkable.append(
                {"number": number, "kind": kind, "what": why or f"ended the process ({process.returncode})"}
            )
            at = number + 1
    return {
        "inputs": n,
        "bound_s": MOST_S,
        "bound_mib": MOST_BYTES >> 20,
        "peak_mib": round(peak),
        "counts": dict(sorted(counts.items())),
        "slowest_s": {kind: round(seconds, 3) for kind, seconds in sorted(slowest.items())},
        "remarkable": remarkable,
    }


def _followed(process: "subprocess.Popen[bytes]", place: str) -> str:
    """Wait for a process; why it was killed, empty where it ended by itself."""
    before, since = b"", time.monotonic()
    while process.poll() is None:
        try:
            process.wait(2.0)
        except subprocess.TimeoutExpired:
            now = Path(place).read_bytes()
            if now != before:
                before, since = now, time.monotonic()
            elif time.monotonic() - since > _HUNG_S:
                process.kill()
                process.wait()
                return f"hung for {_HUNG_S:g} s"
    return ""


def main() -> None:
    """Read them all and keep what happened."""
    if "--work" in sys.argv:
        first, last, place = sys.argv[sys.argv.index("--work") + 1 :][:3]
        worked(int(first), int(last), Path(place))
        return
    n = int(sys.argv[1]) if len(sys.argv) > 1 else N_INPUTS
    machine = f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores"
    start = time.monotonic()
    found = fuzzed(n)
    keep("fuzz_readers", {"machine": machine, "seconds": round(time.monotonic() - start), **found})


if __name__ == "__main__":
    main()
