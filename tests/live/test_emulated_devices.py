"""Live sessions with emulated arms behind pseudo-terminals: other processes, which speak the wires' own bytes.

Nothing sleeps: a test waits for what a process says, or for its end. What an arm truly does is asked of its emulator.
"""

import functools
import json
import os
import pty
import re
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from math import hypot
from pathlib import Path

import msgspec
import pytest

from cogrip.protocol.recording.reader import Follower, RecordingError
from cogrip.protocol.recording.records import Tick

LIMIT_S = 25.0
CONFIGS = Path(__file__).resolve().parents[2] / "configs"
DEMO = CONFIGS / "demo.toml"
WITHIN = ("--set", "coupling.impedance_nspm=8")  # what the vintage Phantom's record advises
STALLED = ("watchdog: the loop was away", "device stall")
FREE = "push&force_n=0"  # nobody holds it

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")

OWN_TERMINAL = (
    "import fcntl, sys, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0)\n"
    "from cogrip.cli.main import main; sys.exit(main(sys.argv[1:]))"
)
BROKEN_LAW = """
import sys
from cogrip.client.core import ClientCore
whole = ClientCore.act
def act(self, now_ns):
    if self.tick > 1024 and abs(self.force_n[0]) > 0.05:
        raise ZeroDivisionError("a bug in the law, as it pushes")
    return whole(self, now_ns)
ClientCore.act = act
from cogrip.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


class Spoken:
    """A `cogrip` command that can be told something, and whose words are read as they come."""

    def __init__(self, *arguments: str, stdin: int = subprocess.PIPE, code: str = "") -> None:
        start = ["-c", code] if code else ["-m", "cogrip.cli"]
        self.popen = subprocess.Popen(
            [sys.executable, *start, *arguments],
            stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1", "COLUMNS": "200", "NO_COLOR": "1"},
        )  # fmt: skip
        self.said = ""
        self.expected_stalls = 0
        self._heard = 0
        self._news = threading.Condition()
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()

    def _listen(self) -> None:
        assert self.popen.stdout is not None
        for line in self.popen.stdout:
            with self._news:
                self.said += line
                self._news.notify_all()
        with self._news:
            self._news.notify_all()

    def tell(self, line: str) -> None:
        assert self.popen.stdin is not None
        self.popen.stdin.write(f"{line}\n")
        self.popen.stdin.flush()

    def hear(self, pattern: str) -> re.Match[str]:
        """Wait until it says something that matches, after what was heard before."""
        with self._news:
            self._news.wait_for(
                lambda: re.search(pattern, self.said[self._heard :]) or not self._listener.is_alive(), LIMIT_S
            )
            found = re.search(pattern, self.said[self._heard :])
            assert found, f"never said {pattern!r} any more, but:\n{self.said}"
            self._heard += found.end()
        return found

    def end(self) -> int:
        try:
            code = self.popen.wait(LIMIT_S)
        except subprocess.TimeoutExpired:
            pytest.fail(f"did not end in {LIMIT_S:g} s, but said:\n{self.said}")
        self._listener.join(LIMIT_S)
        return code

    def stop(self) -> None:
        """Whatever it does."""
        if self.popen.poll() is None:
            self.popen.terminate()
            try:
                self.popen.wait(LIMIT_S)
            except subprocess.TimeoutExpired:
                self.popen.kill()
                self.popen.wait()
        self._listener.join(LIMIT_S)
        for stream in (self.popen.stdin, self.popen.stdout):
            if stream is not None:
                stream.close()


class Arm(Spoken):
    """An emulated arm, a vintage Phantom or a Haply 2DIY. Its address with the keys it needs, and what it truly does."""

    def __init__(self, link: Path, hand: str, *arguments: str, wire: str = "serial") -> None:
        super().__init__("devices", "emulate", wire, "--link", str(link), "--hand", hand, *arguments)
        self.link = link
        self.hear(f"behind {wire}:")
        self.port = f"{wire}:{link}"
        self.address = self.port + ("?pose=home" if wire == "serial" else "?model=2diy&pose=home")

    def force_n(self) -> float:
        """What it pushes with now."""
        self.tell("status")
        return hypot(*map(float, self.hear(r"pushes with \(([^)]*)\) N")[1].split(", ")))

    def fault(self, verb: str) -> None:
        self.tell(verb)
        self.hear(f"fault {verb}")

    def pushes(self, wanted: bool) -> None:
        """Wait until it pushes, or until it does not."""
        until(lambda: (self.force_n() > 0.02) is wanted, f"{self.port} pushes: {wanted}")


def until(good: Callable[[], bool], what: str) -> None:
    """Looks fifty times a second: an emulator that is asked without a pause has no time for its wire."""
    deadline = time.monotonic() + LIMIT_S
    while not good():
        assert time.monotonic() < deadline, f"never: {what}"
        select.select([], [], [], 0.02)


def fairly(test: Callable[..., None]) -> Callable[..., None]:
    """A test is skipped where the machine itself stalled: then a watchdog is right to let go."""

    @functools.wraps(test)
    def judged(start, **fixtures) -> None:
        try:
            test(start=start, **fixtures)
        except (AssertionError, pytest.fail.Exception):
            for process in start.all:
                if sum(process.said.count(words) for words in STALLED) > process.expected_stalls:
                    pytest.skip(f"this machine took the processor away for too long: {process.said}")
            raise

    return judged


@pytest.fixture
def start(tmp_path, monkeypatch) -> Iterator[Callable[..., Spoken]]:
    """Start `cogrip ARGUMENTS`; whatever still runs at the end of the test is ended."""
    monkeypatch.setenv("COGRIP_CALIBRATION", str(tmp_path / "calibration"))
    started: list[Spoken] = []

    def run(*arguments: object, stdin: int = subprocess.DEVNULL, code: str = "") -> Spoken:
        started.append(Spoken(*map(str, arguments), stdin=stdin, code=code))
        return started[-1]

    def arm(name: str, hand: str, *arguments: str, wire: str = "serial") -> Arm:
        started.append(Arm(tmp_path / name, hand, *arguments, wire=wire))
        return started[-1]

    run.arm = arm
    run.all = started
    yield run
    for process in reversed(started):
        process.stop()


class Session:
    """A server, and people who join it with their arms."""

    def __init__(self, start, folder: Path) -> None:
        self._start = start
        self._folder = folder
        self.server = start(
            "serve", DEMO, "--port", "0", "--seconds", "120", "--runs", folder / "server", "--no-report", *WITHIN
        )
        self.port = self.server.hear(r"listening on \S+:(\d+)")[1]

    def join(self, name: str, device: str, *arguments: str, **how) -> Spoken:
        person = self._start(
            "join", f"127.0.0.1:{self.port}", "--name", name, "--device", device, "--runs", self._folder / name,
            "--no-report", *arguments, **how,
        )  # fmt: skip
        person.hear(f"{name} holds cube")
        return person

    def state(self, name: str) -> str:
        """The newest one in the recording of a person."""
        try:
            (path,) = (self._folder / name).glob(f"*/client-{name}.mcap")
            newest = Follower(path).look().get(f"/{name}/tick")
        except (ValueError, OSError, RecordingError):
            return ""
        return msgspec.json.decode(newest.payload, type=Tick).state if newest else ""

    def summary(self, name: str) -> dict:
        (path,) = (self._folder / name).glob("*/summary.json")
        return json.loads(path.read_text())

    def close(self, *people: Spoken) -> None:
        """Everyone leaves as they should; the whole was passive."""
        for person in people:
            person.popen.send_signal(signal.SIGINT)
        for person in people:
            assert person.end() == 0, person.said
        self.server.popen.send_signal(signal.SIGINT)
        assert self.server.end() == 0, self.server.said
        assert self.summary("server")["passive"]


@pytest.fixture
def session(start, tmp_path) -> Session:
    return Session(start, tmp_path)


@fairly
def test_a_silent_arm_is_without_force_until_its_person_re_arms_it(start, session):
    annas, bens = start.arm("anna-arm", "reach&amplitude_m=0.02"), start.arm("ben-arm", "hold")
    anna = session.join("anna", annas.address, "--rearm")
    ben = session.join("ben", bens.address, "--rearm")
    annas.pushes(True)
    anna.popen.send_signal(signal.SIGUSR1)  # before there is a fault: it must not leave one later
    annas.fault("silence 0.3")
    anna.expected_stalls = 1
    reason = anna.hear(r"fault, force released: (.*)")[1]
    assert reason.startswith("device stall")
    anna.hear(rf"`r` and Enter here, or `kill -USR1 {anna.popen.pid}`, re-arms")
    annas.pushes(False)
    until(lambda: session.state("anna") == "fault", "anna's recording says fault")
    assert "re-arm" not in anna.said.partition("re-arms; Ctrl-C leaves")[2]
    anna.popen.send_signal(signal.SIGUSR1)
    anna.hear("re-armed: force ramps in")
    until(lambda: session.state("anna") == "live", "anna's recording says live")
    annas.pushes(True)
    until(lambda: session.state("ben") == "live", "ben goes on")
    session.close(anna, ben)
    assert anna.said.count("re-armed:") == 1
    assert session.summary("anna")["users"][0]["force_n"] == [0.0]
    counted = session.summary("anna")["server"]["dropped"]
    assert counted["reply late"] >= 10
    assert counted["fault"] == 1
    assert f"reply late {counted['reply late']}" in anna.said
    assert "fault, " not in ben.said
    assert annas.force_n() == bens.force_n() == 0.0


@fairly
def test_an_arm_that_was_unplugged_wants_its_calibration_before_it_is_re_armed(start, session):
    annas, bens = start.arm("anna-arm", "hold"), start.arm("ben-arm", "reach&amplitude_m=0.02")
    refused = start("join", f"127.0.0.1:{session.port}", "--device", annas.port)
    assert refused.end() == 1
    assert re.search(
        r"its pose is not known, so there would be no force: .*`cogrip devices calibrate \S+`", refused.said
    )

    session.server.hear("anna left: device: ")  # the seat is free again at once

    def calibrate() -> None:
        done = start("devices", "calibrate", annas.port, "--yes")
        assert done.end() == 0, done.said
        assert "vintage is calibrated; the tip of the home pose is at" in done.said

    calibrate()
    anna, ben = session.join("anna", annas.port, "--rearm"), session.join("ben", bens.address, "--rearm")
    annas.pushes(True)
    annas.fault("unplug")
    assert "lost" in anna.hear(r"fault, force released: (.*)")[1]
    anna.popen.send_signal(signal.SIGUSR1)
    assert "plug the device in" in anna.hear("not re-armed: (.*)")[1]
    assert annas.force_n() == 0.0
    annas.tell("mend")
    annas.hear("plugged in again")
    anna.popen.send_signal(signal.SIGUSR1)
    assert re.search(
        r"was plugged in again since it was calibrated on .*`cogrip devices calibrate", anna.hear("not re-armed: .*")[0]
    )
    until(lambda: session.state("anna") == "fault", "anna's recording says fault")
    calibrate()
    anna.popen.send_signal(signal.SIGUSR1)
    anna.hear("re-armed: force ramps in")
    annas.pushes(True)
    until(lambda: session.state("ben") == "live", "ben goes on")
    session.close(anna, ben)


@fairly
def test_r_and_enter_at_a_terminal_re_arm(start, session):
    arm = start.arm("arm", "reach&amplitude_m=0.02")
    master, slave = pty.openpty()
    try:
        person = session.join("anna", arm.address, stdin=slave, code=OWN_TERMINAL)
        arm.fault("silence 0.2")
        person.expected_stalls = 1
        person.hear("`r` and Enter here")
        os.write(master, b"what now?\n")
        os.write(master, b"r\n")
        person.hear("re-armed: force ramps in")
        os.write(master, b"r\n")  # in no fault
        until(lambda: session.state("anna") == "live", "live")
        os.write(master, b"\x03")  # Ctrl-C
        assert person.end() == 0, person.said
        assert person.said.count("re-arming") == 1
    finally:
        os.close(master)
        os.close(slave)


@fairly
def test_a_session_that_ends_in_a_fault_did_not_end_well(start, session):
    arm = start.arm("arm", "hold")
    person = session.join("anna", arm.address, "--rearm")
    arm.fault("silence")
    person.expected_stalls = 2  # it is said again at the end
    person.hear("re-arms; Ctrl-C leaves")
    person.popen.send_signal(signal.SIGINT)
    assert person.end() == 1
    assert "no force is left: it ended in a fault: device stall" in person.said


@pytest.mark.parametrize("wire", ["serial", "haply"])
@fairly
def test_no_force_is_left_of_a_client_that_was_killed(start, session, wire):
    """On a serial: line the firmware's watchdog sees to it, on a haply: one the guard process: that firmware has none."""
    hand = "reach&amplitude_m=0.01" if wire == "haply" else "reach&amplitude_m=0.02"
    annas, bens = start.arm("anna-arm", hand, wire=wire), start.arm("ben-arm", "hold")
    anna, ben = session.join("anna", annas.address), session.join("ben", bens.address)
    annas.pushes(True)
    anna.popen.kill()
    annas.pushes(False)
    session.server.hear("anna has been silent for too long and lost the seat")
    session.close(ben)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@fairly
