"""The client in C against what is hostile: mutated datagrams under AddressSanitizer and UBSan, servers that keep no rule."""

import re
import subprocess
import tomllib
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import Waves, decode

from tests.client.seated_client import next_waves
from tests.clients.compiled import CHECKED, SOURCES, build, needs_compiler
from tests.clients.test_c_sessions import PEAK_N, SLEW_N
from tests.clients.virtual_session import HZ, VirtualSession
from tests.extent import long
from tests.protocol.test_spec_vectors import VECTORS

pytestmark = needs_compiler

ALLOCATES = re.compile(r"alloc|^free$|strdup|^[sp]brk$|mmap|asprintf|^open|fopen|getline")


@pytest.fixture(scope="module")
def corpus(library: Any, built: Path) -> Path:
    """Return a file of what a server says in a session: welcome, waves and effects of two seconds, farewell, vectors."""
    settings = tomllib.loads((SOURCES.parents[1] / "configs" / "effects.toml").read_text(encoding="utf-8"))
    effects = [{**each, "start_s": 0.1 * number, "every_s": 0.0} for number, each in enumerate(settings["effects"])]
    assert {each["kind"] for each in effects} == {"viscous", "vibration", "texture", "magnet", "path", "zone"}
    session = VirtualSession(library, "anna", object={"axes": 3}, effects=effects)
    told: list[bytes] = []
    receive = session.person.receive

    def overhear(datagram: bytes, now_ns: int) -> None:
        told.append(datagram)
        receive(datagram, now_ns)

    session.person.receive = overhear  # type: ignore[method-assign]
    session.leave(2.0)
    told += [datagram for datagram, _ in VECTORS.values()]
    path = built / "corpus"
    path.write_bytes(b"".join(len(each).to_bytes(2, "little") + each for each in told))
    return path


@pytest.mark.parametrize("count", [20_000, long(5_000_000)])
def test_mutated_datagrams_misuse_no_memory_and_break_no_limit(built: Path, corpus: Path, count: int) -> None:
    program = build(built, "fuzz", *CHECKED, "-DCOGRIP_NO_DRIVER", "fuzz.c", "cogrip.c")
    limit_s = 60 if count <= 100_000 else 1800
    done = subprocess.run(
        [program, corpus, str(count), "20"], capture_output=True, text=True, timeout=limit_s, check=False
    )
    assert done.returncode == 0, done.stderr[-3000:]
    found = re.fullmatch(r"(\d+) mutated, (\d+) malformed, (\d+) frames taken, (\d+) effects late\n", done.stdout)
    assert found
    mutated, malformed, frames, late = map(int, found.groups())
    assert mutated == count
    assert 0.2 < malformed / mutated < 0.95  # many are read: the mutants get past the decoder
    assert frames > count / 100
    assert late > 0  # so effects were taken in


def test_the_core_calls_nothing_that_allocates(library: Any) -> None:
    """All that it needs from outside, by its object file."""
    listed = subprocess.run(["nm", "-uD", library._name], capture_output=True, text=True, check=True)
    needed = {line.split()[-1].partition("@")[0] for line in listed.stdout.splitlines()}
    assert {"memcpy", "sqrt"} & needed
    assert not [name for name in needed if ALLOCATES.search(name)], needed


class HostileServer:
    """A server that keeps no rule, behind a session that began well: `tick` is one of the client, told this wave each frame."""

    def __init__(self, library: Any) -> None:
        self.session = VirtualSession(library, "anna")
        self.session.run(0.5)
        self.person, self._line = self.session.person, LineSender(1, 8)
        self.number = self.session.messages(Waves)[-1].session
        self.place = self.session.hands[0].position_m[0]
        self.forces: list[float] = []
        self.sent: list[bytes] = []

    def waves(self, wave: float, session: int = 0) -> bytes:
        message = next_waves(self._line, wave, session=session or self.number, sent_ns=self.session.now_ns)
        return messages.encode(replace(message, first=message.first + 70, acknowledged=2**53))

    def tick(self, wave: float) -> None:
        now_ns = self.session.now_ns
        if self.session.tick % 8 == 0:
            self.person.receive(self.waves(wave), now_ns)
        self.person.sense(self.session.tick, (self.place,), now_ns)
        self.forces.append(self.person.act(now_ns)[0])
        self.sent += [datagram for datagram, _ in self.person.sent()]
        self.session.tick += 1


@pytest.mark.parametrize("frames", [1, 4, 10_000])
def test_a_hostile_server_gets_no_force_beyond_the_limits(library: Any, frames: int) -> None:
    """Waves at the wire's bounds that turn after so many frames."""
    server = HostileServer(library)
    for tick in range(HZ):
        server.tick(1e4 if (tick // 8 // frames) % 2 else -1e4)
    largest_n = max(map(abs, server.forces))
    assert largest_n <= PEAK_N * (1.0 + 1e-12)
    assert max(abs(after - before) for before, after in pairwise(server.forces)) <= SLEW_N
    assert largest_n == pytest.approx(PEAK_N) or frames == 1
    if frames > 100:
        assert ("sat at its limit" in server.person.reason, server.forces[-1]) == (True, 0.0)
    assert server.person.counts["wave beyond what the device can bring about"] > 0
    sent = [abs(wave) for message in map(decode, server.sent) if isinstance(message, Waves) for wave in message.waves]
    assert max(sent) < 20.0  # bounded by (b V + 2 F) / sqrt(2b) = 8.9


@pytest.mark.parametrize(
    ("balance_j", "force_n"),
    [(0.0, 8.0), (-0.1 + 8.0 * 3.0 / HZ, 8.0), (-0.1 + 1.0 * 3.0 / HZ, 1.0), (-0.1, 0.0), (-0.2, 0.0)],
)
def test_the_port_pays_for_no_force_that_its_balance_does_not_hold(
    library: Any, balance_j: float, force_n: float
) -> None:
    """docs/device_port.md: |F| <= what is left / (3 ticks at the speed limit), whichever its sign."""
    for sign in (1.0, -1.0):
        assert library.probe_port_limit(sign * 8.0, balance_j) == pytest.approx(sign * force_n, abs=1e-12)


def test_a_message_of_another_session_is_counted_and_changes_nothing(library: Any) -> None:
    server = HostileServer(library)
    before = server.person.status.down.received
    server.person.receive(server.waves(0.5, server.number + 1), server.session.now_ns)
    assert server.person.counts == {"other session": 1}
    assert server.person.status.down.received == before
