"""Rival explanations, each followed by a filter of its own (ISO 13374: state detection)."""
