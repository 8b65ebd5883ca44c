"""The guard process, on a pseudo-terminal with the emulated board behind it: whatever ends the driver, the torque goes.

Every wait is for something that must happen, and its bound is no question of speed. A stall is a matter of real time, and a
busy machine stalls a driver by itself: so a guard sees one after NEVER_NS, but where a test is about stalls. Then it may come
at any moment, and the test holds for any.
"""

import os
import select
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator

import pytest
from msgspec.structs import replace

from cogrip.devices import DeviceError
from cogrip.devices.family.haply import goodbye
from cogrip.devices.family.haply import make as make_haply
from cogrip.devices.haply import line
from cogrip.devices.haply.frames import HaplyCodec
from cogrip.devices.haply.models import MODELS
from cogrip.devices.io import guarded_line
from cogrip.devices.io.guard import GOOD, LOOK_S, STALL_NS, StallWatch, take_off
from cogrip.devices.io.guarded_line import GuardedLine
from cogrip.devices.settings import parse_address

from tests.devices.haply_board import BOUND_S, Board
from tests.extent import every

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "pidfd_open"), reason="needs Linux: pseudo-terminals and pidfd"),
    pytest.mark.on_time,
]

MODEL = MODELS["2diy"]
PATIENT_NS = 400_000_000  # a stall, where the test is about stalls
NEVER_NS = 3600_000_000_000
REPLY_S = 2.0  # for a board that always answers, if it gets the processor

DRIVER = """
import os, signal, sys
from contextlib import suppress
from itertools import count, repeat
from math import inf
from cogrip.devices import DeviceError
from cogrip.devices.emulated.emulated_device import Notebook
from cogrip.devices.family.haply import drive, goodbye, make
from cogrip.devices.haply.frames import HaplyCodec
from cogrip.devices.haply.models import MODELS
from cogrip.devices.haply import line
from cogrip.devices.io import guarded_line
from cogrip.devices.io.guarded_line import GuardedLine
from cogrip.devices.settings import parse_address
from msgspec.structs import replace

path, mode, stall_ns, never_ns, reply_s, bound_s = sys.argv[1], sys.argv[2], *map(int, sys.argv[3:5]), *map(float, sys.argv[5:])
guarded_line.START_S = guarded_line.END_S = bound_s
line.PATIENCE_S = reply_s
address = parse_address(f"haply:{path}?model=2diy&pose=home")
if stall_ns:
    codec = HaplyCodec(MODELS["2diy"].wiring, 1)
    stalls_ns = iter([stall_ns])  # of the first opening
    port = GuardedLine(
        path, "haply", lambda: replace(goodbye(codec), stall_ns=next(stalls_ns, never_ns), reply_s=reply_s)
    )
    device = drive(port, "haply:test", Notebook(), address, 2, codec)
else:
    device = make(address, 2, {})
ticks = count(1)

def say(*words):
    print(*words, flush=True)

def push(answers, force_n=0.8):
    while answers > 0:
        answers -= device.read(next(ticks)) is not None
        device.write((force_n, 0.0))

device.open(250)
other = 0
if mode == "fork" and not (other := os.fork()):
    signal.pause()
say(device._line._line.guard_pid, other)
if mode == "raise":
    push(40)
    raise RuntimeError("no more")
if mode == "close":
    push(40)
    device.close()
    say("closed")
    sys.stdin.readline()
    sys.exit()
if mode == "idle":
    while True:
        try:
            push(40)
            push(20, 0.0)
            break
        except DeviceError:  # the machine itself held us up while we pushed
            device.close()
            stalls_ns = iter([stall_ns])
            device.open(250)
    say("idle")
    sys.stdin.readline()
    push(1, 0.0)
    say("undisturbed")
    sys.stdin.readline()
    with suppress(DeviceError):  # as above
        push(40)
    say("has pushed")
    sys.stdin.readline()
    device.close()
    sys.exit()
try:
    push(inf)
except DeviceError as error:
    say(error)
for _ in range(20):
    for verb in (lambda: device.read(next(ticks)), lambda: device.write((0.8, 0.0))):
        with suppress(DeviceError):
            verb()
say(dict(device.counts))
sys.stdin.readline()
device.close()
device.open(250)
push(40)
say("pushes")
sys.stdin.readline()
device.close()
"""


class PushedBoard(Board):
    def wait_for_push(self, since: int = 0) -> None:
        """Until it has pushed since it had a history of so many."""
        self.wait(lambda: any(map(any, self.history[since:])))

    def wait_for_rest(self) -> None:
        """Until it pushes no more."""
        self.wait(lambda: not any(self.firmware.torque_nm))

    def wait_for_take_off(self) -> None:
        """Until a guard has asked as often for no torque as shows it that it was understood."""
        self.wait(lambda: self.history[-GOOD:] == GOOD * [(0.0, 0.0)])

    def ends_at_rest(self) -> None:
        """The last that it was told, once all who could tell it something have ended, is no torque."""
        self.wait(lambda: self.history[-1] == (0.0, 0.0))


