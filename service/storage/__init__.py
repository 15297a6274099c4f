"""Anything that outlives a process: database, tables, raw bytes, spooled uploads."""
