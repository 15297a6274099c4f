"""What bodies of requests have in common; text that every database can hold."""

from functools import lru_cache
from typing import Annotated, Any, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationInfo, field_validator

from twin.pumps.fluids import FLUIDS

_HALVES = range(0xD800, 0xE000)


def is_storable(value: Any) -> bool:
    """False where any text in it holds a NUL, which Postgres refuses and SQLite takes, or half of a surrogate pair."""
    waiting = [value]
    while waiting:  # no recursion: a document may be nested as deep as its reader allows
        one = waiting.pop()
        if isinstance(one, str):
            if any(c == "\x00" or ord(c) in _HALVES for c in one):
                return False
        elif isinstance(one, dict):
            waiting += [*one.keys(), *one.values()]
        elif isinstance(one, list | tuple):
            waiting += one
    return True


def known_fluid(name: str) -> str:
    """The product's own name; a ValueError with the list of those that the twin has properties of."""
    if name not in FLUIDS:
        raise ValueError(f"{name!r} is no fluid that the twin has; known: {', '.join(sorted(FLUIDS))}")
    return name


FluidName = Annotated[str, AfterValidator(known_fluid)]
"""Product name of a fluid that the twin has properties of; another is refused with the list of those."""


class Numbers(BaseModel):
    """A body whose numbers are numbers: what reads JSON would take ``false`` for 0 and ``true`` for 1."""

    @field_validator("*", mode="before")
    @classmethod
    def _is_no_truth(cls, value: Any, info: ValidationInfo) -> Any:
        if _is_numeric(cls, info.field_name or "") and _holds_truth(value):
            raise ValueError("holds true or false where a number belongs")
        return value


@lru_cache(maxsize=1000)
def _is_numeric(body: type[BaseModel], field: str) -> bool:
    """Whether a field takes numbers, alone or in lists and by name, and no truth value."""
    kinds, waiting = set(), [body.model_fields[field].annotation] if field in body.model_fields else []
    while waiting:
        one = waiting.pop()
        parts = get_args(one)
        waiting += parts
        if not parts:
            kinds.add(one)
    return bool(kinds & {int, float}) and bool not in kinds


def _holds_truth(value: Any) -> bool:
    """Whether it is a truth value, or holds one in lists, or under a name; bodies within bodies look for themselves."""
    if isinstance(value, list | tuple):
        return any(map(_holds_truth, value))
    if isinstance(value, dict):
        return any(isinstance(v, bool) for v in value.values())
    return isinstance(value, bool)


class Body(Numbers):
    """A request body: unknown fields, numbers that are none, and text that cannot be stored are refused by name."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    # after the fields' own checks: bodies within bodies have named their own faults by then
    @field_validator("*", mode="after")
    @classmethod
    def _is_storable(cls, value: Any) -> Any:
        if not is_storable(value):
            raise ValueError("holds characters that cannot be stored")
        return value