@pytest.fixture
def board() -> Iterator[PushedBoard]:
    board = PushedBoard()
    yield board
    board.close()


class Driver:
    """A driver in a process group of its own, pushing."""

    def __init__(self, board: PushedBoard, mode: str, stall_ns: int) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", DRIVER, board.path, mode, *map(str, (stall_ns, NEVER_NS, REPLY_S, BOUND_S))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
        self._heard = b""
        self._guard = -1

    def meet(self) -> None:
        self.guard_pid, self.other_pid = map(int, self.line().split())
        self._guard = os.pidfd_open(self.guard_pid)

    def line(self) -> str:
        """The next that it says."""
        assert self.process.stdout is not None
        while b"\n" not in self._heard:
            assert select.select([self.process.stdout], [], [], BOUND_S)[0], "it says no more"
            data = os.read(self.process.stdout.fileno(), 65536)
            assert data, self.end()
            self._heard += data
        line, _, self._heard = self._heard.partition(b"\n")
        return line.decode()

    def go_on(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(b"\n")
        self.process.stdin.flush()

    def kill(self, number: int) -> None:
        os.kill(self.process.pid, number)

    def guard_ended(self, within_s: float = BOUND_S) -> bool:
        return bool(select.select([self._guard], [], [], within_s)[0])

    def end(self) -> str:
        """Return its standard error, which its guard shares: so both have ended."""
        return self.process.communicate(timeout=BOUND_S)[1].decode()

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        with self.process:  # closes its streams
            pass
        if self._guard >= 0:
            os.close(self._guard)


@pytest.fixture(autouse=True)
def _patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Waiting limits meant for people are widened for a busy machine."""
    for name in ("START_S", "END_S"):
        monkeypatch.setattr(guarded_line, name, BOUND_S)
    monkeypatch.setattr(line, "PATIENCE_S", REPLY_S)


Start = Callable[..., Driver]


@pytest.fixture
def start(board: PushedBoard) -> Iterator[Start]:
    """Yield a function that starts a driver, which pushes by then in the modes in which it goes on pushing."""
    started: list[Driver] = []

    def start(mode: str = "push", stall_ns: int = NEVER_NS) -> Driver:
        started.append(Driver(board, mode, stall_ns))
        started[-1].meet()
        if mode in ("push", "fork"):
            board.wait_for_push()
        return started[-1]

    yield start
    for driver in started:
        driver.close()


@pytest.mark.parametrize("stall_ns", [0, NEVER_NS])
def test_killed_driver(board: PushedBoard, start: Start, stall_ns: int) -> None:
    """0: as the family makes it."""
    driver = start(stall_ns=stall_ns)
    driver.kill(signal.SIGKILL)
    board.wait_for_rest()
    assert driver.end() == ""
    assert driver.guard_ended()
    board.ends_at_rest()


def test_killed_driver_whose_child_lives_on_with_the_pipe_open(board: PushedBoard, start: Start) -> None:
    driver = start("fork")
    driver.kill(signal.SIGKILL)
    try:
        board.wait_for_rest()
        assert driver.guard_ended()
    finally:
        os.kill(driver.other_pid, signal.SIGKILL)


def test_interrupt_reaches_the_driver_alone(board: PushedBoard, start: Start) -> None:
    """A terminal's interrupt reaches the guard too, which does not end before its driver."""
    driver = start()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
        os.kill(driver.guard_pid, number)
    os.killpg(driver.process.pid, signal.SIGINT)
    board.wait_for_rest()
    assert "KeyboardInterrupt" in driver.end()
    assert driver.guard_ended()
    board.ends_at_rest()


def test_exception_in_the_driver(board: PushedBoard, start: Start) -> None:
    driver = start("raise")
    assert "no more" in driver.end()
    assert driver.guard_ended()
    assert any(map(any, board.history))
    board.ends_at_rest()


@pytest.mark.long
def test_closed_device_has_no_torque_and_no_guard(board: PushedBoard, start: Start) -> None:
    driver = start("close")
    assert driver.line() == "closed"
    assert driver.guard_ended()
    board.wait_for_rest()
    assert any(map(any, board.history))
    driver.process.kill()


def test_stalled_driver_loses_its_torque_learns_of_it_and_can_be_armed_again(board: PushedBoard, start: Start) -> None:
    driver = start(stall_ns=PATIENT_NS)
    driver.kill(signal.SIGSTOP)
    board.wait_for_take_off()
    begin = len(board.history)
    driver.kill(signal.SIGCONT)
    assert "its guard took it off" in driver.line()
    assert "'guard stepped in': " in driver.line()
    board.wait_for_rest()
    asked_since = board.history[begin:]  # for force, 20 times
    assert sum(map(any, asked_since)) <= 1  # a write that was under way when it was stopped
    begin = len(board.history)
    driver.go_on()
    assert driver.line() == "pushes"
    board.wait_for_push(begin)
    driver.go_on()
    assert driver.end() == ""
    board.ends_at_rest()


def test_guard_that_took_the_torque_off_goes_on_guarding(board: PushedBoard, start: Start) -> None:
    driver = start(stall_ns=PATIENT_NS)
    driver.kill(signal.SIGSTOP)
    board.wait_for_rest()
    driver.kill(signal.SIGKILL)
    assert driver.end() == ""
    assert driver.guard_ended()


@pytest.mark.long
def test_driver_that_pushes_nothing_may_take_its_time(board: PushedBoard, start: Start) -> None:
    driver = start("idle", PATIENT_NS)
    assert driver.line() == "idle"
    assert not driver.guard_ended(within_s=2.0 * PATIENT_NS * 1e-9)
    driver.go_on()
    assert driver.line() == "undisturbed"
    begin = len(board.history)
    driver.go_on()
    assert driver.line() == "has pushed"
    board.wait_for_push(begin)
    driver.go_on()
    assert driver.end() == ""


def test_driver_without_its_guard_stops_pushing(board: PushedBoard, start: Start) -> None:
    driver = start()
    os.kill(driver.guard_pid, signal.SIGKILL)
    assert "has ended; nothing may be pushed without it" in driver.line()
    assert "'guard lost': 1" in driver.line()
    board.wait_for_rest()
    driver.go_on()
    assert driver.line() == "pushes"
    driver.go_on()
    assert driver.end() == ""


@pytest.mark.parametrize(
    ("executable", "text"), [("/nowhere/python", "cannot be started"), ("/bin/false", "did not start")]
)
def test_no_guard_no_device(board: PushedBoard, monkeypatch: pytest.MonkeyPatch, executable: str, text: str) -> None:
    device = make_haply(parse_address(f"haply:{board.path}?model=2diy&pose=home"), 2, {})
    with monkeypatch.context() as patched:
        patched.setattr(sys, "executable", executable)
        with pytest.raises(DeviceError, match=f"{text}.*without it there is no force"):
            device.open(1000)
    with pytest.raises(DeviceError, match="call open"):
        device.write((0.0, 0.0))
    device.open(1000)
    device.close()
    assert not any(map(any, board.history))


def test_system_that_cannot_share_a_port_is_refused(board: PushedBoard, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guarded_line, "CAN_SHARE", False)
    device = make_haply(parse_address(f"haply:{board.path}?model=2diy&pose=home"), 2, {})
    with pytest.raises(DeviceError, match="use it on Linux or macOS"):
        device.open(1000)
    assert board.history == []


@pytest.mark.parametrize("missing", every(3, range(10)))
def test_frame_that_was_cut_off_in_the_middle_leaves_no_torque(board: PushedBoard, missing: int) -> None:
    codec = HaplyCodec(MODEL.wiring, 20)
    port = GuardedLine(board.path, "haply", lambda: replace(goodbye(codec), stall_ns=NEVER_NS))
    port.open()
    push, other = codec.encode((3000, -2000)), codec.encode((-1000, 2500))
    for frame in (codec.wiring.setup(20), push):
        port.write(frame)
    board.wait_for_push()
    begin = len(board.history)
    port.write(other[: 10 - missing] or push)
    assert port._line is not None
    whole = missing in (0, 10)  # then each request is answered, however long that takes
    reported = replace(goodbye(codec), reply_s=REPLY_S) if whole else goodbye(codec)
    assert take_off(port._line.fileno(), reported) == whole
    board.wait_for_rest()
    assert all(abs(torque) <= 0.0301 for pair in board.history[begin:] for torque in pair)
    port.close()
    board.ends_at_rest()


def test_torque_is_off_within_50_ms_of_the_last_write() -> None:
    """A write is seen, and a stall is seen, up to one look late."""
    assert STALL_NS * 1e-9 + 2.0 * LOOK_S < 0.05
    assert goodbye(HaplyCodec(MODEL.wiring, 20)).stall_ns == STALL_NS


def test_stall_watch_speaks_once_at_its_limit_and_only_of_torque() -> None:
    watch = StallWatch(stall_ns=100)
    assert not watch.stalled(1, True, 1000)
    assert not watch.stalled(1, True, 1099)
    assert watch.stalled(1, True, 1100)
    assert not watch.stalled(1, True, 5000)
    assert not watch.stalled(2, True, 5001)  # it beats again
    assert not watch.stalled(2, False, 6000)
    assert watch.stalled(2, True, 6001)  # a torque that is older than the limit
    assert not watch.stalled(3, True, 6002)
    assert not watch.stalled(4, True, 6101)
    assert watch.stalled(4, True, 6201)
