"""Administration: keys, users, webhooks, operators, the audit log."""

from typing_extensions import TypedDict

from service.answers.documents import JsonObject
from service.answers.words import Instant, shape


@shape
class Key(TypedDict):
    """An API key, without the key itself."""

    id: str
    """Id of the key."""
    owner: str
    """Who uses it."""
    role: str
    """`viewer`, `analyst`, `engineer` or `admin`."""
    operator: str | None
    """Operator that it sees; null for all."""
    scopes: list[str] | None
    """Of `read`, `upload`, `maintain` and `admin`, what it is for; null for all that its role may."""
    created_at: Instant
    """When it was made."""
    expires_at: Instant | None
    """When it ends."""
    last_used_at: Instant | None
    """When it was last used, to within a few minutes."""
    revoked_at: Instant | None
    """When it was revoked."""


@shape
class KeyMade(Key):
    """A new API key."""

    key: str
    """The key itself; it is in this answer and nowhere else."""


@shape
class User(TypedDict):
    """Somebody who may sign in to the pages."""

    name: str
    """Name to sign in with."""
    role: str
    """`viewer`, `analyst`, `engineer` or `admin`."""
    operator: str | None
    """Operator whose data the user sees; null for all."""
    email: str | None
    """Where mails go."""
    wants_mail: bool
    """Whether alarms are mailed."""
    created_at: Instant
    """When the user was made."""
    disabled_at: Instant | None
    """Since when the user may not sign in."""
    last_signed_in_at: Instant | None
    """When the user last signed in."""
    oidc_subject: str | None
    """Who this is to the provider that signs people in beside passwords; null for nobody."""


@shape
class SessionsEnded(TypedDict):
    """Sessions of a user that were ended."""

    ended: int
    """Number of sessions (a count)."""


@shape
class Webhook(TypedDict):
    """Where changes of alarms are sent."""

    id: str
    """Id of the webhook."""
    operator: str | None
    """Operator whose alarms it hears of; null for all."""
    url: str
    """Where they are sent."""
    events: list[str]
    """Kinds of changes that are sent."""
    owner: str
    """Who added it."""
    created_at: Instant
    """When it was added."""
    ended_at: Instant | None
    """When it was removed or given up."""
    end_reason: str | None
    """Why."""


@shape
class WebhookMade(Webhook):
    """A new webhook."""

    secret: str
    """What its deliveries are signed with; it is in this answer and in no other."""


@shape
class Delivery(TypedDict):
    """A message to a webhook and how it went."""

    message_id: str
    """Id of the message, the same in every attempt."""
    event: str
    """Kind of change."""
    created_at: Instant
    """When it happened."""
    status: str
    """`pending`, `delivered` or `failed`."""
    attempts: int
    """Number of attempts so far (a count)."""
    tried_at: Instant | None
    """When it was last tried."""
    due_at: Instant | None
    """When it is tried next; null where it is not."""
    delivered_at: Instant | None
    """When it arrived."""
    outcome: str | None
    """What the last attempt met."""


@shape
class Operator(TypedDict):
    """An operator and what it has here."""

    operator: str
    """Its name."""
    pumps: int
    """Number of its pumps (a count)."""
    records: int
    """Number of its records (a count)."""
    retention_days: int | None
    """How long its raw bytes are kept [d]; null: for good."""
    job_days: int | None
    """How long its jobs are kept after they ended, with archives and documents [d]; null: for good."""
    audit_days: int | None
    """How long its audit entries are kept [d]; null: for good."""
    legal_hold: bool
    """Whether nothing of it goes, whatever its age, nor can be deleted."""


@shape
class KeptBackup(TypedDict):
    """A backup that was made before the deletion and that nobody has said to be gone: it still holds the data."""

    id: str
    """Id of the backup."""
    made_at: Instant
    """When it was begun."""
    age_days: float
    """Its age at the deletion [days]."""


@shape
class Receipt(TypedDict, total=False):
    """Proof of a deletion; empty until it is finished."""

    operator: str
    """Whose data was deleted."""
    reason: str
    """Why."""
    author: str
    """By whom."""
    deleted_at: Instant
    """When it was finished."""
    rows: dict[str, int]
    """Number of rows deleted, by table (counts)."""
    raw_files_removed: list[str]
    """Hashes of the raw bytes that were removed."""
    raw_files_of_others: int
    """Number of raw files that others have sent as well, and that stay (a count)."""
    audit_links_erased: list[list[int]]
    """Links of the audit log whose entries were erased with their salts: first and last position of each stretch (counts)."""
    backups: list[KeptBackup]
    """Backups that still hold the data, with their age."""
    sha256: str
    """SHA-256 of the receipt without this member, as canonical JSON."""


@shape
class Deletion(TypedDict):
    """The deletion of everything of an operator."""

    id: str
    """Id of the deletion."""
    operator: str
    """Whose data."""
    author: str
    """By whom."""
    reason: str
    """Why."""
    started_at: Instant
    """When it began."""
    finished_at: Instant | None
    """When it was finished."""
    receipt: Receipt | None
    """Proof; null or empty until it is finished."""


@shape
class AuditEntry(TypedDict):
    """Who changed what."""

    at: Instant
    """When."""
    actor: str
    """Who."""
    role: str
    """With which role."""
    operator: str | None
    """Whose data it touched; null where it is everybody's."""
    action: str
    """What was done, for example `alarm.close`."""
    subject: str
    """To what, for example `alarm/5f3c`."""
    details: JsonObject
    """What the change said; each action has members of its own, in the units that their names end in."""
