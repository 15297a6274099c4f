"""Channel mappings: all that brings an operator's own export to a flight record, as one document that is checked as a whole."""

from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, field_validator, model_validator
from pydantic.config import JsonDict

from service.answers.documents import JsonObject
from service.bodies import Body
from service.ingest.conversion import Conversion, conversion
from service.ingest.csv_rule import CsvRule
from service.ingest.file_names import NamePattern
from service.ingest.formulas import LONGEST, Formula
from service.ingest.instants import EPOCHS, SERIALS, Reading
from service.ingest.metadata import KNOWN
from service.ingest.raw import TextDialect
from service.ingest.zones import zone_of
from twin.recording import OPTIONAL_CHANNELS, REQUIRED_CHANNELS, TIME

CHANNELS: tuple[str, ...] = (*REQUIRED_CHANNELS, *OPTIONAL_CHANNELS)
_MOST_CHANNELS = 500
Name = Annotated[str, Field(min_length=1, max_length=200)]
_EXAMPLE_OF_TIME: JsonDict = {"date": "Lcl Date", "time": "Lcl Time", "offset": "UTCOfst"}


class ChannelRule(Body):
    """One channel of ours: from a column, a constant ``value`` or a ``formula``, as ``(sample * scale + offset)`` in ``unit``."""

    model_config = ConfigDict(frozen=True)
    source: Name | None = Field(default=None, description="Column of the file; by its number where it has no header")
    channel: Name
    unit: str | None = Field(
        default=None, max_length=50, description="Unit of the source; none: what the file says, else ours already"
    )
    scale: float = 1.0
    offset: float = 0.0
    pressure_reference: Literal["gauge", "absolute"] | None = None
    value: float | None = Field(default=None, description="A constant that stands for the channel, in `unit`")
    formula: str | None = Field(
        default=None,
        max_length=LONGEST,
        description="Arithmetic over channels of the record (ours by our names), evaluated on the one time base",
        examples=["{HYD1 P} - {HYD1 R}", "max(p1, p2) * 0.1"],
    )
    table: Name | None = Field(default=None, description="Only from tables or groups whose name matches, as in `HYD1*`")
    delay_s: float = Field(
        default=0.0, ge=-600.0, le=600.0, description="How much later than it happened it is recorded [s]"
    )
    between: Literal["hold", "linear"] | None = Field(
        default=None, description="What stands between samples that are further apart than the record's; none: nothing"
    )
    between_s: float = Field(default=10.0, gt=0.0, le=600.0, description="How far apart they may be [s]")

    @model_validator(mode="after")
    def _makes_sense(self) -> "ChannelRule":
        if self.channel not in CHANNELS:
            raise ValueError(f"there is no channel {self.channel!r}; known: {', '.join(CHANNELS)}")
        given = [n for n in ("source", "value", "formula") if getattr(self, n) is not None]
        if len(given) != 1:
            raise ValueError(
                f"a channel comes from one of source, value, formula, not from {' and '.join(given) or 'none'}"
            )
        if self.channel == TIME and (self.source is None or self.delay_s or self.between):
            raise ValueError("time_s comes from a column or from the mapping's `time`, and is not delayed")
        if self.table is not None and self.source is None:
            raise ValueError("a table says where a source is: a constant or a formula has none")
        if self.scale == 0.0:
            raise ValueError("a scale of 0 makes every sample the same: give a constant as `value`")
        if self.pressure_reference is not None and not self.channel.endswith("_pressure_bar"):
            raise ValueError(f"{self.channel} is no pressure and has no pressure reference")
        found = self.conversion  # raises for a unit that cannot become the channel's
        if None not in (found.reference, self.pressure_reference) and found.reference != self.pressure_reference:
            raise ValueError(f"the unit {self.unit} is {found.reference}, the rule says {self.pressure_reference}")
        if self.formula is not None:
            Formula(self.formula)
        return self

    @property
    def conversion(self) -> Conversion:
        """From the foreign unit to the channel's own."""
        return conversion(self.unit, self.channel)

    @property
    def reference(self) -> str | None:
        """Reference of a pressure, said by the rule or by its unit (psia, barg); None: the record's."""
        return self.pressure_reference or self.conversion.reference

    @property
    def origin(self) -> str:
        """What the channel comes from, in words."""
        if self.source is not None:
            return self.source if self.table is None else f"{self.source} of {self.table}"
        return f"the constant {self.value:g}" if self.value is not None else f"the formula {self.formula}"


