"""Bulk import: every member of an uploaded archive taken as if it had come alone."""

from collections.abc import Iterator
from contextlib import contextmanager
from http import HTTPStatus

from pydantic import Field

from service.access.account import in_background
from service.errors import Problem
from service.ingest.archive import Archive
from service.ingest.file_names import named_by
from service.ingest.mapping_version import MappingVersion, MappingVersionSaid
from service.jobs.kinds import Item, Kind, Parameters, Work, register
from service.monitoring.acceptance import Upload

ANALYSED, KNOWN, REFUSED, STORED = "analysed", "known", "refused", "stored"


class BulkImportParameters(Parameters):
    """What was uploaded; ``overrides`` are metadata of the request, which win over those of every member."""

    content_hash: str
    format: str
    overrides: dict[str, str] = Field(default_factory=dict)
    mapping: MappingVersionSaid | None = None


@register
class BulkImport(Kind[BulkImportParameters, Archive]):
    """One item per member: ``analysed``, ``known`` or ``refused`` with its problem; a bad one costs the others nothing."""

    name = "bulk-import"
    most_parts = 8
    over_api = False
    parameters = BulkImportParameters

    @contextmanager
    def opened(self, work: Work[BulkImportParameters]) -> Iterator[Archive]:
        context = work.context
        with context.spool.of_parts(context.raw_store.chunks(work.parameters.content_hash)) as file:
            archive = context.parser.opened(file.path, work.parameters.format, context.settings.max_upload_bytes)
            try:
                yield archive
            finally:
                archive.close()

    def total(self, _work: Work[BulkImportParameters], archive: Archive) -> int:
        return len(archive)

    def item(self, work: Work[BulkImportParameters], archive: Archive, position: int) -> Item:
        name, context, parameters = archive.name(position), work.context, work.parameters
        mapping = MappingVersion.from_json(parameters.mapping) if parameters.mapping else None
        try:
            member = archive.member(position)
            with in_background(work.operator), context.spool.of_parts(archive.parts(position)) as file:
                overrides = named_by(mapping.mapping.name_pattern if mapping else None, name, parameters.overrides)
                upload = Upload(file, member.content_type, "", overrides, mapping=mapping)
                accepted = context.acceptance.accept(upload, work.principal)
        except Problem as problem:
            if problem.status >= HTTPStatus.INTERNAL_SERVER_ERROR:  # ours, not the fault of the member
                raise
            return Item(name, REFUSED, {"record_id": None, "problem": problem.body()})
        status = KNOWN if accepted.known else STORED if accepted.waiting else ANALYSED
        return Item(name, status, {"record_id": accepted.record_id, "problem": None})
