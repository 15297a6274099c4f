"""What a file would become: recognised channels, metadata, first rows and faults, without storing anything."""

import math

from service.answers.mappings import MappingPreview, RecognisedChannel
from service.answers.problems import ProblemError
from service.errors import Invalid
from service.ingest.decode import checked
from service.ingest.mapping import CHANNELS, ChannelMapping, mapped
from service.ingest.metadata import KNOWN
from service.ingest.raw import RawFile, RawRecord
from service.ingest.time_base import on_one_base
from twin.recording import REQUIRED_CHANNELS


def preview(file: RawFile, mapping: ChannelMapping | None, n_rows: int) -> MappingPreview:
    """Preview of a parsed file.

    Parameters
    ----------
    file
        The file as its adapter read it.
    mapping
        Mapping to try; None takes the names as they are.
    n_rows
        Number of first rows to show.
    """
    held = [name for table in file.tables for name in (*table.channels, *table.texts)]
    record = on_one_base(file if mapping is None else mapped(file, mapping))
    rules = {rule.channel: rule for rule in (mapping.channels if mapping else ()) if rule.source in held}
    recognised: list[RecognisedChannel] = [
        {
            "source": rules[name].source if name in rules else name,
            "channel": name,
            "unit": rules[name].unit if name in rules else None,
            "samples": len(record.channels[name]),
        }
        for name in CHANNELS
        if name in record.channels
    ]
    used = {entry["source"] for entry in recognised}
    try:
        checked(file, {}, mapping=mapping)
        faults: list[ProblemError] = []
    except Invalid as problem:
        faults = [{"where": f.where, "problem": f.problem} for f in problem.errors]
    length = min(n_rows, max((len(samples) for samples in record.channels.values()), default=0))
    return {
        "recognised": recognised,
        "unrecognised": [name for name in held if name not in used],
        "missing": [name for name in REQUIRED_CHANNELS if name not in record.channels],
        "metadata": {name: value for name, value in record.metadata.items() if name in KNOWN},
        "unrecognised_metadata": {name: value for name, value in record.metadata.items() if name not in KNOWN},
        "rows": [
            {entry["channel"]: _sample(record, entry["channel"], i) for entry in recognised} for i in range(length)
        ],
        "faults": faults,
    }


def _sample(record: RawRecord, name: str, i: int) -> float | None:
    samples = record.channels[name]
    return float(samples[i]) if i < len(samples) and math.isfinite(samples[i]) else None
