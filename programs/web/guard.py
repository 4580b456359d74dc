"""Access rules of `contactd-web`: hosts, origins, token, rate limits. Pure; time is an argument.

Requests from a browser in this network cannot be trusted, as any site that a user visits may cause
them. The Host must therefore be one of ours, which excludes DNS rebinding (421); the Origin must be
ours if there is one, and is required for whatever changes something (403); and commands need a
header that no form can send.
"""

import hashlib
import hmac
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

COMMAND_HEADER: Final = "X-Contactd-Command"
COOKIE: Final = "contactd"
WRONG_TOKENS: Final = 5  # allowed from one address within WRONG_TOKENS_S
WRONG_TOKENS_S: Final = 60.0
MOST_ADDRESSES: Final = 1000  # with wrong tokens; at more, all tokens are refused until some expire
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
    """Refusal of a request, with HTTP status and reason."""

    status: int
    text: str


@dataclass(frozen=True, slots=True)
class OriginRules:
    """Rules on Host and Origin: allowed hosts, and whether a proxy in front provides TLS."""

    hosts: frozenset[str]  # as in a Host header, with the port unless it is the default
    tls: bool = False

    def refusal(self, method: str, headers: Mapping[str, str], *, upgrades: bool) -> Refusal | None:
        """Reason why a request with these headers is refused; None if it is not."""
        host = headers.get("Host", "").lower()
        if host not in self.hosts:
            known = ", ".join(sorted(self.hosts))
            return Refusal(421, f"this page has no such host name; allowed: {known}")
        origin = headers.get("Origin")
        if origin is None and method in ("GET", "HEAD") and not upgrades:
            return None
        scheme = "https" if self.tls else "http"
        if origin is None or origin.lower() != f"{scheme}://{host}":
            return Refusal(403, "request from another site")
        if headers.get("Sec-Fetch-Site", "same-origin") not in ("same-origin", "none"):
            return Refusal(403, "request from another site")
        return None


def command_refusal(command: str, headers: Mapping[str, str]) -> Refusal | None:
    """Refusal of a request whose header does not name the command; None if it does."""
    if headers.get(COMMAND_HEADER) == command:
        return None
    return Refusal(403, f"a command needs the header {COMMAND_HEADER}: {command}")


@dataclass(slots=True)
class TokenCheck:
    """Check of the token, which a user enters once per browser and a cookie proves afterwards. With
    an empty token, none is needed."""

    token: str
    _wrong: dict[str, list[float]] = field(default_factory=dict)  # times, by address

    @property
    def cookie(self) -> str:
        """Value of the cookie, derived from the token without revealing it."""
        return hmac.new(self.token.encode(), b"contactd-web cookie 1", hashlib.sha256).hexdigest()

    def admits(self, cookie: str) -> bool:
        """True if this cookie is valid, or none is needed."""
        return not self.token or hmac.compare_digest(cookie.encode(), self.cookie.encode())

    def enter(self, token: str, address: str, time_s: float) -> Refusal | None:
        """Refusal of an entered token, None if it is right. An address with too many wrong tokens
        is refused for WRONG_TOKENS_S, even with the right one."""
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
    """Counts of open connections, in total and by address."""

    most: int
    most_of_one: int
    _open: dict[str, int] = field(default_factory=dict)

    def take(self, address: str) -> bool:
        """Take a place for a connection from `address`; False if there is none."""
        mine = self._open.get(address, 0)
        if mine >= self.most_of_one or sum(self._open.values()) >= self.most:
            return False
        self._open[address] = mine + 1
        return True

    def may_have_more(self, address: str) -> bool:
        """True if `address` has not reached its own limit."""
        return self._open.get(address, 0) < self.most_of_one

    def leave(self, address: str) -> None:
        """Give a place back."""
        self._open[address] -= 1
        if not self._open[address]:
            del self._open[address]


def hosts_of(names: list[str], port: int | None) -> frozenset[str]:
    """Allowed Host headers: each name, with the port unless it is the default; port None: without
    port, as for a proxy at the default port."""
    shown = [f"[{name}]" if ":" in name and not name.startswith("[") else name for name in names]
    if port is None or port == 80:
        return frozenset(name.lower() for name in shown)
    return frozenset(f"{name.lower()}:{port}" for name in shown)
