"""Access to the view's port: Host, Origin, path and token of each request (`docs/view.md`)."""

import hmac
from collections import Counter
from collections.abc import Collection

HELLO_S = 5.0
MOST_MESSAGE_BYTES = 4096
TOKEN, MALFORMED, NO_RIGHT, NO_HELLO, TOO_LARGE = 4401, 4400, 4403, 4408, 4413  # codes with which the socket is closed
SOCKET, FOXGLOVE = "/socket", "/foxglove"
HEADERS = (
    ("Cache-Control", "no-store"),
    ("Cross-Origin-Opener-Policy", "same-origin"),
    ("Cross-Origin-Resource-Policy", "same-origin"),
    ("Referrer-Policy", "no-referrer"),
    ("X-Content-Type-Options", "nosniff"),
)
"""Headers of every answer, beside its Content-Security-Policy."""


class Access:
    """Judge of requests; `refused` counts them by reason.

    hosts    `HOST:PORT` texts by which the page is reached: another Host means another name for this machine (DNS rebinding)
    scheme   of the page, http or https
    allowed  further origins, of front ends elsewhere
    public   origins by which the page itself is reached, through a proxy that ends TLS
    """

    def __init__(
        self, hosts: Collection[str], scheme: str = "http", allowed: Collection[str] = (), public: Collection[str] = ()
    ) -> None:
        self.refused: Counter[str] = Counter()
        self._hosts = frozenset(host.lower() for host in hosts)
        self._origins = frozenset(
            {f"{scheme}://{host}" for host in self._hosts} | {each.lower() for each in (*allowed, *public)}
        )
        self._hosts |= {each.lower().partition("://")[2] for each in public}  # never with the page's own scheme

    def refusal(self, host: str | None, origin: str | None, *, upgrade: bool) -> str:
        """Return why a request is refused, "" if it is not. origin: None where there is none, as with a program."""
        reason = ""
        if (host or "").lower() not in self._hosts:
            reason = "Host is not this page's"
        elif origin is not None and origin.lower() not in self._origins:
            reason = "Origin is not this page's"
        if reason:
            self.refused[reason + (" (socket)" if upgrade else "")] += 1
        return reason


def same(token: str, other: str) -> bool:
    """Compare two tokens in a time that tells nothing of them."""
    return hmac.compare_digest(token.encode(), other.encode())
