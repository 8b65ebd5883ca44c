"""Placement of a server's rooms: in its own process, in worker processes, or on the hosts of a cluster.

A command chooses a placement by its flags, and from then on knows `Placement` alone. A front and its administration ask
`Homes` where a room is.

    made: it listens --begin: the rooms are there--> chores.begin --run--> stopped: people said goodbye, files left
"""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple, Protocol

from cogrip.protocol.settings.network_rate import RateChoice
from cogrip.protocol.settings.sections import Settings
from cogrip.server.io.authenticator import TokenAuthenticator
from cogrip.server.io.metrics_feed import MetricsFeed
from cogrip.server.io.published_state import PublishedState
from cogrip.server.io.rooms_on_demand import EMPTY_S
from cogrip.server.io.state_folder import StateFolder
from cogrip.server.snapshot import Snapshot

if TYPE_CHECKING:  # with OpenSSL, which takes a while
    from cogrip.server.hosting.link import Obey


class Served(NamedTuple):
    """Rooms to serve, with all that any placement needs.

    host, port    address to listen on
    folder        state of the server; None without
    rates         choice of the rate of each room that asked for "auto"
    templates     names of the spare rooms of each template, which are the last of `rooms`
    empty_s       how long a room on demand may be empty
    """

    rooms: Sequence[Settings]
    host: str
    port: int
    folder: StateFolder | None
    authenticator: TokenAuthenticator | None
    encrypted: bool
    record: bool
    report: bool
    rates: Mapping[str, RateChoice]
    templates: Mapping[str, Sequence[str]] = MappingProxyType({})
    empty_s: float = EMPTY_S

    @property
    def standing(self) -> Sequence[Settings]:
        """Rooms that are open from the start."""
        spare = {name for names in self.templates.values() for name in names}
        return [room for room in self.rooms if room.name not in spare]

    @property
    def key_folder(self) -> StateFolder | None:
        """Return the folder with the key; None without encryption."""
        return self.folder if self.encrypted else None


class Chores(Protocol):
    """Chores of a server between its datagrams: `Housekeeping` of rooms in this process, `Administration` of a front.

    published      what the server has published, written again and again
    more_degraded  says what else cannot be written now, and why (`Snapshot.degraded`)
    """

    published: PublishedState | None
    more_degraded: Callable[[], Mapping[str, str]]

    def begin(self) -> None:
        """Notify that all is ready, and work from now on. It ends with the server."""


class Placement(Protocol):
    """Where some rooms run. It listens once it is made."""

    @property
    def bound(self) -> tuple[str, int]:
        """Return host and port where people come in."""

    def begin(self, feed: MetricsFeed | None, told: Mapping[str, Sequence[str]]) -> Chores:
        """Prepare the rooms. feed: takes snapshots; told: warnings of each room, for its report. Raises Problem."""

    def run(self, seconds: float | None) -> int:
        """Serve until stopped, at most for `seconds`; leave the files of the run. Return the exit code."""


class OrderLink(Protocol):
    """Link to whoever serves a room, as orders need it."""

    def send(self, message: "Obey") -> object:
        """Send an order, without waiting."""


class HomeProcess(Protocol):
    """A process that serves rooms. state: "ready" once it does; snapshot: the newest, None before the first."""

    @property
    def rooms(self) -> tuple[str, ...]: ...

    @property
    def link(self) -> OrderLink: ...

    @property
    def state(self) -> str: ...

    @property
    def snapshot(self) -> Snapshot | None: ...


class Homes(Protocol):
    """Processes that serve the rooms of a front.

    unknown   why what is known of the rooms is old; "" where it is not
    replaced  count of processes that died and were replaced
    rereads   whether each room reads the tokens by itself, and must be told to
    templates names of the spare rooms of each template; none where there are no rooms on demand
    """

    @property
    def templates(self) -> Mapping[str, Sequence[str]]: ...

    def spare(self, template: str) -> "Sequence[tuple[HomeProcess, int]]":
        """Return each process that serves rooms, and how many of a template it has left."""

    @property
    def unknown(self) -> str: ...

    @property
    def replaced(self) -> int: ...

    @property
    def rereads(self) -> bool: ...

    @property
    def workers(self) -> Sequence[HomeProcess]: ...

    def home(self, room: str) -> HomeProcess | None:
        """Return the process that serves a room; None while none does."""

    def void(self, revoked: set[str], expired: set[str]) -> None:
        """Let every room know of ids of tokens that became void."""
