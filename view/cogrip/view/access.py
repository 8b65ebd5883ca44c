"""Access to the view's port: Host, Origin, path and token of each request (`docs/view.md`)."""

import hmac
from collections import Counter
from collections.abc import Collection
from urllib.parse import urlsplit

HELLO_S = 5.0
MOST_MESSAGE_BYTES = 4096
TOKEN, MALFORMED, NO_RIGHT, NO_HELLO, TOO_LARGE = 4401, 4400, 4403, 4408, 4413  # codes with which the socket is closed
OVER = 4410  # code of a socket that is closed for good: nothing will be served at this address again
SOCKET, FOXGLOVE = "/socket", "/foxglove"
HEADERS = (
    ("Cache-Control", "no-store"),
    ("Cross-Origin-Opener-Policy", "same-origin"),
    ("Cross-Origin-Resource-Policy", "same-origin"),
    ("Referrer-Policy", "no-referrer"),
    ("X-Content-Type-Options", "nosniff"),
)
"""Headers of every answer, beside its Content-Security-Policy."""
FRONT_ENDS = ("https://app.foxglove.dev", "file://", "null")
"""Origins of Foxglove's own site, and of pages and programs on a disk, as Chromium and Firefox call them."""
_LOOPBACK = ("localhost", "127.0.0.1", "::1")


class Access:
    """Judge of requests; `refused` counts them by reason.

    hosts    `HOST:PORT` texts by which the page is reached: another Host means another name for this machine (DNS rebinding)
    scheme   of the page, http or https
    allowed  further origins, of front ends elsewhere
    public   origins by which the page itself is reached, through a proxy that ends TLS
    front_ends  origins whose pages may open FOXGLOVE, beside pages of this machine; none where that is not offered. What
             such a page is shown still takes the token of its address.
    """

    def __init__(
        self,
        hosts: Collection[str],
        scheme: str = "http",
        allowed: Collection[str] = (),
        public: Collection[str] = (),
        front_ends: Collection[str] = (),
    ) -> None:
        self.refused: Counter[str] = Counter()
        self._hosts = frozenset(host.lower() for host in hosts)
        self._origins = frozenset(
            {f"{scheme}://{host}" for host in self._hosts} | {each.lower() for each in (*allowed, *public)}
        )
        self._hosts |= {each.lower().partition("://")[2] for each in public}  # never with the page's own scheme
        self._front_ends = frozenset(each.lower() for each in front_ends)

    def refusal(self, host: str | None, origin: str | None, path: str = "", *, upgrade: bool) -> str:
        """Return why a request is refused, "" if it is not. origin: None where there is none, as with a program."""
        reason = ""
        if (host or "").lower() not in self._hosts:
            reason = "Host is not this page's"
        elif origin is not None and not self._may_ask(origin.lower(), path):
            reason = "Origin is not this page's"
        if reason:
            self.refused[reason + (" (socket)" if upgrade else "")] += 1
        return reason

    def _may_ask(self, origin: str, path: str) -> bool:
        if origin in self._origins:
            return True
        offered = path == FOXGLOVE and bool(self._front_ends)
        return offered and (origin in self._front_ends or host_of(origin) in _LOOPBACK)


def host_of(origin: str) -> str:
    """Return the host of `SCHEME://HOST` or `SCHEME://HOST:PORT` where SCHEME is http or https, "" for any other text."""
    try:
        parts = urlsplit(origin)
        host, _ = parts.hostname or "", parts.port
    except ValueError:
        return ""
    whole = origin.lower() == f"{parts.scheme}://{parts.netloc}".lower() and "@" not in parts.netloc
    return host if whole and parts.scheme in ("http", "https") else ""


def same(token: str, other: str) -> bool:
    """Compare two tokens in a time that tells nothing of them."""
    return hmac.compare_digest(token.encode(), other.encode())