def test_a_signal_ends_with_no_force(start, session, number):
    arm = start.arm("arm", "reach&amplitude_m=0.02")
    person = session.join("anna", arm.address)
    arm.pushes(True)
    person.popen.send_signal(number)
    assert person.end() == 0, person.said
    assert arm.force_n() == 0.0


@fairly
def test_an_error_in_the_loop_ends_with_no_force(start, session):
    """One that nobody thought of, while the arm pushes."""
    arm = start.arm("arm", "reach&amplitude_m=0.02")
    person = session.join("anna", arm.address, code=BROKEN_LAW)
    assert person.end() == 1
    assert "ZeroDivisionError: a bug in the law, as it pushes" in person.said
    assert arm.force_n() == 0.0
    arm.tell("status")
    assert float(arm.hear(r"most so far ([\d.]+) N")[1]) > 0.05


@fairly
def test_an_arm_that_vanishes_ends_a_session_that_nobody_watches(start, session):
    annas, bens = start.arm("anna-arm", "reach&amplitude_m=0.02"), start.arm("ben-arm", "hold")
    anna, ben = session.join("anna", annas.address), session.join("ben", bens.address)
    annas.pushes(True)
    annas.fault("unplug")
    assert anna.end() == 1
    assert "the session broke off, no force is left: device: serial:" in anna.said
    assert "plug it in again, then re-arm" in anna.said
    assert annas.force_n() == 0.0
    session.server.hear("anna left")
    session.close(ben)


