"""From a recording to evidence: zero, windows, residuals, state, isolation, damage identification curve.

Imports ``twin`` and never ``service``; touches no file, network or database.
"""
