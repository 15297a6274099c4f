"""The proof of the audit log: lines from the database or from a file that was exported, and what is wrong with them.

A proof is JSON lines: the signed head, then every link in order with its entry where it is shown. Whoever holds the
public key can verify it without this service; the entries of other operators are withheld, their hashes are not.
"""

from bisect import bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import NotRequired, TypedDict, cast, final

from sqlalchemy import exists, select
from sqlalchemy.orm import Session

from service.access.audit import DELETION, ERASED, EXPIRY
from service.answers.documents import JsonObject
from service.storage.audit_anchor import Anchor
from service.storage.audit_chain import (
    HEAD_ID,
    EntrySaid,
    Head,
    HeadSaid,
    content_hash,
    content_of,
    first_link,
    head_of,
    link_hash,
)
from service.storage.database import Database
from service.storage.tables import AuditEntry, AuditHead, AuditLink

FORMAT = "casedrain audit proof 1"
MOST_FAULTS = 100
_BATCH = 1000


@final
class ProofHead(TypedDict):
    """First line of a proof: whose entries it shows (None: everybody's), and the head that it ends at."""

    format: str
    operator: str | None
    head: HeadSaid | None


@final
class ProofLink(TypedDict):
    """A line of a proof: a link, and its entry where it is shown and still there."""

    position: int
    entry_id: int
    content_hash: str
    link: str
    salt: str | None
    content: EntrySaid | None
    withheld: NotRequired[bool]


class Verified(TypedDict):
    """Findings as JSON."""

    whole: bool
    links: int
    erased: int
    withheld: int
    head: HeadSaid | None
    faults: list[str]


@dataclass(slots=True)
class Findings:
    """What a verification found: numbers of links, of entries erased by deletions and withheld, and every fault."""

    head: Head | None
    links: int = 0
    erased: int = 0
    withheld: int = 0
    faults: list[str] = field(default_factory=list)
    more: int = 0
    """Faults beyond those that are listed (a count)."""

    def add(self, fault: str) -> None:
        """Note a fault."""
        if len(self.faults) < MOST_FAULTS:
            self.faults.append(fault)
        else:
            self.more += 1

    def to_json(self) -> Verified:
        """As the command line says it."""
        return {
            "whole": not self.faults,
            "links": self.links,
            "erased": self.erased,
            "withheld": self.withheld,
            "head": self.head.to_json() if self.head else None,
            "faults": self.faults + ([f"and {self.more} more"] if self.more else []),
        }


def stored_proof(session: Session, operator: str | None = None) -> Iterator[ProofHead | ProofLink]:
    """Lines of the stored log: head, then links; with ``operator`` the entries of all others are withheld.

    The session must be a snapshot.
    """
    row = session.get(AuditHead, HEAD_ID)
    yield {"format": FORMAT, "operator": operator, "head": head_of(row).to_json() if row else None}
    query = (
        select(AuditLink, AuditEntry)
        .outerjoin(AuditEntry, AuditEntry.id == AuditLink.entry_id)
        .order_by(AuditLink.position)
        .execution_options(yield_per=_BATCH)
    )
    for link, joined in session.execute(query):
        entry: AuditEntry | None = joined
        line: ProofLink = {
            "position": link.position,
            "entry_id": link.entry_id,
            "content_hash": link.content_hash,
            "link": link.link,
            "salt": None,
            "content": None,
        }
        if entry is not None and operator in (None, entry.operator):
            line["salt"], line["content"] = entry.salt, content_of(entry)
        elif operator is not None:
            line["withheld"] = True
        yield line


def verify_database(database: Database, public_key: str | None, anchors: Iterable[Anchor]) -> Findings:
    """Verify the stored log: its chain, its entries, its head, and that no entry stands beside the chain.

    Parameters
    ----------
    public_key
        Whose signature the head must carry; None takes the head's own word for it.
    anchors
        Places that the chain must go through.
    """
    with database.snapshot() as session:
        findings = verify(stored_proof(session), public_key, anchors)
        beside = ~exists().where(AuditLink.entry_id == AuditEntry.id)
        for entry_id in session.scalars(select(AuditEntry.id).where(beside).order_by(AuditEntry.id)):
            findings.add(
                f"entry {entry_id} is not in the chain: it was inserted, or a release before the chain wrote it "
                "(then `casedrain audit adopt` chains it)"
            )
    return findings


