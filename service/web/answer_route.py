"""A route whose answer has a shape, and that refuses query parameters which it does not know, by name."""

import inspect
from collections.abc import Callable, Iterable
from functools import wraps
from types import UnionType
from typing import Annotated, Any, get_args, get_origin

from fastapi import Depends, Request, Response
from fastapi.datastructures import DefaultPlaceholder
from fastapi.routing import APIRoute
from pydantic import GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

from service.answers.documents import JsonObject
from service.errors import Fault, Invalid

Endpoint = Callable[..., Any]
SHAPE_KEY = "x-shape"
"""Where a schema carries the name of its shape until the document is complete."""
_UNKNOWN = "unknown_query_parameters"


class Checking:
    """Whether answers are checked against their shapes before they are sent: the tests set it.

    A running service does not: an answer that an older release stored is shown as it is.
    """

    is_on: bool = False


def shape_name(kind: Any) -> str:
    """Name of a shape in the document: ``PumpPage`` for ``Page[Pump]``; empty for several."""
    parts = [*get_args(kind), get_origin(kind) or kind]
    names = [getattr(part, "__name__", "") for part in parts]
    return "" if isinstance(kind, UnionType) else "".join(names)


class _AsItIs:
    """Describes a shape in the document; what is sent is the value itself, to the last digit."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        shape = handler(source)

        def checked(value: Any, validate: Callable[[Any], Any]) -> Any:
            if Checking.is_on:
                validate(value)
            return value

        return core_schema.no_info_wrap_validator_function(
            checked,
            shape,
            # a serializer in Python would cost as much again as the list itself
            serialization=core_schema.simple_ser_schema("any"),
            metadata={
                "pydantic_js_annotation_functions": [
                    lambda _schema, describe: {**describe(shape), SHAPE_KEY: shape_name(source)}
                ]
            },
        )


class AnswerRoute(APIRoute):
    """Route of the API."""

    def __init__(self, path: str, endpoint: Endpoint, **options: Any) -> None:
        model = options.get("response_model")
        if isinstance(model, DefaultPlaceholder):
            model = inspect.signature(endpoint).return_annotation
        if model in (None, inspect.Signature.empty) or (isinstance(model, type) and issubclass(model, Response)):
            options["response_model"] = None
        else:
            options["response_model"] = Annotated[model, _AsItIs()]
        super().__init__(path, _refusing(endpoint), **options)


def unknown_parameters(request: Request) -> list[Fault]:
    """Query parameters that the request's route does not declare, each once."""
    route = request.scope.get("route")
    known = declared_parameters(route) if isinstance(route, AnswerRoute) else None
    if known is None:
        return []
    words = f"is not a parameter of this call; known: {', '.join(known)}" if known else "is not known: there is none"
    return [Fault(f"query.{name}", words) for name in dict.fromkeys(request.query_params) if name not in known]


async def _unknown(request: Request) -> list[Fault]:
    # a coroutine costs no thread
    return unknown_parameters(request)


def declared_parameters(route: APIRoute) -> list[str]:
    """Names of the query parameters that a route declares, in its signature or beside it, in their order."""
    found: list[str] = []
    waiting = [route.dependant]
    while waiting:
        dependant = waiting.pop()
        found += [field.alias for field in dependant.query_params]
        waiting += dependant.dependencies
    beside: Iterable[JsonObject] = (route.openapi_extra or {}).get("parameters", ())
    return list(dict.fromkeys([*found, *(p["name"] for p in beside if p["in"] == "query")]))


def _refusing(endpoint: Endpoint) -> Endpoint:
    """The endpoint, called only where every query parameter is known.

    Raises
    ------
    Invalid
        naming every one that is not.
    """

    def refuse(values: dict[str, Any]) -> None:
        faults: list[Fault] = values.pop(_UNKNOWN)
        if faults:
            raise Invalid(f"the request has {len(faults)} fault(s)", faults)

    if inspect.iscoroutinefunction(endpoint):

        @wraps(endpoint)
        async def called(**values: Any) -> Any:
            refuse(values)
            return await endpoint(**values)

    else:

        @wraps(endpoint)
        def called(**values: Any) -> Any:
            refuse(values)
            return endpoint(**values)

    # after its own parameters, so that faults of those are named in the same answer
    signature = inspect.signature(endpoint)
    further = inspect.Parameter(
        _UNKNOWN, inspect.Parameter.KEYWORD_ONLY, annotation=Annotated[list[Fault], Depends(_unknown)]
    )
    called.__signature__ = signature.replace(  # type: ignore[attr-defined]
        parameters=[*signature.parameters.values(), further]
    )
    return called
