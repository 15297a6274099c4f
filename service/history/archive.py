"""Recordings decoded from uploads and, again, from the raw bytes of stored records."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from service.errors import Unavailable
from service.ingest.decode import DecodedRecord, FullScales, checked, no_sensors
from service.ingest.mapping_version import MappingVersion
from service.ingest.metadata import TypeLookup, built_in
from service.ingest.parser_pool import ParserPool
from service.ingest.raw import Limits
from service.storage.raw_store import RawStore
from service.storage.spool import Spool, SpooledFile
from service.storage.tables import Record
from twin.parameters import PumpType
from twin.recording import Recording

RegisteredType = Callable[[str | None, str], str | None]
"""Pump type that is registered for (operator, serial), if any."""


def _unregistered(_operator: str | None, _serial: str) -> str | None:
    return None


@dataclass(frozen=True, slots=True)
class Archive:
    """The raw store with what decoding its bytes takes: files are read in processes of their own, within limits."""

    raw_store: RawStore
    spool: Spool
    parser: ParserPool
    limits: Limits

    def recording(self, row: Record, kind: PumpType) -> Recording:
        """Recording of one stored record, read as one of pump type ``kind`` where the upload names none.

        A type that the upload names was known when it came; what the twin has not of its own is read as ``kind``.

        Raises
        ------
        Unavailable
            when the raw bytes are gone or damaged.
        Problem
            when they cannot be decoded any more, e.g. because limits were lowered.
        """
        return self.decoded_again(
            row, lambda _operator, _serial: kind.name, lambda operator, name: built_in(operator, name) or kind, None
        ).recording

    def must_have(self, digest: str) -> None:
        """See that raw bytes are there, unread.

        Raises
        ------
        Unavailable
            when they are gone.
        """
        if not self.raw_store.has(digest):
            raise Unavailable(f"raw bytes {digest[:12]} are gone from the raw store: nothing was changed")

    def decoded_again(
        self,
        row: Record,
        registered: RegisteredType = _unregistered,
        types: TypeLookup = built_in,
        full_scales: FullScales | None = no_sensors,
    ) -> DecodedRecord:
        """A stored record decoded as its upload asked for, with the mapping that it was sent with; raises as above.

        ``full_scales`` None: it was taken once, and is not asked again whether its units are likely.
        """
        request = row.request
        mapping = MappingVersion.from_json(request["mapping"]) if request.get("mapping") else None
        with self.spool.of_parts(self.raw_store.chunks(row.content_hash)) as file:
            overrides = request["overrides"]
            kind, encoding = row.content_type, request["encoding"]
            return self.decoded(file, kind, encoding, overrides, mapping, registered, types, full_scales)

    def decoded(
        self,
        file: SpooledFile,
        content_type: str,
        content_encoding: str,
        overrides: Mapping[str, str],
        mapping: MappingVersion | None,
        registered: RegisteredType = _unregistered,
        types: TypeLookup = built_in,
        full_scales: FullScales | None = no_sensors,
    ) -> DecodedRecord:
        """A file decoded and checked; ``overrides`` are metadata that win over its own.

        Raises
        ------
        Problem
            with every fault.
        """
        applied = mapping.mapping if mapping else None
        dialect = applied.dialect if applied else None
        limits = self.limits if full_scales is not None else self.limits.without_words()
        raw = self.parser.parsed(file.path, content_type, content_encoding, limits, dialect, applied is not None)
        return checked(raw, overrides, registered, applied, types=types, full_scales=full_scales)
