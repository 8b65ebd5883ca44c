"""A server under load, in a process of its own that says how it fares: `python -m tests.bench.loads.server_process JOB`.

It runs what `cogrip serve` runs: loop, channel, authenticator, housekeeping with its checkpoints, and, where a folder is
named, the recording. Or the bare echo it is compared with: the same socket, the same pace, and nothing else.
Each line on standard input asks for a Reading, which ends one span and begins the next; its end ends the process.
"""

import os
import secrets
import select
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Literal

import msgspec

from cogrip.machine.histogram import DurationHistogram
from cogrip.machine.pacing import Pacer
from cogrip.machine.realtime import engage, release
from cogrip.machine.receive_buffer import enlarge
from cogrip.machine.stop import Stop
from cogrip.protocol.io.dtls_client import DtlsClient
from cogrip.protocol.secure.channel import UnencryptedChannel
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.settings.sections import Settings
from cogrip.server.core import ServerCore
from cogrip.server.io.authenticator import TokenAuthenticator
from cogrip.server.io.dtls_channel import DtlsListener
from cogrip.server.io.housekeeping import Housekeeping
from cogrip.server.io.loop import LiveServer
from cogrip.server.io.state_folder import StateFolder, make_folder
from cogrip.server.io.token_file import TokenFile, draw_token
from cogrip.server.io.udp_port import ServerChannel
from cogrip.server.rate_limit import RateLimiter
from cogrip.server.unencrypted_channel import UnencryptedListener

from tests.bench import machine
from tests.bench.children import start_python
from tests.bench.loads.people import Echoed, Load, Person, make_people, room_name
from tests.bench.loads.process_memory import own_memory_in_use_kb, own_memory_kb
from tests.bench.loads.twin import start_twin, start_vrpn
from tests.bench.loads.vrpn_person import VrpnPerson

Kind = Literal["c", "vrpn", "echo", "unencrypted", "encrypted"]
BARE: dict[Kind, type[Person]] = {"c": Echoed, "vrpn": VrpnPerson, "echo": Echoed}  # without sessions
HOST = "127.0.0.1"
NETWORK_HZ = 128
MOST_BYTES = 2048
LOOK_EVERY_NS = 20_000_000
END_LIMIT_S = 20.0
SETTLE_S = 1.0
ASK_S = 0.1


class Job(msgspec.Struct, frozen=True):
    kind: Kind
    people: int
    per_room: int = 2
    axes: int = 3
    core: int | None = None  # the processor to stay on
    state: str = ""  # folder, of a server
    record_at: str = ""  # "" no recording
    vrpn: str = ""  # folder with the source of VRPN
    rooms: int = 0  # at least so many, of which the last have nobody in them


class Started(msgspec.Struct, frozen=True):
    port: int
    ports: tuple[int, ...] = ()  # one a room, where a room has one
    fingerprint: str = ""
    token: str = ""


class Reading(msgspec.Struct, frozen=True):
    """Lateness, work and ticks are those since the reading before; the others are since the start.

    used_kb: of the resident memory, without what the heap keeps free; of a server alone
    """

    time_ns: int
    cpu_ns: int
    memory_kb: int
    late_us: dict[str, float]
    work_us: dict[str, float]
    ticks: int
    skipped: int
    drops: dict[str, int] = {}
    seated: int = 0
    frames_lost: int = 0
    frames_late: int = 0
    used_kb: int = 0
    said: int = 0  # lines that a server would have printed
    trouble: tuple[str, ...] = ()


