"""Identity of a parameter set: a hash over the numbers of a pump type and of the circuits around it."""

import hashlib
from collections.abc import Mapping

from twin.parameters import PumpType, Quantity
from twin.pumps.circuits import CIRCUIT_QUANTITIES

_HEX = 8


def numbers_hash(pump: PumpType) -> str:
    """Hash over every number of a pump type: laws, limits, spreads, sensors and nominal values.

    Its name, title and the sources of its numbers are no part of it: a copy under another name has the same.

    Returns
    -------
    str
        8 hexadecimal digits, the same on every machine.
    """
    digest = hashlib.sha256()
    groups: tuple[Mapping[str, Quantity], ...] = (
        pump.quantities,
        pump.limits,
        pump.population,
        *CIRCUIT_QUANTITIES.values(),
    )
    for group in groups:
        for name in sorted(group):
            digest.update(f"{name}={group[name].value!r} {group[name].unit} {group[name].uncertainty!r};".encode())
    for channel in sorted(pump.sensors):
        digest.update(f"{channel}={pump.sensors[channel]!r};".encode())
    digest.update(f"nominal {pump.nominal_speed_rpm!r} rpm {pump.nominal_reservoir_pressure_bar!r} bar".encode())
    if pump.lacks or not pump.own_twin:
        digest.update(f"lacks {sorted(pump.lacks)!r} own twin {pump.own_twin!r}".encode())
    return digest.hexdigest()[:_HEX]
