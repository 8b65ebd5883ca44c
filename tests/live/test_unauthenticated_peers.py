"""Unauthenticated peers at an encrypted server, and people who lose it and resume: real processes, real sockets, real kills.

Each refusal is read on both sides. The encrypted server is shared by the tests of this file; a test leaves all seats free.
"""

import re
import secrets
import select
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path

import msgspec
import numpy as np
import pytest

from cogrip.protocol.recording.reader import RecordingError, open_recording
from cogrip.protocol.wire.join_link import JoinLink, parse_link
from cogrip.protocol.wire.messages import HELLO_BYTES
from cogrip.results.reading.records import End
from cogrip.results.replay.verify import verify
from cogrip.server.checkpoint import RoomCheckpoint, decode
from cogrip.server.io import checkpoint_file
from cogrip.server.io.state_folder import find_folder
from cogrip.server.io.token_file import TokenFile, draw_token
from cogrip.server.recorder import step_topic

from tests.free_ports import free_port
from tests.live.held_arms import DEMO, LIMIT_S, Spoken, fairly, until

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads what Linux says of addresses and processes")

HOST = "127.0.0.1"
PULL = ("--device", "sim:phantom?hand=reach&amplitude_m=0.01")
MOST_STEP_N = 0.5
FRAME_TICKS = 8
SILENT_TICKS = 256  # a server is missed after less
MOST_STEP_M = 1e-3  # of the object, in one frame
HOSTILE_OBSERVER = """
import sys
from cogrip.client.observer import ObserverCore
from cogrip.protocol.wire.messages import Stamp, Waves, encode
whole = ObserverCore.receive
def receive(self, datagram, now_ns):
    whole(self, datagram, now_ns)
    if self.views == 1:
        session = self.session.welcome.session
        self.outbox.append(encode(Waves(
            session, 0, (9.0,), (0.0,), (0.0,), 1.0, 1.0, 0, Stamp(now_ns), (0.0, 0.0),
        )))
ObserverCore.receive = receive
from cogrip.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


class Server:
    """A `cogrip serve` with a state folder, on a port of its own that it keeps when it is started again."""

    def __init__(self, base: Path, *arguments: str) -> None:
        self.base, self._arguments = base, arguments
        self.state = base / "state"
        self.starts = 0
        self.port = free_port()
        self.start()

    def start(self) -> None:
        self.starts += 1
        self.runs = self.base / f"server{self.starts}"
        self.process = Spoken(
            "serve", str(DEMO), "--port", str(self.port), "--state", str(self.state), "--seconds", "900", "--no-report",
            "--set", "link.delay_ms=0", "--runs", str(self.runs), *self._arguments,
        )  # fmt: skip
        self.process.hear("listening on")

    @property
    def said(self) -> str:
        return self.process.said

    def link(self, role: str) -> JoinLink:
        """The one that it printed."""
        found = re.search(rf"as {role}: .*'(cogrip:\S+)'", self.said)
        assert found, self.said
        return parse_link(found[1])

    def new_link(self, age_s: float = 0.0, **terms: object) -> tuple[JoinLink, str]:
        """A link with a token of these terms, that was made some time ago; and the token's id."""
        token, now_s = draw_token(), time.time() - age_s
        made = TokenFile(find_folder(self.state)).change(lambda book: book.new(token, now_s, **terms))
        return msgspec.structs.replace(self.link("player"), token=token), made.id

    def revoke_in_file(self, ident: str) -> None:
        TokenFile(find_folder(self.state)).change(lambda book: (book.revoke(ident, time.time()), None))

    def account(self) -> dict:
        """Return the summary that it left."""
        (path,) = self.runs.glob("*/summary.json")
        return msgspec.json.decode(path.read_bytes())


@pytest.fixture(scope="module")
def encrypted(tmp_path_factory) -> Iterator[Server]:
    server = Server(tmp_path_factory.mktemp("encrypted"), "--encrypted")
    yield server
    server.process.stop()


