"""Where a webhook may go: to public addresses, and to hosts that the installation names; never inside by accident."""

import ipaddress
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from urllib.parse import urlsplit

Address = ipaddress.IPv4Address | ipaddress.IPv6Address
Resolver = Callable[[str, int], Sequence[str]]
_NAT64 = ipaddress.IPv6Network("64:ff9b::/96")
_COMPATIBLE = ipaddress.IPv6Network("::/96")
_NOT_PUBLIC = tuple(
    ipaddress.ip_network(text)
    for text in (
        "192.0.0.0/24",  # protocol assignments, among them the far end of a carrier's tunnel (RFC 6890)
        "192.88.99.0/24",  # relays of 6to4, whoever runs them (RFC 7526)
        "64:ff9b:1::/48",  # NAT64 of an own network (RFC 8215)
        "fec0::/10",  # site-local, deprecated and still routed inside (RFC 3879)
        "3fff::/20",  # documentation (RFC 9637)
        "5f00::/16",  # segment routing (RFC 9602)
        "2001::/23",  # protocol assignments; Teredo among them is looked through before
    )
)
"""What ``is_global`` of this and of older Pythons lets pass."""
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
    try:
        # what goes into the Host header and to the resolver; a label that is empty or too long is none
        host = host if ":" in host else host.encode("idna").decode("ascii")
    except UnicodeError:
        raise Blocked("must name a host and carry no credentials") from None
    named = host in allowed_hosts
    if parts.scheme != "https" and not (named and parts.scheme == "http"):
        raise Blocked("must be an https URL")
    if not host or parts.username is not None or parts.password is not None:
        raise Blocked("must name a host and carry no credentials")
    port = port or (443 if parts.scheme == "https" else 80)
    try:
        addresses = (resolve or _resolved)(host, port)
    except (OSError, UnicodeError):
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
    inner = _inside(address) if isinstance(address, ipaddress.IPv6Address) else ()
    return all(_is_public(one) for one in inner or (address,))


def _inside(address: ipaddress.IPv6Address) -> tuple[ipaddress.IPv4Address, ...]:
    """IPv4 addresses that an IPv6 address stands for: packets to it end up at one of them."""
    if address.teredo:
        return address.teredo
    if address in _NAT64 or (address in _COMPATIBLE and int(address) > 1):
        return (ipaddress.IPv4Address(int(address) & 0xFFFFFFFF),)
    one = address.ipv4_mapped or address.sixtofour
    return (one,) if one else ()


def _is_public(address: Address) -> bool:
    if any(address.version == net.version and address in net for net in _NOT_PUBLIC):
        return False
    return address.is_global and not address.is_multicast and not address.is_reserved


def _resolved(host: str, port: int) -> list[str]:
    found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    return list(dict.fromkeys(str(entry[4][0]) for entry in found))
