"""Settings from the environment (prefix ``CASEDRAIN_``) or a ``.env`` file."""

import ipaddress
import socket
from functools import cached_property
from pathlib import Path
from typing import Literal
from urllib.parse import urlsplit

from pydantic import Field, SecretStr, field_validator, model_validator
from pydantic_settings import BaseSettings, SettingsConfigDict
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError


class Settings(BaseSettings):
    """What an installation can set; every field is ``CASEDRAIN_<NAME>`` in the environment."""

    model_config = SettingsConfigDict(env_prefix="CASEDRAIN_", env_file=".env", extra="ignore", frozen=True)

    database_url: str = ""
    data_dir: Path = Path("casedrain-data")
    raw_store_url: str = ""
    auth: Literal["on", "off"] = "off"
    max_upload_bytes: int = Field(default=64 * 2**20, ge=1024)
    max_inflated_bytes: int = Field(default=512 * 2**20, ge=1024)
    max_rows: int = Field(default=5_000_000, ge=10)
    max_preview_records: int = Field(default=3000, ge=1)
    session_hours: float = Field(default=12.0, gt=0.0, le=720.0)
    session_idle_minutes: float = Field(default=120.0, gt=0.0, le=43_200.0)
    webhook_allowed_hosts: str = ""
    public_url: str = ""
    oidc_issuer: str = ""
    """Address of the OpenID provider that signs people in beside passwords; empty: nobody does."""
    oidc_client_id: str = ""
    oidc_client_secret: SecretStr = SecretStr("")
    oidc_name: str = "your organisation"
    """What the sign-in page calls it."""
    smtp_host: str = ""
    smtp_port: int = Field(default=587, ge=1, le=65535)
    smtp_security: Literal["starttls", "none"] = "starttls"
    smtp_user: str = ""
    smtp_password: SecretStr = SecretStr("")
    mail_from: str = "casedrain@localhost"
    max_bulk_bytes: int = Field(default=2 * 2**30, ge=1024)
    max_parse_seconds: float = Field(default=60.0, gt=0.0)
    max_parse_memory_bytes: int = Field(default=2 * 2**30, ge=64 * 2**20)
    parse_workers: int = Field(default=2, ge=1, le=64)
    max_body_bytes: int = Field(default=2**20, ge=1024)
    """Of a request that is no upload; looked at before its key is."""
    body_stall_seconds: float = Field(default=20.0, gt=0.0)
    """Longest pause within a request's head or body."""
    drain_seconds: float = Field(default=10.0, ge=0.0, le=3600.0)
    """What a stop gives to requests in hand; `/readyz` says no from its beginning."""
    drain_notice_seconds: float = Field(default=0.0, ge=0.0, le=600.0)
    """How long a stop still takes requests after `/readyz` has said no: time for a load balancer to look."""
    min_free_bytes: int = Field(default=64 * 2**20, ge=0)
    """Room that uploads leave on a disk, or a tenth of a small disk; `/readyz` says no at twice as much."""
    trusted_proxies: str = ""
    """Addresses or networks, with commas, whose `X-Forwarded-For` and `X-Forwarded-Proto` count; by default nobody's."""
    upload_workers: int = Field(default=2, ge=1, le=64)
    """Uploads that are worked on at the same time; others wait their turn without a thread."""
    read_workers: int = Field(default=8, ge=1, le=64)
    """Reads that are worked on at the same time, tenants in turn; more would only share one interpreter."""
    max_waiting_uploads: int = Field(default=64, ge=1)
    """Uploads, and files at the parser, that may wait with somebody waiting for the answer; more are answered 503."""
    max_wait_seconds: float = Field(default=20.0, gt=0.0, le=600.0)
    """Longest wait of an upload for its turn."""
    max_requests_in_hand: int = Field(default=256, ge=1)
    """Requests that are being answered at the same time; more are answered 503."""
    max_requests_each: int = Field(default=16, ge=1)
    """Of these, how many one operator, key or address may have while others come too; more are answered 429."""
    quota_key_requests_per_minute: float = Field(default=3000.0, ge=0.0)
    """Quotas are of each process, 0 is none; what is beyond them is answered 429. Nobody has any where `auth` is off."""
    quota_operator_requests_per_minute: float = Field(default=6000.0, ge=0.0)
    quota_key_bytes_per_hour: float = Field(default=32 * 2.0**30, ge=0.0)
    quota_operator_bytes_per_hour: float = Field(default=64 * 2.0**30, ge=0.0)
    quota_key_parser_seconds_per_hour: float = Field(default=3600.0, ge=0.0)
    quota_operator_parser_seconds_per_hour: float = Field(default=3600.0, ge=0.0)
    quota_key_jobs: int = Field(default=20, ge=0)
    """Jobs that have not ended, counted in the database over all processes."""
    quota_operator_jobs: int = Field(default=50, ge=0)
    traces: Literal["off", "otlp"] = "off"
    """Send traces by OTLP over HTTP, to where OpenTelemetry's own variables (`OTEL_EXPORTER_OTLP_ENDPOINT` …) say."""
    cors_origins: str = ""
    """Origins like `https://dashboards.example.org`, with commas, whose pages may call the API with a key; `*`: all."""
    job_concurrency: int = Field(default=1, ge=1, le=64)
    worker_name: str = Field(default_factory=socket.gethostname, min_length=1)
    """Tells the workers of one Postgres apart; a worker takes up what it left when it comes back by the same name."""

    audit_key: SecretStr = SecretStr("")
    """Signs the head of the audit log, 64 hexadecimal digits; empty: a key of its own in the data folder."""

    @field_validator("database_url")
    @classmethod
    def _is_known_database(cls, url: str) -> str:
        if not url:
            return url
        try:
            kind = make_url(url).get_backend_name()
        except ArgumentError:
            raise ValueError(
                "is no SQLAlchemy URL like postgresql://user@host/name or sqlite:////folder/file"
            ) from None
        if kind not in ("sqlite", "postgresql"):
            raise ValueError(f"{kind} is not supported: sqlite and postgresql are")
        return url

    @model_validator(mode="after")
    def _is_whole(self) -> "Settings":
        if bool(self.oidc_issuer) != bool(self.oidc_client_id):
            raise ValueError("CASEDRAIN_OIDC_ISSUER and CASEDRAIN_OIDC_CLIENT_ID go together")
        if self.oidc_issuer and not self.oidc_issuer.startswith("https://") and not self._is_local_issuer():
            raise ValueError("CASEDRAIN_OIDC_ISSUER must be an https:// address, but on this machine")
        return self

    def _is_local_issuer(self) -> bool:
        parts = urlsplit(self.oidc_issuer)
        return parts.scheme == "http" and is_loopback(parts.hostname or "")

    @field_validator("trusted_proxies")
    @classmethod
    def _are_addresses(cls, text: str) -> str:
        for part in filter(None, (p.strip() for p in text.split(","))):
            try:
                ipaddress.ip_network(part, strict=False)
            except ValueError:
                raise ValueError(f"{part!r} is no address or network") from None
        return text

    @field_validator("cors_origins")
    @classmethod
    def _are_origins(cls, text: str) -> str:
        for part in filter(None, (p.strip() for p in text.split(","))):
            address = urlsplit(part)
            is_origin = address.scheme in ("http", "https") and bool(address.netloc) and "@" not in address.netloc
            if part != "*" and (not is_origin or part != f"{address.scheme}://{address.netloc}"):
                raise ValueError(f"{part!r} is no origin like https://dashboards.example.org")
        return text

    @cached_property
    def effective_database_url(self) -> str:
        """SQLAlchemy URL: as set, else an SQLite file in the data directory."""
        return self.database_url or f"sqlite:///{self.data_dir.resolve() / 'casedrain.sqlite'}"

    @cached_property
    def effective_raw_store_url(self) -> str:
        """URL of the raw-file store: as set, else a folder in the data directory."""
        return self.raw_store_url or str(self.data_dir.resolve() / "raw")

    @cached_property
    def webhook_hosts(self) -> frozenset[str]:
        """Hosts on the premises that webhooks may reach, from a list with commas."""
        return frozenset(h.strip().lower() for h in self.webhook_allowed_hosts.split(",") if h.strip())

    @cached_property
    def proxies(self) -> list[str]:
        """Addresses and networks of trusted proxies."""
        return [p.strip() for p in self.trusted_proxies.split(",") if p.strip()]

    @cached_property
    def cors(self) -> list[str]:
        """Origins whose pages may call the API."""
        return [p.strip() for p in self.cors_origins.split(",") if p.strip()]

    @property
    def effective_spool_dir(self) -> Path:
        """Folder for uploads on their way in."""
        return self.data_dir.resolve() / "spool"

    @property
    def auth_is_on(self) -> bool:
        return self.auth == "on"

    def binding_fault(self, host: str) -> str | None:
        """Why the server must not bind to ``host``: without keys it may serve this machine only."""
        if self.auth_is_on or is_loopback(host):
            return None
        return (
            f"CASEDRAIN_AUTH=off works on loopback only, and {host} is not loopback: "
            "set CASEDRAIN_AUTH=on and make a key with `casedrain keys create --role admin`"
        )


def is_loopback(host: str) -> bool:
    """True for addresses that only this machine reaches."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
