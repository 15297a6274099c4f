"""The chain of the audit log: each link rests on the one before and on a salted hash of its entry; the head is signed.

Links are made at the very end of a transaction, so that those who write meet for as long as a commit takes. An entry
that is erased takes its salt along: its hash stays, and says nothing of it any more.
"""

import hashlib
import json
import secrets
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Any, TypedDict, cast

from sqlalchemy.orm import Session

from service.answers.documents import JsonObject
from service.storage.audit_key import AuditKey, is_signed
from service.storage.tables import AuditEntry, AuditHead, AuditLink

NOTED = "audit-entries"
"""Where a session keeps the entries that its commit shall chain."""
HEAD_ID = 1


class HeadSaid(TypedDict):
    """A head as JSON says it."""

    chain_id: str
    count: int
    link: str
    public_key: str
    signature: str


class EntrySaid(TypedDict):
    """An entry of the log as its hash is over: an instant in RFC 3339 to the microsecond, who did what to which subject."""

    at: str
    actor: str
    role: str
    operator: str | None
    action: str
    subject: str
    details: JsonObject


@dataclass(frozen=True, slots=True)
class Head:
    """End of a chain: its name, the number of links, the last of them, and who signed that."""

    chain_id: str
    count: int
    link: str
    public_key: str
    signature: str

    def to_json(self) -> HeadSaid:
        """As proofs and backups say it."""
        return cast("HeadSaid", asdict(self))

    @property
    def is_signed(self) -> bool:
        """True when the signature is that of ``public_key``."""
        return is_signed(head_message(self.chain_id, self.count, self.link), self.signature, self.public_key)


def new_salt() -> str:
    """Sixteen random bytes in hexadecimal digits: without them a hash cannot be guessed back to its entry."""
    return secrets.token_hex(16)


def new_chain_id() -> str:
    """Name of a new chain."""
    return secrets.token_hex(16)


def first_link(chain_id: str) -> str:
    """What the first link of a chain rests on."""
    return _hash(f"casedrain audit chain 1\n{chain_id}")


def link_hash(before: str, position: int, entry_id: int, content_hash: str) -> str:
    """Hash of a link over the one before it, its position from 1 on, its entry's id and hash."""
    return _hash(f"{before}\n{position}\n{entry_id}\n{content_hash}")


def content_hash(salt: str, content: EntrySaid) -> str:
    """Salted hash of an entry in the shape of ``content_of``.

    Numbers count by their value: 2.0 and 2 are the same to a database of JSON.
    """
    plain = json.dumps(_by_value(content), sort_keys=True, separators=(",", ":"))
    return _hash(f"{salt}\n{plain}")


def head_message(chain_id: str, count: int, link: str) -> bytes:
    """What the signature of a head is over."""
    return f"casedrain audit head 1\n{chain_id}\n{count}\n{link}\n".encode()


def content_of(entry: AuditEntry) -> EntrySaid:
    """Everything that an entry says, as JSON."""
    return {
        "at": entry.at.astimezone(UTC).isoformat(timespec="microseconds"),
        "actor": entry.actor,
        "role": entry.role,
        "operator": entry.operator,
        "action": entry.action,
        "subject": entry.subject,
        "details": entry.details,
    }


def head_of(row: AuditHead) -> Head:
    """A stored head."""
    return Head(row.chain_id, row.count, row.link, row.public_key, row.signature)


def chain_noted(session: Session, key: AuditKey | None) -> None:
    """Chain the entries that this transaction has noted; for the moment before its commit."""
    noted: list[AuditEntry] = session.info.pop(NOTED, [])
    if not noted:
        return
    session.flush()
    append(session, noted, key)


def append(session: Session, entries: Sequence[AuditEntry], key: AuditKey | None) -> None:
    """Add links for entries that have their ids, and sign the new head; without a key it stays unsigned."""
    hashes = [content_hash(entry.salt or "", content_of(entry)) for entry in entries]
    # from here to the commit everybody else waits
    head = session.get_one(AuditHead, HEAD_ID, with_for_update=True)
    now = datetime.now(UTC)
    for entry, hashed in zip(entries, hashes, strict=True):
        head.count += 1
        head.link = link_hash(head.link, head.count, entry.id, hashed)
        session.add(AuditLink(position=head.count, entry_id=entry.id, content_hash=hashed, link=head.link))
    sign(head, key, now)
    session.flush()


def sign(head: AuditHead, key: AuditKey | None, now: datetime) -> None:
    """Sign a head as it is."""
    head.signed_at = now
    head.public_key = key.public if key else ""
    head.signature = key.sign(head_message(head.chain_id, head.count, head.link)) if key else ""


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _by_value(value: Any) -> Any:
    """JSON as both databases give it back: texts as keys, lists, whole numbers without a point."""
    if isinstance(value, dict):
        return {_key(k): _by_value(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_by_value(v) for v in value]
    if isinstance(value, float) and value.is_integer():
        return int(value)
    return value


def _key(value: Any) -> str:
    # as json.dumps writes a key that is no text
    return value if isinstance(value, str) else json.dumps(value)
