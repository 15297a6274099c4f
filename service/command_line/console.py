"""What the command line prints on: answers on one stream, complaints and progress on the other.

Neither console reads markup: names, paths and words of files, servers and users are shown as they stand. What is to be
bold or red is said beside the words. In a pipe a line is never wrapped and a table never shortened.
"""

import json
import re
import sys
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:  # slow, and no help needs it
    from rich.console import Console

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document instead; its shape stands above.")]
STANDARD_OUTPUT = "-"
"""Name of a file of numbers that stands for the output itself."""
_TURNS_TEXT_ROUND = (*range(0x202A, 0x202F), *range(0x2066, 0x206A))
_FOREIGN = {*range(32), *range(127, 160), 0x2028, 0x2029, *_TURNS_TEXT_ROUND} - set(map(ord, "\n\t"))
_CONTROLS = dict.fromkeys(_FOREIGN, "\N{REPLACEMENT CHARACTER}")
_FOREIGN_BREAK = re.compile(r"\n(?!  )")


@cache
def console() -> "Console":
    """Standard output."""
    from service.command_line.plain_console import PlainConsole  # noqa: PLC0415

    return PlainConsole()


@cache
def complaints() -> "Console":
    """Standard error."""
    from service.command_line.plain_console import PlainConsole  # noqa: PLC0415

    return PlainConsole(stderr=True)


def shown(words: str) -> str:
    """Foreign text as any stream can print it: no control characters, nothing that is no text.

    Our own further lines are indented. A break before anything else came with a name, which could make itself look like
    an answer on a line of its own.
    """
    one_line = _FOREIGN_BREAK.sub("\N{REPLACEMENT CHARACTER}", words)
    return one_line.translate(_CONTROLS).encode("utf-8", "replace").decode("utf-8")


def say(*parts: str | tuple[str, str], to: "Console | None" = None) -> None:
    """Print one line; a part is words, or words with their style."""
    from rich.text import Text  # noqa: PLC0415

    pieces = [shown(part) if isinstance(part, str) else (shown(part[0]), part[1]) for part in parts]
    (to or console()).print(Text.assemble(*pieces), soft_wrap=True)


def say_json(document: Any) -> None:
    """Print a document as the only thing on standard output."""
    sys.stdout.write(json.dumps(document, indent=1, allow_nan=False) + "\n")
    sys.stdout.flush()


def listener(json_: bool) -> "Console":
    """Where words for people go: beside the answer, or out of its way."""
    return complaints() if json_ else console()


def failure(words: str, code: int = 1) -> typer.Exit:
    """Say what is wrong; the exit to raise."""
    say(("error:", "bold red"), f" {words}", to=complaints())
    return typer.Exit(code)
