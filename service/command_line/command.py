"""A command: logs go to the error stream as soon as one runs, and are not loaded for its help."""

import sys
from typing import Any

from typer.core import TyperCommand

from service.command_line.console import failure


class Command(TyperCommand):
    """Sets the logs up before it runs; a folder that cannot be written or a full disk is said in one line."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        _set_logs_up()
        try:
            return super().invoke(ctx)
        except BrokenPipeError:  # nobody reads on: no fault
            raise
        except OSError as error:
            raise failure(str(error)) from None


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
