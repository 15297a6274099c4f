"""A recording of a pump type that lacks channels: what stands in for them, and what is simply not there.

Conditions that nobody records are taken as the type's nominal ones, so that windows can be looked for; a pressure that
nobody records is NaN throughout and never judged.
"""

from collections.abc import Mapping

import numpy as np

from twin.parameters import PumpType
from twin.recording import REQUIRED_CHANNELS, Recording
from twin.units import KELVIN_AT_0_DEGC

_WORDS: Mapping[str, str] = {
    "shaft_speed_rpm": "shaft speed is not recorded: the pump type's {:g} rpm stand in",
    "fluid_temperature_degc": "fluid temperature is not recorded: the pump type's {:g} degC stand in",
    "discharge_pressure_bar": "discharge pressure is not recorded",
    "case_pressure_bar": "case pressure is not recorded",
}


def with_stand_ins(recording: Recording, pump: PumpType) -> Recording:
    """The recording with every channel that its type lacks and it does not hold; says so in its flags."""
    missing = [name for name in pump.lacks if name not in recording]
    if not missing:
        return recording
    known = {
        "shaft_speed_rpm": pump.nominal_speed_rpm,
        "fluid_temperature_degc": pump.limits["reference_temperature_k"].value - KELVIN_AT_0_DEGC,
    }
    channels = dict(recording.channels)
    for name in missing:
        channels[name] = np.full(len(recording), known.get(name, np.nan))
    flags = (*recording.flags, *(_WORDS[name].format(known.get(name, np.nan)) for name in missing))
    return Recording(channels, recording.attributes, flags)


def fitted_channels(pump: PumpType) -> tuple[str, ...]:
    """Required channels, time apart, that records of the type hold or that something stands in for."""
    absent = {"discharge_pressure_bar", "case_pressure_bar"}.intersection(pump.lacks)
    return tuple(name for name in REQUIRED_CHANNELS[1:] if name not in absent)
