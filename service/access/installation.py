"""Values that all replicas on one database share: the key that signs cursors, the count that versions never fall below."""

import secrets

from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.orm import Session

from service.storage.database import Database
from service.storage.tables import InstallationValue

CURSOR_KEY = "cursor key"


def cursor_key(database: Database) -> bytes:
    """The key that signs cursors; made by whoever asks first."""
    with database.reading() as session:
        row = session.get(InstallationValue, CURSOR_KEY)
    if row is None:
        with database.writing() as session:
            keep_first(session, CURSOR_KEY, secrets.token_hex(32))
        with database.reading() as session:
            row = session.get_one(InstallationValue, CURSOR_KEY)
    return bytes.fromhex(row.value)


def keep_first(session: Session, name: str, value: str) -> None:
    """Keep a value unless there is one already."""
    insert = sqlite.insert if session.get_bind().dialect.name == "sqlite" else postgresql.insert
    session.execute(insert(InstallationValue).values(name=name, value=value).on_conflict_do_nothing())
