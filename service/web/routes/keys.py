"""API keys: made by an admin, shown once, revoked for good."""

from datetime import UTC, datetime
from typing import Annotated

from fastapi import APIRouter, Query
from pydantic import ConfigDict, Field

from service.access import audit, scopes
from service.access.scopes import Scope
from service.access.security import Principal, Role, new_key
from service.answers.administration import Key, KeyMade
from service.answers.words import Page, instant
from service.bodies import Body
from service.errors import Fault, Forbidden, Invalid, NotFound
from service.reading import queries
from service.registry.fields import Written
from service.storage.tables import ApiKey
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf
from service.web.paging import DEFAULT_ITEMS, MOST_ITEMS, page, place_of

router = APIRouter(prefix="/keys", tags=["administration"], route_class=AnswerRoute)


class NewKey(Body):
    """What a key shall be allowed to do; without ``operator`` it sees every operator, without ``scopes`` it does what its
    role may.
    """

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"owner": "hums-office", "role": "analyst", "operator": "north"}]},
    )
    owner: str = Field(min_length=1, max_length=200, examples=["hums-office"])
    role: Role
    operator: str | None = Field(default=None, min_length=1, max_length=200)
    expires_at: Written | None = None
    scopes: list[Scope] | None = Field(default=None, min_length=1, max_length=4)


@router.get("", summary="List keys, without the keys themselves")
def listed(
    context: ContextOf,
    asker: Asker,
    limit: Annotated[int, Query(ge=1, le=MOST_ITEMS)] = DEFAULT_ITEMS,
    cursor: str | None = None,
) -> Page[Key]:
    """All keys that this admin may manage."""
    asker.require("admin")
    query = {"list": "keys"}
    after = place_of(query, cursor)
    wanted = queries.in_order_of_making(ApiKey, asker, after)
    with context.database.reading() as session:
        rows = list(session.scalars(wanted.limit(limit + 1)))
        return page(rows, limit, query, lambda row: [row.created_at.isoformat(), row.id], _shown)


@router.post("", status_code=201, summary="Make a key")
def make(body: NewKey, context: ContextOf, asker: Asker) -> KeyMade:
    """Make a key; it is in this answer and nowhere else."""
    asker.require("admin")
    _check(body, asker)
    with context.database.writing() as session:
        row, key = new_key(
            session, body.owner, body.role, body.operator or asker.operator, body.expires_at, body.scopes
        )
        details = {
            "owner": row.owner,
            "role": row.role,
            "scopes": scopes.shown(row.scopes),
            "expires_at": row.expires_at and row.expires_at.isoformat(),
        }
        audit.note(session, asker, "key.make", f"key/{row.id}", row.operator, details)
        return {**_shown(row), "key": key}


@router.delete("/{key_id}", status_code=204, summary="Revoke a key")
def revoke(key_id: str, context: ContextOf, asker: Asker) -> None:
    """Revoke a key: it opens nothing any more, and what it did stays in the audit log. Safe to repeat."""
    asker.require("admin")
    with context.database.writing() as session:
        row = session.get(ApiKey, key_id)
        if row is None or asker.operator not in (None, row.operator):
            raise NotFound(f"there is no key {key_id}")
        if row.revoked_at is None:
            row.revoked_at = datetime.now(UTC)
            audit.note(session, asker, "key.revoke", f"key/{row.id}", row.operator, {"owner": row.owner})


def _check(body: NewKey, asker: Principal) -> None:
    if asker.operator is not None and body.operator not in (None, asker.operator):
        raise Forbidden(f"an admin of operator {asker.operator} makes keys of that operator only")
    beyond = scopes.beyond(body.scopes, asker.scopes)
    if beyond:
        raise Forbidden(f"{asker.owner} cannot give what it has not: {', '.join(beyond)}")
    if body.expires_at is None:
        return
    if body.expires_at.tzinfo is None:
        raise Invalid("an instant needs a time zone", [Fault("expires_at", "has no time zone: write Z for UTC")])
    if body.expires_at <= datetime.now(UTC):
        raise Invalid("the key would be dead on arrival", [Fault("expires_at", "lies in the past")])


def _shown(row: ApiKey) -> Key:
    return {
        "id": row.id,
        "owner": row.owner,
        "role": row.role,
        "operator": row.operator,
        "scopes": scopes.shown(row.scopes),
        "created_at": instant(row.created_at),
        "expires_at": instant(row.expires_at),
        "last_used_at": instant(row.last_used_at),
        "revoked_at": instant(row.revoked_at),
    }
