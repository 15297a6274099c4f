"""Channel mappings: an operator's exports uploaded as they are."""

import json
from typing import Annotated, Any

from fastapi import APIRouter, Header, Query, Request, Response
from pydantic import ConfigDict, Field, ValidationError
from starlette.concurrency import run_in_threadpool

from service.access import audit
from service.access.security import Principal
from service.answers.documents import JsonObject
from service.answers.mappings import Mapping, MappingPreview, MappingSuggestion
from service.answers.problems import ProblemError
from service.answers.words import Page, instant
from service.context import Context
from service.errors import Conflict, Fault, Invalid, NotFound, PreconditionRequired, StaleVersion
from service.ingest.file_formats import ANY_TYPE
from service.ingest.file_names import named_by
from service.ingest.mapping import ChannelMapping
from service.ingest.mappings import append_version, latest_mapping, mapping_version, mappings
from service.ingest.preview import preview
from service.ingest.raw import RawFile, TextDialect
from service.ingest.suggesting import proposed
from service.storage.tables import StoredMapping
from service.web.addresses import location
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf
from service.web.paging import DEFAULT_ITEMS, MOST_ITEMS, page, place_of
from service.web.routes.records import METADATA_PARAMETERS, overrides_of
from service.web.sent_file import FileName, SentFile, sent_file

router = APIRouter(prefix="/mappings", tags=["mappings"], route_class=AnswerRoute)
Operator = Annotated[str | None, Query(description="Whose mapping; default: the key's operator")]
_EXAMPLE: JsonObject = {
    "description": "export of the maintenance computer",
    "aircraft_type": "H225",
    "channels": [
        {"source": "Time", "channel": "time_s", "unit": "ms"},
        {"source": "HYD1_P", "channel": "discharge_pressure_bar", "unit": "psi"},
        {"source": "HYD1_CASE_P", "channel": "case_pressure_bar", "unit": "psia"},
        {"source": "HYD1_N", "channel": "shaft_speed_rpm", "unit": "Hz"},
        {"source": "HYD1_T", "channel": "fluid_temperature_degc", "unit": "degF"},
    ],
    "metadata": {"Tail": "aircraft", "PumpSN": "pump_serial", "Flight": "flight_id", "Start": "started_at"},
    "defaults": {"position": "LH"},
    "csv": {"delimiter": ";", "decimal": ","},
}


class MappingContent(ChannelMapping):
    """A new version of a mapping: it replaces the earlier one as a whole, which records keep that used it."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [_EXAMPLE]})
    aircraft_type: str | None = Field(default=None, min_length=1, max_length=200)
    description: str = Field(default="", max_length=2000)

    def mapping(self) -> ChannelMapping:
        """The part that is applied to files."""
        return ChannelMapping.model_validate(self.model_dump(exclude={"aircraft_type", "description", "name"}))


class NewMapping(MappingContent):
    """A mapping under a new name."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [{"name": "hums-export", **_EXAMPLE}]})
    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,99}$")


@router.get("", summary="List channel mappings")
def listed(
    context: ContextOf,
    asker: Asker,
    aircraft_type: str | None = None,
    limit: Annotated[int, Query(ge=1, le=MOST_ITEMS)] = DEFAULT_ITEMS,
    cursor: str | None = None,
) -> Page[Mapping]:
    """Page through the newest versions of the mappings that this key may see."""
    query = {"list": "mappings", "aircraft_type": aircraft_type}
    after = place_of(query, cursor)
    with context.database.reading() as session:
        rows = list(session.scalars(mappings(asker, aircraft_type, after).limit(limit + 1)))
    return page(rows, limit, query, lambda r: [r.operator, r.name], _shown)


@router.post("", status_code=201, summary="Store a channel mapping")
def make(body: NewMapping, response: Response, context: ContextOf, asker: Asker, operator: Operator = None) -> Mapping:
    """Store a mapping under a new name."""
    asker.require("analyst")
    owner = asker.operator_of(operator)
    with context.database.writing() as session:
        try:
            latest_mapping(session, owner, body.name)
        except NotFound:
            row = _appended(session, owner, body.name, 1, body, asker)
        else:
            raise Conflict(f"there is a channel mapping {body.name} already: change it with PUT /mappings/{body.name}")
    response.headers["ETag"] = _etag(row)
    response.headers["Location"] = location("mappings", row.name)
    return _shown(row)


@router.get("/{name}", summary="One channel mapping")
def one(name: str, response: Response, context: ContextOf, asker: Asker, operator: Operator = None) -> Mapping:
    """The newest version; its number is the ETag."""
    with context.database.reading() as session:
        row = latest_mapping(session, asker.operator_of(operator), name)
    response.headers["ETag"] = _etag(row)
    return _shown(row)


@router.put("/{name}", summary="A new version of a channel mapping")
def change(
    name: str,
    body: MappingContent,
    response: Response,
    context: ContextOf,
    asker: Asker,
    operator: Operator = None,
    if_match: Annotated[str | None, Header()] = None,
) -> Mapping:
    """Append a version; records that were uploaded through an earlier one stay what they are."""
    asker.require("analyst")
    owner = asker.operator_of(operator)
    with context.database.writing() as session:
        current = latest_mapping(session, owner, name)
        if if_match is None:
            raise PreconditionRequired(f"send If-Match with the version you read ({_etag(current)})")
        if _etag(current) not in {tag.strip() for tag in if_match.split(",")}:
            raise StaleVersion(f"the latest version is {_etag(current)}: read it again and repeat your change")
        row = _appended(session, owner, name, current.version + 1, body, asker)
    response.headers["ETag"] = _etag(row)
    return _shown(row)


