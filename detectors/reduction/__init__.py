"""From a recording to its zero, windows, lines and steps (ISO 13374: data manipulation)."""