def verify(
    lines: Iterable[ProofHead | ProofLink | JsonObject], public_key: str | None, anchors: Iterable[Anchor] = ()
) -> Findings:
    """Verify the lines of a proof; lines that are no proof are a fault like any other."""
    steps = iter(lines)
    try:
        head = _head_in(cast("ProofHead", next(steps, {})))
    except (KeyError, TypeError, ValueError):
        findings = Findings(None)
        findings.add("this is no proof of an audit log, or its head was taken away")
        return findings
    walk = _Walk(head, {a.count: a for a in anchors if a.chain_id == head.chain_id})
    for anchor in anchors:
        if anchor.chain_id != head.chain_id:
            walk.findings.add(
                f"the log is another chain ({head.chain_id}) than the one known ({anchor.chain_id}): it was begun anew"
            )
    for line in steps:
        try:
            walk.step(cast("ProofLink", line))
        except (KeyError, TypeError, ValueError):
            walk.findings.add(f"a line after link {walk.position} is none of a proof")
    walk.end(public_key)
    return walk.findings


class _Walk:
    """A walk along a chain."""

    def __init__(self, head: Head, anchors: dict[int, Anchor]) -> None:
        self.findings = Findings(head)
        self.head = head
        self.position = 0
        self.link: str | None = first_link(head.chain_id)
        self.anchors = anchors
        self.gone: list[int] = []
        self.receipts: list[tuple[int, int]] = []

    def step(self, line: ProofLink) -> None:
        position, stored = int(line["position"]), str(line["link"])
        if position != self.position + 1:
            if position <= self.position:
                self.findings.add(
                    f"link {position} stands after link {self.position}: links were inserted or reordered"
                )
                return
            self.findings.add(f"links {self.position + 1} to {position - 1} were removed")
            self.link = None
        self.position = position
        self.findings.links += 1
        expected = self.link and link_hash(self.link, position, line["entry_id"], line["content_hash"])
        if expected is not None and expected != stored:
            self.findings.add(f"link {position} does not follow from the one before: it was changed or reordered")
        self.link = stored
        anchor = self.anchors.pop(position, None)
        if anchor is not None and anchor.link != stored:
            self.findings.add(f"link {position} is not the one known of it: the log was written anew")
        self._entry(position, line)

    def _entry(self, position: int, line: ProofLink) -> None:
        content = line["content"]
        if line.get("withheld"):
            self.findings.withheld += 1
        elif content is None:
            self.gone.append(position)
        elif content_hash(line["salt"] or "", content) != line["content_hash"]:
            self.findings.add(f"entry {line['entry_id']} (link {position}) was changed")
        elif content["action"] in (DELETION, EXPIRY):
            self.receipts += [(int(a), int(b)) for a, b in content["details"].get(ERASED, ())]

    def end(self, public_key: str | None) -> None:
        head, findings = self.head, self.findings
        spans = sorted(self.receipts)
        starts = [first for first, _ in spans]
        for position in self.gone:
            # spans never overlap: an entry is erased once
            nearest = bisect_right(starts, position) - 1
            if nearest >= 0 and position <= spans[nearest][1]:
                findings.erased += 1
            else:
                findings.add(
                    f"the entry of link {position} was removed, and neither a deletion of an operator nor its retention says so"
                )
        if self.position != head.count:
            findings.add(
                f"the head counts {head.count} links and the log ends at {self.position}: its end was cut or added to"
            )
        elif self.link != head.link:
            findings.add("the head's link is not the last one of the log")
        first = self.anchors.pop(0, None)
        if first is not None and first.link != first_link(head.chain_id):
            findings.add("the log does not begin where the one known did")
        for anchor in self.anchors.values():
            findings.add(f"the log ends before link {anchor.count}, which it once had: it was put back or cut")
        if not head.signature:
            findings.add("the head is not signed: a start of the service signs a new log")
        elif not head.is_signed:
            findings.add("the head's signature is wrong: the head was changed")
        elif public_key is not None and head.public_key != public_key:
            findings.add(
                f"the head is signed with another key ({head.public_key}) than the one expected ({public_key}): "
                "it was forged, or a replica has no common CASEDRAIN_AUDIT_KEY"
            )


def _head_in(line: ProofHead) -> Head:
    if line.get("format") != FORMAT:
        raise ValueError("no proof")
    if line["head"] is None:
        raise ValueError("no head")
    return Head(**line["head"])