@router.post(
    "/preview",
    summary="What a channel mapping makes of a file",
    openapi_extra={
        "requestBody": {
            "required": True,
            "content": {
                "multipart/form-data": {
                    "schema": {
                        "type": "object",
                        "required": ["file"],
                        "properties": {
                            "file": {"type": "string", "format": "binary"},
                            "mapping": {"type": "string", "description": "A mapping as JSON, or the name of one"},
                        },
                    }
                },
                ANY_TYPE: {},
            },
        }
    },
)
async def previewed(
    request: Request,
    context: ContextOf,
    asker: Asker,
    mapping: Annotated[str | None, Query(description="Name of a stored mapping")] = None,
    operator: Operator = None,
    rows: Annotated[int, Query(ge=0, le=100)] = 10,
    file_name: FileName = None,
) -> MappingPreview:
    """What each part did, recognised and unrecognised channels, metadata, first rows and every fault; nothing is stored.

    The file is the body with ``?mapping=name``, or a form's part ``file`` beside a part ``mapping``.
    """
    owner = asker.operator_of(operator)
    async with sent_file(request, context, file_name) as sent:
        words = mapping if sent.mapping is None else sent.mapping
        chosen = await run_in_threadpool(_chosen, context, owner, words)
        return await run_in_threadpool(_preview, context, sent, chosen, rows)


@router.post(
    "/suggest",
    summary="A channel mapping that a file seems to need",
    openapi_extra={
        "parameters": METADATA_PARAMETERS,
        "requestBody": {
            "required": True,
            "content": {
                "multipart/form-data": {
                    "schema": {
                        "type": "object",
                        "required": ["file"],
                        "properties": {"file": {"type": "string", "format": "binary"}},
                    }
                },
                ANY_TYPE: {},
            },
        },
    },
)
async def suggested(
    request: Request,
    context: ContextOf,
    asker: Asker,
    file_name: FileName = None,
) -> MappingSuggestion:
    """Look at a file and propose a mapping, with its certainty and what it could not tell; nothing is stored.

    What the upload would say as well (`pump_serial` …) may stand in the query. Preview the mapping, complete it, store it.
    """
    named = overrides_of(request)
    asker.operator_of(named.get("operator"))
    async with sent_file(request, context, file_name) as sent:
        return await run_in_threadpool(_suggestion, context, sent, named)


def _suggestion(context: Context, sent: SentFile, named: dict[str, str]) -> MappingSuggestion:
    def read(dialect: TextDialect | None) -> RawFile:
        return context.parser.parsed(sent.path, sent.kind, sent.encoding, context.limits, dialect)

    return proposed(sent.path, sent.kind, sent.encoding, read, named)


def _chosen(context: Context, operator: str, words: str | None) -> ChannelMapping | None:
    """A mapping given as JSON or by name; None without one."""
    if words is None:
        return None
    if not words.lstrip().startswith("{"):
        with context.database.reading() as session:
            return mapping_version(session, operator, words).mapping
    try:
        document = json.loads(words)
        document.pop("name", None)
        return MappingContent.model_validate(document).mapping()
    except ValueError as error:
        if not isinstance(error, ValidationError):
            raise Invalid("the mapping is not JSON", [Fault("mapping", str(error)[:200])]) from None
        faults = [Fault(".".join(("mapping", *map(str, e["loc"]))), e["msg"]) for e in error.errors()]
        raise Invalid(f"the mapping has {len(faults)} fault(s)", faults) from None


def _preview(context: Context, sent: SentFile, mapping: ChannelMapping | None, n_rows: int) -> MappingPreview:
    dialect = mapping.dialect if mapping else None
    raw = context.parser.parsed(sent.path, sent.kind, sent.encoding, context.limits, dialect)
    pattern = mapping.name_pattern if mapping else None
    named: dict[str, str] = {}
    faults: list[ProblemError] = []
    try:
        named = named_by(pattern, sent.name, {})
    except Invalid as problem:
        faults = [{"where": f.where, "problem": f.problem} for f in problem.errors]
    shown = preview(raw, mapping, n_rows, named)
    if pattern is not None and named:
        found = ", ".join(f"{name} is {value}" for name, value in named.items())
        shown["steps"].append({"part": "file_name", "did": f"from {sent.name}: {found}"})
    shown["faults"] = [*faults, *shown["faults"]]
    return shown


def _appended(
    session: Any, operator: str, name: str, version: int, body: MappingContent, asker: Principal
) -> StoredMapping:
    row = append_version(
        session,
        operator,
        name,
        version,
        body.mapping(),
        aircraft_type=body.aircraft_type,
        description=body.description,
        author=asker.owner,
    )
    audit.note(session, asker, "mapping.put", f"mapping/{name}", operator, {"version": version})
    return row


def _etag(row: StoredMapping) -> str:
    return f'"{row.version}"'


def _shown(row: StoredMapping) -> Mapping:
    mapping = ChannelMapping.model_validate(row.document).model_dump(mode="json")
    return {
        "name": row.name,
        "operator": row.operator,
        "version": row.version,
        "aircraft_type": row.aircraft_type,
        "description": row.description,
        "channels": mapping["channels"],
        "metadata": mapping["metadata"],
        "defaults": mapping["defaults"],
        "csv": mapping["csv"],
        "constants": mapping["constants"],
        "time": mapping["time"],
        "leave_out": mapping["leave_out"],
        "file_name": mapping["file_name"],
        "tables": mapping["tables"],
        "author": row.author,
        "created_at": instant(row.created_at),
    }