class TimeRule(Body):
    """Time from instants: one column, or a date, a time of day and an offset apart; ``started_at`` is the first of them."""

    model_config = ConfigDict(frozen=True, json_schema_extra={"examples": [_EXAMPLE_OF_TIME]})
    source: Name | None = Field(default=None, description="Column of instants, or of times of day")
    date: Name | None = None
    time: Name | None = None
    offset: Name | None = Field(default=None, description="Column of offsets from UTC, as in +02:00")
    format: str | None = Field(
        default=None,
        min_length=1,
        max_length=60,
        description=f"As strptime reads it, or one of {', '.join((*EPOCHS, *SERIALS))}; none: recognised",
    )
    zone: str | None = Field(
        default=None, max_length=60, description="Zone of instants that name none: UTC, +02:00, Europe/Paris"
    )
    day_first: bool | None = Field(default=None, description="Whether 02/05/2026 is in May")
    repeats: Literal["spread", "keep"] | None = Field(
        default=None,
        description="Instants that repeat: spread over their step, or kept; none: spread where most repeat",
    )

    @model_validator(mode="after")
    def _makes_sense(self) -> "TimeRule":
        if (self.source is None) == (self.time is None):
            raise ValueError("time comes from `source`, or from `date` and `time` (and `offset`)")
        if self.source is not None and (self.date or self.offset):
            raise ValueError("`date` and `offset` stand beside `time`, not beside `source`")
        if self.format is not None and "%" not in self.format and self.format not in (*EPOCHS, *SERIALS):
            raise ValueError(
                f"the format {self.format!r} is neither strptime's nor one of {', '.join((*EPOCHS, *SERIALS))}"
            )
        if self.zone is not None:
            zone_of(self.zone)
        return self

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns that it needs, in the order in which they are joined."""
        return tuple(name for name in (self.source, self.date, self.time, self.offset) if name is not None)

    @property
    def reading(self) -> Reading:
        """How the instants are read."""
        zone = zone_of(self.zone) if self.zone else None
        return Reading(self.format, zone, self.day_first, {"spread": True, "keep": False}.get(self.repeats or ""))


class NameRule(Body):
    """Metadata from the file's name."""

    model_config = ConfigDict(frozen=True)
    pattern: str = Field(max_length=200, examples=["{aircraft}_{started_at:%Y%m%d-%H%M}_{pump_serial}"])
    zone: str | None = Field(default="UTC", max_length=60, description="Zone of an instant in the name")

    @model_validator(mode="after")
    def _makes_sense(self) -> "NameRule":
        if self.zone is not None:
            zone_of(self.zone)
        unknown = sorted(set(self.made.fields) - set(KNOWN))
        if unknown or "operator" in self.made.fields:
            raise ValueError(
                f"{', '.join(unknown or ['operator'])} cannot be read from a file's name; known: {', '.join(KNOWN)}"
            )
        return self

    @cached_property
    def made(self) -> NamePattern:
        """The pattern, ready to be used."""
        return NamePattern(self.pattern, self.zone)


class ChannelMapping(Body):
    """All that turns one operator's export into a flight record."""

    model_config = ConfigDict(frozen=True)
    channels: tuple[ChannelRule, ...] = Field(default=(), max_length=_MOST_CHANNELS)
    metadata: dict[Name, Name] = Field(
        default_factory=dict,
        description="Foreign name to the record's own name; an attribute of a group as `group.name`",
    )
    defaults: dict[Name, str | float] = Field(default_factory=dict, description="Metadata that the file may lack")
    csv: CsvRule | None = None
    constants: dict[Name, str | float] = Field(
        default_factory=dict, description="Metadata that hold whatever the file says; the request's still win"
    )
    time: TimeRule | None = None
    leave_out: tuple[Name, ...] = Field(
        default=(), max_length=_MOST_CHANNELS, description="Columns that are not kept, as in `Spare*`"
    )
    file_name: NameRule | None = None
    tables: tuple[Name, ...] = Field(
        default=(),
        max_length=_MOST_CHANNELS,
        description="Only these tables or groups are read, as in `HYD1*`; none: all",
    )

    @field_validator("file_name", mode="before")
    @classmethod
    def _pattern_alone(cls, value: Any) -> Any:
        return {"pattern": value} if isinstance(value, str) else value

    @model_validator(mode="after")
    def _is_unambiguous(self) -> "ChannelMapping":
        places = [(r.channel, r.table) for r in self.channels]
        faults = [f"two sources are mapped to {n}" for n in _repeated([channel for channel, _ in places])]
        faults += [f"two names are mapped to {n}" for n in _repeated(list(self.metadata.values()))]
        unknown = sorted({*self.metadata.values(), *self.defaults, *self.constants} - set(KNOWN))
        faults += [f"{n!r} is not metadata of a record; known: {', '.join(KNOWN)}" for n in unknown]
        for kind, values in (("default", self.defaults), ("constant", self.constants)):
            if "operator" in values:
                faults.append(f"operator cannot be a {kind}: a mapping belongs to one operator")
        if self.time is not None and any(rule.channel == TIME for rule in self.channels):
            faults.append(f"{TIME} comes from the mapping's `time` or from a channel's rule, not from both")
        if faults:
            raise ValueError("; ".join(faults))
        return self

    @property
    def dialect(self) -> TextDialect | None:
        """How to read the file's text; None: as documented."""
        return None if self.csv is None else self.csv.dialect

    @property
    def name_pattern(self) -> NamePattern | None:
        """Pattern of the file's name, where metadata come from it."""
        return None if self.file_name is None else self.file_name.made

    def document(self) -> JsonObject:
        """The mapping as it is stored: what came after the first release only where it says something.

        So the identity of records that were uploaded through an older mapping stays what it was.
        """
        full = self.model_dump(mode="json")
        shown = _without(full, _LATER)
        shown["channels"] = [_without(rule, _LATER_OF_A_CHANNEL) for rule in full["channels"]]
        if full["csv"] is not None:
            shown["csv"] = _without(full["csv"], _LATER_OF_CSV)
        return shown


def _later(model: type[Body], first: tuple[str, ...]) -> JsonObject:
    """Fields that came after the first release, and their defaults as JSON."""
    made = {name: field.get_default(call_default_factory=True) for name, field in model.model_fields.items()}
    return {n: list(v) if isinstance(v, tuple) else v for n, v in made.items() if n not in first}


_LATER = _later(ChannelMapping, ("channels", "metadata", "defaults", "csv"))
_LATER_OF_A_CHANNEL = _later(ChannelRule, ("source", "channel", "unit", "scale", "offset", "pressure_reference"))
_LATER_OF_CSV = _later(CsvRule, ("delimiter", "decimal", "encoding"))


def _without(full: Mapping[str, Any], later: Mapping[str, Any]) -> JsonObject:
    return {name: value for name, value in full.items() if name not in later or value != later[name]}


def _repeated(names: list[str]) -> list[str]:
    return sorted({name for name in names if names.count(name) > 1})
