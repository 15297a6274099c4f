"""What this installation remembers of the audit log beside its database: a log that is put back to an older state shows.

A database that somebody rolls back, or begins anew, holds a head that was once signed rightly. The data folder keeps
the furthest head that a process has met: the chain must go through it.
"""

import contextlib
import json
import os
import secrets
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

import structlog
from sqlalchemy import select

from service.storage.audit_chain import HEAD_ID, Head, first_link, head_of, sign
from service.storage.audit_key import AuditKey
from service.storage.database import Database
from service.storage.tables import AuditHead, AuditLink

ANCHOR_FILE = "audit-anchor.json"
log = structlog.get_logger("casedrain.audit")


@dataclass(frozen=True, slots=True)
class Anchor:
    """A place that a chain must go through: ``count`` links, the last of them ``link``."""

    chain_id: str
    count: int
    link: str

    @classmethod
    def of(cls, head: Head) -> "Anchor":
        """Anchor at a head."""
        return cls(head.chain_id, head.count, head.link)


def read_anchor(folder: Path) -> Anchor | None:
    """The anchor of a data folder; None where there is none yet.

    Raises
    ------
    ValueError
        when the file is no anchor.
    """
    file = folder / ANCHOR_FILE
    try:
        return anchor_from(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except ValueError as fault:
        raise ValueError(f"{file} {fault}") from None


def anchor_from(text: str) -> Anchor:
    """An anchor from JSON with ``chain_id``, ``count`` and ``link``: a kept head.

    Raises
    ------
    ValueError
        when it is none.
    """
    try:
        found = json.loads(text)
        return Anchor(str(found["chain_id"]), int(found["count"]), str(found["link"]))
    except (ValueError, KeyError, TypeError):
        raise ValueError("is no head of an audit log: chain_id, count and link") from None


def keep_anchor(folder: Path, anchor: Anchor) -> None:
    """Write the anchor of a data folder: whole or not at all."""
    partial = folder / f"{ANCHOR_FILE}.{secrets.token_hex(8)}.partial"
    partial.write_text(json.dumps(asdict(anchor)) + "\n", encoding="utf-8")
    os.replace(partial, folder / ANCHOR_FILE)


def begin(database: Database, key: AuditKey, folder: Path) -> None:
    """What a start does: sign a head that nobody has signed yet, and move the anchor on where the chain goes through it.

    A log that does not is left to `casedrain audit verify`, and told to the log of the service: it keeps no pump
    from being watched.

    Raises
    ------
    ValueError
        when the key is none.
    """
    public = key.public
    with database.reading() as session:
        row = session.get(AuditHead, HEAD_ID)
        head = head_of(row) if row else None
    if head is not None and not head.signature:
        with database.writing() as session:
            unsigned = session.get_one(AuditHead, HEAD_ID, with_for_update=True)
            if not unsigned.signature:
                sign(unsigned, key, datetime.now(UTC))
    elif head is not None and head.public_key != public:
        log.warning("the audit log was signed with another key: replicas need the same CASEDRAIN_AUDIT_KEY")
    with contextlib.suppress(OSError):  # a folder that is only read: there is no anchor then
        if head is None or not move_anchor(database, head, folder):
            log.error("the audit log was changed, put back or begun anew: run `casedrain audit verify`")


def move_anchor(database: Database, head: Head, folder: Path) -> bool:
    """Move the anchor on to a head; False where the chain does not go through the one that there is."""
    try:
        kept = read_anchor(folder)
    except ValueError:
        return False
    if kept is not None:
        if kept.chain_id != head.chain_id or kept.link != link_at(database, head, kept.count):
            return False
        if kept.count >= head.count:
            return True
    keep_anchor(folder, Anchor.of(head))
    return True


def link_at(database: Database, head: Head, position: int) -> str | None:
    """The link at a position of the stored chain; None where it does not reach there."""
    if position == 0:
        return first_link(head.chain_id)
    with database.reading() as session:
        return session.scalar(select(AuditLink.link).where(AuditLink.position == position))
