"""Server-rendered pages: quiet, printable, usable by keyboard and without colour, no script."""
