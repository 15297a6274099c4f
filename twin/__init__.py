"""The simulated pump: laws, parts, parameter sets and the steady operating point.

Imports nothing from ``detectors`` or ``service``; see ``docs/architecture.md``.
"""
