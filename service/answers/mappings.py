"""Channel mappings, and what one makes of a file."""

from typing_extensions import TypedDict

from service.answers.problems import ProblemError
from service.answers.words import Instant, shape


@shape
class MappedChannel(TypedDict):
    """One foreign channel: (sample * scale + offset) in `unit`, brought to the channel's own unit."""

    source: str
    """Name in the file."""
    channel: str
    """Name of ours."""
    unit: str | None
    """Unit of the foreign channel; null: ours already."""
    scale: float
    """Factor on the samples (a number without unit)."""
    offset: float
    """Added after the factor, in `unit`."""
    pressure_reference: str | None
    """`gauge` or `absolute`; null: what the unit or the record says."""


@shape
class CsvDialect(TypedDict):
    """How a file's text is read."""

    delimiter: str
    """Between fields."""
    decimal: str
    """Decimal sign."""
    encoding: str
    """Text encoding."""


@shape
class Mapping(TypedDict):
    """A version of a channel mapping."""

    name: str
    """Its name, for `?mapping=`."""
    operator: str
    """Operator that it belongs to."""
    version: int
    """Its number (a count)."""
    aircraft_type: str | None
    """Type of aircraft that it is for."""
    description: str
    """What it is for."""
    channels: list[MappedChannel]
    """Rules for channels."""
    metadata: dict[str, str]
    """Foreign name of metadata to the record's own name."""
    defaults: dict[str, str | float]
    """Metadata that the file may lack, in the units that their names end in."""
    csv: CsvDialect | None
    """How to read the file's text; null: as documented."""
    author: str
    """Who stored it."""
    created_at: Instant
    """When it was stored."""


@shape
class RecognisedChannel(TypedDict):
    """A channel of a file that is ours."""

    source: str
    """Name in the file."""
    channel: str
    """Name of ours."""
    unit: str | None
    """Unit that the mapping converts from; null: ours already."""
    samples: int
    """Number of samples (a count)."""


@shape
class MappingPreview(TypedDict):
    """What a channel mapping makes of a file."""

    recognised: list[RecognisedChannel]
    """Channels that are ours."""
    unrecognised: list[str]
    """Names of the file that are kept and not used."""
    missing: list[str]
    """Required channels that are not there."""
    metadata: dict[str, str | float | bool | None]
    """Metadata of the record, in the units that their names end in."""
    unrecognised_metadata: dict[str, object]
    """Foreign metadata, kept as it is."""
    rows: list[dict[str, float | None]]
    """First rows by channel, in the units that the channels' names end in."""
    faults: list[ProblemError]
    """Every fault that an upload would name."""
