"""The casedrain service: ingest, storage, monitoring, HTTP API, pages and command line."""

__version__ = "1.1.0"
