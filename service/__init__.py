"""The casedrain service: ingest, storage, monitoring, HTTP API, pages and command line."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("casedrain")
except PackageNotFoundError:  # a checkout that was never installed
    __version__ = "0"
