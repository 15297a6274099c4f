"""Stored channel mappings: looked up, listed, appended; versions are never changed."""

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import Select, func, select, tuple_
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from service.access.security import Principal
from service.errors import Conflict, NotFound
from service.ingest.mapping import ChannelMapping
from service.ingest.mapping_version import MappingVersion
from service.storage.tables import StoredMapping


def latest_mapping(session: Session, operator: str, name: str) -> StoredMapping:
    """Newest version of an operator's mapping.

    Raises
    ------
    NotFound
        when this operator has none of that name, whatever others have.
    """
    query = select(StoredMapping).where(StoredMapping.operator == operator, StoredMapping.name == name)
    row = session.scalar(query.order_by(StoredMapping.version.desc()).limit(1))
    if row is None:
        raise NotFound(f"operator {operator} has no channel mapping {name}")
    return row


def mapping_version(session: Session, operator: str, name: str) -> MappingVersion:
    """Newest version of a mapping, ready to be applied."""
    row = latest_mapping(session, operator, name)
    return MappingVersion(row.name, row.version, ChannelMapping.model_validate(row.document))


def mappings(principal: Principal, aircraft_type: str | None, after: Sequence[Any] | None) -> Select[StoredMapping]:
    """Newest version of each mapping that the principal may see, by operator and name."""
    newest = select(StoredMapping.operator, StoredMapping.name, func.max(StoredMapping.version).label("version"))
    found = newest.group_by(StoredMapping.operator, StoredMapping.name).subquery()
    query = select(StoredMapping).join(
        found,
        (StoredMapping.operator == found.c.operator)
        & (StoredMapping.name == found.c.name)
        & (StoredMapping.version == found.c.version),
    )
    if principal.operator is not None:
        query = query.where(StoredMapping.operator == principal.operator)
    if aircraft_type is not None:
        query = query.where(StoredMapping.aircraft_type == aircraft_type)
    if after is not None:
        query = query.where(tuple_(StoredMapping.operator, StoredMapping.name) > tuple(after))
    return query.order_by(StoredMapping.operator, StoredMapping.name)


def append_version(
    session: Session,
    operator: str,
    name: str,
    version: int,
    mapping: ChannelMapping,
    *,
    aircraft_type: str | None,
    description: str,
    author: str,
) -> StoredMapping:
    """Store one version.

    Raises
    ------
    Conflict
        when somebody else stored this version first.
    """
    row = StoredMapping(
        operator=operator,
        name=name,
        version=version,
        aircraft_type=aircraft_type,
        description=description,
        document=mapping.document(),
        author=author,
        created_at=datetime.now(UTC),
    )
    session.add(row)
    try:
        session.flush()
    except IntegrityError:
        raise Conflict(f"the channel mapping {name} was stored at the same moment by somebody else") from None
    return row
