"""Sign-in by an issuer (OpenID Connect, authorization code with PKCE): what is asked there, and what its answer must say."""

import secrets
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import httpx2
from authlib.common.errors import AuthlibBaseError
from authlib.oauth2.client import OAuth2Client
from authlib.oidc.core import CodeIDToken
from joserfc import jwt
from joserfc.errors import JoseError
from joserfc.jwk import KeySet

from service.answers.documents import JsonObject
from service.errors import Unauthenticated, Unavailable

ALGORITHMS = ["RS256", "PS256", "ES256", "ES384", "EdDSA"]
"""Signatures that are taken: by a key pair each; a shared secret could sign for the issuer."""
_TIMEOUT_S = 5.0
_MOST_BYTES = 2**20
_DISCOVERY_S = 3600.0
_LEEWAY_S = 60
_SCOPE = "openid email profile"


@dataclass(frozen=True, slots=True)
class Asked:
    """What a sign-in sends the browser to, and what must come back with it."""

    address: str
    state: str
    nonce: str
    verifier: str


class Issuer:
    """One OpenID provider: its addresses and keys are asked when they are needed and kept for an hour.

    Parameters
    ----------
    issuer, client_id, client_secret
        As the provider knows this service; without a secret it is a public client.
    """

    def __init__(self, issuer: str, client_id: str, client_secret: str = "") -> None:
        self._issuer, self._client_id, self._client_secret = issuer.rstrip("/"), client_id, client_secret
        self._lock = threading.Lock()
        self._known: tuple[float, JsonObject, KeySet] | None = None

    def asked(self, redirect_uri: str) -> Asked:
        """Where to send somebody who wants to sign in.

        Raises
        ------
        Unavailable
            when the issuer does not answer, or not as one.
        """
        document, _ = self._discovered()
        state, nonce, verifier = (secrets.token_urlsafe(32) for _ in range(3))
        with _session() as http:
            address, _ = self._client(http, redirect_uri).create_authorization_url(
                document["authorization_endpoint"], state=state, nonce=nonce, code_verifier=verifier
            )
        return Asked(address, state, nonce, verifier)

    def subject(self, code: str, redirect_uri: str, nonce: str, verifier: str) -> str:
        """Who signed in, as the issuer knows them: ``sub`` of an ID token that was made for this service and this sign-in.

        Raises
        ------
        Unauthenticated
            when the code is not taken, or the token is not what it has to be.
        Unavailable
            as above.
        """
        document, keys = self._discovered()
        try:
            with _session() as http:
                token = self._client(http, redirect_uri).fetch_token(
                    document["token_endpoint"], code=code, code_verifier=verifier, grant_type="authorization_code"
                )
        except AuthlibBaseError as refused:
            raise Unauthenticated(f"the issuer refused the sign-in: {refused.error}") from None
        except (httpx2.HTTPError, ValueError, KeyError, TypeError):
            raise Unavailable("the issuer of sign-ins does not answer: try again") from None
        text = token.get("id_token") if isinstance(token, dict) else None
        if not isinstance(text, str):
            raise Unauthenticated("the issuer sent no ID token")
        return self._checked(text, keys, nonce, token.get("access_token"))

    def _checked(self, text: str, keys: KeySet, nonce: str, access_token: Any) -> str:
        try:
            decoded = jwt.decode(text, keys, algorithms=ALGORITHMS)
        except (JoseError, ValueError, TypeError, KeyError):
            # it may be signed by a key that is newer than those that are known
            try:
                decoded = jwt.decode(text, self._discovered(anew=True)[1], algorithms=ALGORITHMS)
            except (JoseError, ValueError, TypeError, KeyError) as wrong:
                raise Unauthenticated(f"the ID token is not the issuer's: {type(wrong).__name__}") from None
        options = {
            "iss": {"essential": True, "value": self._issuer_as_it_says()},
            "aud": {"essential": True, "value": self._client_id},
            "nonce": {"essential": True},
        }
        params = {"nonce": nonce, "client_id": self._client_id, "access_token": access_token}
        claims = CodeIDToken(decoded.claims, decoded.header, options, params)
        try:
            claims.validate(leeway=_LEEWAY_S)
        except (AuthlibBaseError, JoseError, ValueError, TypeError) as wrong:
            raise Unauthenticated(f"the ID token is not for this sign-in: {wrong}") from None
        subject = claims["sub"]
        if not isinstance(subject, str) or not 0 < len(subject) <= 255:
            raise Unauthenticated("the ID token names nobody")
        return subject

    def _issuer_as_it_says(self) -> str:
        issuer: str = self._discovered()[0]["issuer"]
        return issuer

    def _client(self, http: "_Http", redirect_uri: str) -> Any:
        return OAuth2Client(
            http,
            self._client_id,
            self._client_secret or None,
            scope=_SCOPE,
            redirect_uri=redirect_uri,
            code_challenge_method="S256",
        )

    def _discovered(self, *, anew: bool = False) -> tuple[JsonObject, KeySet]:
        with self._lock:
            now = time.monotonic()
            if self._known is None or now - self._known[0] > _DISCOVERY_S or (anew and now - self._known[0] > 10.0):
                self._known = (now, *self._looked_up())
            return self._known[1], self._known[2]

    def _looked_up(self) -> tuple[JsonObject, KeySet]:
        try:
            with _session() as http:
                document = http.got(f"{self._issuer}/.well-known/openid-configuration")
                if str(document["issuer"]).rstrip("/") != self._issuer:
                    raise Unavailable("the issuer of sign-ins calls itself by another name than CASEDRAIN_OIDC_ISSUER")
                _ = document["authorization_endpoint"], document["token_endpoint"]
                return document, KeySet.import_key_set(http.got(document["jwks_uri"]))
        except (httpx2.HTTPError, JoseError, ValueError, KeyError, TypeError):
            raise Unavailable("the issuer of sign-ins does not answer: try again, or use a password") from None


class _Http:
    """What authlib asks of a session, over our own client: no redirects, bounded time and size."""

    def __init__(self, client: httpx2.Client) -> None:
        self._client = client

    def got(self, address: str) -> Any:
        """A JSON document."""
        return self._answer("GET", address, None, {}).json()

    def post(self, url: str, data: dict[str, str], headers: dict[str, str], auth: Any) -> httpx2.Response:
        """Answer to a form, with the client's own authentication."""
        body = str(httpx2.QueryParams(data))
        url, headers, body = auth.prepare("POST", url, headers, body)
        return self._answer("POST", url, body.encode(), headers)

    def _answer(self, method: str, url: str, content: bytes | None, headers: dict[str, str]) -> httpx2.Response:
        with self._client.stream(method, url, content=content, headers=headers) as response:
            parts, size = [], 0
            for part in response.iter_bytes():
                size += len(part)
                if size > _MOST_BYTES:
                    raise ValueError("the issuer's answer is too long")
                parts.append(part)
        kept = httpx2.Response(response.status_code, content=b"".join(parts), request=response.request)
        if kept.status_code >= 500 or (method == "GET" and kept.status_code != 200):
            raise ValueError(f"the issuer answered {kept.status_code}")
        return kept


@contextmanager
def _session() -> Iterator[_Http]:
    with httpx2.Client(timeout=_TIMEOUT_S, follow_redirects=False) as client:
        yield _Http(client)
