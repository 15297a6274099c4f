"""A stored version of a mapping, as uploads name it and as records remember it."""

from dataclasses import dataclass
from typing import Any, Self

from service.ingest.mapping import ChannelMapping


@dataclass(frozen=True, slots=True)
class MappingVersion:
    """Name, number and content: a record keeps all of it, so that it can be decoded again as it was."""

    name: str
    version: int
    mapping: ChannelMapping

    def to_json(self) -> dict[str, Any]:
        """As it is stored with a record."""
        return {"name": self.name, "version": self.version, "document": self.mapping.document()}

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> Self:
        """Inverse of ``to_json``."""
        return cls(document["name"], document["version"], ChannelMapping.model_validate(document["document"]))
