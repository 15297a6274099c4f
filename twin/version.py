"""Identity of the twin behind a verdict: the model code's number and the parameter set's own hash."""

import hashlib

from twin.parameters import PumpType
from twin.pumps.circuits import CIRCUIT_QUANTITIES

MODEL_NUMBER = 4
"""Raised by hand whenever equations or the judge's built-in priors change what comes out of the same numbers."""


def twin_version(pump: PumpType) -> str:
    """Version of the twin of one pump type, e.g. ``h225-1-5f3c09ab``; the same on every machine."""
    digest = hashlib.sha256()
    groups = (pump.quantities, pump.limits, pump.population, *CIRCUIT_QUANTITIES.values())
    for group in groups:
        for name in sorted(group):
            digest.update(f"{name}={group[name].value!r} {group[name].unit} {group[name].uncertainty!r};".encode())
    return f"{pump.name}-{MODEL_NUMBER}-{digest.hexdigest()[:8]}"