class Process:
    """The other end of this: start it, ask, and end it."""

    def __init__(self, job: Job) -> None:
        if job.kind == "c":
            self._child = start_twin(job.core)
        elif job.kind == "vrpn":
            self._child = start_vrpn(Path(job.vrpn), job.people, job.per_room, job.core)
        else:
            self._child = start_python("-m", "tests.bench.loads.server_process", msgspec.json.encode(job).decode())
        self.started = msgspec.json.decode(self._line(), type=Started)

    @property
    def pid(self) -> int:
        return self._child.pid

    def ask(self) -> None:
        """For a reading; `answer` gives it, a moment later."""
        assert self._child.stdin is not None
        self._child.stdin.write(b"\n")
        self._child.stdin.flush()

    def answer(self) -> Reading:
        return msgspec.json.decode(self._line(), type=Reading)

    def _line(self) -> bytes:
        assert self._child.stdout is not None
        line = self._child.stdout.readline()
        if not line:
            raise RuntimeError(f"the server under load ended with code {self._child.wait()}")
        return line

    def end(self) -> None:
        for stream in (self._child.stdin, self._child.stdout):
            assert stream is not None
            with suppress(OSError):
                stream.close()
        try:
            self._child.wait(END_LIMIT_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()


def settings_of(job: Job) -> list[Settings]:
    """Rooms with a seat for everyone, and those where nobody will be."""
    rooms = []
    used = -(-job.people // job.per_room)
    for number in range(max(used, job.rooms)):
        seats = min(job.per_room, job.people - number * job.per_room) if number < used else job.per_room
        rooms.append(resolve({
            "name": room_name(number), "rates": {"network_hz": NETWORK_HZ}, "object": {"axes": job.axes},
            "playout": {"frames": 2}, "users": [{"name": f"p{seat}"} for seat in range(seats)],
            "admission": {"seats_per_token": max(1, job.people)},
        }))  # fmt: skip
    return rooms


def make_load(job: Job, server: Process) -> Load:
    """People for that server."""
    started = server.started
    people = make_people(
        job.people, job.per_room, [(HOST, port) for port in started.ports or (started.port,)],
        (lambda: DtlsClient(started.fingerprint)) if job.kind == "encrypted" else UnencryptedChannel,
        started.token, BARE.get(job.kind, Person),
    )  # fmt: skip
    return Load(people, seat_settings(settings_of(job)[0], 0))


def serve(job: Job) -> None:
    """A real server until standard input ends."""
    stop, said, trouble = Stop(), [0], list[str]()
    folder = make_folder(Path(job.state))

    def say(event: object) -> None:
        said[0] += 1
        if getattr(event, "event", "") == "trouble":
            trouble.append(str(event))

    authenticator = TokenAuthenticator(TokenFile(folder), say) if job.kind == "encrypted" else None
    server = LiveServer(settings_of(job), HOST, 0, stop, say, lambda core: _channel(core, job, folder))
    if authenticator is not None:
        server.authenticator = authenticator
    server.record_at = Path(job.record_at) if job.record_at else None
    _, port = server.listen()
    housekeeping = Housekeeping(server, say, folder=folder, authenticator=authenticator)

    reading_ns = 0  # processor time, of readings alone

    def read() -> Reading:
        nonlocal reading_ns
        lateness, work = DurationHistogram(), DurationHistogram()
        awake = server.awake or server.core.rooms[:1]  # all are asleep before people come
        pacers = [server.pacers[room.name] for room in awake]
        lateness.merge(pacers[0].lateness)  # all rooms begin with the same look at the clock
        work.merge(pacers[-1].work)
        for pacer in pacers:
            pacer.lateness.clear()
            pacer.work.clear()
        counts = [seat.port.count() for room in awake for seat in room.seats if seat.port]
        began_ns = time.process_time_ns()
        used_kb = own_memory_in_use_kb()
        reading_ns += time.process_time_ns() - began_ns
        return Reading(
            time.monotonic_ns(), time.process_time_ns() - reading_ns, own_memory_kb(), lateness.summary_us(), work.summary_us(),
            lateness.count, pacers[0].skipped, {**server.drops(), **server.losses()}, len(server.core.roster()),
            sum(count.lost for count in counts), sum(count.late for count in counts), used_kb, said[0], tuple(trouble),
        )  # fmt: skip

    asked = Asked(job, read, stop)
    server.chores.append(asked.look)
    started = Started(port)
    if isinstance(server.channel, DtlsListener):
        token = draw_token()
        TokenFile(folder).change(lambda book: book.new(token, time.time(), role="player"))
        started = Started(port, fingerprint=server.channel.fingerprint, token=token)
    _print(started)
    housekeeping.begin()
    try:
        server.run()
    finally:
        housekeeping.end(said_goodbye=True)


def _channel(core: ServerCore, job: Job, folder: StateFolder) -> ServerChannel:
    rate_limiter = RateLimiter(secrets.token_bytes(16))
    return (
        UnencryptedListener(rate_limiter, core.listens_to)
        if job.kind == "unencrypted"
        else DtlsListener(folder.path, rate_limiter, core.knows)
    )


class Asked:
    """A chore: answers when asked, and stays on its processor."""

    def __init__(self, job: Job, read: Callable[[], Reading], stop: Stop) -> None:
        self._core = job.core
        self._read = read
        self._stop = stop
        self._next_ns = 0

    def look(self, now_ns: int) -> None:
        if now_ns < self._next_ns:
            return
        if not self._next_ns and self._core is not None:
            machine.pin(0, {self._core})  # this thread alone: who records is another process, and may go elsewhere
        self._next_ns = now_ns + LOOK_EVERY_NS
        if select.select([sys.stdin], [], [], 0.0)[0]:
            if not os.read(sys.stdin.fileno(), 64):
                self._stop.reason = "the bench is over"
                return
            _print(self._read())


def echo(job: Job) -> None:
    """Every datagram goes back once a tick: what the socket and the pace alone cost."""
    stop = Stop()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        enlarge(end)
        end.bind((HOST, 0))
        end.setblocking(False)
        _print(Started(end.getsockname()[1]))
        measures = engage()
        pacer = Pacer(NETWORK_HZ, time.monotonic_ns())

        def read() -> Reading:
            late, work, ticks = pacer.lateness.summary_us(), pacer.work.summary_us(), pacer.lateness.count
            pacer.lateness.clear()
            pacer.work.clear()
            return Reading(
                time.monotonic_ns(), time.process_time_ns(), own_memory_kb(), late, work, ticks, pacer.skipped
            )  # fmt: skip

        asked = Asked(job, read, stop)
        receive, put = end.recvfrom, end.sendto
        while not stop.reason:
            pacer.wait()
            held = []
            try:
                while True:
                    held.append(receive(MOST_BYTES))
            except BlockingIOError:
                pass
            for datagram, address in held:
                put(datagram, address)
            pacer.done()
            asked.look(time.monotonic_ns())
        release(measures)


def _print(what: msgspec.Struct) -> None:
    sys.stdout.buffer.write(msgspec.json.encode(what) + b"\n")
    sys.stdout.buffer.flush()


def main() -> None:
    job = msgspec.json.decode(sys.argv[1], type=Job)
    (echo if job.kind == "echo" else serve)(job)
