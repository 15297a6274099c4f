"""Pages of an admin: keys, users, webhooks, the audit log. What is secret is shown once, on the page that made it."""

from collections.abc import Mapping
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from fastapi.responses import HTMLResponse, Response

from service.access.security import ROLES, Principal
from service.access.users import user
from service.answers.administration import KeyMade, WebhookMade
from service.context import Context
from service.web.dashboard.forms import SentForm, checked, done, instant_of
from service.web.dashboard.frame import PageRoute, html_page
from service.web.dashboard.links import address
from service.web.dependencies import Asker, ContextOf
from service.web.routes import audit, keys, users, webhooks

administration_router = APIRouter(include_in_schema=False, route_class=PageRoute)
_PER_PAGE = 100


@administration_router.get("/keys", response_class=HTMLResponse)
def keys_page(request: Request, context: ContextOf, asker: Asker, cursor: str | None = None) -> Response:
    """Keys without the keys themselves, and a form that makes one."""
    return _keys(request, context, asker, cursor, None)


@administration_router.post("/keys")
def make_key(form: SentForm) -> Response:
    """Make a key and show it, this once."""
    form.goes_back_to("/keys")
    form.who.require("admin")
    values = form.filled(without=("expires_at", "scope")) | {"expires_at": form.instant("expires_at")}
    if form.text("scope"):
        values["scopes"] = [form.text("scope")]
    made = keys.make(checked(keys.NewKey, values, "key"), form.context, form.who)
    return _keys(form.request, form.context, form.who, None, made)


@administration_router.post("/keys/{key_id}/revoke")
def revoke_key(key_id: str, form: SentForm) -> Response:
    """Revoke a key for good."""
    form.goes_back_to("/keys")
    keys.revoke(key_id, form.context, form.who)
    return done("/keys")


def _keys(request: Request, context: Context, asker: Principal, cursor: str | None, made: KeyMade | None) -> Response:
    found = keys.listed(context, asker, limit=_PER_PAGE, cursor=cursor)
    return html_page("keys.html", 200, _values(request, asker, "keys", found, cursor) | {"made": made})


@administration_router.get("/users", response_class=HTMLResponse)
def users_page(request: Request, context: ContextOf, asker: Asker, cursor: str | None = None) -> Response:
    """Who may sign in, and a form that makes a user."""
    found = users.listed(context, asker, limit=_PER_PAGE, cursor=cursor)
    return html_page("users.html", 200, _values(request, asker, "users", found, cursor))


@administration_router.post("/users")
def make_user(form: SentForm) -> Response:
    """Make a user."""
    form.goes_back_to("/users")
    form.who.require("admin")
    values = {"name": form.text("name"), **form.filled(without=("wants_mail",))}
    values |= {"password": form.text("password"), "wants_mail": bool(form.text("wants_mail"))}
    users.make(checked(users.NewUser, values, "user"), form.context, form.who)
    return done("/users")


@administration_router.post("/users/{name}")
def change_user(name: str, form: SentForm) -> Response:
    """Change what differs from what is stored; a password that is left empty stays."""
    form.goes_back_to("/users")
    form.who.require("admin")
    with form.context.database.reading() as session:
        row = user(session, form.who, name)
        held = {"role": row.role, "email": row.email, "wants_mail": row.wants_mail, "disabled": bool(row.disabled_at)}
    known = ("role", "email", "wants_mail", "disabled", "password")
    wanted: dict[str, str | bool | None] = {
        "role": form.text("role") or held["role"],
        "email": form.text("email") or None,
        "wants_mail": bool(form.text("wants_mail")),
        "disabled": bool(form.text("disabled")),
    }
    changed = {key: value for key, value in wanted.items() if value != held[key]}
    if form.text("password"):
        changed["password"] = form.text("password")
    body = checked(users.ChangedUser, form.filled(without=known) | changed, "change")
    if changed:
        users.change(name, body, form.context, form.who)
    return done("/users")


@administration_router.post("/users/{name}/sign-out")
def sign_out_user(name: str, form: SentForm) -> Response:
    """End every session of a user."""
    form.goes_back_to("/users")
    users.sign_out(name, form.context, form.who)
    return done("/users")


@administration_router.get("/webhooks", response_class=HTMLResponse)
def webhooks_page(
    request: Request, context: ContextOf, asker: Asker, deliveries: str | None = None, cursor: str | None = None
) -> Response:
    """Where changes of alarms are sent, a form that adds one, and how the deliveries of one went."""
    return _webhooks(request, context, asker, (deliveries, cursor), None)


@administration_router.post("/webhooks")
def add_webhook(form: SentForm) -> Response:
    """Add a webhook and show what signs its deliveries, this once."""
    form.goes_back_to("/webhooks")
    form.who.require("admin")
    values = {"url": form.text("url"), **form.filled(without=("events",)), "events": form.all("events")}
    made = webhooks.make(checked(webhooks.NewWebhook, values, "webhook"), form.context, form.who)
    return _webhooks(form.request, form.context, form.who, (None, None), made)


@administration_router.post("/webhooks/{webhook_id}/remove")
def remove_webhook(webhook_id: str, form: SentForm) -> Response:
    """Stop sending."""
    form.goes_back_to("/webhooks")
    webhooks.remove(webhook_id, form.context, form.who)
    return done("/webhooks")


def _webhooks(
    request: Request,
    context: Context,
    asker: Principal,
    looked_at: tuple[str | None, str | None],
    made: WebhookMade | None,
) -> Response:
    chosen, cursor = looked_at
    found = webhooks.listed(context, asker, limit=_PER_PAGE, cursor=None if chosen else cursor)
    values = _values(request, asker, "webhooks", found, None if chosen else cursor)
    deliveries = webhooks.deliveries(chosen, context, asker, limit=_PER_PAGE, cursor=cursor) if chosen else None
    older = deliveries and deliveries["next"]
    return html_page(
        "webhooks.html",
        200,
        values
        | {
            "made": made,
            "events": webhooks.EVENTS,
            "chosen": chosen,
            "deliveries": deliveries["items"] if deliveries else [],
            "older": address("webhooks", query={"deliveries": chosen, "cursor": older}) if older else None,
        },
    )


@administration_router.get("/audit", response_class=HTMLResponse)
def audit_page(
    request: Request,
    context: ContextOf,
    asker: Asker,
    actor: str | None = None,
    action: str | None = None,
    subject: str | None = None,
    since: Annotated[str, Query(alias="from")] = "",
    until: Annotated[str, Query(alias="to")] = "",
    cursor: str | None = None,
) -> Response:
    """Who changed what, the newest first."""
    found = audit.listed(
        context,
        asker,
        actor=actor,
        action=action,
        subject=subject,
        since=instant_of(since, "from") if since else None,
        until=instant_of(until, "to") if until else None,
        limit=_PER_PAGE,
        cursor=cursor,
    )
    filters = {"actor": actor, "action": action, "subject": subject, "from": since, "to": until}
    return html_page("audit.html", 200, _values(request, asker, "audit", found, cursor, filters) | {"filters": filters})


def _values(
    request: Request,
    asker: Principal,
    path: str,
    found: Any,
    cursor: str | None,
    filters: Mapping[str, str | None] | None = None,
) -> dict[str, object]:
    """What every list of an admin shows."""
    query = filters or {}
    return {
        "request": request,
        "items": found["items"],
        "next": address(path, query={**query, "cursor": found["next"]}) if found["next"] else None,
        "first": address(path, query=query) if cursor else None,
        "roles": ROLES,
        "sees_all": asker.operator is None,
    }
