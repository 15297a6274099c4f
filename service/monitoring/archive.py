"""Recordings of stored records, decoded again from their raw bytes."""

from dataclasses import dataclass

from service.ingest.decode import Limits, decode
from service.raw_store import RawStore
from service.tables import Record
from twin.recording import Recording


@dataclass(frozen=True, slots=True)
class Archive:
    """The raw store with the limits that decoding keeps to."""

    raw_store: RawStore
    limits: Limits

    def recording(self, row: Record, kind: str) -> Recording:
        """Recording of one stored record, read as one of pump type ``kind`` where the upload names none.

        Raises
        ------
        Unavailable
            when the raw bytes are gone or damaged.
        """
        content = self.raw_store.get(row.content_hash)
        overrides = {"pump_type": kind, **row.request["overrides"]}
        return decode(content, row.content_type, row.request["encoding"], overrides, self.limits).recording
