"""The key that signs the head of the audit log: Ed25519, from ``CASEDRAIN_AUDIT_KEY`` or a file of the data folder.

A public key is enough to verify: who is handed an export need not be trusted with the power to forge one.
"""

import os
import secrets
from functools import cached_property
from pathlib import Path

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

KEY_FILE = "audit-key"
_KEY_BYTES = 32


class AuditKey:
    """A signing key, read or made when it is first needed.

    Parameters
    ----------
    text
        32 bytes as 64 hexadecimal digits; empty: those of ``folder``.
    folder
        Where the key is kept in a file of its own, made once and readable by its owner only.
    """

    def __init__(self, text: str, folder: Path) -> None:
        self._text = text
        self._file = folder / KEY_FILE

    @property
    def file(self) -> Path | None:
        """File of the key; None where the environment gives it."""
        return None if self._text else self._file

    @cached_property
    def _private(self) -> Ed25519PrivateKey:
        return Ed25519PrivateKey.from_private_bytes(key_bytes(self._text or _kept(self._file)))

    @cached_property
    def public(self) -> str:
        """The public key, 64 hexadecimal digits."""
        return self._private.public_key().public_bytes_raw().hex()

    def sign(self, message: bytes) -> str:
        """Signature of a message, 128 hexadecimal digits."""
        return self._private.sign(message).hex()


def key_bytes(text: str) -> bytes:
    """Bytes of a key that is written in hexadecimal digits.

    Raises
    ------
    ValueError
        when it is none; the sentence names the variable.
    """
    try:
        found = bytes.fromhex(text.strip())
    except ValueError:
        found = b""
    if len(found) != _KEY_BYTES:
        raise ValueError("CASEDRAIN_AUDIT_KEY is 64 hexadecimal digits: make one with `openssl rand -hex 32`")
    return found


def is_signed(message: bytes, signature: str, public: str) -> bool:
    """True when the signature of a message is that of a public key (both hexadecimal)."""
    try:
        Ed25519PublicKey.from_public_bytes(bytes.fromhex(public)).verify(bytes.fromhex(signature), message)
    except (InvalidSignature, ValueError):
        return False
    return True


def _kept(file: Path) -> str:
    """The key of a file, made by whoever comes first."""
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        partial = file.with_name(f"{file.name}.{secrets.token_hex(8)}.partial")
        descriptor = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w", encoding="ascii") as written:
            written.write(secrets.token_hex(_KEY_BYTES) + "\n")
            written.flush()
            os.fsync(written.fileno())
        try:
            os.link(partial, file)
        except FileExistsError:  # another process was first: its key holds
            pass
        finally:
            partial.unlink()
    return file.read_text(encoding="ascii")
