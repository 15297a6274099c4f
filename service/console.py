"""What the command line prints on: results on one stream, complaints and progress on the other."""

import typer
from rich.console import Console
from rich.text import Text

console = Console()
complaints = Console(stderr=True)


def failure(words: str, code: int = 1) -> typer.Exit:
    """Say what is wrong; the exit to raise."""
    complaints.print("[bold red]error:[/]", Text(words), highlight=False, soft_wrap=True)
    return typer.Exit(code)
