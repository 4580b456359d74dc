"""Access rules of `contactd-web`: hosts, origins, token, and how often. Pure; time is
an argument.

A page in a browser of this network is not to be trusted because the browser is: any site that a
person visits may send requests here. So the Host must be one of ours (a foreign name that was made
to point here is none: 421), the Origin must be ours wherever a browser sends one and always for
what changes something (403), and commands carry a header that no form can send.
"""

import hashlib
import hmac
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

COMMAND_HEADER: Final = "X-Contactd-Command"
COOKIE: Final = "contactd"
WRONG_TOKENS: Final = 5  # of one address, within
WRONG_TOKENS_S: Final = 60.0
MOST_ADDRESSES: Final = 1000  # that gave wrong ones; beyond, no token is heard until some are old
LEAST_TOKEN: Final = 16  # characters
HEADERS: Final[Mapping[str, str]] = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "; ".join(
        [
            "default-src 'none'",
            "script-src 'self'",
            "style-src 'self'",
            "connect-src 'self'",
            "img-src 'self'",
            "base-uri 'none'",
            "form-action 'self'",
            "frame-ancestors 'none'",
            "require-trusted-types-for 'script'",
            "trusted-types 'none'",
        ]
    ),
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
    "Referrer-Policy": "same-origin",
    "Server": "contactd-web",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}


@dataclass(frozen=True, slots=True)
class Refusal:
    """HTTP status and reason."""

    status: int
    text: str


@dataclass(frozen=True, slots=True)
class Doorstep:
    """Hosts by which the page may be asked for, and whether a proxy with TLS stands before it."""

    hosts: frozenset[str]  # as in a Host header, with the port where it is not the usual one
    tls: bool = False

    def refusal(self, method: str, headers: Mapping[str, str], *, upgrades: bool) -> Refusal | None:
        """Reason why a request with these headers is refused; None if it is not."""
        host = headers.get("Host", "").lower()
        if host not in self.hosts:
            known = ", ".join(sorted(self.hosts))
            return Refusal(421, f"this page is not known by that name; it is known as {known}")
        origin = headers.get("Origin")
        if origin is None and method in ("GET", "HEAD") and not upgrades:
            return None
        scheme = "https" if self.tls else "http"
        if origin is None or origin.lower() != f"{scheme}://{host}":
            return Refusal(403, "asked from another site")
        if headers.get("Sec-Fetch-Site", "same-origin") not in ("same-origin", "none"):
            return Refusal(403, "asked from another site")
        return None


def command_refusal(command: str, headers: Mapping[str, str]) -> Refusal | None:
    """Reason why a request is not such a command: its header must name it."""
    if headers.get(COMMAND_HEADER) == command:
        return None
    return Refusal(403, f"a command needs the header {COMMAND_HEADER}: {command}")


@dataclass(slots=True)
class TokenCheck:
    """Token that a person gives once per browser; the cookie proves it from then on. With an
    empty token none is needed."""

    token: str
    _wrong: dict[str, list[float]] = field(default_factory=dict)  # times, by address

    @property
    def cookie(self) -> str:
        """Value of the cookie: made from the token, which it does not reveal."""
        return hmac.new(self.token.encode(), b"contactd-web cookie 1", hashlib.sha256).hexdigest()

    def admits(self, cookie: str) -> bool:
        """True if this cookie is ours, or none is needed."""
        return not self.token or hmac.compare_digest(cookie.encode(), self.cookie.encode())

    def enter(self, token: str, address: str, time_s: float) -> Refusal | None:
        """Refusal of a token that was given, None if it is the one. An address that gave too many
        wrong ones is not heard for a while, whatever it gives."""
        self._forget(time_s)
        wrong = self._wrong.get(address, [])
        if len(wrong) >= WRONG_TOKENS or len(self._wrong) >= MOST_ADDRESSES:
            return Refusal(429, "too many wrong tokens; wait a minute")
        if hmac.compare_digest(token.encode(errors="replace"), self.token.encode()):
            return None
        self._wrong[address] = [*wrong, time_s]
        return Refusal(401, "that is not the token")

    def _forget(self, time_s: float) -> None:
        for address, times in list(self._wrong.items()):
            if times[-1] <= time_s - WRONG_TOKENS_S:
                del self._wrong[address]


@dataclass(slots=True)
class Places:
    """Connections that are open, in all and by address."""

    most: int
    most_of_one: int
    _open: dict[str, int] = field(default_factory=dict)

    def take(self, address: str) -> bool:
        """Take a place for a connection of `address`; False if there is none for it."""
        mine = self._open.get(address, 0)
        if mine >= self.most_of_one or sum(self._open.values()) >= self.most:
            return False
        self._open[address] = mine + 1
        return True

    def may_have_more(self, address: str) -> bool:
        """True if it is not `address` itself that has too many."""
        return self._open.get(address, 0) < self.most_of_one

    def leave(self, address: str) -> None:
        """Give a place back."""
        self._open[address] -= 1
        if not self._open[address]:
            del self._open[address]


def hosts_of(names: list[str], port: int | None) -> frozenset[str]:
    """Host headers by which the page is asked for: each name, with the port unless it is usual;
    port None: a proxy decides, and the usual ones are left out."""
    shown = [f"[{name}]" if ":" in name and not name.startswith("[") else name for name in names]
    if port is None or port == 80:
        return frozenset(name.lower() for name in shown)
    return frozenset(f"{name.lower()}:{port}" for name in shown)
