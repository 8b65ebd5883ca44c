"""A client that lies as it leaves: what it says neither reaches the operator's terminal raw nor decides the verdict."""

import json
import signal
import socket
import time
from contextlib import suppress
from pathlib import Path

import pytest

from cogrip.machine.tick_count import Percentiles, TickCount
from cogrip.protocol.wire.accounts import LEFT, SATURATED, ClientAccount, DeviceAccount, LinkCount
from cogrip.protocol.wire.messages import Leave, encode
from cogrip.protocol.wire.session import ClientSession, make_hello

from tests.fair_time import FairTime

DEMO = Path(__file__).resolve().parents[2] / "configs" / "demo.toml"
ESCAPES = "\x1b]0;mine\x07\x1b[2J\x9b31m\u202e\r\nPassive: all is well\u2028"
RAW = [each for each in ESCAPES if not each.isprintable() and each != "\n"]
LIMIT_S = 60.0


def lie(**changed: object) -> ClientAccount:
    told: dict[str, object] = {
        "position_m": (0.0,), "force_n": (0.0,), "peak_force_n": 0.0, "travel_m": 0.0, "felt_stiffness_npm": None,
        "predicted_stiffness_npm": None, "down_margin_j": -5.0, "device_leak_j": 0.0, "down": LinkCount(),
        "rtt_ms": Percentiles(), "ticks": TickCount(), "unstable": True, "incidents": LEFT + SATURATED,
        "state": f"fault{ESCAPES[:20]}",
        "reason": f"the server burns{ESCAPES}", "device": DeviceAccount(oscillates=True, margin_j=-9.0),
    }  # fmt: skip
    return ClientAccount(**{**told, **changed})  # type: ignore[arg-type]


def say_and_leave(port: int, reason: str, account: ClientAccount) -> None:
    """Take ben's seat and leave it with these words."""
    hello = make_hello(
        software="test", nonce=7, room="", name="ben", digest="", device=f"sim:{ESCAPES}"[:40], axes=3, rate_hz=1024.0
    )
    session = ClientSession(hello)
    with socket.socket(type=socket.SOCK_DGRAM) as end:
        end.connect(("127.0.0.1", port))
        end.settimeout(0.05)
        waited = FairTime()
        session.connect(time.monotonic_ns())
        while session.state != "closed" and waited.spent_s() < LIMIT_S:
            while session.outbox:
                end.send(session.outbox.popleft())
            with suppress(TimeoutError):
                session.receive(end.recv(2048), time.monotonic_ns())
            if session.state == "seated" and session.welcome is not None:
                end.send(encode(Leave(session.welcome.session, reason, account)))
            session.poll(time.monotonic_ns())
        assert session.farewell is not None, session.failed


@pytest.mark.parametrize("log", ["text", "json"])
def test_what_a_client_says_as_it_leaves_is_shown_clean_and_decides_nothing(serve, tmp_path, log) -> None:
    server, port = serve(DEMO, "--log", log, "--no-record")
    say_and_leave(port, f"bye{ESCAPES}", lie())
    server.hear("ben left")
    server.signal(signal.SIGINT)
    assert server.end() == 0, server.said
    said = server.said
    assert not [each for each in RAW if each in said]
    assert "\nPassive: all is well" not in said  # no line of its own
    summary = json.loads(next((tmp_path / "server").glob("*/summary.json")).read_text())
    assert (summary["passive"], summary["unstable"]) == (True, False)
    assert (summary["saturated"], summary["left"]) == (False, False)
    ben = summary["users"][1]
    assert ben["claimed"] == {"unstable": True, "saturated": True, "left": True, "down_margin_j": -5.0}
    assert not [each for each in (*RAW, "\n") if each in ben["reason"] + ben["state"]]
    assert "Not passive" not in said
    if log == "json":  # the words about the run are for people
        return
    assert (
        "Stable as far as this end measured, but clients say that they were not: the force of ben, the hand of ben."
        in " ".join(said.split())
    )
    assert "the client of ben says that its line down gave out 5 J too much" in " ".join(said.split())
