"""Signatures of Standard Webhooks: HMAC-SHA256 over ``id.timestamp.body`` with a secret that starts ``whsec_``."""

import base64
import hashlib
import hmac
import secrets

_PREFIX = "whsec_"
_BYTES = 32


def new_secret() -> str:
    """A fresh secret; the receiver needs it to verify, so it is shown once and kept."""
    return _PREFIX + base64.b64encode(secrets.token_bytes(_BYTES)).decode()


def signed_headers(secret: str, message_id: str, timestamp: int, body: bytes) -> dict[str, str]:
    """The three headers of a delivery.

    Parameters
    ----------
    secret
        As given by ``new_secret``.
    timestamp
        Of this attempt [s since 1970].
    """
    key = base64.b64decode(secret.removeprefix(_PREFIX))
    signed = f"{message_id}.{timestamp}.".encode() + body
    digest = base64.b64encode(hmac.new(key, signed, hashlib.sha256).digest()).decode()
    return {"webhook-id": message_id, "webhook-timestamp": str(timestamp), "webhook-signature": f"v1,{digest}"}
