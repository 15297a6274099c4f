"""Channel mappings: an operator's own names and units, written in a table; a change is a new version."""

from collections.abc import Mapping

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response

from service.access.security import Principal
from service.answers.documents import JsonObject
from service.answers.mappings import Mapping as Stored
from service.context import Context
from service.errors import Invalid, Problem
from service.ingest.mapping import CHANNELS
from service.ingest.metadata import KNOWN
from service.web.dashboard.forms import Sent, SentForm, checked, done
from service.web.dashboard.frame import PageRoute, html_page
from service.web.dashboard.links import address
from service.web.dependencies import Asker, ContextOf
from service.web.routes import mappings

mapping_router = APIRouter(include_in_schema=False, route_class=PageRoute)
_PER_PAGE = 100
_SPARE_ROWS = 6
_RULE = ("source", "channel", "unit", "scale", "offset", "pressure_reference")
_OWN = ("name", "operator", "version", "description", "aircraft_type", "delimiter", "decimal", "encoding")


@mapping_router.get("/mappings", response_class=HTMLResponse)
def mappings_page(
    request: Request,
    context: ContextOf,
    asker: Asker,
    name: str | None = None,
    operator: str | None = None,
    cursor: str | None = None,
) -> Response:
    """Mappings, the newest version of each; ``name`` opens one, and without one there is an empty table to fill."""
    held = mappings.one(name, Response(), context, asker, operator) if name is not None else None
    return _page(request, context, asker, (_table(held) if held else {}, held), cursor, None)


@mapping_router.post("/mappings")
def store(form: SentForm) -> Response:
    """Store a new mapping, or a new version over the one that the form was made from."""
    name, operator, version = form.text("name"), form.text("operator") or None, form.text("version")
    form.goes_back_to(address("mappings", query={"name": name if version else None, "operator": operator}))
    form.who.require("analyst")
    try:
        content = _content(form)
        if version:
            body = checked(mappings.MappingContent, content, "mapping")
            mappings.change(name, body, Response(), form.context, form.who, operator, f'"{version}"')
        else:
            new = checked(mappings.NewMapping, {"name": name, **content}, "mapping")
            mappings.make(new, Response(), form.context, form.who, operator)
    except Invalid as problem:
        held = mappings.one(name, Response(), form.context, form.who, operator) if version else None
        typed = {field: values[0] for field, values in form.fields.items()}
        return _page(form.request, form.context, form.who, (typed, held), None, problem)
    return done(address("mappings", query={"name": name, "operator": operator}))


def _content(form: Sent) -> JsonObject:
    """What the table says, as the API takes it; rows without a source are not there."""
    fields = form.filled()
    rows = sorted({int(f.partition(".")[2]) for f in fields if f.startswith("source.") and f[7:].isdecimal()})
    rules = [{part: fields[f"{part}.{i}"] for part in _RULE if f"{part}.{i}" in fields} for i in rows]
    known = {*_OWN, *(f"{part}.{i}" for part in _RULE for i in rows)}
    named: dict[str, JsonObject] = {"metadata": {}, "default": {}}
    for field, value in fields.items():
        kind, _, what = field.partition(":")
        if kind == "metadata":
            named[kind][value] = what
        elif kind == "default":
            named[kind][what] = value
    stray = [f for f in fields if f not in known and f.partition(":")[0] not in named]
    content: JsonObject = {
        "channels": rules,
        "metadata": named["metadata"],
        "defaults": named["default"],
        "description": form.text("description"),
        # a row without a source, or a field that no table has, is named like any other fault
        **{field: fields[field] for field in stray},
    }
    if "aircraft_type" in fields:
        content["aircraft_type"] = fields["aircraft_type"]
    csv = {part: fields[part] for part in ("delimiter", "decimal", "encoding") if part in fields}
    if csv:
        content["csv"] = {name: "\t" if value == "tab" else value for name, value in csv.items()}
    return content


def _table(held: Stored) -> dict[str, str]:
    """A stored mapping as the fields of the form."""
    fields: dict[str, str] = {"description": held["description"], "aircraft_type": held["aircraft_type"] or ""}
    for i, rule in enumerate(held["channels"]):
        for part, value in rule.items():
            fields[f"{part}.{i}"] = _text(value)
    fields |= {f"metadata:{ours}": foreign for foreign, ours in held["metadata"].items()}
    fields |= {f"default:{ours}": _text(value) for ours, value in held["defaults"].items()}
    if held["csv"] is not None:
        fields |= {name: "tab" if value == "\t" else str(value) for name, value in held["csv"].items()}
    return fields


def _text(value: object) -> str:
    if value is None:
        return ""
    return repr(value).removesuffix(".0") if isinstance(value, float) else str(value)


def _page(
    request: Request,
    context: Context,
    asker: Principal,
    table: tuple[Mapping[str, str], Stored | None],
    cursor: str | None,
    problem: Problem | None,
) -> Response:
    fields, held = table
    found = mappings.listed(context, asker, limit=_PER_PAGE, cursor=cursor)
    used = [int(f.partition(".")[2]) for f in fields if f.startswith("source.") and f[7:].isdecimal()]
    values = {
        "request": request,
        "mappings": found["items"],
        "next": address("mappings", query={"cursor": found["next"]}) if found["next"] else None,
        "held": held,
        "fields": dict(fields),
        "rows": range(max(used, default=-1) + 1 + _SPARE_ROWS),
        "channels": CHANNELS,
        "metadata": [name for name in KNOWN if name != "operator"],
        "problem": problem.body() if problem else None,
        "may_store": asker.may("analyst"),
        "sees_all": asker.operator is None,
    }
    return html_page("mappings.html", int(problem.status) if problem else 200, values)
