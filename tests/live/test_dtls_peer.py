"""An independent DTLS 1.2 peer at a real encrypted server: it takes a seat, holds, resumes; and attacks two thousand times."""

import re
import signal
import sys
from pathlib import Path

import msgspec
import pytest

from cogrip.cli.settings.settings_file import load
from cogrip.protocol.settings.room import seat_settings
from cogrip.protocol.wire.join_link import JoinLink, parse_link
from cogrip.protocol.wire.session import make_hello

from tests.bench.loads.people import Load, Person
from tests.dtls_peer.attack import attack
from tests.dtls_peer.client import DtlsPeer
from tests.extent import long
from tests.live.held_arms import DEMO, Spoken, fairly

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="many addresses on loopback, memory from /proc")

HOST = "127.0.0.1"
PER_S = 95.0  # the budget of all that are new is 100 a second
KINDS = ("encrypted fragments", "encrypted before Finished", "one before Finished", "plaintext fragments")
MOST_GROWTH_MB = 40.0


@pytest.fixture
def encrypted(request, start, tmp_path) -> tuple[Spoken, JoinLink]:
    other = tmp_path / "other.toml"
    other.write_text(DEMO.read_text("utf-8").replace('name = "demo"', 'name = "other"'), "utf-8")
    workers = getattr(request, "param", 1)
    rooms = [DEMO, *([other] if workers > 1 else [])]
    server = start(
        "serve", *rooms, "--workers", workers,
        "--encrypted", "--port", "0", "--state", tmp_path / "state", "--seconds", "600", "--no-report",
        "--set", "link.delay_ms=0", "--runs", tmp_path / "server",
    )  # fmt: skip
    server.hear("listening on")
    return server, link_of(server, "player")


def link_of(server: Spoken, role: str) -> JoinLink:
    return parse_link(re.search(rf"as {role}: .*'(cogrip:\S+)'", server.said)[1])


def person(link: JoinLink, name: str, nonce: int, ticket: str = "") -> Person:
    hello = make_hello(
        software="test", nonce=nonce, room="demo", name=name, digest="", device="sim:light", axes=1, rate_hz=1024.0,
        force_n=10.0, speed_mps=2.0, token=link.token,
    )  # fmt: skip
    hello = msgspec.structs.replace(hello, ticket=ticket)
    return Person(name, hello, (HOST, link.port), DtlsPeer(link.fingerprint))


def joined(someone: Person) -> Load:
    held = Load([someone], seat_settings(load(DEMO), 0))
    held.join()
    return held


def account(runs: Path) -> dict:
    path = next(
        iter([*runs.glob("*/summary.json"), *runs.glob("*/demo/summary.json")])
    )  # of one process, or of workers
    return msgspec.json.decode(path.read_bytes())


@pytest.mark.parametrize("encrypted", [1, 2], indirect=True)
@fairly
def test_it_takes_a_seat_holds_and_comes_back_by_its_ticket(start, encrypted, tmp_path):
    server, link = encrypted
    anna = person(link, "anna", 1)
    held = joined(anna)
    try:
        held.run(1.0)
        server.hear("anna joined")
        assert held.tally().received > held.tally().sent / 2 > 0, "however slow this machine is"
        ticket, session = anna.session.welcome.ticket, anna.session.welcome.session
        again = person(link, "anna", 2, ticket)  # from another port, with another handshake
        held_again = joined(again)
        server.hear("anna resumed from")
        assert again.session.welcome.session == session
        held_again.run(0.5)
        assert held_again.tally().received > held_again.tally().sent / 2 > 0
        server.rewind()
        thief = person(link_of(server, "observer"), "anna", 3, ticket)
        joined(thief).close()
        assert thief.session.welcome.role == "observer", "a player's ticket makes no player of an observer"
        server.hear("observes from")
        held_again.run(0.5)
        held_again.leave()
        server.hear("anna left")
    finally:
        held.close()
    server.popen.send_signal(signal.SIGTERM)
    assert server.end() == 0, server.said
    dropped = account(tmp_path / "server")["server"]["dropped"]
    assert not {"malformed", "seat timed out"} & dropped.keys(), dropped


@pytest.mark.long
@fairly
@pytest.mark.parametrize("handshakes", [500, long(2000)])
def test_handshakes_without_a_token_take_no_memory_and_no_seat(start, encrypted, tmp_path, handshakes):
    server, link = encrypted
    anna = start("join", link.text, "--name", "anna", "--no-report", "--runs", tmp_path / "anna")
    anna.hear("anna holds cube")
    before_mb = memory_mb(server, "VmRSS")
    reached = {kind: attack(link.port, kind, handshakes // len(KINDS), PER_S) for kind in KINDS}
    peak_mb, after_mb = memory_mb(server, "VmHWM"), memory_mb(server, "VmRSS")
    assert anna.popen.poll() is None, anna.said
    anna.popen.send_signal(signal.SIGINT)
    assert anna.end() == 0, anna.said
    server.popen.send_signal(signal.SIGTERM)
    assert server.end() == 0, server.said
    summary = account(tmp_path / "server")["server"]
    skipped = summary["ticks"]["due"] - summary["ticks"]["run"]
    print(f"{reached}: {before_mb:.0f} MB, at most {peak_mb:.0f}, then {after_mb:.0f}; {skipped} ticks skipped")
    print(summary["dropped"])

    assert sum(reached.values()) > handshakes / 2, "however slow this machine is"
    assert peak_mb - before_mb < MOST_GROWTH_MB
    assert "Traceback" not in server.said
    assert "seat timed out" not in summary["dropped"]
    names = {"handshake after its end", "handshake message too long", "too many without a seat"}
    assert names <= summary["dropped"].keys()


def memory_mb(process: Spoken, name: str) -> float:
    """VmRSS: resident now; VmHWM: the most that it has been."""
    words = Path(f"/proc/{process.popen.pid}/status").read_text()
    return int(re.search(rf"{name}:\s+(\d+) kB", words)[1]) / 1000.0
