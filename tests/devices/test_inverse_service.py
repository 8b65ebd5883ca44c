"""`cogrip devices emulate inverse` as a process of its own behind a real websocket: the driver of `inverse:` on it.

Nothing sleeps but the loop's own pacing: what is waited for is a line that is said, or an answer, with an end to every wait.
"""

import json
import re
import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import count
from math import hypot
from threading import Thread

import pytest
from websockets.http11 import Request
from websockets.server import ServerProtocol
from websockets.sync.client import connect

from cogrip.cli.devices.conform import TickClock
from cogrip.devices.conformance import CHECKS, DeviceSubject
from cogrip.devices.device import Device, DeviceError, Sample
from cogrip.devices.io.websocket_line import WebsocketLine
from cogrip.devices.registry import make

from tests.devices.held_device import RATE_HZ, opened
from tests.devices.test_pseudo_terminal import Emulator, Loop, emulating

PUSH = (0.4, 0.0, 0.0)


@pytest.fixture
def emulate() -> Iterator[Callable[..., Emulator]]:
    yield from emulating("", "inverse")


def held(emulate: Callable[..., Emulator]) -> tuple[Emulator, Device, Loop]:
    emulator = emulate("--hand", "hold")
    device = opened(f"inverse:{emulator.place}", axes=3)
    return emulator, device, Loop(device)


def test_another_program_s_websocket_gets_the_documented_messages(emulate: Callable[..., Emulator]) -> None:
    """By the package's own client, as Haply's example does it: an inventory first, then one state update a message."""
    place = emulate("--hand", "hold").place
    with connect(f"ws://{place}") as service:
        first = json.loads(service.recv(10.0))
        (arm,) = first["inverse3"]
        assert {"config", "state", "status"} <= set(arm)
        for _ in range(3):
            command = {"set_cursor_force": {"vector": {"x": 0.0, "y": 0.0, "z": 0.0}}}
            service.send(json.dumps({"inverse3": [{"device_id": arm["device_id"], "commands": command}]}))
            (told,) = json.loads(service.recv(10.0))["inverse3"]
            assert "config" not in told
            assert set(told["state"]["cursor_position"]) == {"x", "y", "z"}
        with pytest.raises(TimeoutError):
            service.recv(0.05)


def test_a_driver_holds_it_at_1024_hz(emulate: Callable[..., Emulator]) -> None:
    emulator, device, loop = held(emulate)
    sample = loop.run(PUSH, 500)
    assert sample.position_m[0] < -0.5e-3  # a load moves the hand against x: 0.4 N on 300 N/m
    assert emulator.status()["force_n"] == pytest.approx([-0.4, 0.0, 0.0], abs=2e-3)
    emulator.ask("press", "pressed")
    while not sample.buttons:
        sample = loop.run(PUSH, 1)
    device.close()
    assert emulator.status()["force_n"] == [0.0] * 3
    emulator.tell("quit")
    assert emulator.end() == 0


@pytest.mark.parametrize("how", ["unplug", "kill"])
def test_a_killed_service_is_a_fault_by_name_and_is_opened_again(emulate: Callable[..., Emulator], how: str) -> None:
    emulator, device, loop = held(emulate)
    loop.run(PUSH, 50)
    if how == "kill":
        emulator.popen.send_signal(signal.SIGKILL)
        emulator.popen.wait()
    else:
        emulator.ask("unplug", "unplugged")
    with pytest.raises(
        DeviceError, match=rf"inverse:{emulator.place}: lost the service: .*; start it again, then re-arm"
    ) as lost:
        # an answer that came before may be read first
        all(loop.turn(PUSH) for _ in range(3))
    with pytest.raises(DeviceError, match=re.escape(str(lost.value))):
        device.write(PUSH)
    device.close()
    with pytest.raises(DeviceError, match=r"no service at localhost:\d+ \(.*\); start Haply's Inverse service"):
        device.open(RATE_HZ)
    if how == "unplug":
        emulator.ask("mend", "plugged in again: " + emulator.place)
        device.open(RATE_HZ)
        Loop(device).run(PUSH, 50)
        assert hypot(*emulator.status()["force_n"]) > 0.3
        device.close()


