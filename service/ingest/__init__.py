"""Data acquisition: from the bytes of an upload to a checked recording with its metadata."""