@pytest.fixture
def unencrypted(tmp_path) -> Iterator[Server]:
    server = Server(tmp_path / "unencrypted")
    yield server
    server.process.stop()


@pytest.fixture
def join(start, tmp_path) -> Callable[..., Spoken]:
    """Start `cogrip join WHERE ARGUMENTS`; whoever still runs at the end of the test is ended."""

    def someone(where: JoinLink | str, *arguments: str, code: str = "") -> Spoken:
        text = where.text if isinstance(where, JoinLink) else where
        runs = tmp_path / secrets.token_hex(4)
        person = start("join", text, "--no-report", "--runs", runs, *arguments, code=code)
        person.runs = runs
        return person

    return someone


def recording_of(person: Spoken) -> End:
    (path,) = person.runs.glob("*/client-*.mcap")
    return End(open_recording(path))


def largest_step_n(end: End, since_tick: int = 0) -> float:
    """Return the largest change of the force from one tick to the next; pairs between which ticks were skipped do not count.

    A loop that was away for a frame leaves a gap in its waves, which is none of what is looked for: then the test is skipped.
    """
    columns = end.columns("tick", "tick", "force_n")
    ticks, forces_n = (columns[name][columns["tick"] >= since_tick] for name in ("tick", "force_n"))
    if np.max(np.diff(ticks)) > FRAME_TICKS:
        pytest.skip(f"this machine took the processor away from a loop for {np.max(np.diff(ticks))} ticks")
    steps = np.linalg.norm(np.diff(forces_n, axis=0), axis=1)
    return float(np.max(steps[np.diff(ticks) == 1]))


def before_silence(end: End) -> int:
    """Return a tick shortly before the server was missed."""
    return next(tick.tick for _, tick in end.records("tick") if tick.state != "live") - SILENT_TICKS


@pytest.mark.long
@fairly
def test_whoever_does_not_belong_is_refused_with_the_reason_on_both_sides(start, encrypted, unencrypted, join):
    once, _ = encrypted.new_link(once=True, role="player", user="anna")
    anna = join(once, *PULL)
    anna.hear("anna holds cube")
    revoked, ident = encrypted.new_link(role="player")
    encrypted.revoke_in_file(ident)
    expired, _ = encrypted.new_link(100.0, role="player", expires=int(time.time()) - 50)
    bound, _ = encrypted.new_link(role="player", device="hid:woodenhaptics")
    link = encrypted.link("player")
    fingerprint = link.fingerprint[::-1]
    token = msgspec.structs.replace(link, token=draw_token())
    other = msgspec.structs.replace(link, fingerprint=fingerprint)
    cases = [  # what is asked, what both say, the code that the server prints and the person reads
        (join(token), "this token is unknown here", "token"),
        (join(once), "this token was used already: it is good for one time", "token"),
        (join(revoked), "this token was revoked", "token"),
        (join(expired), "this token has expired", "token"),
        (join(bound), "this token is for hid:woodenhaptics, and sim:phantom", "device"),
        (join(link, "--name", "anna"), "the seat of 'anna' is taken", "taken"),
        (join(link, "--name", "zoe"), "no seat is kept for 'zoe'", "name"),
        (join(msgspec.structs.replace(link, room="attic")), "this token is for room 'demo', not 'attic'", "room"),
    ]
    no_dtls = join(f"{HOST}:{encrypted.port}")
    wrong_server = join(other)
    to_unencrypted = join(msgspec.structs.replace(link, port=unencrypted.port))
    for person, words, code in cases:
        assert person.end() == 1, person.said
        assert words in person.said
        assert f"[{code}]" in person.said
        assert "Traceback" not in person.said
        assert not person.runs.exists(), "nothing was run, nothing is left"
        encrypted.process.hear("refused")  # one of them
        assert words in encrypted.said
        assert f"[{code}]" in encrypted.said
    assert no_dtls.end() == 1
    assert "this server is encrypted (DTLS): join by a link" in no_dtls.said
    assert "its hello was not encrypted" in encrypted.said
    assert wrong_server.end() == 1
    assert f"fingerprint {link.fingerprint[:16]}…, the link names {fingerprint[:16]}…" in wrong_server.said
    assert "the other end does not trust this certificate" in encrypted.said
    assert anna.popen.poll() is None, "she holds on through all of it"
    anna.popen.send_signal(signal.SIGINT)
    assert anna.end() == 0, anna.said
    assert to_unencrypted.end() == 1
    assert "no encrypted server answered" in to_unencrypted.said
    for secret in (token.token, once.token, revoked.token, expired.token, bound.token, link.token):
        assert secret not in encrypted.said.replace(link.text, "")