def test_a_service_that_hangs_stops_no_loop(emulate: Callable[..., Emulator]) -> None:
    """Its process is stopped: every call still returns at once, without a sample; then it goes on from zero force."""
    emulator, device, loop = held(emulate)
    loop.run(PUSH, 50)
    emulator.popen.send_signal(signal.SIGSTOP)
    samples: list[Sample | None] = [loop.turn(PUSH) for _ in range(200)]
    assert not any(samples[-100:])
    acting = device.write(PUSH)
    assert acting is not None
    assert not any(acting)
    emulator.popen.send_signal(signal.SIGCONT)
    loop.run(PUSH, 50)
    assert dict(device.counts)["reply late"] >= 100
    device.close()


def test_it_keeps_every_promise_in_real_time(emulate: Callable[..., Emulator]) -> None:
    """The conformance suite over the socket, as `cogrip devices conform` runs it, but for how long calls take."""
    address = f"inverse:{emulate('--hand', 'hold').place}"
    clock = TickClock(RATE_HZ)
    subject = DeviceSubject(lambda: make(address, axes=3), RATE_HZ, clock.wait, push_n=0.2)
    for check in CHECKS:
        for attempt in count():  # the service takes one program at a time, and may not have seen the last one go
            try:
                check(subject)
                break
            except DeviceError as error:
                if "no service at" not in str(error) or attempt == 1000:
                    raise


def test_whatever_is_no_service_is_refused() -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with pytest.raises(DeviceError, match=f"no service at localhost:{port} "):
        WebsocketLine("inverse:x", "localhost", port).open()
    with pytest.raises(DeviceError, match="is closed; open it first"):
        WebsocketLine("inverse:x", "localhost", port).read()


@contextmanager
def wild_service(sent: bytes) -> Iterator[int]:
    """Yield the port of a websocket that sends these bytes, whatever they are, once it has shaken hands."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            host, _ = listener.accept()
            with host, suppress(OSError):
                protocol = ServerProtocol()
                protocol.receive_data(host.recv(4096))
                (request,) = protocol.events_received()
                assert isinstance(request, Request)
                protocol.send_response(protocol.accept(request))
                host.sendall(b"".join(protocol.data_to_send()) + sent)
                while host.recv(4096):
                    pass

        thread = Thread(target=serve, daemon=True)
        thread.start()
        yield listener.getsockname()[1]
        thread.join(10.0)


def frame(*texts: bytes) -> bytes:
    """Return one unmasked text message in as many frames."""
    last = len(texts) - 1
    return b"".join(
        bytes([(0x80 if at == last else 0) | (0 if at else 1), len(text)]) + text for at, text in enumerate(texts)
    )


@pytest.mark.parametrize(
    ("sent", "read"),
    [
        (frame(b"one"), b"one"),
        (frame(b"o", b"n", b"e"), b"one"),
        (frame(b"old") + b"\x89\x00" + frame(b"new"), b"new"),  # a ping between
        (b"\xff" * 40, "what it sends is no websocket"),
        (b"\x81\x7f" + b"\xff" * 8, "what it sends is no websocket"),  # of 2^64 bytes
        (b"\x88\x02\x03\xe8", "it closed the connection"),
    ],
)
def test_what_a_websocket_may_send(sent: bytes, read: bytes | str) -> None:
    with wild_service(sent) as number:
        port = WebsocketLine("inverse:x", "127.0.0.1", number)
        port.open()
        if isinstance(read, bytes):
            assert port.read(10.0) == read
            assert port.counts["older message passed over"] == (b"old" in sent)
            port.write(b"{}")
        else:
            with pytest.raises(DeviceError, match=rf"lost the service: {read}"):
                port.read(10.0)
        port.close()


def test_one_program_at_a_time(emulate: Callable[..., Emulator]) -> None:
    emulator, device, loop = held(emulate)
    loop.run(PUSH, 5)
    with pytest.raises(DeviceError, match="no service at"):
        opened(f"inverse:{emulator.place}", axes=3)
    loop.run(PUSH, 5)
    device.close()
    for attempt in count():  # until the service has seen that it closed
        try:
            device.open(RATE_HZ)
            break
        except DeviceError:
            assert attempt < 1000
    device.close()
