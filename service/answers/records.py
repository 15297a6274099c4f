"""Records: where they stand, their windows, their spectrum."""

from typing import NotRequired

from typing_extensions import TypedDict

from service.answers.problems import Problem
from service.answers.verdicts import Verdict
from service.answers.words import Instant, State, shape


@shape
class Mean(TypedDict):
    """Mean of a channel over a window, in the unit that the channel's name ends in."""

    mean: float | None
    """Mean as measured, in the channel's unit (bar gauge, rpm, degC, L/min); no zero is taken out."""
    standard_error: float | None
    """One-sigma error of the mean, in the same unit."""


@shape
class Residual(TypedDict):
    """A measured mean beside the twin's value, in the unit that the channel's name ends in."""

    measured: float | None
    """Measured mean without the sensor's zero [bar]."""
    twin: float | None
    """The healthy twin's value at the same condition [bar]."""
    residual: float | None
    """Measured minus twin [bar]."""
    standard_deviation: float | None
    """One-sigma error of the residual [bar]."""


@shape
class ReducedWindow(TypedDict):
    """A stretch of a record and its means."""

    kind: str
    """`pump_off`, `zero_flow` or `constant_flow`."""
    start_s: float
    """Start from the record's own [s]."""
    end_s: float
    """End from the record's start [s]."""
    accepted: bool
    """Whether the analysis uses it."""
    reason: str | None
    """Why not."""
    means: dict[str, Mean]
    """Mean of each channel by its name."""
    scatter_bar: NotRequired[float | None]
    """One sigma of the samples of the discharge pressure [bar]; null where they cannot tell."""
    bridged: NotRequired[str | None]
    """How much of it holds no samples and of which channels, `3 of 120 s bridged: case pressure`; null where none is lost."""
    warming_k_per_min: NotRequired[float | None]
    """How fast the fluid warms about it [K/min]; null where that cannot be told."""


@shape
class Window(ReducedWindow):
    """A stretch of a record, with its means compared with the twin."""

    residuals: dict[str, Residual]
    """Residual of each compared channel by its name; empty where the window is not compared."""


class StoredReduction(TypedDict, total=False):
    """A reduction as it is stored (``detectors.words.observation.Reduction``)."""

    zero: dict[str, float | bool]
    windows: list[ReducedWindow]
    explanation: str | None
    flags: list[str]
    spectrum: dict[str, object] | None
    droop: dict[str, object] | None


@shape
class ChannelSamples(TypedDict):
    """One channel over a stretch of a record."""

    channel: str
    """Name of the channel."""
    unit: str
    """Unit of `value`; `-` for a number without one."""
    missing: int
    """Number of samples of the stretch that are missing (a count)."""
    time_s: list[float]
    """Times from the record's start, rising [s]."""
    value: list[float | None]
    """Sample at each time, in `unit`; null where samples are missing, so that a line breaks there."""


@shape
class TwinValue(TypedDict):
    """The healthy twin's value over one window."""

    channel: str
    """Channel that it stands beside."""
    start_s: float
    """Start of the window [s]."""
    end_s: float
    """End of the window [s]."""
    value: float
    """The twin's value, gauge [bar]."""
    as_measured: float
    """The same with the sensor's zero of this record, so that it lies over the samples, gauge [bar]."""


@shape
class RecordChannels(TypedDict):
    """Channels of a record over a stretch, with what the analysis saw there."""

    record_id: str
    """Id of the record."""
    start_s: float
    """Time of the first sample of the stretch [s]."""
    end_s: float
    """Time of its last sample [s]."""
    samples: int
    """Number of samples of the stretch (a count)."""
    thinned: bool
    """Whether each channel is shown by the lowest and the highest sample of bins of equal time."""
    channels: list[ChannelSamples]
    """Every channel of the file."""
    windows: list[Window]
    """Windows that overlap the stretch, in time order, the rejected ones with their reason."""
    twin: list[TwinValue]
    """The twin's values of the windows that were compared."""


@shape
class Refusal(TypedDict):
    """An upload that was refused at once; nothing of it was kept."""

    id: str
    """Id of the refusal."""
    operator: str
    """Operator that it was sent for."""
    received_at: Instant
    """When it was sent."""
    content_hash: str
    """SHA-256 of its bytes."""
    problem: Problem
    """Why it was refused, with every fault."""


@shape
class Withdrawal(TypedDict):
    """Why a record was withdrawn."""

    reason: str
    """In the words of who did it."""
    author: str
    """Who did it."""