@fairly
def test_the_demo_with_two_arms(start, tmp_path):
    """Counts that are no clocks; the numbers are those of `cogrip bench devices`."""
    arms = [start.arm("a", "reach&amplitude_m=0.03"), start.arm("b", "reach&amplitude_m=0.03&delay_s=0.25")]
    devices = [word for arm in arms for word in ("--device", arm.address)]
    demo = start("demo", "--seconds", "5", "--runs", tmp_path / "runs", *devices, *WITHIN)
    code = demo.end()
    (folder,) = (tmp_path / "runs").iterdir()
    said = "".join(log.read_text() for log in folder.glob("*.log"))
    demo.said += said
    assert code == 0, demo.said
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["passive"]
    assert not summary["diverged"]
    assert summary["object"]["travel_m"] > 0.01
    for user in summary["users"]:
        assert user["state"] == "idle"
        assert user["force_n"] == [0.0]
        assert user["peak_force_n"] > 0.1
        assert user["travel_m"] > 0.01
        assert user["ticks"]["due"] >= user["ticks"]["run"] > 2000
        assert user["link"]["applied"] > 300
        for way in ("up", "down"):
            link = user["link"][way]
            assert link["sent"] == link["applied"] + link["late"] + link["lost"]
    assert (folder / "report.html").exists()
    for arm in arms:
        assert arm.force_n() == 0.0


