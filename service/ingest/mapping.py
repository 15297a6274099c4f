"""Channel mappings: an operator's own names, units and references brought to those of a flight record."""

import codecs
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import ConfigDict, Field, field_validator, model_validator

from service.bodies import Body
from service.errors import Fault
from service.ingest.conversion import Conversion, conversion
from service.ingest.metadata import KNOWN
from service.ingest.raw import RawFile, Table, TextDialect
from twin.recording import OPTIONAL_CHANNELS, REQUIRED_CHANNELS, TIME

CHANNELS: tuple[str, ...] = (*REQUIRED_CHANNELS, *OPTIONAL_CHANNELS)
_MOST_CHANNELS = 500
Name = Annotated[str, Field(min_length=1, max_length=200)]


class ChannelRule(Body):
    """One foreign channel: ``value = (sample * scale + offset)`` in ``unit``, brought to the channel's own unit."""

    model_config = ConfigDict(frozen=True)
    source: Name
    channel: Name
    unit: str | None = Field(default=None, max_length=50, description="Unit of the foreign channel; none: ours already")
    scale: float = 1.0
    offset: float = 0.0
    pressure_reference: Literal["gauge", "absolute"] | None = None

    @model_validator(mode="after")
    def _makes_sense(self) -> "ChannelRule":
        if self.channel not in CHANNELS:
            raise ValueError(f"there is no channel {self.channel!r}; known: {', '.join(CHANNELS)}")
        if self.scale == 0.0:
            raise ValueError("a scale of 0 makes every sample the same")
        if self.pressure_reference is not None and not self.channel.endswith("_pressure_bar"):
            raise ValueError(f"{self.channel} is no pressure and has no pressure reference")
        found = self.conversion  # raises for a unit that cannot become the channel's
        if None not in (found.reference, self.pressure_reference) and found.reference != self.pressure_reference:
            raise ValueError(f"the unit {self.unit} is {found.reference}, the rule says {self.pressure_reference}")
        return self

    @property
    def conversion(self) -> Conversion:
        """From the foreign unit to the channel's own."""
        return conversion(self.unit, self.channel)

    @property
    def reference(self) -> str | None:
        """Reference of a pressure, said by the rule or by its unit (psia, barg); None: the record's."""
        return self.pressure_reference or self.conversion.reference


class CsvRule(Body):
    """How the operator's CSV is written."""

    model_config = ConfigDict(frozen=True)
    delimiter: Literal[",", ";", "\t", "|"] = ","
    decimal: Literal[".", ","] = "."
    encoding: str = Field(default="utf-8", max_length=40)

    @model_validator(mode="after")
    def _tells_apart(self) -> "CsvRule":
        if self.delimiter == self.decimal:
            raise ValueError("fields and decimals cannot both be separated by a comma")
        return self

    @field_validator("encoding")
    @classmethod
    def _is_a_text_encoding(cls, value: str) -> str:
        try:
            info = codecs.lookup(value)
            b"".decode(value)
        except LookupError:
            raise ValueError(f"there is no text encoding {value!r}: try utf-8, cp1252 or utf-16") from None
        return info.name


class ChannelMapping(Body):
    """All that turns one operator's export into a flight record."""

    model_config = ConfigDict(frozen=True)
    channels: tuple[ChannelRule, ...] = Field(default=(), max_length=_MOST_CHANNELS)
    metadata: dict[Name, Name] = Field(default_factory=dict, description="Foreign name to the record's own name")
    defaults: dict[Name, str | float] = Field(default_factory=dict, description="Metadata that the file may lack")
    csv: CsvRule | None = None

    @model_validator(mode="after")
    def _is_unambiguous(self) -> "ChannelMapping":
        faults = [f"the source {n!r} is mapped twice" for n in _repeated([r.source for r in self.channels])]
        faults += [f"two sources are mapped to {n}" for n in _repeated([r.channel for r in self.channels])]
        faults += [f"two names are mapped to {n}" for n in _repeated(list(self.metadata.values()))]
        unknown = sorted({*self.metadata.values(), *self.defaults} - set(KNOWN))
        faults += [f"{n!r} is not metadata of a record; known: {', '.join(KNOWN)}" for n in unknown]
        faults += [
            f"{n} cannot be a default: a mapping belongs to one operator" for n in self.defaults if n == "operator"
        ]
        if faults:
            raise ValueError("; ".join(faults))
        return self

    @property
    def dialect(self) -> TextDialect | None:
        """How to read the file's text; None: as documented."""
        return None if self.csv is None else TextDialect(self.csv.delimiter, self.csv.decimal, self.csv.encoding)


def mapped(file: RawFile, mapping: ChannelMapping) -> RawFile:
    """The file with its channels and metadata under our names and in our units; foreign channels stay as they are."""
    references, faults = dict(file.references), list(file.faults)
    held = {name for table in file.tables for name in table.channels}
    sources = {rule.source for rule in mapping.channels}
    rules = []
    for rule in mapping.channels:
        if rule.source not in held:
            if rule.channel in REQUIRED_CHANNELS and rule.channel not in held:
                text = f"is not in the file; the mapping takes {rule.channel} from it"
                faults.append(Fault(f"channels.{rule.source}", text))
        elif rule.channel in held and rule.channel not in sources:
            text = f"is in the file, and the mapping takes it from {rule.source} as well"
            faults.append(Fault(f"channels.{rule.channel}", text))
        else:
            rules.append(rule)
            if rule.reference is not None:
                references[rule.channel] = rule.reference
    tables = tuple(_renamed(table, rules) for table in file.tables)
    return RawFile(_metadata(file, mapping), tables, faults, file.not_kept, file.flags, references)


def _renamed(table: Table, rules: Sequence[ChannelRule]) -> Table:
    """One table with its channels under our names and in our units."""
    own = [rule for rule in rules if rule.source in table.channels]
    sources = {rule.source for rule in own}
    channels = {name: samples for name, samples in table.channels.items() if name not in sources}
    for rule in own:
        samples = np.asarray(table.channels[rule.source]) * rule.scale + rule.offset
        channels[rule.channel] = rule.conversion.applied(samples)
        if rule.channel == TIME:
            channels[TIME] = _from_start(channels[TIME])
    return replace(table, channels=channels)


def _metadata(raw: RawFile, mapping: ChannelMapping) -> dict[str, Any]:
    renamed = {mapping.metadata.get(name, name): value for name, value in raw.metadata.items()}
    return {**mapping.defaults, **renamed}


def _from_start(time: Any) -> Any:
    """Time from the first sample: a foreign clock counts from midnight, or from when it was switched on."""
    return time - time[0] if len(time) and np.isfinite(time[0]) else time


def _repeated(names: Sequence[str]) -> list[str]:
    return sorted({name for name in names if names.count(name) > 1})
