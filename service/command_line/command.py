"""Commands: logs go to the error stream as soon as one runs, and are not loaded for its help."""

import sys
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from service.command_line.console import failure, say_json
from service.command_line.failures import WRONG_SETTING, words_of


class Commands(TyperGroup):
    """All commands; the version is told before options are read, which loads more than it needs."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Take the options before the command."""
        if "--version" in args and set(args) <= {"--version", "--json"}:
            tell_version("--json" in args)
            ctx.exit()
        return super().parse_args(ctx, args)


def tell_version(as_json: bool) -> None:
    """Print release and commit; as JSON also the hash over the sources."""
    from service.identity import in_words, software  # noqa: PLC0415 - only here is git asked and code hashed

    if as_json:
        say_json(software().to_json())
    else:
        typer.echo(in_words())


class Command(TyperCommand):
    """Sets the logs up before it runs; what the settings, the database or a disk
    do not allow is said in one line.
    """

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        _set_logs_up()
        try:
            return super().invoke(ctx)
        except BrokenPipeError:  # nobody reads on: no fault
            raise
        except OSError as error:
            raise failure(str(error)) from None
        except Exception as error:
            words = words_of(error)
            if words is None:
                raise
            raise failure(words, WRONG_SETTING) from None


def _set_logs_up() -> None:
    import structlog  # noqa: PLC0415 - slow, and no help needs it

    structlog.configure(
        processors=[
            structlog.contextvars.merge_contextvars,
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.format_exc_info,
            structlog.processors.JSONRenderer(),
        ],
        # asked for at every call: a test or a supervisor may have put another stream in its place
        logger_factory=lambda *_: structlog.PrintLogger(sys.stderr),
    )
