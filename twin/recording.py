"""A recording: equally long channels over time, measured or simulated, the same type for both."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

TIME = "time_s"
REQUIRED_CHANNELS: tuple[str, ...] = (
    TIME,
    "discharge_pressure_bar",
    "case_pressure_bar",
    "shaft_speed_rpm",
    "fluid_temperature_degc",
)
MAY_LACK: tuple[str, ...] = REQUIRED_CHANNELS[1:]
"""Channels that a pump type may declare its records to lack."""
OPTIONAL_CHANNELS: tuple[str, ...] = (
    "reservoir_pressure_bar",
    "case_flow_lpm",
    "discharge_flow_lpm",
    "commanded_flow_lpm",
    "flight_control_activity",
)


@dataclass(frozen=True, slots=True)
class Recording:
    """Channels of one pump over one stretch of time.

    Attributes
    ----------
    channels
        Name to samples, each of shape (n,), ``time_s`` among them; pressures are gauge; a missing sample is
        NaN. The arrays are made read-only.
    attributes
        Anything else that is known about the recording (foreign metadata of a file, a scenario's name).
    flags
        What was mended before the recording could be made (repeated rows, a clock that jumped), a sentence each.
    """

    channels: Mapping[str, NDArray[np.float64]]
    attributes: Mapping[str, str | float] = field(default_factory=dict)
    flags: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if TIME not in self.channels:
            raise ValueError(f"a recording needs the channel {TIME}")
        n = len(self.channels[TIME])
        for name, samples in self.channels.items():
            if samples.shape != (n,):
                raise ValueError(f"channel {name} has shape {samples.shape}, time_s has {n} samples")
            samples.setflags(write=False)

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def time_s(self) -> NDArray[np.float64]:
        """Time from the start of the recording, shape (n,) [s]."""
        return self.channels[TIME]

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        return self.channels[name]

    def __contains__(self, name: object) -> bool:
        return name in self.channels

    def between(self, start_s: float, end_s: float) -> "Recording":
        """Part of the recording with ``start_s <= time < end_s``."""
        first, last = np.searchsorted(self.time_s, (start_s, end_s))
        return Recording({k: v[first:last] for k, v in self.channels.items()}, self.attributes, self.flags)
