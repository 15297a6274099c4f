"""Where a webhook may go: to public addresses, and to hosts that the installation names; never inside by accident."""

import ipaddress
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from urllib.parse import urlsplit

Address = ipaddress.IPv4Address | ipaddress.IPv6Address
Resolver = Callable[[str, int], Sequence[str]]
_NAT64 = ipaddress.IPv6Network("64:ff9b::/96")
_MOST_URL = 2000


class Blocked(Exception):
    """A target that is not allowed; the words say why."""


@dataclass(frozen=True, slots=True)
class Target:
    """A checked target: connect to ``address`` and to nothing else, whatever the name says a moment later."""

    scheme: str
    host: str
    port: int
    path: str
    address: str


def target_of(url: str, allowed_hosts: frozenset[str], resolve: Resolver | None = None) -> Target:
    """Check a URL and resolve its host once.

    Parameters
    ----------
    allowed_hosts
        Names or addresses of receivers on the premises: they may be internal and may speak plain HTTP.
    resolve
        Gives the addresses of a name and port; default: the system's resolver.

    Raises
    ------
    Blocked
        when the URL is no HTTPS URL, carries credentials, cannot be resolved, or leads to an address that is not
        public: private, loopback, link-local, shared, reserved, multicast, or one of those inside an IPv6 address.
    """
    if len(url) > _MOST_URL:
        raise Blocked(f"is longer than {_MOST_URL} characters")
    try:
        parts = urlsplit(url)
        host, port = (parts.hostname or "").rstrip("."), parts.port
    except ValueError:
        raise Blocked("is not a URL") from None
    named = host in allowed_hosts
    if parts.scheme != "https" and not (named and parts.scheme == "http"):
        raise Blocked("must be an https URL")
    if not host or parts.username is not None or parts.password is not None:
        raise Blocked("must name a host and carry no credentials")
    port = port or (443 if parts.scheme == "https" else 80)
    try:
        addresses = (resolve or _resolved)(host, port)
    except OSError:
        raise Blocked(f"the host {host} cannot be resolved") from None
    if not addresses:
        raise Blocked(f"the host {host} cannot be resolved")
    # one bad address among good ones is reason enough: a name that mixes them is up to something
    if not named and not all(is_public(a) for a in addresses):
        raise Blocked(f"the host {host} is not a public one")
    path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
    return Target(parts.scheme, host, port, path, addresses[0])


def is_public(text: str) -> bool:
    """True for an address that anybody on the internet could mean."""
    address: Address = ipaddress.ip_address(text.partition("%")[0])
    if isinstance(address, ipaddress.IPv6Address):
        inner = address.ipv4_mapped or address.sixtofour or (address.teredo[1] if address.teredo else None)
        if inner is None and address in _NAT64:
            inner = ipaddress.IPv4Address(int(address) & 0xFFFFFFFF)
        if inner is not None:
            address = inner
    return address.is_global and not address.is_multicast and not address.is_reserved


def _resolved(host: str, port: int) -> list[str]:
    found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    return list(dict.fromkeys(str(entry[4][0]) for entry in found))
