"""Channel mappings, and what one makes of a file."""

from typing_extensions import TypedDict

from service.answers.problems import ProblemError
from service.answers.words import Instant, shape


@shape
class MappedChannel(TypedDict):
    """One channel of ours: (sample * scale + offset) in `unit`, brought to the channel's own unit."""

    source: str | None
    """Column of the file; null: a constant or a formula."""
    channel: str
    """Name of ours."""
    unit: str | None
    """Unit of the foreign channel; null: what the file says, else ours already."""
    scale: float
    """Factor on the samples (a number without unit)."""
    offset: float
    """Added after the factor, in `unit`."""
    pressure_reference: str | None
    """`gauge` or `absolute`; null: what the unit or the record says."""
    value: float | None
    """A constant that stands for the channel, in `unit`."""
    formula: str | None
    """Arithmetic over channels of the record, its result in `unit`."""
    table: str | None
    """Pattern of the tables or groups that it is taken from; null: any."""
    delay_s: float
    """How much later than it happened it is recorded [s]."""
    between: str | None
    """`hold` or `linear` between samples that are further apart than the record's; null: nothing."""
    between_s: float
    """How far apart they may be [s]."""


@shape
class MappedTime(TypedDict):
    """Time from instants."""

    source: str | None
    """Column of instants, or of times of day."""
    date: str | None
    """Column of dates."""
    time: str | None
    """Column of times of day."""
    offset: str | None
    """Column of offsets from UTC."""
    format: str | None
    """As strptime reads it, or a count; null: recognised."""
    zone: str | None
    """Zone of instants that name none."""
    day_first: bool | None
    """Whether 02/05/2026 is in May; null: only where it can be nothing else."""
    repeats: str | None
    """`spread` over their step, or `keep`; null: spread where most repeat."""


@shape
class NamePattern(TypedDict):
    """Metadata from the file's name."""

    pattern: str
    """Fields of metadata in braces."""
    zone: str | None
    """Zone of an instant in the name."""


@shape
class CsvDialect(TypedDict):
    """How a file's text is read; lines are counted from 1."""

    delimiter: str
    """Between fields; a blank: runs of blanks."""
    decimal: str
    """Decimal sign."""
    encoding: str
    """Text encoding."""
    thousands: str
    """Between groups of three digits; empty: nothing."""
    header_row: int | None
    """Line of the names (a count); null: the first that is no comment."""
    header_rows: int
    """Lines of the header (a count)."""
    no_header: bool
    """Whether there are no names."""
    names: list[str]
    """Names instead of the header's."""
    units_row: int | None
    """Line of the units (a count)."""
    skip_rows: list[int]
    """Lines that say nothing (counts)."""
    comment: str
    """What a comment begins with."""
    footer_rows: int
    """Lines at the end that are no samples (a count)."""
    missing: list[str]
    """Words for a missing sample."""


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
    constants: dict[str, str | float]
    """Metadata that hold whatever the file says, in the units that their names end in."""
    time: MappedTime | None
    """Time from instants; null: from a channel's rule or as it is."""
    leave_out: list[str]
    """Patterns of columns that are not kept."""
    file_name: NamePattern | None
    """Metadata from the file's name."""
    tables: list[str]
    """Patterns of the tables or groups that are read; empty: all."""
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
class MappingStep(TypedDict):
    """What one part of a mapping did to a file."""

    part: str
    """Part of the mapping."""
    did: str
    """What it did, in words."""


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
    steps: list[MappingStep]
    """What each part of the mapping did."""
    flags: list[str]
    """What was mended, a sentence each."""
    faults: list[ProblemError]
    """Every fault that an upload would name."""
