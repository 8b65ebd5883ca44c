"""An encrypted server with two people, under a flood from a thousand addresses: a real server, real people, real sockets.

How punctual it stays is `dev.py bench network --flood`'s to say; here stands what is not a question of time.
"""

import os
import re
import signal
import sys
import time
from pathlib import Path

import msgspec
import pytest

from cogrip.cli.settings.settings_file import load
from cogrip.protocol.io.dtls_client import DtlsClient
from cogrip.protocol.settings.room import seat_settings
from cogrip.protocol.wire.join_link import parse_link
from cogrip.protocol.wire.session import make_hello
from cogrip.server.rate_limit import LIMITS

from tests.bench.loads.flood import MIX, Flood, Job, samples_of
from tests.bench.loads.people import Load, Person
from tests.live.held_arms import DEMO, Spoken, fairly

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="loopback has one address elsewhere, and no thousand")

HOST = "127.0.0.1"
FLOOD_S = 1.5
MOST_GROWTH_BYTES = 8 * 2**20  # of the server, while some 30,000 datagrams of strangers come
OURS = 16  # first contacts of those who belong here
ANSWERED = {"refused: not encrypted", "cookie sent"}  # of what was dropped


def resident_bytes(process: Spoken) -> int:
    return int(Path(f"/proc/{process.popen.pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def lost_by_the_machine(port: int) -> int:
    """Return the datagrams for a port that came while the buffer of its socket was full."""
    rows = [line.split() for line in Path("/proc/net/udp").read_text().splitlines()[1:]]
    return sum(int(row[-1]) for row in rows if int(row[1].rpartition(":")[2], 16) == port)


def overheard(port: int, fingerprint: str, token: str) -> list[bytes]:
    """Encrypted datagrams of somebody who held the cube for a moment, and left."""

    hello = make_hello(
        software="test", nonce=1, room="demo", name="anna", digest="", device="sim:light", axes=1, rate_hz=1024.0,
        force_n=10.0, speed_mps=2.0, token=token,
    )  # fmt: skip
    person = Person("anna", hello, (HOST, port), DtlsClient(fingerprint))
    someone = Load([person], seat_settings(load(DEMO), 0))
    heard: list[bytes] = []
    try:
        someone.join()
        someone.run(0.3, lambda now_ns: heard.append(person.last))
        someone.leave()
    finally:
        someone.close()
    return heard


@pytest.mark.long
@fairly
def test_nobody_loses_a_seat_in_a_flood_and_all_of_it_is_counted(start, tmp_path):
    server = start(
        "serve", DEMO, "--encrypted", "--port", "0", "--state", tmp_path / "state", "--seconds", "600", "--no-report",
        "--set", "link.delay_ms=0", "--runs", tmp_path / "server",
    )  # fmt: skip
    server.hear("listening on")
    link = parse_link(re.search(r"as player: .*'(cogrip:\S+)'", server.said)[1])
    records = overheard(link.port, link.fingerprint, link.token)
    people = [
        start("join", link.text, "--name", name, "--no-report", "--runs", tmp_path / name) for name in ("anna", "ben")
    ]
    for person, name in zip(people, ("anna", "ben"), strict=True):
        person.hear(f"{name} holds cube")
    mixed = samples_of((HOST, link.port), link.fingerprint, records)[MIX]
    before, begun_s, contacts = resident_bytes(server), time.monotonic(), LIMITS.contacts
    flood = Flood(Job(HOST, link.port, FLOOD_S, mixed))
    try:
        done = flood.end()
    finally:
        flood.kill()
    growth = resident_bytes(server) - before
    print(
        f"{done.per_second:.0f} datagrams/s from {done.addresses} addresses; the server grew by {growth / 1024:.0f} KiB"
    )
    for person in people:
        assert person.popen.poll() is None, person.said
        person.popen.send_signal(signal.SIGINT)
    for person in people:
        assert person.end() == 0, person.said
    lost = lost_by_the_machine(link.port)
    server.popen.send_signal(signal.SIGTERM)
    assert server.end() == 0, server.said
    took_s = time.monotonic() - begun_s
    for process in (server, *people):
        assert "Traceback" not in process.said

    assert done.sent > 2 * done.addresses, "each of them more than once, however slow this machine is"
    assert growth < MOST_GROWTH_BYTES
    assert "silent for too long" not in server.said
    dropped = summary(tmp_path / "server")["server"]["dropped"]
    print(dropped, f"{lost} lost on a machine that let the server wait")
    assert {"unauthenticated", "contact budget", "too large", *ANSWERED} <= dropped.keys()
    assert sum(dropped.values()) + lost >= done.sent, "each of them is somewhere"
    answered = sum(dropped[reason] for reason in ANSWERED)
    peers = 2 * (contacts.burst + contacts.per_second * took_s)  # of the new, and of those who come again
    assert answered <= peers + OURS, "hardly any is worth an answer"
    assert "seat timed out" not in dropped


def summary(runs: Path) -> dict:
    (path,) = runs.glob("*/summary.json")
    return msgspec.json.decode(path.read_bytes())
