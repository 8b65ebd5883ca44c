"""The live server: one thread, one UDP socket, many rooms (design: Server process).

A tick of a room: drain the socket, step, send one datagram a user. Rooms may have different rates. Checkpoints, metrics and
the administrator's orders are chores: called between ticks, and none may wait for anything.
"""

import hashlib
import secrets
from collections import Counter, deque
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path

from cogrip.machine.pacing import SPIN_NS, Pacer
from cogrip.machine.platform import time
from cogrip.machine.realtime import SERVER_PRIORITY, engage, release
from cogrip.machine.receive_buffer import OVERRUN
from cogrip.machine.stop import Stop
from cogrip.protocol.io.recorder import Recorder, open_recorder
from cogrip.protocol.recording.header import Header, versions_here
from cogrip.protocol.recording.sink import Nowhere, pack
from cogrip.protocol.settings.rates import NS_PER_S
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.version import VERSION
from cogrip.protocol.wire.session import SECONDS_OVER
from cogrip.server import inputs
from cogrip.server.admission.admission import AdmissionServices, AdmitAll, Authenticator
from cogrip.server.events import UNAUTHENTICATED_EVENTS, ServerEvent
from cogrip.server.io.call_limit import call_limit
from cogrip.server.io.datagram_path import DatagramPath
from cogrip.server.io.next_server import NextServer
from cogrip.server.io.paced_room import PacedRoom, deserted_among, next_due_ns, step_due, take_due
from cogrip.server.io.udp_socket import DatagramSocket, ServerChannel, UdpRange, UdpSocket
from cogrip.server.rate_limit import Buckets, Budget
from cogrip.server.recorder import WHO, RecordedServer
from cogrip.server.room import Room

FLOOR_BYTES = 500_000_000
"""Free bytes of a disk that recordings leave: a server's key, tokens and checkpoints are to have room."""
RESTARTS_TOLD, TOLD_EVERY_S = 3, 0.01
"""Number of times that a restart is told, and time between them: a datagram may be lost."""
HANDS_OVER_AT = "SIGTERM"  # signal that a service manager sends at a restart
LINGER_NS = 300_000_000  # time to wait after the goodbye, for the clients' accounts
REPORTED = Budget(1, 40)  # budget of each of UNAUTHENTICATED_EVENTS
OVERSLEEP_FRAMES = 8  # number of frames over whose wake-ups the delay is averaged
EARLY_PART = 4  # divisor of a frame: the loop wakes at most this part of it ahead of a step to take in what has come


Chore = Callable[[int], None]


