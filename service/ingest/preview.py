"""What a file would become: recognised channels, metadata, first rows and faults, without storing anything."""

import math
from collections.abc import Mapping
from typing import Any

from service.answers.mappings import MappingPreview, RecognisedChannel
from service.answers.problems import ProblemError
from service.errors import Invalid
from service.ingest.decode import checked
from service.ingest.mapped import Account, mapped_record
from service.ingest.mapping import CHANNELS, ChannelMapping, ChannelRule
from service.ingest.metadata import KNOWN
from service.ingest.raw import RawFile, RawRecord
from twin.recording import REQUIRED_CHANNELS, TIME


def preview(
    file: RawFile, mapping: ChannelMapping | None, n_rows: int, overrides: Mapping[str, Any] | None = None
) -> MappingPreview:
    """Preview of a parsed file.

    Parameters
    ----------
    file
        The file as its adapter read it.
    mapping
        Mapping to try; None takes the names as they are.
    n_rows
        Number of first rows to show.
    overrides
        Metadata of the request, among them those that the file's name says.
    """
    held = list(dict.fromkeys(name for table in file.tables for name in (*table.channels, *table.texts)))
    account, overrides = Account(), overrides or {}
    record = mapped_record(file, mapping, account)
    rules = {rule.channel: rule for rule in (mapping.channels if mapping else ()) if _is_used(rule, held)}
    columns = mapping.time.columns if mapping and mapping.time else ()
    recognised: list[RecognisedChannel] = [
        {
            "source": _source(name, rules, columns),
            "channel": name,
            "unit": rules[name].unit if name in rules else None,
            "samples": len(record.channels[name]),
        }
        for name in CHANNELS
        if name in record.channels
    ]
    used = {entry["source"] for entry in recognised} | set(columns)
    try:
        checked(file, overrides, mapping=mapping)
        faults: list[ProblemError] = []
    except Invalid as problem:
        faults = [{"where": f.where, "problem": f.problem} for f in problem.errors]
    length = min(n_rows, max((len(samples) for samples in record.channels.values()), default=0))
    return {
        "recognised": recognised,
        "unrecognised": [name for name in held if name not in used],
        "missing": [name for name in REQUIRED_CHANNELS if name not in record.channels],
        "metadata": {name: value for name, value in {**record.metadata, **overrides}.items() if name in KNOWN},
        "unrecognised_metadata": {name: value for name, value in record.metadata.items() if name not in KNOWN},
        "rows": [
            {entry["channel"]: _sample(record, entry["channel"], i) for entry in recognised} for i in range(length)
        ],
        "steps": [{"part": part, "did": did} for part, did in account.steps],
        "flags": record.flags,
        "faults": faults,
    }


def _is_used(rule: ChannelRule, held: list[str]) -> bool:
    return rule.source is None or rule.source in held


def _source(name: str, rules: Mapping[str, ChannelRule], columns: tuple[str, ...]) -> str:
    if name in rules:
        return rules[name].source or rules[name].origin
    return ", ".join(columns) if name == TIME and columns else name


def _sample(record: RawRecord, name: str, i: int) -> float | None:
    samples = record.channels[name]
    return float(samples[i]) if i < len(samples) and math.isfinite(samples[i]) else None
