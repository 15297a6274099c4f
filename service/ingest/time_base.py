"""All tables of a file on one time base: channels are found by name over the tables, never laid on each other by index."""

from service.ingest.raw import RawFile, RawRecord
from twin.recording import TIME


def on_one_base(file: RawFile) -> RawRecord:
    """The file's channels on one base of time.

    A table's own clock stands in for ``time_s`` where it has no column of that name.
    """
    if not file.tables:
        return RawRecord(file.metadata, {}, list(file.faults), file.references, dict(file.not_kept), list(file.flags))
    table = file.tables[0]
    channels = dict(table.channels)
    if TIME not in channels and table.time is not None:
        channels[TIME] = table.time
    not_kept = file.not_kept | dict.fromkeys(table.texts, "text")
    return RawRecord(
        {**file.metadata, **table.attributes}, channels, list(file.faults), file.references, not_kept, list(file.flags)
    )