@fairly
def test_people_are_kicked_and_an_observer_who_pushes_is_too(start, encrypted, join):
    token, ident = encrypted.new_link(role="player", user="ben")
    watch, watch_ident = encrypted.new_link(role="observer")
    anna = join(encrypted.link("player"), "--name", "anna", *PULL)
    ben = join(token, *PULL)
    watcher = join(watch, "--observe")
    hostile = join(encrypted.link("observer"), "--observe", code=HOSTILE_OBSERVER)
    anna.hear("anna holds cube")
    ben.hear("ben holds cube")
    watcher.hear("object at")

    assert hostile.end() == 1, hostile.said
    assert "an observer may not send waves: they were not applied" in hostile.said
    encrypted.process.hear("was kicked: an observer may not send waves")

    words = f"the lamp goes on {secrets.token_hex(4)}"  # what a try before this one marked is told to newcomers
    mark = start("mark", words, "--state", str(encrypted.state))
    assert mark.end() == 0, mark.said
    assert f"marked in 1 room: {words}" in mark.said
    encrypted.process.hear(f"demo: marker: {words}")

    kick = start("kick", "anna", "--state", str(encrypted.state), "--reason", "enough")
    assert kick.end() == 0, kick.said
    assert anna.end() == 1
    assert "kicked by the administrator: enough" in anna.said
    encrypted.process.hear("demo: anna was kicked by the administrator: enough")

    revoke = start("token", "revoke", ident, "--state", str(encrypted.state))
    assert revoke.end() == 0, revoke.said
    assert ben.end() == 1
    assert "kicked: the token was revoked" in ben.said
    encrypted.process.hear("demo: ben was kicked: the token was revoked")

    encrypted.revoke_in_file(watch_ident)
    encrypted.process.popen.send_signal(signal.SIGHUP)
    assert watcher.end() == 1
    assert "kicked: the token was revoked" in watcher.said
    encrypted.process.hear("was kicked: the token was revoked")
    for person in (anna, ben):
        recording = recording_of(person)
        assert largest_step_n(recording) < MOST_STEP_N
        texts = [timed.record.text for timed in recording.records("event")]
        assert texts.count(f"marker: {words}") == 1


@fairly
def test_an_observers_link_is_all_that_an_observer_types(start, encrypted, join):
    watcher = join(encrypted.link("observer"))
    watcher.hear("object at")
    watcher.popen.send_signal(signal.SIGINT)
    assert watcher.end() == 0, watcher.said
    encrypted.process.hear("observes from")


@fairly
def test_after_a_kill_under_load_all_resume_and_nothing_jumps(start, encrypted, join):
    link = encrypted.link("player")
    people = [join(link, "--name", name, *PULL) for name in ("anna", "ben")]
    for person, name in zip(people, ("anna", "ben"), strict=True):
        person.hear(f"{name} holds cube")
    path = encrypted.state / "checkpoint-demo.bin"
    until(lambda: path.exists() and all(seat.ticket for seat in checkpoint(path).seats), "both seats are kept")
    travel_m = checkpoint(path).travel_m
    until(lambda: checkpoint(path).travel_m > travel_m + 0.005, "the object moves, and is kept")
    encrypted.process.stop()
    kept = checkpoint(path)
    encrypted.start()
    assert encrypted.link("player") == link, "a restart prints the same links"
    assert "demo: restored: the object is at" in encrypted.said
    for person in people:
        person.hear(r"resumed after ([\d.]+) s")
    for name in ("anna", "ben"):
        assert f"demo: {name} resumed from" in encrypted.said or encrypted.process.hear(f"demo: {name} resumed from")
    for person in people:
        person.hear("force ramps in")
        person.popen.send_signal(signal.SIGINT)
    for person in people:
        assert person.end() == 0, person.said
    first = first_step(encrypted)
    assert np.linalg.norm(np.subtract(first.object_m, kept.position_m)) < MOST_STEP_M * first.frames
    for person in people:
        end = recording_of(person)
        assert largest_step_n(end, before_silence(end)) < MOST_STEP_N
        assert verify(end.recording).exact


