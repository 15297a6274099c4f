"""Runs the commands of docs/api.md in a real shell; with ``--write`` the outputs in it are recorded anew."""

import math
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

ROOT = Path(__file__).resolve().parent.parent
DOCUMENT = ROOT / "docs" / "api.md"
_BLOCK = re.compile(r"^```console\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_WRITTEN_PORT = "8000"
_END = "---end-of-command---"
COMPILE_CACHE = "CASEDRAIN_COMPILE_CACHE"
"""The one setting of ours that a reader's shell keeps: where kernels lie changes no output."""
_LONGEST_S = 120.0
"""The first start on a machine compiles the twin."""
_SECRETS_AND_IDS = (
    (re.compile(r"\bcd_[A-Za-z0-9_-]{20,}"), "cd_…"),
    (re.compile(r"\bwhsec_[A-Za-z0-9+/=]{20,}"), "whsec_…"),
    (re.compile(r"\b[0-9a-f]{8}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{12}\b|\b[0-9a-f]{32,64}\b"), "<id>"),
    # event times have whole seconds; an instant of this run has a fraction
    (re.compile(r"\b\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d+(?:Z|\+00:00)"), "<now>"),
    (re.compile(r"\b(h225[a-z0-9-]*?)-[0-9a-f]{8}-[0-9a-f]{8}\b"), r"\1-…"),
)
_NUMBER = re.compile(r"(?<![\w.-])-?\d+\.\d+(?:e[-+]?\d+)?(?![\w.:])")


@dataclass
class Step:
    """One command of the document with the output that is written under it."""

    command: str
    output: str


def steps(text: str) -> list[list[Step]]:
    """Commands and outputs of every ``console`` block; a command goes on over lines that start with ``> ``."""
    return [_steps_of(block) for block in _BLOCK.findall(text)]


def _steps_of(block: str) -> list[Step]:
    found: list[Step] = []
    for line in block.splitlines():
        if line.startswith("$ "):
            found.append(Step(line[2:], ""))
        elif line.startswith("> ") and found and not found[-1].output:
            found[-1].command += "\n" + line[2:]
        elif found:
            found[-1].output += line + "\n"
        else:
            raise ValueError(f"a block starts with output: {line!r}")
    return found


def normalised(output: str, folder: Path, port: int) -> str:
    """An output with placeholders for what differs between runs; decimal numbers keep three significant digits."""
    output = output.replace(str(folder), "").replace(f":{port}", f":{_WRITTEN_PORT}")
    for pattern, word in _SECRETS_AND_IDS:
        output = pattern.sub(word, output)
    return _NUMBER.sub(lambda match: _rounded(float(match.group())), output)


def _rounded(number: float) -> str:
    """Three significant digits, without an exponent where a reader expects none."""
    if number == 0.0 or not 1e-4 <= abs(number) < 1e6:
        return f"{number:.3g}"
    return f"{number:.{max(2 - math.floor(math.log10(abs(number))), 0)}f}"


def outputs(blocks: list[list[Step]], folder: Path) -> Iterator[str]:
    """Run every command in one shell in an empty folder, as a reader would; gives the normalised outputs in order.

    Raises
    ------
    RuntimeError
        when the shell ends before the last command.
    """
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    programs = folder.parent / f"{folder.name}-programs"
    programs.mkdir()
    shim = programs / "casedrain"
    shim.write_text(f'#!/bin/sh\nexec "{sys.executable}" -c "from service.command_line.main import app; app()" "$@"\n')
    shim.chmod(0o755)
    kept = {k: v for k, v in os.environ.items() if not k.startswith("CASEDRAIN_") or k == COMPILE_CACHE}
    environment = kept | {
        "PATH": f"{programs}:{Path(sys.executable).parent}:{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "COLUMNS": "120",
        "TERM": "dumb",
        "NO_COLOR": "1",
    }
    shell = subprocess.Popen(
        ["bash", "--noprofile", "--norc"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        cwd=folder,
        env=environment,
        text=True,
        start_new_session=True,
    )
    assert shell.stdin is not None
    assert shell.stdout is not None
    try:
        for step in (step for block in blocks for step in block):
            command = step.command.replace(_WRITTEN_PORT, str(port))
            shell.stdin.write(f"{command}\necho {_END}\n")
            shell.stdin.flush()
            output = _said(shell, shell.stdout, step.command)
            yield normalised(output if not output or output.endswith("\n") else output + "\n", folder, port)
    finally:
        shell.stdin.close()
        try:
            shell.wait(timeout=20)
        finally:
            # the server that the document leaves running, if a command before its stop failed
            _end_group(shell.pid)
            shell.stdout.close()


def _said(shell: subprocess.Popen[str], stdout: IO[str], command: str) -> str:
    """What a command prints until it ends."""
    watchdog = threading.Timer(_LONGEST_S, _end_group, (shell.pid,))
    watchdog.start()
    lines = []
    try:
        for line in stdout:
            before, end, _ = line.partition(_END)
            lines.append(before)
            if end:
                return "".join(lines)
    finally:
        watchdog.cancel()
    raise RuntimeError(f"the shell ended in: {command}\n{''.join(lines)}")


def _end_group(leader: int) -> None:
    try:
        os.killpg(leader, signal.SIGKILL)
    except ProcessLookupError:
        return


def rewritten(text: str, found: list[str]) -> str:
    """The document with these outputs in place of its own."""
    queue = iter(found)

    def block(match: re.Match[str]) -> str:
        lines = ["$ " + step.command.replace("\n", "\n> ") + "\n" + next(queue) for step in _steps_of(match.group(1))]
        return "```console\n" + "".join(lines) + "```"

    return _BLOCK.sub(block, text)


def main() -> int:
    """Print every command with its output; with ``--write`` put the outputs into the document."""
    text, found = DOCUMENT.read_text(encoding="utf-8"), []
    blocks = steps(text)
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "day"
        folder.mkdir()
        flat = [step for block in blocks for step in block]
        for step, output in zip(flat, outputs(blocks, folder), strict=True):
            found.append(output)
            print(f"$ {step.command}\n{output}", end="", flush=True)
    if "--write" in sys.argv[1:]:
        DOCUMENT.write_text(rewritten(text, found), encoding="utf-8")
        return 0
    return int(rewritten(text, found) != text)


if __name__ == "__main__":
    sys.exit(main())
