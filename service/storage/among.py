"""Whether a number is among many others: one value for the database however many they are, not one for each."""

from collections.abc import Collection
from typing import Any

from sqlalchemy import ARRAY, JSON, Boolean, Dialect, Integer, bindparam
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.compiler import SQLCompiler
from sqlalchemy.sql.elements import ColumnElement
from sqlalchemy.sql.functions import FunctionElement
from sqlalchemy.types import TypeDecorator, TypeEngine


class _Numbers(TypeDecorator[list[int]]):
    """Numbers as one value: an array for Postgres, a JSON document for SQLite."""

    impl = JSON
    cache_ok = True

    def load_dialect_impl(self, dialect: Dialect) -> TypeEngine[Any]:
        return dialect.type_descriptor(ARRAY(Integer()) if dialect.name == "postgresql" else JSON())


class _Among(FunctionElement[bool]):
    inherit_cache = True
    type = Boolean()

    def self_group(self, against: Any = None) -> Any:
        """The condition as it is: SQLite would not use an index for one that is compared with 1."""
        return self


@compiles(_Among)
def _in_json(element: _Among, compiler: SQLCompiler, **options: Any) -> str:
    column, numbers = (compiler.process(part, **options) for part in element.clauses)
    return f"({column} IN (SELECT value FROM json_each({numbers})))"  # noqa: S608 - compiled parts


@compiles(_Among, "postgresql")
def _in_array(element: _Among, compiler: SQLCompiler, **options: Any) -> str:
    column, numbers = (compiler.process(part, **options) for part in element.clauses)
    return f"({column} = ANY({numbers}))"


def among(column: Any, numbers: Collection[int]) -> ColumnElement[bool]:
    """Condition that a column of whole numbers holds one of ``numbers``.

    A list of parameters is compiled, sent and planned anew for every length: with thousands of pumps that costs more than
    what the statement finds.
    """
    return _Among(column, bindparam(None, list(numbers), type_=_Numbers(), unique=True))
