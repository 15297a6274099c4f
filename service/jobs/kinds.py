"""The one registry of kinds of jobs: what each takes, who may start it, and how it works on its items."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, ClassVar, Generic, TypeVar

from pydantic import ConfigDict
from sqlalchemy.orm import Session

from service.access.security import Principal
from service.answers.documents import JsonObject
from service.answers.jobs import JobResult
from service.bodies import Body
from service.context import Context
from service.errors import Fault, Invalid

NAME_LENGTH = 500


class Parameters(Body):
    """What a kind of job is started with; unknown fields are refused by name."""

    model_config = ConfigDict(frozen=True)


P = TypeVar("P", bound=Parameters)
State = TypeVar("State")


@dataclass(frozen=True, slots=True)
class Work(Generic[P]):
    """What a running job knows of itself. ``principal`` has the rights of whoever started it."""

    job_id: str
    context: Context
    principal: Principal
    operator: str | None
    parameters: P


@dataclass(frozen=True, slots=True)
class Item:
    """Result of one item; ``status`` is a word of its kind, ``detail`` is shown as it is."""

    name: str
    status: str
    detail: JsonObject = field(default_factory=dict)


class Kind(ABC, Generic[P, State]):
    """A kind of job: a row of items, worked on in order, by several workers where it comes in parts.

    An item may be worked on twice when a process dies between the work and the note of it, so that work must be
    harmless when repeated; its result is stored exactly once.
    """

    name: ClassVar[str]
    role: ClassVar[str] = "analyst"
    over_api: ClassVar[bool] = True
    """Whether ``POST /jobs`` starts it; some kinds have a call of their own."""
    parameters: type[P]
    most_parts: ClassVar[int] = 1
    """Parts at most that its items are shared out in between workers; each opens what the items need for itself."""
    internal: ClassVar[frozenset[str]] = frozenset()
    """Parameters that are not shown: they would tell one operator how much the others have."""

    def prepared(self, _session: Session, parameters: P, _operator: str | None) -> P:
        """Parameters checked against what is stored, and made complete, when the job is asked for."""
        return parameters

    def role_for(self, _parameters: P) -> str:
        """Role that these parameters take, at least ``role``."""
        return self.role

    @abstractmethod
    @contextmanager
    def opened(self, work: Work[P]) -> Iterator[State]:
        """Whatever the items need, opened once per run."""

    @abstractmethod
    def total(self, work: Work[P], state: State) -> int:
        """Number of items; the same at every run of the same job."""

    @abstractmethod
    def item(self, work: Work[P], state: State, position: int) -> Item:
        """Work on one item."""

    def result(self, _work: Work[P], _state: State, counts: dict[str, int]) -> JobResult:
        """The job's result beside its items, once all of them are done: number of items by status, and documents."""
        return {"counts": counts}


_KINDS: dict[str, Kind[Any, Any]] = {}


def register(kind: Callable[[], Kind[Any, Any]]) -> Any:
    """Class decorator: make a kind known by its name.

    Raises
    ------
    ValueError
        when the name is taken.
    """
    made = kind()
    if made.name in _KINDS:
        raise ValueError(f"there are two kinds of jobs {made.name}")
    _KINDS[made.name] = made
    return kind


def kind_named(name: str) -> Kind[Any, Any]:
    """A kind by name.

    Raises
    ------
    Invalid
        naming those that exist.
    """
    if name not in _KINDS:
        raise Invalid(f"there is no kind of job {name!r}", [Fault("kind", f"is not one of {', '.join(kind_names())}")])
    return _KINDS[name]


def kind_names() -> Sequence[str]:
    """Names of all kinds."""
    return sorted(_KINDS)
