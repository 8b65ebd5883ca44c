"""sd_notify over real sockets, with a file's name and an abstract one; and silence where nobody listens."""

import os
import secrets
import socket
from collections.abc import Iterator
from types import SimpleNamespace

import pytest

from cogrip.server.io.service_notify import ServiceNotifier


@pytest.fixture(params=["file", "abstract"])
def manager(request, tmp_path) -> Iterator[SimpleNamespace]:
    """Stands in for systemd."""
    name = f"@cogrip-{secrets.token_hex(8)}" if request.param == "abstract" else str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as end:
        end.bind("\0" + name[1:] if name.startswith("@") else name)
        end.settimeout(10.0)
        yield SimpleNamespace(name=name, socket=end)


def test_everything_that_systemd_asks(manager):
    notifier = ServiceNotifier({"NOTIFY_SOCKET": manager.name, "WATCHDOG_USEC": "5000000"})
    assert notifier.watchdog_every_ns == 2_500_000_000
    notifier.ready("2 rooms\nREADY=0\n hold")
    notifier.ready()
    notifier.reloading(12_345_678_901)
    notifier.watchdog()
    notifier.stopping()
    assert [manager.socket.recv(4096).decode() for _ in range(5)] == [
        "READY=1\nSTATUS=2 rooms READY=0 hold", "READY=1", "RELOADING=1\nMONOTONIC_USEC=12345678", "WATCHDOG=1", "STOPPING=1",
    ]  # fmt: skip
    notifier.close()
    notifier.close()
    notifier.ready()
    assert notifier.failed == 0


@pytest.mark.parametrize("environ", [{}, {"NOTIFY_SOCKET": ""}, {"NOTIFY_SOCKET": "vsock:2:1234"}])
def test_nobody_asked(environ):
    notifier = ServiceNotifier(environ)
    assert notifier.watchdog_every_ns is None
    notifier.ready("x")
    notifier.watchdog()
    notifier.close()
    assert notifier.failed == 0


def test_a_manager_that_is_gone_or_does_not_read_holds_nothing(manager):
    notifier = ServiceNotifier({"NOTIFY_SOCKET": manager.name})
    sent = 0
    while not notifier.failed:  # its queue is full then: else this never ends
        notifier.watchdog()
        sent += 1
    assert sent > 1
    manager.socket.close()
    before = notifier.failed
    notifier.watchdog()
    assert notifier.failed == before + 1
    notifier.close()


@pytest.mark.parametrize(
    ("environ", "every_ns"),
    [
        ({"WATCHDOG_USEC": "1"}, 500),
        ({"WATCHDOG_USEC": "3000000", "WATCHDOG_PID": "4711"}, 1_500_000_000),
        ({"WATCHDOG_USEC": "3000000", "WATCHDOG_PID": "4712"}, None),
        ({"WATCHDOG_USEC": "0"}, None),
        ({"WATCHDOG_USEC": "-3"}, None),
        ({"WATCHDOG_USEC": "soon"}, None),
        ({"WATCHDOG_USEC": "³"}, None),
        ({"WATCHDOG_USEC": ""}, None),
    ],
)
def test_how_often_the_watchdog_wants_to_hear(environ, every_ns, monkeypatch):
    monkeypatch.setattr(os, "getpid", lambda: 4711)
    assert ServiceNotifier(environ).watchdog_every_ns == every_ns
