"""Server-rendered pages: quiet, printable, usable by keyboard and without colour, one small script for charts."""
