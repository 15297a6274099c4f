"""Users of the pages: made and managed by an admin."""

from datetime import UTC, datetime
from typing import Annotated

from fastapi import APIRouter, Query
from pydantic import ConfigDict, Field, SecretStr
from sqlalchemy import select, tuple_

from service.access import audit
from service.access.security import Role
from service.access.sessions import end_sessions_of
from service.access.users import address_faults, new_user, password_faults, set_password, user
from service.answers.administration import SessionsEnded
from service.answers.administration import User as Account
from service.answers.words import Page, instant
from service.bodies import Body
from service.errors import Forbidden, Invalid
from service.storage.tables import User
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf
from service.web.paging import DEFAULT_ITEMS, MOST_ITEMS, page, place_of

router = APIRouter(prefix="/users", tags=["administration"], route_class=AnswerRoute)

Operator = Annotated[str | None, Query(description="Tells namesakes of several operators apart")]


class NewUser(Body):
    """Somebody who shall sign in; without ``operator`` that of the admin, or every one's."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"name": "j.dupont", "password": "a long sentence is easy", "role": "analyst"}]
        },
    )
    name: str = Field(max_length=200)
    password: SecretStr
    role: Role
    operator: str | None = Field(default=None, min_length=1, max_length=200)
    email: str | None = Field(default=None, max_length=320)
    wants_mail: bool = False


class ChangedUser(Body):
    """What shall change; what is left out stays."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"role": "engineer"}]})
    password: SecretStr | None = None
    role: Role | None = None
    email: str | None = Field(default=None, max_length=320)
    wants_mail: bool | None = None
    disabled: bool | None = None


@router.get("", summary="List users")
def listed(
    context: ContextOf,
    asker: Asker,
    limit: Annotated[int, Query(ge=1, le=MOST_ITEMS)] = DEFAULT_ITEMS,
    cursor: str | None = None,
) -> Page[Account]:
    """The users that this admin may manage."""
    asker.require("admin")
    query = {"list": "users"}
    after = place_of(query, cursor)
    wanted = select(User).order_by(User.name, User.id)
    if asker.operator is not None:
        wanted = wanted.where(User.operator == asker.operator)
    if after is not None:
        wanted = wanted.where(tuple_(User.name, User.id) > (after[0], after[1]))
    with context.database.reading() as session:
        rows = list(session.scalars(wanted.limit(limit + 1)))
        return page(rows, limit, query, lambda row: [row.name, row.id], _shown)


@router.post("", status_code=201, summary="Make a user")
def make(body: NewUser, context: ContextOf, asker: Asker) -> Account:
    """Make a user with a password of at least 12 characters."""
    asker.require("admin")
    if asker.operator is not None and body.operator not in (None, asker.operator):
        raise Forbidden(f"an admin of operator {asker.operator} makes users of that operator only")
    with context.database.writing() as session:
        row = new_user(
            session,
            body.name,
            body.password.get_secret_value(),
            body.role,
            body.operator or asker.operator,
            body.email,
            body.wants_mail,
        )
        details = {"role": row.role, "operator": row.operator}
        audit.note(session, asker, "user.make", f"user/{row.name}", row.operator, details)
        return _shown(row)


@router.patch("/{name}", summary="Change a user")
def change(name: str, body: ChangedUser, context: ContextOf, asker: Asker, operator: Operator = None) -> Account:
    """Change password, role, mail or access; a new password or a lost access ends the user's sessions."""
    asker.require("admin")
    wanted = body.model_dump(exclude_unset=True)
    with context.database.writing() as session:
        row = user(session, asker, name, operator)
        faults = password_faults(body.password.get_secret_value()) if body.password else []
        faults += address_faults(
            body.email if "email" in wanted else row.email,
            row.wants_mail if body.wants_mail is None else body.wants_mail,
        )
        if faults:
            raise Invalid(f"{len(faults)} fault(s); the user is unchanged", faults)
        if body.password is not None:
            set_password(row, body.password.get_secret_value())
        if body.role is not None:
            row.role = body.role
        if "email" in wanted:
            row.email = body.email
        if body.wants_mail is not None:
            row.wants_mail = body.wants_mail
        if body.disabled is not None:
            row.disabled_at = (row.disabled_at or datetime.now(UTC)) if body.disabled else None
        if body.password is not None or body.disabled:
            end_sessions_of(session, row)
        changed = {k: v for k, v in wanted.items() if k != "password"}
        details = {"changed": sorted(wanted), **changed}
        audit.note(session, asker, "user.change", f"user/{row.name}", row.operator, details)
        return _shown(row)


@router.delete("/{name}/sessions", summary="Sign a user out everywhere")
def sign_out(name: str, context: ContextOf, asker: Asker, operator: Operator = None) -> SessionsEnded:
    """End every session of a user."""
    asker.require("admin")
    with context.database.writing() as session:
        row = user(session, asker, name, operator)
        ended = end_sessions_of(session, row)
        audit.note(session, asker, "user.sign_out", f"user/{row.name}", row.operator, {"sessions": ended})
        return {"ended": ended}


def _shown(row: User) -> Account:
    return {
        "name": row.name,
        "role": row.role,
        "operator": row.operator,
        "email": row.email,
        "wants_mail": row.wants_mail,
        "created_at": instant(row.created_at),
        "disabled_at": instant(row.disabled_at),
        "last_signed_in_at": instant(row.last_signed_in_at),
    }
