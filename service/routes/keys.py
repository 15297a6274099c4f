"""API keys: made by an admin, shown once."""

from datetime import UTC, datetime
from typing import Any, Literal

from fastapi import APIRouter
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy import select

from service.context import Asker, ContextOf
from service.errors import Fault, Forbidden, Invalid
from service.security import Principal, new_key
from service.tables import ApiKey

router = APIRouter(prefix="/keys", tags=["administration"])


class NewKey(BaseModel):
    """What a key shall be allowed to do; without ``operator`` it sees every operator."""

    model_config = ConfigDict(extra="forbid")
    owner: str = Field(min_length=1, max_length=200, examples=["hums-office"])
    role: Literal["viewer", "analyst", "engineer", "admin"]
    operator: str | None = Field(default=None, min_length=1, max_length=200)
    expires_at: datetime | None = None


@router.get("", summary="List keys, without the keys themselves")
def listed(context: ContextOf, asker: Asker) -> dict[str, Any]:
    """All keys that this admin may manage."""
    asker.require("admin")
    query = select(ApiKey).order_by(ApiKey.created_at, ApiKey.id)
    if asker.operator is not None:
        query = query.where(ApiKey.operator == asker.operator)
    with context.database.reading() as session:
        return {"items": [_shown(row) for row in session.scalars(query)], "next": None}


@router.post("", status_code=201, summary="Make a key")
def make(body: NewKey, context: ContextOf, asker: Asker) -> dict[str, Any]:
    """Make a key; it is in this answer and nowhere else."""
    asker.require("admin")
    _check(body, asker)
    with context.database.writing() as session:
        row, key = new_key(session, body.owner, body.role, body.operator or asker.operator, body.expires_at)
        return _shown(row) | {"key": key}


def _check(body: NewKey, asker: Principal) -> None:
    if asker.operator is not None and body.operator not in (None, asker.operator):
        raise Forbidden(f"an admin of operator {asker.operator} makes keys of that operator only")
    if body.expires_at is None:
        return
    if body.expires_at.tzinfo is None:
        raise Invalid("an instant needs a time zone", [Fault("expires_at", "has no time zone: write Z for UTC")])
    if body.expires_at <= datetime.now(UTC):
        raise Invalid("the key would be dead on arrival", [Fault("expires_at", "lies in the past")])


def _shown(row: ApiKey) -> dict[str, Any]:
    return {
        "id": row.id,
        "owner": row.owner,
        "role": row.role,
        "operator": row.operator,
        "created_at": row.created_at,
        "expires_at": row.expires_at,
        "last_used_at": row.last_used_at,
    }
