"""Parts of a running service."""

from dataclasses import dataclass

from service.access.crowd import Crowd
from service.access.oidc import Issuer
from service.history.archive import Archive
from service.ingest.parser_pool import ParserPool
from service.ingest.raw import Limits
from service.monitoring.acceptance import Acceptance
from service.settings import Settings
from service.storage.database import Database
from service.storage.raw_store import RawStore
from service.storage.spool import Spool


@dataclass(frozen=True, slots=True)
class Context:
    """Parts of a running service, made once at its start; ``cursor_key`` signs the cursors of lists.

    ``crowd`` holds who is being served and what each may ask; ``issuer`` signs people in beside passwords.
    """

    settings: Settings
    database: Database
    archive: Archive
    acceptance: Acceptance
    cursor_key: bytes
    crowd: Crowd
    issuer: Issuer | None = None

    @property
    def raw_store(self) -> RawStore:
        """Bytes as they were uploaded."""
        return self.archive.raw_store

    @property
    def spool(self) -> Spool:
        """Uploads on their way in."""
        return self.archive.spool

    @property
    def parser(self) -> ParserPool:
        """Processes that read files from outside."""
        return self.archive.parser

    @property
    def limits(self) -> Limits:
        """Bounds on inflation and rows."""
        return self.archive.limits

    def close(self) -> None:
        """End what is made in the background, close connections and end the parsing processes."""
        self.acceptance.settling.close()
        self.parser.close()
        self.database.close()
