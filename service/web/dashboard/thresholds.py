"""Thresholds by layer: what holds and from where, a change previewed on history, published with a reason, restored."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypedDict

from fastapi import APIRouter, BackgroundTasks, Request
from fastapi.responses import HTMLResponse, Response

from service.access.security import Principal
from service.answers.jobs import Job
from service.answers.problems import Problem as ProblemDocument
from service.answers.thresholds import Preview, ThresholdKey
from service.answers.thresholds import Thresholds as Layer
from service.context import Context
from service.errors import Fault, Invalid, Problem
from service.units import UnitSystem, unit_of
from service.web.dashboard.forms import Sent, SentForm, checked, done
from service.web.dashboard.frame import PageRoute, html_page
from service.web.dashboard.links import address
from service.web.dashboard.preferences import system_of
from service.web.dependencies import Asker, ContextOf
from service.web.routes import operators, pump_types, thresholds

threshold_router = APIRouter(include_in_schema=False, route_class=PageRoute)
_VALUE = "value."
"""What the name of a field begins with that holds a threshold."""
SCOPE_WORDS = {"fleet": "whole fleet", "pump-type": "pump type", "operator": "operator", "pump": "pump"}


@dataclass(frozen=True, slots=True)
class _Shown:
    """What one rendering of the page holds besides what is stored."""

    values: Mapping[str, str] | None = None
    reason: str = ""
    preview: Preview | None = None
    problem: Problem | None = None


class _Held(TypedDict):
    """A threshold's value in its unit, and the layer that it comes from."""

    value: float
    origin: str


@threshold_router.get("/thresholds", response_class=HTMLResponse)
def thresholds_page(
    request: Request,
    context: ContextOf,
    asker: Asker,
    scope: str = "fleet",
    id: str = "default",
    operator: str | None = None,
) -> Response:
    """One layer: every threshold with the layer that its value comes from, and the layer's history."""
    return _page(request, context, asker, (scope, id, operator), _Shown())


@threshold_router.post("/thresholds/preview")
def preview(form: SentForm) -> Response:
    """What a change would have done on stored history; nothing is changed."""
    layer = _layer(form)
    form.goes_back_to(_link(*layer))
    try:
        scope, scope_id, operator = layer
        body = checked(
            thresholds.Candidate,
            {"scope": scope, "id": scope_id, "operator": operator, "values": _values(form)},
            "candidate",
        )
        found: Preview | Job = thresholds.previewed(body, Response(), form.context, form.who)
    except Invalid as problem:
        return _again(form, layer, _Shown(problem=problem))
    if "progress" in found:
        return done(address("jobs", found["id"]))
    return _again(form, layer, _Shown(preview=found))


@threshold_router.post("/thresholds")
def publish(form: SentForm, background: BackgroundTasks) -> Response:
    """A new version of a layer, if it is still the one that the form was made from."""
    layer = _layer(form)
    scope, scope_id, operator = layer
    form.goes_back_to(_link(*layer))
    try:
        values = {"values": _values(form), "reason": form.text("reason")}
        thresholds.change(
            scope,
            scope_id,
            checked(thresholds.NewThresholds, values, "change"),
            Response(),
            background,
            form.context,
            form.who,
            operator=operator,
            if_match=f'"{form.text("version")}"',
        )
    except Invalid as problem:
        return _again(form, layer, _Shown(problem=problem))
    return done(_link(*layer))


@threshold_router.post("/thresholds/restore")
def restore(form: SentForm, background: BackgroundTasks) -> Response:
    """Put an earlier version of a layer back as a new one."""
    layer = _layer(form)
    scope, scope_id, operator = layer
    form.goes_back_to(_link(*layer))
    number = form.text("number")
    if not number.isdecimal():
        raise Invalid("nothing was restored", [Fault("number", "is no number of a version")])
    thresholds.restored(
        scope,
        scope_id,
        int(number),
        Response(),
        background,
        form.context,
        form.who,
        body=checked(
            thresholds.Restoration, form.filled(("scope", "id", "operator", "number", "version")), "restoration"
        ),
        operator=operator,
        if_match=f'"{form.text("version")}"',
    )
    return done(_link(*layer))


def _layer(form: Sent) -> tuple[str, str, str | None]:
    return form.text("scope"), form.text("id"), form.text("operator") or None


def _link(scope: str, scope_id: str, operator: str | None) -> str:
    return address("thresholds", query={"scope": scope, "id": scope_id, "operator": operator})