def checkpoint(path: Path) -> RoomCheckpoint:
    return decode(checkpoint_file.read(path) or b"")


def first_step(server: Server):
    """Return the first recorded step of room demo since the last start, once its writer has written it."""
    (path,) = server.runs.glob("*/server.mcap")
    found = []

    def written() -> bool:
        with suppress(RecordingError):
            found[:] = islice(End(open_recording(path)).records(step_topic("demo")), 1)
        return bool(found)

    until(written, "the recording has a step")
    return found[0].record


class Relay:
    """Carries datagrams between people and a server as a NAT does; `rebind` gives everyone another port."""

    def __init__(self, server: int) -> None:
        self._server = (HOST, server)
        self._near = self._bound()
        self.port = self._near.getsockname()[1]
        self._far: dict[tuple[str, int], socket.socket] = {}
        self._wake, self._woken = socket.socketpair()
        self._rebind = self._end = False
        self.rebound = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    @staticmethod
    def _bound() -> socket.socket:
        end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        end.bind((HOST, 0))
        return end

    def _run(self) -> None:
        while not self._end:
            if self._rebind:
                for far in self._far.values():
                    far.close()
                self._far.clear()
                self._rebind = False
                self.rebound.set()
            owners = {far: person for person, far in self._far.items()}
            for ready in select.select([self._near, self._woken, *owners], [], [])[0]:
                if ready is self._woken:
                    ready.recv(16)
                elif ready is self._near:
                    datagram, person = ready.recvfrom(HELLO_BYTES * 2)
                    far = self._far.get(person)
                    if far is None:
                        far = self._far[person] = self._bound()
                    far.sendto(datagram, self._server)
                else:
                    self._near.sendto(ready.recv(HELLO_BYTES * 2), owners[ready])

    def rebind(self) -> None:
        self._rebind = True
        self._wake.send(b"!")
        assert self.rebound.wait(LIMIT_S)

    def close(self) -> None:
        self._end = True
        self._wake.send(b"!")
        self._thread.join()
        for end in (self._near, self._wake, self._woken, *self._far.values()):
            end.close()


@fairly
def test_another_port_resumes_the_seat_and_a_stop_is_told(start, encrypted, join):
    relay = Relay(encrypted.port)
    try:
        link = msgspec.structs.replace(encrypted.link("player"), port=relay.port)
        anna = join(link, "--name", "anna", *PULL)
        anna.hear("anna holds cube")
        relay.rebind()
        anna.hear("the server is silent: trying to resume")
        anna.hear(r"resumed after ([\d.]+) s")
        encrypted.process.hear("demo: anna resumed from")
        anna.hear("force ramps in")
        encrypted.process.popen.send_signal(signal.SIGTERM)
        assert encrypted.process.end() == 0, encrypted.said
        assert anna.end() == 1
    finally:
        relay.close()
    assert "anna has been silent for too long" not in encrypted.said, "it was the same seat"
    assert "resumed 1" in anna.said
    assert "line begun anew" not in anna.said
    assert "the session is over, no force is left: the server was stopped (SIGTERM)" in anna.said
    end = recording_of(anna)
    assert largest_step_n(end) < MOST_STEP_N
    assert verify(end.recording).exact
    dropped = encrypted.account()["server"]["dropped"]
    assert dropped["unauthenticated"] > 10, "what still came by the new port of the old association"
    assert not (encrypted.state / "checkpoint-demo.bin").exists(), "a stop is no crash: nobody resumes it"
