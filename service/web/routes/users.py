"""Users of the pages: made and managed by an admin."""

import secrets
from datetime import UTC, datetime
from typing import Annotated

from fastapi import APIRouter, Query
from pydantic import ConfigDict, Field, SecretStr
from sqlalchemy import select, tuple_

from service.access import audit
from service.access.security import Principal, Role
from service.access.sessions import end_sessions_of
from service.access.users import address_faults, link, new_user, password_faults, set_password, user
from service.answers.administration import SessionsEnded
from service.answers.administration import User as Account
from service.answers.words import Page, instant
from service.bodies import Body
from service.errors import Fault, Forbidden, Invalid
from service.storage.tables import User
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf
from service.web.paging import DEFAULT_ITEMS, MOST_ITEMS, page, place_of

router = APIRouter(prefix="/users", tags=["administration"], route_class=AnswerRoute)

Operator = Annotated[str | None, Query(description="Tells namesakes of several operators apart")]


class NewUser(Body):
    """Somebody who shall sign in; without ``operator`` that of the admin, or every one's.

    With an ``oidc_subject``, which only an admin of every operator gives, a password is not needed.
    """

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"name": "j.dupont", "password": "a long sentence is easy", "role": "analyst"}]
        },
    )
    name: str = Field(max_length=200)
    password: SecretStr | None = None
    role: Role
    operator: str | None = Field(default=None, min_length=1, max_length=200)
    email: str | None = Field(default=None, max_length=320)
    wants_mail: bool = False
    oidc_subject: str | None = Field(default=None, min_length=1, max_length=255)


class ChangedUser(Body):
    """What shall change; what is left out stays."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"role": "engineer"}]})
    password: SecretStr | None = None
    role: Role | None = None
    email: str | None = Field(default=None, max_length=320)
    wants_mail: bool | None = None
    disabled: bool | None = None
    oidc_subject: str | None = Field(default=None, min_length=1, max_length=255)


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
    if body.password is None and body.oidc_subject is None:
        raise Invalid(
            "1 fault(s); no user was made", [Fault("body.password", "is missing, and no oidc_subject is given")]
        )
    if body.oidc_subject is not None:
        _check_linking(asker)
    with context.database.writing() as session:
        row = new_user(
            session,
            body.name,
            secrets.token_urlsafe(48) if body.password is None else body.password.get_secret_value(),
            body.role,
            body.operator or asker.operator,
            body.email,
            body.wants_mail,
        )
        if body.oidc_subject is not None:
            link(session, row, body.oidc_subject)
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
        if "oidc_subject" in wanted:
            _check_linking(asker)
            link(session, row, body.oidc_subject)
        if body.disabled is not None:
            row.disabled_at = (row.disabled_at or datetime.now(UTC)) if body.disabled else None
        if body.password is not None or body.disabled or "oidc_subject" in wanted:
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


def _check_linking(asker: Principal) -> None:
    """Subjects are unique over all operators: whoever sees one of them only must not learn of the others'."""
    if asker.operator is not None:
        raise Forbidden("accounts elsewhere are linked by an admin who sees every operator")


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
        "oidc_subject": row.oidc_subject,
    }
