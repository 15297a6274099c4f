"""What the command line prints on: answers on one stream, complaints and progress on the other.

Neither console reads markup: names, paths and words of files, servers and users are shown as they stand. What is to be
bold or red is said beside the words. In a pipe a line is never wrapped and a table never shortened.
"""

import json
import sys
from typing import Annotated, Any

import typer
from rich.console import Console, ConsoleDimensions
from rich.text import Text

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document instead; its shape stands above.")]
STANDARD_OUTPUT = "-"
"""Name of a file of numbers that stands for the output itself."""
_PIPE = ConsoleDimensions(100_000, 25)
_CONTROLS = {code: "\N{REPLACEMENT CHARACTER}" for code in (*range(32), *range(127, 160)) if chr(code) not in "\n\t"}


class _PlainConsole(Console):
    """Reads no markup; as wide as its lines where nobody looks on."""

    @property
    def size(self) -> ConsoleDimensions:
        isatty = getattr(self.file, "isatty", None)
        return super().size if isatty is not None and isatty() else _PIPE

    @size.setter
    def size(self, new_size: tuple[int, int]) -> None:
        self._width, self._height = new_size


console = _PlainConsole(markup=False, highlight=False, emoji=False)
complaints = _PlainConsole(stderr=True, markup=False, highlight=False, emoji=False)


def shown(words: str) -> str:
    """Foreign text as any stream can print it: no control characters, nothing that is no text."""
    return words.translate(_CONTROLS).encode("utf-8", "replace").decode("utf-8")


def say(*parts: str | tuple[str, str], to: Console = console) -> None:
    """Print one line; a part is words, or words with their style."""
    pieces = [shown(part) if isinstance(part, str) else (shown(part[0]), part[1]) for part in parts]
    to.print(Text.assemble(*pieces), soft_wrap=True)


def say_json(document: Any) -> None:
    """Print a document as the only thing on standard output."""
    sys.stdout.write(json.dumps(document, indent=1, allow_nan=False) + "\n")
    sys.stdout.flush()


def listener(json_: bool) -> Console:
    """Where words for people go: beside the answer, or out of its way."""
    return complaints if json_ else console


def failure(words: str, code: int = 1) -> typer.Exit:
    """Say what is wrong; the exit to raise."""
    say(("error:", "bold red"), f" {words}", to=complaints)
    return typer.Exit(code)
