"""A small OpenID provider on this machine: it signs in whoever it is told to, and lies as it is told to."""

import base64
import hashlib
import hmac
import json
import secrets
import threading
import time
from functools import lru_cache
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

from joserfc import jwt
from joserfc.jwk import RSAKey

CLIENT_ID, CLIENT_SECRET = "casedrain", "a secret of the two"


@lru_cache(maxsize=1)
def _key() -> RSAKey:
    return RSAKey.generate_key(2048, {"kid": "k1"}, auto_kid=False)


class FakeIssuer:
    """Answers discovery, keys and tokens over HTTP; ``allow`` is the person at the browser who says yes."""

    def __init__(self) -> None:
        self.key = _key()
        self.signs_with: Any = self.key
        self.signs_as_the_public_key = False
        """The old trick: the public key, which everybody knows, as a shared secret."""
        self.claims: dict[str, Any] = {}
        """Claims that stand in the place of the true ones; None leaves one out."""
        self.is_away = False
        self._codes: dict[str, dict[str, str]] = {}
        issuer = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                self._send(200, issuer._document(self.path))

            def do_POST(self) -> None:
                length = int(self.headers.get("content-length", 0))
                form = {k: v[0] for k, v in parse_qs(self.rfile.read(length).decode()).items()}
                status, answer = issuer._token(form, self.headers.get("authorization", ""))
                self._send(status, answer)

            def _send(self, status: int, answer: Any) -> None:
                content = json.dumps(answer).encode()
                self.send_response(500 if issuer.is_away else status)
                self.send_header("content-type", "application/json")
                self.send_header("content-length", str(len(content)))
                self.end_headers()
                self.wfile.write(content)

            def log_message(self, *_: Any) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self._server.server_port}"
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()

    def allow(self, address: str, subject: str) -> dict[str, str]:
        """What the provider sends the browser back with, for an address that it was sent to."""
        asked = {k: v[0] for k, v in parse_qs(urlsplit(address).query).items()}
        assert asked["client_id"] == CLIENT_ID
        assert asked["response_type"] == "code"
        assert asked["code_challenge_method"] == "S256"
        code = secrets.token_urlsafe(16)
        self._codes[code] = {**asked, "sub": subject}
        return {"code": code, "state": asked["state"]}

    def _document(self, path: str) -> dict[str, Any]:
        if path == "/keys":
            return {"keys": [self.key.as_dict(private=False)]}
        return {
            "issuer": self.url,
            "authorization_endpoint": f"{self.url}/authorize",
            "token_endpoint": f"{self.url}/token",
            "jwks_uri": f"{self.url}/keys",
        }

    def _token(self, form: dict[str, str], authorization: str) -> tuple[int, dict[str, Any]]:
        expected = base64.b64encode(f"{CLIENT_ID}:{CLIENT_SECRET}".encode()).decode()
        if authorization != f"Basic {expected}":
            return 401, {"error": "invalid_client"}
        asked = self._codes.pop(form.get("code", ""), None)
        challenge = base64.urlsafe_b64encode(hashlib.sha256(form.get("code_verifier", "").encode()).digest())
        if (
            asked is None
            or challenge.decode().rstrip("=") != asked["code_challenge"]
            or form.get("redirect_uri") != asked["redirect_uri"]
        ):
            return 400, {"error": "invalid_grant"}
        now = int(time.time())
        true = {"iss": self.url, "aud": CLIENT_ID, "sub": asked["sub"], "nonce": asked["nonce"], "iat": now}
        claims = {k: v for k, v in {**true, "exp": now + 300, **self.claims}.items() if v is not None}
        return 200, {"access_token": "x", "token_type": "Bearer", "id_token": self._signed(claims)}

    def _signed(self, claims: dict[str, Any]) -> str:
        if not self.signs_as_the_public_key:
            return jwt.encode({"alg": "RS256", "kid": "k1"}, claims, self.signs_with)
        parts = [json.dumps(part).encode() for part in ({"alg": "HS256", "kid": "k1"}, claims)]
        signed = b".".join(_base64(part) for part in parts)
        mark = hmac.new(self.key.as_pem(private=False), signed, hashlib.sha256).digest()
        return (signed + b"." + _base64(mark)).decode()


def _base64(content: bytes) -> bytes:
    return base64.urlsafe_b64encode(content).rstrip(b"=")