@dataclass(slots=True)
class LiveServer:
    """A daemon for some rooms. `listen`, then `run` until `stop` is set.

    open_channel  returns the channel to the clients of a core
    floor_bytes   what a recording leaves free on its disk
    ask_next      asks the program that is installed whether the next server can take the seats over, before they are let go
    hand_over_s   how long people wait for the next server, once SIGTERM has ended this one; None: it ends their sessions
    chores        called between ticks with the time [ns]
    events        of chores, reported as those of the core are
    """

    rooms: Sequence[Settings]
    host: str
    port: int
    stop: Stop
    say: Callable[[ServerEvent], None]
    open_channel: Callable[[RecordedServer], ServerChannel]
    record_at: Path | None = None
    floor_bytes: int = FLOOR_BYTES
    seconds: float | None = None
    hand_over_s: float | None = None
    ask_next: Callable[[], NextServer] = NextServer
    authenticator: Authenticator = field(default_factory=AdmitAll)
    chores: list[Chore] = field(default_factory=list)
    events: deque[ServerEvent] = field(default_factory=deque)
    marked: Callable[[str], None] | None = None  # function that is called with the words of each marker
    core: RecordedServer = field(init=False)
    channel: ServerChannel = field(init=False)
    pacers: dict[str, Pacer] = field(init=False, default_factory=dict)
    recorder: Recorder | None = field(init=False, default=None)
    _next: NextServer | None = field(init=False, default=None)
    _misfit: str = field(init=False, default="")
    _socket: DatagramSocket = field(init=False)
    _start_ns: int = field(init=False, default=0)
    _overran: int = field(init=False, default=0)
    _path: DatagramPath = field(init=False)
    _most_early_ns: int = field(init=False, default=0)
    _oversleep_ns: int = field(init=False, default=SPIN_NS)
    _event_budget: Buckets = field(init=False, default_factory=lambda: Buckets(len(UNAUTHENTICATED_EVENTS), REPORTED))
    _withheld: Counter[str] = field(init=False, default_factory=Counter)
    _awake: list[PacedRoom] = field(init=False, default_factory=list)
    _asleep: dict[Room, PacedRoom] = field(init=False, default_factory=dict)  # rooms that are deserted

    def listen(self, ports: UdpRange | None = None) -> tuple[str, int]:
        """Bind, and return (host, port). ports: to take one of, in place of `port`. Raises ServeError."""
        opened = UdpSocket(self.host, self.port, ports)
        self.serve_at(opened)
        return opened.place

    def serve_at(self, opened: DatagramSocket) -> None:
        """Serve at a socket that is open already. Raises what `open_channel` raises, the socket being closed then."""
        self._socket = opened
        services = AdmissionServices(
            lambda: secrets.randbelow(2**63 - 1) + 1, self.authenticator, lambda: secrets.token_urlsafe(16), ticket_hash
        )
        self.core = RecordedServer(self.rooms, VERSION, services)
        for room in self.core.rooms:
            room.world.limit_calls(call_limit)
        try:
            self.channel = self.open_channel(self.core)
        except BaseException:  # there is no usable key
            self.close()
            raise
        half_frame_ns = min(500_000_000 // room.rates.network_hz for room in self.rooms)
        self._most_early_ns = 2 * half_frame_ns // EARLY_PART
        self._path = DatagramPath(opened, self.channel, self.core, half_frame_ns)

    def close(self) -> None:
        """Close the socket where `run` is not called."""
        self._socket.close()

    @property
    def elapsed_s(self) -> float:
        """Time since `run` began."""
        return (time.monotonic_ns() - self._start_ns) * 1e-9

    def run(self) -> None:
        """Serve until stopped, end all sessions, and close the socket."""
        self.recorder = self._record()
        measures = engage(priority=SERVER_PRIORITY)
        self._start_ns = time.monotonic_ns()
        pacers = self.pacers
        for room in self.core.rooms:
            pacers[room.name] = pacer = Pacer(room.settings.rates.network_hz, self._start_ns)
            self.core.count_ticks(room, pacer.count)
        try:
            with closing(self._socket):
                self._loop(pacers)
                self.count_deserted(time.monotonic_ns())
                self._farewell()
            self.core.handle(inputs.CloseLedger(), time.monotonic_ns())
        finally:
            release(measures)
            self.core.record(Nowhere())
            if self.recorder is not None:
                self.recorder.close()

    def _record(self) -> Recorder | None:
        """Start the recorder, before anything is received."""
        if self.record_at is None:
            self.core.record(Nowhere())
            return None
        first, epoch_ns = self.rooms[0], time.time_ns() - time.monotonic_ns()
        header = Header(
            "server", WHO, self.core.start, first.rates.network_hz, first.seed, epoch_ns, False, versions_here(),
            self.core.topics,
        )  # fmt: skip
        recorder = open_recorder(
            self.record_at, header, lambda text: self.say(ServerEvent("trouble", text)), floor_bytes=self.floor_bytes
        )
        self.core.record(recorder or Nowhere(), pack)
        return recorder

    def losses(self) -> dict[str, int]:
        """Return the counts of what is missing in the recording, by name."""
        recorder = self.recorder
        stopped = bool(self.record_at) if recorder is None else bool(recorder.trouble)
        counts = {"recording stopped": int(stopped), "not recorded": recorder.lost if recorder else 0}
        return {name: count for name, count in counts.items() if count}

    @property
    def not_recorded(self) -> str:
        """Why the recording that is asked for does not go on; "" where it does."""
        if self.record_at is None or not self.pacers:
            return ""
        return "it could not begin" if self.recorder is None else self.recorder.look()

    @property
    def datagrams(self) -> tuple[int, int]:
        """(Received, sent) at the socket so far."""
        return self._path.received, self._path.sent

    def drops(self) -> dict[str, int]:
        """Return the drop counts by reason: of kernel, channel and core."""
        dropped = Counter(self.core.dropped)
        dropped.update(self.channel.dropped)
        if self._path.cut_short:
            dropped["left for the next tick"] = self._path.cut_short  # times that some were
        with suppress(OSError):  # the socket is closed: the last count holds
            self._overran = self._socket.overruns()
        if self._overran:
            dropped[OVERRUN] = self._overran
        return dict(dropped)

    def _loop(self, pacers: dict[str, Pacer]) -> None:
        core, clock, path = self.core, time.monotonic_ns, self._path
        end_ns = None if self.seconds is None else self._start_ns + round(self.seconds * 1e9)
        awake = self._awake = [PacedRoom(room, pacers[room.name]) for room in core.rooms]
        quiet_ns = min(NS_PER_S // pacer.rate_hz for pacer in pacers.values())  # between looks where all are
        now_ns, early_ns = self._start_ns, 0
        while not (self.stop.reason and self._may_end()):
            if end_ns is not None and clock() >= end_ns:
                self.stop.reason = f"stopped ({SECONDS_OVER})"
            due_ns = next_due_ns(awake) if awake else now_ns + quiet_ns
            now_ns, early_ns = self._wait(due_ns, early_ns)
            take_due(awake, now_ns)
            path.drain(now_ns, now_ns - due_ns)
            step_due(awake, core, path, now_ns, early_ns)
            if core.woken:
                self._wake(now_ns)
            for each in deserted_among(awake):
                awake.remove(each)
                self._asleep[each.room] = each
            self._report()
            self.channel.poll(now_ns)
            path.flush()
            for chore in self.chores:
                chore(now_ns)

    def _may_end(self) -> bool:
        """Return whether a server that was stopped may end: one that hands its seats over knows first that they can go on."""
        if not self.hands_over:
            return True
        self._next = self._next or self.ask_next()
        misfit = self._next.misfit()
        if misfit:
            self.hand_over_s, self._misfit = None, misfit
            self.say(ServerEvent("trouble", f"no seat is handed over: {misfit}"))
        return misfit is not None

    def _wait(self, due_ns: int, early_ns: int) -> tuple[int, int]:
        """Wait for the step that is due. Returns now, and how long datagrams were received ahead of it.

        What has come is taken in while the step is waited for: it has less to do then, and its code and data at hand.
        early_ns: how long that took ahead of the step before, by which it is begun earlier. The kernel's delay of a wake-up,
        in the mean of the last ones, is slept less as well; only what it differs by is spun.
        """
        clock, ahead_ns = time.monotonic_ns, self._oversleep_ns + min(early_ns, self._most_early_ns)
        slept_ns = due_ns - ahead_ns - clock()
        if slept_ns > 0:
            time.sleep(slept_ns * 1e-9)
        woken_ns, early_ns = clock(), 0
        if slept_ns > 0:
            over_ns = woken_ns - (due_ns - ahead_ns) - self._oversleep_ns
            self._oversleep_ns = max(0, min(SPIN_NS, self._oversleep_ns + over_ns // OVERSLEEP_FRAMES))
        if woken_ns < due_ns:
            self._path.drain(woken_ns, 0, due_ns)
            early_ns = clock() - woken_ns
        while (now_ns := clock()) < due_ns:
            pass
        return now_ns, early_ns

    def _wake(self, now_ns: int) -> None:
        """Step rooms again that somebody has joined, and which nobody holds yet."""
        for room in self.core.woken:
            each = self._asleep.pop(room, None)
            if each is not None:
                each.count_passed(self.core, now_ns)
                self._awake.append(each)
        self.core.woken.clear()

    @property
    def awake(self) -> Sequence[Room]:
        """Rooms that are stepped: all but those where nobody is; all before it runs."""
        return [each.room for each in self._awake] if self.pacers else self.core.rooms

    def count_deserted(self, now_ns: int, room: str = "", *, steps: bool = True) -> None:
        """Bring the ticks of this deserted room, or of all of them, up to date, and their steps."""
        for each in self._asleep.values():
            if room not in ("", each.room.called):
                continue
            if steps and each.room.is_open:
                each.count_passed(self.core, now_ns)
            else:
                each.pass_by(now_ns)

    def _report(self) -> None:
        """Report events; of those that unauthenticated peers can cause a bounded number, then the count of the others."""
        now_ns = time.monotonic_ns()
        for events in (self.channel.events, self.core.events, self.events):
            while events:
                event = events.popleft()
                if event.event == "marker" and self.marked is not None:
                    self.marked(event.text)
                if event.event not in UNAUTHENTICATED_EVENTS or self._may_say(event.event, now_ns):
                    self.say(event)
                else:
                    self._withheld[event.event] += 1
        for kind in list(self._withheld):
            if self._may_say(kind, now_ns):
                text = f"{self._withheld.pop(kind)} more of this kind ({kind}) were not said one by one"
                self.say(ServerEvent(kind, text))

    def _may_say(self, kind: str, now_ns: int) -> bool:
        return self._event_budget.take(UNAUTHENTICATED_EVENTS.index(kind), now_ns)

    @property
    def hands_over(self) -> bool:
        """Return whether the seats are the next server's: this one was stopped to be started anew."""
        return self.hand_over_s is not None and HANDS_OVER_AT in self.stop.reason

    def _announce_restart(self, wait_s: float) -> None:
        """Tell everybody to hold off and come back, and answer nobody any more: a hello is for the next server."""
        for _ in range(RESTARTS_TOLD):
            self.core.handle(inputs.Restart(round(1000 * wait_s)), time.monotonic_ns())
            self._path.send()
            self._path.flush()
            time.sleep(TOLD_EVERY_S)
        self._report()

    def _farewell(self) -> None:
        if self.hands_over and self.hand_over_s is not None:
            self._announce_restart(self.hand_over_s)
            return
        why = f": {self._misfit}; join anew" if self._misfit else ""
        self.core.handle(inputs.Stop(f"the server was {self.stop.reason}{why}"), time.monotonic_ns())
        self._path.send()
        until_ns = time.monotonic_ns() + LINGER_NS
        while (now_ns := time.monotonic_ns()) < until_ns and self.core.awaits_accounts:
            self._path.drain(now_ns)
            self._path.send()
            time.sleep(0.002)
        for address in self.core.addresses:
            self.channel.close(address)
        self._path.flush()
        self._report()


def ticket_hash(ticket: str) -> str:
    """Return what is kept of a session ticket; it resumes no session."""
    return hashlib.sha256(ticket.encode()).hexdigest()[:32]