@fairly
def test_an_emulated_arm_without_a_wire_is_held_live_too(start, session):
    """Its firmware's time is that of the ticks."""
    person = session.join("anna", "emulated:vintage?hand=reach&amplitude_m=0.02&faults=silence@0.5+0.2", "--rearm")
    person.expected_stalls = 1
    person.hear("fault, force released: device stall")
    person.popen.send_signal(signal.SIGUSR1)
    person.hear("re-armed: force ramps in")
    session.close(person)
    assert session.summary("anna")["server"]["dropped"]["reply late"] >= 10


# --- arms made ready --------------------------------------------------------------------------------------------------


def signs(said: str) -> list[str]:
    return re.findall(r"([✓✗]) │ sign, axis ([abc])", said)


@fairly
def test_check_finds_the_signs_of_a_free_arm(start):
    """How fast this machine is decides the rest of the verdict, and so the exit code."""
    arm = start.arm("arm", FREE)
    check = start("devices", "check", arm.port, "--yes", "--moving-s", "0")
    code = check.end()
    assert signs(check.said) == [("✓", "a"), ("✓", "b"), ("✓", "c")], check.said
    assert code == (0 if "✗" not in check.said else 1)
    assert ("NOT fit to be held" in check.said) == (code == 1)
    assert "vintage" in check.said
    assert arm.force_n() == 0.0


