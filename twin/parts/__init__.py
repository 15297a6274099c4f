"""One file per pump part: compiled functions of floats, each part with its own physics and nothing else's."""
