"""A stored version of a mapping, as uploads name it and as records remember it."""

from dataclasses import dataclass
from typing import Self

from typing_extensions import TypedDict

from service.answers.documents import JsonObject
from service.ingest.mapping import ChannelMapping


class MappingVersionSaid(TypedDict):
    """A version as JSON; ``document`` as ``ChannelMapping.document`` gives it."""

    name: str
    version: int
    document: JsonObject


@dataclass(frozen=True, slots=True)
class MappingVersion:
    """Name, number and content: a record keeps all of it, so that it can be decoded again as it was."""

    name: str
    version: int
    mapping: ChannelMapping

    def to_json(self) -> MappingVersionSaid:
        """As it is stored with a record."""
        return {"name": self.name, "version": self.version, "document": self.mapping.document()}

    @classmethod
    def from_json(cls, document: MappingVersionSaid) -> Self:
        """Inverse of ``to_json``."""
        return cls(document["name"], document["version"], ChannelMapping.model_validate(document["document"]))
