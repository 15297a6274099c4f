"""The casedrain service: ingest, storage, monitoring, HTTP API, pages and command line."""