@shape
class RecordSummary(TypedDict):
    """A record in a list."""

    record_id: str
    """Id of the record."""
    status: str
    """`stored`, `analysed`, `refused`, `superseded` or `withdrawn`."""
    operator: str
    """Operator that it belongs to."""
    pump_serial: str | None
    """Serial number of its pump; null until the bytes are decoded."""
    aircraft: str | None
    """Tail or serial number of the helicopter."""
    position: str | None
    """Where the pump sits, for example `LH`."""
    flight_id: str | None
    """The operator's own identifier of the flight."""
    segment: str | None
    """Part of the flight that was recorded separately; null for the main record."""
    started_at: Instant | None
    """Instant of `time_s` = 0."""
    received_at: Instant
    """When it was uploaded."""
    state: State | None
    """State of the verdict right after it; null where it does not count."""
    explanation: str | None
    """Why it adds nothing; null where it adds something, or is not analysed."""
    problem: Problem | None
    """Why it was refused, with every fault; null where it was not."""


@shape
class Record(TypedDict):
    """Where a record stands; once it is analysed with its windows and the verdict right after it."""

    record_id: str
    """Id of the record."""
    status: str
    """`stored`, `analysed`, `refused`, `superseded` or `withdrawn`."""
    operator: str
    """Operator that it belongs to."""
    aircraft: str | None
    """Tail or serial number of the helicopter."""
    position: str | None
    """Where the pump sits, for example `LH`."""
    flight_id: str | None
    """The operator's own identifier of the flight."""
    segment: str | None
    """Part of the flight that was recorded separately; null for the main record."""
    started_at: Instant | None
    """Instant of `time_s` = 0."""
    received_at: Instant
    """When it was uploaded."""
    supersedes: str | None
    """Id of the record that it replaced."""
    ended_at: NotRequired[Instant]
    """When it was superseded or withdrawn."""
    withdrawal: NotRequired[Withdrawal | None]
    """Why it was withdrawn; null where it was superseded."""
    problem: NotRequired[Problem]
    """Why it was refused."""
    waits_for_release: NotRequired[str]
    """Release that has to analyse it: a newer one has analysed others of its pump."""
    pump_serial: NotRequired[str]
    """Serial number of its pump."""
    windows: NotRequired[list[Window]]
    """All windows in time order."""
    explanation: NotRequired[str | None]
    """Why the record adds nothing; null where it adds something."""
    flags: NotRequired[list[str]]
    """Remarks on the record's quality."""
    residuals: NotRequired[dict[str, Residual] | None]
    """Residuals of the last accepted zero-flow window by channel; null where there is none."""
    verdict: NotRequired[Verdict]
    """The verdict right after this record."""


@shape
class SpectralDensity(TypedDict):
    """Power spectral density (Welch)."""

    unit: str
    """Unit of `value`: the channel's, squared, per Hz."""
    frequency_hz: list[float]
    """Frequencies [Hz]."""
    value: list[float]
    """Density at each frequency, in `unit`."""


@shape
class ShaftOrder(TypedDict):
    """Amplitude at a multiple of the shaft's speed."""

    order: int
    """Multiple of the shaft's frequency (a count)."""
    frequency_hz: float
    """Its mean frequency [Hz]."""
    unit: str
    """Unit of amplitude and error: the channel's."""
    amplitude: float | None
    """Amplitude, in `unit`; null where the record is too slow for it."""
    standard_error: float | None
    """One-sigma error of the amplitude, in `unit`."""
    phase_deg: float | None
    """Phase from the start of the stretch [deg]."""
    reason: str | None
    """Why there is no amplitude."""


@shape
class ChannelSpectrum(TypedDict):
    """Density and orders of one channel over a stretch."""

    channel: str
    """Name of the channel."""
    start_s: float
    """Start of the stretch that was used [s]."""
    end_s: float
    """Its end [s]."""
    sample_rate_hz: float
    """Sampling rate [Hz]."""
    shaft_speed_rpm: float
    """Mean shaft speed over the stretch [rpm]."""
    density: SpectralDensity
    """Power spectral density."""
    orders: list[ShaftOrder]
    """Orders 1, n and 2 n of the shaft, n the number of pistons."""


@shape
class Spectrum(ChannelSpectrum):
    """Spectrum of one channel of a record."""

    record_id: str
    """Id of the record."""
