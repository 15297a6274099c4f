"""The transient pump: every chamber, slipper, compensator, swashplate, drive and circuit over time.

``simulate`` runs a ``Scenario`` and gives a ``Run``; ``scenario``, ``run`` and ``means`` are the typed shell, the
other files are kernels.
"""
