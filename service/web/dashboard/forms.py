"""What a form brings: who sends it, checked by the session's token or the origin, and its fields as text."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Annotated, Any, TypeVar
from urllib.parse import urlsplit

from fastapi import Depends, Request
from fastapi.responses import RedirectResponse
from pydantic import BaseModel, ValidationError
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import FormData

from service.access.security import EVERYBODY, Principal
from service.access.sessions import Visitor
from service.answers.documents import JsonObject
from service.bodies import is_storable
from service.context import Context
from service.errors import Fault, Forbidden, Invalid, TooLarge, Unauthenticated
from service.units import METRIC, SYSTEMS, UnitSystem, unit_of
from service.web.dependencies import context_of, visitor_of

AnyBody = TypeVar("AnyBody", bound=BaseModel)
TOKEN = "csrf_token"  # noqa: S105 - the name of a field
UNITS = "units"
"""Name of the field in which a form says what units its numbers are in."""
_MOST_BYTES = 2**20
_MOST_FIELDS = 2000


@dataclass(frozen=True, slots=True)
class Sent:
    """A form that may be acted upon, its fields without the token; every value is stripped text."""

    request: Request
    context: Context
    who: Principal
    fields: Mapping[str, Sequence[str]]

    def text(self, name: str) -> str:
        """Value of a field; empty where it was not sent."""
        return next(iter(self.fields.get(name, ())), "")

    def all(self, name: str) -> Sequence[str]:
        """Every value of a field that may be sent several times, without the empty ones."""
        return [value for value in self.fields.get(name, ()) if value]

    def filled(self, without: Sequence[str] = ()) -> JsonObject:
        """The fields that were filled in, each with its first value: what is left open says nothing.

        Numbers that a name says the unit of, ``measured_case_flow_lpm``, come in it, whatever units the form was shown in.
        """
        system, left_out = self.system, {*without, UNITS}
        return {
            name: in_ours(values[0], name, system)
            for name, values in self.fields.items()
            if name not in left_out and values[0]
        }

    @property
    def system(self) -> UnitSystem:
        """Units that the form was shown in: it says so itself, for its reader may have chosen others since.

        Raises
        ------
        Invalid
            for units that there are none of.
        """
        name = self.text(UNITS) or METRIC.name
        if name not in SYSTEMS:
            raise Invalid("nothing was changed", [Fault(UNITS, f"is not one of {', '.join(SYSTEMS)}")])
        return SYSTEMS[name]

    def instant(self, name: str) -> str | None:
        """Time of a field with the zone that it lacks (the pages speak UTC); None where it is empty."""
        return zoned(self.text(name)) if self.text(name) else None

    def goes_back_to(self, link: str) -> None:
        """Where the page of a problem leads back to."""
        self.request.state.back = link


def in_ours(text: str, name: str, system: UnitSystem) -> str | float:
    """What somebody typed in a field, in the unit that its name ends in; text that needs no conversion, or is no number, stays."""
    unit = unit_of(name)
    if not system.converts(unit):
        return text
    try:
        return system.stored(text, unit)
    except ValueError:
        return text


async def sent_form(request: Request) -> Sent:
    """The form of a request, once it is known to come from a page of ours.

    Raises
    ------
    Unauthenticated, Forbidden
        without a session, with a token that is not the session's, or from another origin.
    Invalid, TooLarge
        when it is no form, or a larger one than any page has.
    """
    visitor = await run_in_threadpool(signed_in, request)
    declared = request.headers.get("content-length", "")
    if not declared.isdigit():
        raise Invalid("a form needs its length", [Fault("content-length", "is missing")])
    if int(declared) > _MOST_BYTES:
        raise TooLarge(f"the form is larger than {_MOST_BYTES} bytes")
    async with request.form(max_files=0, max_fields=_MOST_FIELDS) as form:
        who = sender(visitor, form)
        fields = texts(form)
    return Sent(request, context_of(request), who, fields)


def signed_in(request: Request) -> Visitor | None:
    """Who sends the form; None where authentication is off and the form's origin is ours.

    Raises
    ------
    Unauthenticated, Forbidden
        without a session, or without one to ask for from another origin.
    """
    if not context_of(request).settings.auth_is_on:
        origin = urlsplit(request.headers.get("origin", ""))
        # without sessions a form is known by its origin, which browsers send with every form
        if origin.netloc != request.headers.get("host", ""):
            raise Forbidden("the form does not come from these pages: open the page again and repeat")
        return None
    visitor = visitor_of(request)
    if visitor is None:
        raise Unauthenticated("sign in first: nothing was changed")
    return visitor


def sender(visitor: Visitor | None, form: FormData) -> Principal:
    """In whose name a form is acted upon; raises ``Forbidden`` where its token is not the session's."""
    if visitor is None:
        return EVERYBODY
    token = form.get(TOKEN, "")
    visitor.check_form(token if isinstance(token, str) else "")
    return visitor.principal


def texts(form: FormData) -> dict[str, list[str]]:
    """Fields of a form as stripped text, files and the token left out.

    Raises
    ------
    Invalid
        naming every field with characters that no database takes.
    """
    found: dict[str, list[str]] = {}
    for name, value in form.multi_items():
        if isinstance(value, str) and name != TOKEN:
            # what somebody types as a password is kept to the last blank
            found.setdefault(name, []).append(value if name == "password" else value.strip())
    bad = [n for n, values in found.items() if not is_storable(n) or not is_storable(values)]
    if bad:
        raise Invalid("the form cannot be stored", [Fault(ascii(n), "holds characters that no text has") for n in bad])
    return found


def checked(kind: type[AnyBody], values: Mapping[str, Any], what: str) -> AnyBody:
    """Values of a form as the API takes them; one error names every fault."""
    try:
        return kind.model_validate(values)
    except ValidationError as error:
        faults = [Fault(".".join(str(part) for part in e["loc"]), e["msg"]) for e in error.errors()]
        raise Invalid(f"the {what} has {len(faults)} fault(s); nothing was entered", faults) from None


def zoned(text: str) -> str:
    """Time of a form's field with the zone that it lacks: the pages speak UTC."""
    return text if text.endswith("Z") else f"{text}Z"


def instant_of(text: str, where: str) -> datetime:
    """Time of a form's field, in UTC where it names no zone.

    Raises
    ------
    Invalid
        naming the field.
    """
    try:
        found = datetime.fromisoformat(text)
    except ValueError:
        raise Invalid("the time cannot be read", [Fault(where, "is not a time like 2026-05-08T12:00")]) from None
    return found.replace(tzinfo=UTC) if found.tzinfo is None else found


def done(link: str) -> RedirectResponse:
    """Lead on to a page after a form has done its work."""
    return RedirectResponse(link, status_code=303)


SentForm = Annotated[Sent, Depends(sent_form)]
