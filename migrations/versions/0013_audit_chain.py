"""The audit log is a chain: a link per entry with the hash of its salted content, and a head that is signed.

Entries that are there are chained in the order of their ids: from here on nothing of them can change unseen. The head
is signed by the first process that starts with a key. Backups are noted from here on.
"""

import json
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

import sqlalchemy as sa
from alembic import op

from service.storage.audit_chain import HEAD_ID, content_hash, first_link, link_hash, new_chain_id, new_salt
from service.storage.tables.base import JSON_COLUMN, UtcDateTime

revision = "0013"
down_revision = "0012"
branch_labels = None
depends_on = None
_BATCH = 1000

_ENTRIES = sa.table(
    "audit_entries",
    sa.column("id", sa.Integer()),
    sa.column("at", UtcDateTime()),
    *(sa.column(name, sa.String()) for name in ("actor", "role", "operator", "action", "subject", "salt")),
    sa.column("details", JSON_COLUMN),
)


def upgrade() -> None:
    """Make the tables, and chain what is there."""
    # SQLite gives the number of an erased last row to the next one, and a link names its entry by number
    with op.batch_alter_table("audit_entries", recreate="auto", table_kwargs={"sqlite_autoincrement": True}) as batch:
        batch.add_column(sa.Column("salt", sa.String(), nullable=True))
        if op.get_bind().dialect.name == "sqlite":
            batch.alter_column("id", existing_type=sa.Integer(), nullable=False, autoincrement=True)
    links = op.create_table(
        "audit_links",
        sa.Column("position", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("entry_id", sa.Integer(), nullable=False),
        sa.Column("content_hash", sa.String(), nullable=False),
        sa.Column("link", sa.String(), nullable=False),
        sa.PrimaryKeyConstraint("position", name=op.f("pk_audit_links")),
        sa.UniqueConstraint("entry_id", name=op.f("uq_audit_links_entry_id")),
    )
    heads = op.create_table(
        "audit_heads",
        sa.Column("id", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("chain_id", sa.String(), nullable=False),
        sa.Column("count", sa.Integer(), nullable=False),
        sa.Column("link", sa.String(), nullable=False),
        sa.Column("public_key", sa.String(), nullable=False),
        sa.Column("signature", sa.String(), nullable=False),
        sa.Column("signed_at", sa.DateTime(timezone=True), nullable=True),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_audit_heads")),
    )
    op.create_table(
        "backups",
        sa.Column("id", sa.String(), nullable=False),
        sa.Column("started_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("finished_at", sa.DateTime(timezone=True), nullable=True),
        sa.Column("removed_at", sa.DateTime(timezone=True), nullable=True),
        sa.Column("place", sa.String(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_backups")),
    )
    chain_id = new_chain_id()
    link, count = first_link(chain_id), 0
    for rows in _batches(op.get_bind()):
        salts = [{"the_id": row.id, "the_salt": new_salt()} for row in rows]
        made = []
        for row, salt in zip(rows, salts, strict=True):
            count += 1
            hashed = content_hash(salt["the_salt"], _content(row))
            link = link_hash(link, count, row.id, hashed)
            made.append({"position": count, "entry_id": row.id, "content_hash": hashed, "link": link})
        salted = sa.update(_ENTRIES).where(_ENTRIES.c.id == sa.bindparam("the_id"))
        op.get_bind().execute(salted.values(salt=sa.bindparam("the_salt")), salts)
        op.bulk_insert(links, made)
    head = {"id": HEAD_ID, "chain_id": chain_id, "count": count, "link": link, "public_key": "", "signature": ""}
    op.bulk_insert(heads, [head])


def downgrade() -> None:
    """Drop them: with the links goes the proof."""
    for table in ("backups", "audit_heads", "audit_links"):
        op.drop_table(table)
    with op.batch_alter_table("audit_entries") as batch:
        batch.drop_column("salt")


def _batches(connection: sa.Connection) -> Iterator[list[Any]]:
    last = -1
    while True:
        query = sa.select(_ENTRIES).where(_ENTRIES.c.id > last).order_by(_ENTRIES.c.id).limit(_BATCH)
        rows = list(connection.execute(query))
        if not rows:
            return
        yield rows
        last = rows[-1].id


def _content(row: Any) -> dict[str, Any]:
    at: datetime = row.at
    details = json.loads(row.details) if isinstance(row.details, str) else row.details
    texts = {name: getattr(row, name) for name in ("actor", "role", "operator", "action", "subject")}
    return {"at": at.astimezone(UTC).isoformat(timespec="microseconds"), **texts, "details": details}