@fairly
def test_check_finds_an_encoder_that_is_stuck(start):
    arm = start.arm("arm", FREE)
    arm.fault("stuck")
    check = start("devices", "check", arm.port, "--yes", "--moving-s", "0")
    assert check.end() == 1
    assert [mark for mark, _ in signs(check.said)].count("✗") == 1, check.said
    assert "NOT fit to be held" in check.said
    assert "is the amplifier enabled, the arm free, the motor plugged in?" in check.said


@fairly
def test_check_keeps_to_the_limit_of_a_motor(start):
    arm = start.arm("arm", FREE)
    check = start("devices", "check", f"{arm.port}?model=vintage&limit_ma=90,80,100", "--yes", "--moving-s", "0")
    check.end()
    assert "up, down under +-80 mA" in check.said


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@fairly
def test_check_lets_go_when_it_is_interrupted(start, number):
    arm = start.arm("arm", "hold")
    check = start("devices", "check", arm.port, "--yes", "--moving-s", "0")
    check.hear("axis a under")
    check.popen.send_signal(number)
    assert check.end() == 130, check.said
    assert "Traceback" not in check.said
    assert arm.force_n() == 0.0
    again = start("devices", "calibrate", arm.port, "--yes")
    assert again.end() == 0, again.said


@fairly
def test_check_and_join_refuse_another_model(start, session):
    arm = start.arm("arm", "hold")
    for command in (
        ["devices", "check", "--yes"],
        ["devices", "calibrate", "--yes"],
        ["join", f"127.0.0.1:{session.port}", "--device"],
    ):
        refused = start(*command, f"{arm.port}?model=polhem")
        assert refused.end() == 1, refused.said
        assert "it says that it is vintage, not polhem; correct the key model, or the port" in refused.said


@fairly
def test_one_arm_has_one_owner(start, session):
    arm = start.arm("arm", "hold")
    person = session.join("anna", arm.address)
    refused = start("devices", "calibrate", arm.port, "--yes")
    assert refused.end() == 1
    assert "close the program that uses it" in refused.said
    session.close(person)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (None, 0)])
@fairly
def test_the_prompt_of_calibrate(start, number, code):
    arm = start.arm("arm", "hold")
    asked = start("devices", "calibrate", arm.port, stdin=subprocess.PIPE)
    asked.hear("Enter when it is so")
    if number is None:
        asked.tell("")
    else:
        asked.popen.send_signal(number)
    assert asked.end() == code, asked.said
    assert ("is calibrated" in asked.said) == (code == 0)
    assert "Traceback" not in asked.said


@fairly
def test_conform_tries_an_arm_on_its_wire(start):
    arm = start.arm("arm", FREE)
    conform = start("devices", "conform", arm.address, "--yes")
    assert conform.end() == 0, conform.said
    assert re.search(r"(\d+) of \1 promises kept", conform.said)


@fairly
def test_the_emulator_says_what_it_is_and_leaves_no_link(start):
    arm = start.arm("arm", "hold")
    assert "its counters are zero in the home pose: join it with ?pose=home" in arm.said
    arm.popen.send_signal(signal.SIGINT)
    assert arm.end() == 0
    assert not arm.link.is_symlink()
    other = start.arm("other", "hold", "--powered-at-m", "0.01", "0", "0")
    assert "its pose is not known" in other.said
    assert "pose=home" not in other.said
