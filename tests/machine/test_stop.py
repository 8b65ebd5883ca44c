"""Signals: what ends a loop, what asks it to read its files anew, and a terminal that is closed."""

import os
import signal
import subprocess
import sys

import pytest

from cogrip.machine.platform import system
from cogrip.machine.stop import Stop, on_signals

LIMIT_S = 60.0
LOOP = """
import fcntl, signal, sys, termios
from cogrip.machine.platform import system
from cogrip.machine.stop import Stop, on_signals
hangup, nohup, terminal = sys.argv[1], sys.argv[2] == "True", int(sys.argv[3])
if nohup:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
if terminal >= 0:
    fcntl.ioctl(terminal, termios.TIOCSCTTY, 0)
reloads = 0
with on_signals(Stop(), hangup) as stop:
    print("ready", file=sys.stderr, flush=True)
    while not stop.reason:
        if stop.take_reload():
            reloads += 1
            print(f"reloaded {reloads}", file=sys.stderr, flush=True)
print(f"ended: {stop.reason}", file=sys.stderr, flush=True)
"""


class Loop:
    """A process that runs until a signal stops it, and prints its requests."""

    def __init__(self, hangup: str, *, nohup: bool = False, terminal: int = -1) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", LOOP, hangup, str(nohup), str(terminal)], stdin=subprocess.DEVNULL,
            stderr=subprocess.PIPE, text=True, start_new_session=True, pass_fds=() if terminal < 0 else (terminal,),
        )  # fmt: skip
        assert self.next() == "ready"

    def next(self) -> str:
        assert self.process.stderr is not None
        return self.process.stderr.readline().strip()

    def after(self, number: int) -> str:
        self.process.send_signal(number)
        return self.next()

    def close(self) -> None:
        self.process.kill()
        self.process.wait(LIMIT_S)
        assert self.process.stderr is not None
        self.process.stderr.close()


@pytest.fixture
def loop():
    begun: list[Loop] = []

    def begin(hangup: str, **more: object) -> Loop:
        begun.append(Loop(hangup, **more))
        return begun[-1]

    yield begin
    for each in begun:
        each.close()


def test_a_reload_and_a_rearm_are_each_asked_for_once():
    stop, before = Stop(), signal.getsignal(signal.SIGHUP)
    assert not stop.take_reload()
    with on_signals(stop, "reload"):
        for times in (1, 5):  # none of them ends anything
            for _ in range(times):
                os.kill(os.getpid(), signal.SIGHUP)
            assert stop.take_reload()
            assert not stop.take_reload()
        os.kill(os.getpid(), signal.SIGUSR1)
        assert stop.take_rearm()
        assert not stop.take_rearm()
    assert (stop.reason, stop.signals) == ("", 0)
    assert signal.getsignal(signal.SIGHUP) is before


def test_lines_are_orders_each_taken_once(monkeypatch):
    typed = [b"m lamp on\n", b"R\nm off\n \n", b"", b"\xff\n"]
    monkeypatch.setattr(system, "typed", lambda: typed.pop(0) if typed else b"")
    stop = Stop()
    assert stop.take_typed() == ["m lamp on"]
    assert stop.take_rearm()
    assert stop.take_typed() == ["m off"]
    assert not stop.take_rearm()
    assert stop.take_typed() == ["\N{REPLACEMENT CHARACTER}"]


def test_the_first_reason_stays_and_the_third_signal_breaks_what_hangs():
    """A hangup terminates too where nothing else was asked of it."""
    stop = Stop()
    with on_signals(stop):
        os.kill(os.getpid(), signal.SIGHUP)
        os.kill(os.getpid(), signal.SIGTERM)
        assert (stop.reason, stop.reload) == ("stopped (SIGHUP)", False)
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)


def test_a_service_reloads_as_often_as_it_is_told_and_then_ends(loop):
    service = loop("reload")
    assert [service.after(signal.SIGHUP) for _ in range(3)] == ["reloaded 1", "reloaded 2", "reloaded 3"]
    assert service.after(signal.SIGTERM) == "ended: stopped (SIGTERM)"
    assert service.process.wait(LIMIT_S) == 0


@pytest.mark.parametrize("hangup", ["terminate", "reload"])
def test_under_nohup_a_hangup_is_nothing(loop, hangup):
    kept = loop(hangup, nohup=True)
    kept.process.send_signal(signal.SIGHUP)
    assert kept.after(signal.SIGINT) == "ended: stopped (SIGINT)"


def test_at_a_terminal_a_hangup_reloads_and_its_end_ends(loop):
    """A server that somebody began by hand ends with the window, as every program does."""
    ours, its = os.openpty()
    server = loop("reload", terminal=its)
    os.close(its)
    assert server.after(signal.SIGHUP) == "reloaded 1"
    os.close(ours)
    assert server.next() == "ended: stopped (SIGHUP)"
    assert server.process.wait(LIMIT_S) == 0
