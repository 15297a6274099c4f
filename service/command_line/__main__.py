"""``python -m service.command_line``: the command line where no script is installed."""

from service.command_line.main import app

app(prog_name="casedrain")
