"""Directory of a cluster: which room is where, which host gets the next one. It asks no clock and starts nothing.

A room's processes are numbered. One of them serves; the next is started where none does, or where the host of that one is to
be drained. All that is known here comes with reports, some times a second: a directory that is started again learns it anew.
"""

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field
from typing import NamedTuple

from cogrip.machine.addition import add_integers
from cogrip.server.events import ServerEvent

LOST_S = 1.5  # time without a report after which a process that serves is lost
START_S = 30.0  # time after which a process that is being started is lost; it may have to wait for the one before
SUSPECT_S = 15.0  # time for which no room is placed on a host that lost one, if there is another
RETRY_S = 2.0  # wait after a start that failed
SETTLE_S = 8.0  # time for which a directory that has just begun waits for hosts that have not reported yet
GAP_S = 0.5  # longest gap between two calls: a longer one is this process's own pause, and no silence of others


class Host(NamedTuple):
    """One node of Ray. name: its identity; address: by which people reach it."""

    name: str
    address: str
    processors: float


class Report(NamedTuple):
    """State of a room's process as the actor of its host tells it.

    place     HOST:PORT, "" before it serves
    taken     seats
    snapshot  encoded
    ended     the process has gone
    """

    actor: str
    room: str
    number: int
    host: str
    job: bytes
    place: str = ""
    taken: tuple[str, ...] = ()
    snapshot: bytes = b""
    ended: bool = False


class ProcessStart(NamedTuple):
    """Process to be started. after: actor of the host that hands the room over, "" for none."""

    room: str
    number: int
    host: str
    job: bytes
    after: str


class Home(NamedTuple):
    """Where a room is: what its newest report said. actor: that of its host; number: of the process."""

    actor: str
    place: str
    taken: tuple[str, ...]
    snapshot: bytes
    number: int = 0


class ClusterState(NamedTuple):
    """State of the cluster, for a front. refused: rooms that are here with other settings; next_line: to be asked for."""

    refused: tuple[str, ...]
    homes: dict[str, Home]
    fronts: tuple[str, ...]
    counts: dict[str, int]
    lines: list[ServerEvent]
    next_line: int


@dataclass(slots=True)
class _Room:
    """number, since_s: of the newest process, and when it was reported last; starting: it does not serve yet.

    retry_s: no start before
    """

    job: bytes
    number: int = 0
    host: str = ""
    since_s: float = 0.0
    starting: bool = False
    serving: Report | None = None
    reported_s: float = 0.0
    retry_s: float = 0.0


