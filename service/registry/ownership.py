"""Which rows of which table belong to an operator: by their own column, or by the row that they refer to."""

from sqlalchemy import ColumnElement, Table, or_, select

from service.storage.tables import Base, ThresholdVersion

_OPERATOR_COLUMN = "operator"
_LAYERS = ThresholdVersion.__table__


def owned_tables() -> dict[str, Table]:
    """Tables that hold rows of operators, those referred to before those that refer."""
    return {table.name: table for table in Base.metadata.sorted_tables if _belongs(table)}


def rows_of(table: Table, operator: str) -> ColumnElement[bool]:
    """Condition that picks an operator's rows of one table."""
    if _OPERATOR_COLUMN in table.c:
        own = table.c[_OPERATOR_COLUMN] == operator
        # the layer of an operator names it as what it is about, and as nobody's: a namesake would inherit it
        layer = (table.c.scope == "operator") & (table.c.scope_id == operator) if table is _LAYERS else None
        return own if layer is None else own | layer
    conditions = []
    for key in table.foreign_keys:
        parent = key.column.table
        if parent is not table and _belongs(parent):
            conditions.append(key.parent.in_(select(key.column).where(rows_of(parent, operator))))
    return or_(*conditions)


def _belongs(table: Table) -> bool:
    if _OPERATOR_COLUMN in table.c:
        return True
    return any(k.column.table is not table and _belongs(k.column.table) for k in table.foreign_keys)
