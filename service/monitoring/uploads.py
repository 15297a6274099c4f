"""One upload as it came, and what it is recognised by."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime

from service.history.analysis import RecordAnalysis, keep_analysis
from service.history.overview import overview_of
from service.ingest.decode import DecodedRecord
from service.ingest.mapping_version import MappingVersion
from service.storage.spool import SpooledFile
from service.storage.tables import STORED, Record


@dataclass(frozen=True, slots=True)
class Upload:
    """One upload as it came; ``overrides`` are metadata of the request, which win over those of the file.

    ``mapping`` is the version of a channel mapping that the request names, ``is_waited_for`` whether its answer comes
    after the analysis.
    """

    file: SpooledFile
    content_type: str
    content_encoding: str
    overrides: Mapping[str, str]
    supersedes: str | None = None
    mapping: MappingVersion | None = None
    is_waited_for: bool = True


def new_row(upload: Upload, operator: str, request_hash: str) -> Record:
    """The row of an upload that nobody has looked into yet."""
    return Record(
        # a function of what was uploaded, so that records of one instant fold in the same order everywhere
        id=request_hash[:32],
        operator=operator,
        segment="",
        request={
            "encoding": upload.content_encoding,
            "overrides": dict(upload.overrides),
            "mapping": upload.mapping.to_json() if upload.mapping else None,
            "later": not upload.is_waited_for,
        },
        attributes={},
        content_hash=upload.file.digest,
        content_type=upload.content_type,
        status=STORED,
        request_hash=request_hash,
        supersedes=upload.supersedes,
        received_at=datetime.now(UTC),
    )


def fill(row: Record, pump_id: int, decoded: DecodedRecord, identity: str, analysis: RecordAnalysis) -> None:
    """Write what a file says, and what was made of it, into its record's row; it does not count by that."""
    metadata = decoded.metadata
    row.pump_id, row.identity_hash = pump_id, identity
    row.aircraft, row.position = metadata.aircraft, metadata.position
    row.flight_id, row.segment = metadata.flight_id, metadata.segment
    row.started_at, row.flight_hours = metadata.started_at, metadata.flight_hours
    row.pump_type = metadata.pump_type
    row.attributes = dict(decoded.recording.attributes)
    keep_analysis(row, analysis)
    row.overview = overview_of(decoded.recording)


def request_hash_of(operator: str, upload: Upload) -> str:
    """What the same request is recognised by."""
    parts: dict[str, object] = {
        "operator": operator,
        "bytes": upload.file.digest,
        "type": upload.content_type.partition(";")[0].strip().lower(),
        "encoding": upload.content_encoding.strip().lower(),
        "overrides": dict(sorted(upload.overrides.items())),
        "supersedes": upload.supersedes,
    }
    if upload.mapping is not None:
        parts["mapping"] = upload.mapping.to_json()
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def identity_hash_of(operator: str, digest: str, decoded: DecodedRecord, mapping: MappingVersion | None) -> str:
    """What the same operator, bytes and effective metadata are recognised by."""
    metadata = decoded.metadata
    effective = {
        name: str(getattr(metadata, name)) for name in metadata.__slots__ if name not in ("foreign", "operator")
    }
    parts = {"operator": operator, "bytes": digest, "metadata": effective}
    if mapping is not None:
        # what the bytes mean depends on how their channels are read, not on the name of the mapping
        parts["mapping"] = mapping.to_json()["document"]
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()