@dataclass(slots=True)
class Directory:
    """Rooms and fronts of a cluster, by name and by place. moved, lost: counts."""

    moved: int = 0
    lost: int = 0
    _rooms: dict[str, _Room] = field(default_factory=dict)
    _fronts: dict[str, float] = field(default_factory=dict)
    _drained: set[str] = field(default_factory=set)
    _suspect: dict[str, float] = field(default_factory=dict)
    _called_s: float | None = None
    _born_s: float = 0.0

    def offer(self, jobs: Mapping[str, bytes]) -> tuple[str, ...]:
        """Take rooms that are to be served. Returns those that are here with another job."""
        for room, job in jobs.items():
            self._rooms.setdefault(room, _Room(job))
        return tuple(room for room, job in jobs.items() if self._rooms[room].job != job)

    def keep_front(self, place: str, now_s: float) -> tuple[str, ...]:
        """Note that a front is there. Returns the places of all."""
        self._pass(now_s)
        self._fronts[place] = now_s
        self._fronts = {front: reported_s for front, reported_s in self._fronts.items() if now_s - reported_s < LOST_S}
        return tuple(self._fronts)

    def leave_front(self, place: str) -> bool:
        """Forget a front. Returns whether it was the last."""
        self._fronts.pop(place, None)
        return not self._fronts

    def report(self, told: Report, now_s: float) -> bool:
        """Take in a report. Returns whether this process may go on."""
        self._pass(now_s)
        room = self._rooms.setdefault(told.room, _Room(told.job))
        serving = room.serving.number if room.serving else 0
        if told.number < (serving or room.number):
            return False  # another one has the room, or is to have it
        if told.ended:
            self._ended(room, told, now_s)
            return False
        if told.number >= room.number:
            room.number, room.host, room.since_s = told.number, told.host, now_s
            room.starting = not told.place
        if told.place:
            self.moved += bool(serving) and told.number > serving
            room.serving, room.reported_s = told, now_s
        return True

    def _ended(self, room: _Room, told: Report, now_s: float) -> None:
        """Let the next one be started: at once for one that served, after a while for one that could not begin."""
        if room.serving and room.serving.number == told.number:
            self.lost += not room.starting  # else it has handed over
            room.serving = None
        if told.number == room.number:
            self._suspect[told.host] = now_s
            room.retry_s = now_s + RETRY_S if room.starting else 0.0
            room.starting = False

    def homes(self) -> dict[str, Home]:
        """Return where the rooms are that are served."""
        return {
            name: Home(
                room.serving.actor, room.serving.place, room.serving.taken, room.serving.snapshot, room.serving.number
            )
            for name, room in self._rooms.items()
            if room.serving
        }

    def drain(self, host: str, hosts: Sequence[Host]) -> tuple[str, bool]:
        """Place no room on a host any more, and let its rooms move. Returns what to tell, and whether it is done.

        host: its address, or the beginning of its name
        """
        found = [each for each in hosts if each.address == host or (len(host) >= 4 and each.name.startswith(host))]
        there = ", ".join(f"{each.address} ({each.name[:8]})" for each in hosts if each.name not in self._drained)
        if len(found) != 1:
            several = "there are several" if found else "there is no"
            return f"{several} host {host!r} in the cluster; give the beginning of one of these: {there}", False
        drained = self._drained | {found[0].name}
        if not any(each.name not in drained for each in hosts):
            return f"{host} is the last host that is left: its rooms have nowhere to go", False
        self._drained = drained
        rooms = sorted(name for name, room in self._rooms.items() if room.host == found[0].name)
        moving = f"its rooms move: {', '.join(rooms)}" if rooms else "it has no rooms"
        return f"no room is placed on {found[0].address} ({found[0].name[:8]}) any more; {moving}", True

    def is_empty(self, host: str) -> bool:
        """Return whether a host is drained, by its name, and has no room any more."""
        there = {room.host for room in self._rooms.values()}
        there |= {room.serving.host for room in self._rooms.values() if room.serving}
        return host in self._drained and host not in there

    def look(self, hosts: Sequence[Host], now_s: float, all_reported: bool = True) -> list[ProcessStart]:
        """Return the processes that are to be started now, on these hosts. all_reported: no other host has said nothing yet."""
        self._pass(now_s)
        if now_s - self._born_s < (LOST_S if all_reported else SETTLE_S):  # rooms are reported meanwhile
            return []
        started = []
        for name, room in self._rooms.items():
            if room.serving and not room.starting and now_s - room.reported_s > LOST_S:
                self.lost += 1
                self._suspect[room.serving.host] = now_s
                room.serving = None
            if room.starting and now_s - room.since_s > START_S:
                self._suspect[room.host] = now_s
                room.starting = False
            drained = room.serving is not None and room.serving.host in self._drained
            if room.starting or (room.serving and not drained) or now_s < room.retry_s:
                continue
            if host := self._host(hosts, now_s):
                after = room.serving.actor if room.serving else ""
                room.number, room.host, room.since_s, room.starting = room.number + 1, host, now_s, True
                started.append(ProcessStart(name, room.number, host, room.job, after))
        return started

    def _host(self, hosts: Sequence[Host], now_s: float) -> str:
        """Return the host with the least load: rooms and people for each processor. "" where there is none."""
        suspect = {name for name, since_s in self._suspect.items() if now_s - since_s < SUSPECT_S}
        free = [each for each in hosts if each.name not in self._drained]
        fit = [each for each in free if each.name not in suspect] or free
        return min(fit, key=lambda each: self._load(each.name) / max(each.processors, 1.0)).name if fit else ""

    def _load(self, host: str) -> int:
        there = [room for room in self._rooms.values() if room.host == host]
        return add_integers(1 + (len(room.serving.taken) if room.serving else 0) for room in there)

    def _pass(self, now_s: float) -> None:
        """Let time pass. Between calls nobody can report: a long gap is this process's own pause, and none of a room."""
        if self._called_s is None:
            self._called_s = self._born_s = now_s
        gap_s, self._called_s = now_s - self._called_s, now_s
        if gap_s > GAP_S:
            for room in self._rooms.values():
                room.reported_s += gap_s
                room.since_s += gap_s


def taken_seats(homes: Mapping[str, Home]) -> Set[tuple[str, str]]:
    """Return rooms and names of all seats that are taken."""
    return {(room, user) for room, home in homes.items() for user in home.taken}