def _values(form: Sent) -> dict[str, float]:
    """Thresholds that the form sets; a field that is left empty leaves the value to the layers above."""
    found, faults = {}, []
    for name, text in form.filled().items():
        if not name.startswith(_VALUE):
            continue
        key = name.removeprefix(_VALUE)
        try:
            found[key] = float(text)
        except ValueError:
            faults.append(Fault(f"values.{key}", f"{text!r} is no number"))
    if faults:
        raise Invalid(f"{len(faults)} fault(s) in the thresholds; nothing was changed", faults)
    return found


def _again(form: Sent, layer: tuple[str, str, str | None], shown: _Shown) -> Response:
    """The page once more with what the form holds, in the units that the reader has now."""
    system = system_of(form.request)
    typed: dict[str, str] = {}
    for name, value in form.filled().items():
        if name.startswith(_VALUE):
            same = system is form.system or not isinstance(value, float)
            typed[name.removeprefix(_VALUE)] = form.text(name) if same else system.text(value, unit_of(name))
    again = _Shown(typed, form.text("reason"), shown.preview, shown.problem)
    return _page(form.request, form.context, form.who, layer, again)


def _page(
    request: Request, context: Context, asker: Principal, layer: tuple[str, str, str | None], shown: _Shown
) -> Response:
    scope, scope_id, operator = layer
    found = thresholds.effective(scope, scope_id, Response(), context, asker, operator)
    history = thresholds.history(scope, scope_id, context, asker, operator)["items"]
    keys = thresholds.keys(asker)["items"]
    system = system_of(request)
    units = {key["key"]: key["unit"] for key in keys}
    typed = shown.values
    if typed is None:
        typed = {k: system.text(v, units.get(k, "-")) for k, v in found["own"].items()}
    values = {
        "request": request,
        "layer": {"scope": scope, "id": scope_id, "operator": operator, "word": SCOPE_WORDS[scope]},
        "found": found,
        "rows": [{**key, **_row(found, key["key"]), "typed": typed.get(key["key"], "")} for key in keys],
        "versions": [
            {
                **version,
                "changes": _changes(
                    version["values"], history[i + 1]["values"] if i + 1 < len(history) else {}, units, system
                ),
            }
            for i, version in enumerate(history)
        ],
        "layers": _layers(context, asker),
        "may_preview": asker.may("analyst"),
        "may_publish": asker.may("engineer") and (asker.operator is None or scope in ("operator", "pump")),
        "preview": shown.preview,
        "problem": _told(shown.problem, keys, system) if shown.problem else None,
        "reason": shown.reason,
    }
    return html_page("thresholds.html", int(shown.problem.status) if shown.problem else 200, values)


def _told(problem: Problem, keys: Sequence[ThresholdKey], system: UnitSystem) -> ProblemDocument:
    """A problem with the ranges of what the reader has in other units than ours."""
    told = problem.body()
    ranges = {
        f"values.{key['key']}": f"; the range is {system.plain(key['low'], key['unit'])} to "
        f"{system.said(key['high'], key['unit'])}"
        for key in keys
        if system.converts(key["unit"])
    }
    if "errors" in told:
        told["errors"] = [
            {"where": e["where"], "problem": e["problem"] + ranges.get(e["where"], "")} for e in told["errors"]
        ]
    return told


def _row(found: Layer, key: str) -> _Held:
    return {"value": found["values"][key]["value"], "origin": found["values"][key]["from"]}


def _changes(
    after: Mapping[str, float], before: Mapping[str, float], units: Mapping[str, str], system: UnitSystem
) -> list[str]:
    """What a version changed beside the one before it, in words; ``units`` are ours by key, where keys have one."""
    words = []
    for key in sorted({*after, *before}):
        old, new = (_written(held.get(key), units.get(key, "-"), system) for held in (before, after))
        if key not in before:
            words.append(f"{key} set to {new}")
        elif key not in after:
            words.append(f"{key} no longer set (was {old})")
        elif after[key] != before[key]:
            words.append(f"{key} from {old} to {new}")
    return words or ["nothing"]


def _written(value: float | None, unit: str, system: UnitSystem) -> str:
    """A value beside its key, which says our unit: another one is said."""
    if value is None:
        return "nothing"
    return system.said(value, unit) if system.converts(unit) else f"{value:g}"


def _layers(context: Context, asker: Principal) -> list[tuple[str, str]]:
    """Layers that are few enough to be listed, with their links; a pump's is reached from its page or by its serial."""
    found = [("whole fleet", _link("fleet", "default", None))]
    found += [
        (f"type {t['id']}", _link("pump-type", t["id"], None)) for t in pump_types.listed(context, asker)["items"]
    ]
    names = [asker.operator] if asker.operator is not None else []
    if asker.operator is None and asker.may("admin"):
        names = [o["operator"] for o in operators.listed(context, asker)["items"]]
    return [*found, *((f"operator {name}", _link("operator", name, None)) for name in names)]
