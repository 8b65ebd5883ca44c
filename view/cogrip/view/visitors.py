"""Limits of what people at a page server's port may cost: connections, tabs, and tokens that are none."""

from collections import Counter
from typing import NamedTuple

from cogrip.server.rate_limit import Buckets, Budget, network_of

_ADDRESS_SLOTS = 4096


class VisitorLimits(NamedTuple):
    """Bounds in all and for each address (IPv4, or the /64 of IPv6): many people may sit behind one."""

    connections: int = 512
    connections_each: int = 128
    tabs: int = 256
    tabs_each: int = 64
    failed: Budget = Budget(5, 100)  # tokens that the server refused
    failed_each: Budget = Budget(1, 20)


class Visitors:
    """Counts of connections and tabs by address. Methods that admit return "", or the name under which they refuse."""

    def __init__(self, limits: VisitorLimits, secret: int) -> None:
        """secret: random; whoever knows it can aim at the budget of another address."""
        self.limits = limits
        self._secret = secret
        self._connections: Counter[str] = Counter()
        self._tabs: Counter[str] = Counter()
        self._failed = Buckets(1, limits.failed)
        self._failed_each = Buckets(_ADDRESS_SLOTS, limits.failed_each)

    @property
    def tabs(self) -> int:
        """Number of tabs that are open."""
        return self._tabs.total()

    def connect(self, address: object) -> str:
        """Note a connection; `disconnect` ends it, also one that is refused."""
        self._connections[network_of(address)] += 1
        if self._connections.total() > self.limits.connections:
            return "too many connections"
        each = self._connections[network_of(address)]
        return "too many connections of one address" if each > self.limits.connections_each else ""

    def disconnect(self, address: object) -> None:
        _less(self._connections, network_of(address))

    def may_open(self, address: object) -> str:
        """Return why one more tab is refused."""
        if self.tabs >= self.limits.tabs:
            return "too many tabs"
        return "too many tabs of one address" if self._tabs[network_of(address)] >= self.limits.tabs_each else ""

    def open_tab(self, address: object) -> None:
        self._tabs[network_of(address)] += 1

    def close_tab(self, address: object) -> None:
        _less(self._tabs, network_of(address))

    def may_try(self, address: object, now_ns: int) -> bool:
        """Return whether a token of this address may be asked about."""
        return self._failed.has(0, now_ns) and self._failed_each.has(self._slot(address), now_ns)

    def failed(self, address: object, now_ns: int) -> None:
        """Note a token that was refused."""
        self._failed.take(0, now_ns)
        self._failed_each.take(self._slot(address), now_ns)

    def _slot(self, address: object) -> int:
        return hash((self._secret, network_of(address))) % _ADDRESS_SLOTS


def _less(counter: Counter[str], key: str) -> None:
    counter[key] -= 1
    if counter[key] <= 0:
        del counter[key]
