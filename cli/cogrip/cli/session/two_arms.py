"""Two arms of one person: a tethered `cogrip join` for each device, held and released together.

Each child has its seat, its device and its safety. This process passes on what is typed and shows what they say. It tells one
child to hold its clutch while the other is in a fault, and ends one when the other ends. A child ends when this process does.
"""

import queue
import re
import subprocess
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field

from rich.console import Console

from cogrip.cli.session.children import end_all, reason_in, start_tethered
from cogrip.cli.session.joined_device import make_joined
from cogrip.cli.settings.before_run import HELD_BY_NOBODY
from cogrip.cli.terminal.platform import no_stop_key
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.machine.platform import system
from cogrip.machine.stop import Stop, on_signals
from cogrip.protocol.settings.sections import Settings

LOOK_EVERY_S = 0.02
NO_SUCH_SEAT = "no seat is kept for "
_SEATED = re.compile(r"(.+) holds \S+ in room ")
_OVER = re.compile(r".+: the session (broke off|is over), no force is left")
_NEGATABLE = ("report", "record", "rearm", "browser", "trial")
_FAULT, _REARMED = "fault, force released: ", "re-armed: "


@dataclass(slots=True)
class Arm:
    """One arm and its child.

    label   name of its seat, once it has one
    faulty  it is in a fault, and not re-armed
    over    it holds no more; `ended`: its process has ended; `observes`: it has an observer's place only
    """

    number: int
    device: str
    label: str
    child: subprocess.Popen[bytes]
    seated: bool = False
    faulty: bool = False
    over: bool = False
    ended: bool = False
    observes: bool = False
    _said: list[str] = field(default_factory=list)

    @property
    def reason(self) -> str:
        """Return the reason that the child gave for its end, "" for none."""
        return reason_in(self._said)

    def follow(self, line: str) -> None:
        """Follow what the child says of its state."""
        self._said.append(line)
        if not self.seated and (found := _SEATED.match(line)):
            self.seated, self.label = True, found[1]
        elif line.startswith(_FAULT):
            self.faulty = True
        elif line.startswith(_REARMED):
            self.faulty = False
        elif _OVER.match(line):
            self.over = True
        elif line.startswith("this link is for observing"):
            self.observes = True

    def order(self, line: str) -> None:
        """Pass a line on, as if it were typed there."""
        assert self.child.stdin is not None
        with suppress(OSError):  # it has ended, which is found out
            self.child.stdin.write(f"{line}\n".encode())
            self.child.stdin.flush()


def join_two(
    target: str, devices: Sequence[str], flags: Sequence[str], name: str, clutched: bool, view: Sequence[str],
    seconds: float | None, stop: Stop, console: Console,
) -> int:  # fmt: skip
    """Hold two devices until one of them ends. Raises Problem where one of them gets no seat.

    flags: of both children, and seconds: from when both hold on. Returns the exit code of the arm that ended worse.
    """
    with on_signals(stop), no_stop_key():
        return _TwoArms(target, devices, flags, stop, console).run(name, clutched, view, seconds)


def check_two(devices: Sequence[str], settings: Settings | None, axes: int | None, *playback: float | None) -> None:
    """Raise BadInput unless these are two devices that can be made, each of its own. playback: options of a single replay."""
    if any(each is not None for each in playback):
        raise BadInput("--speed, --loop, --start-s, --stop-s are of one replay: write them as keys of its address")
    if len(devices) > 2:
        raise BadInput(f"--device is given {len(devices)} times; a person has two arms: leave the others out")
    one, other = (re.split(r"[?#]", device)[0] for device in devices)
    if one == other and not one.startswith(HELD_BY_NOBODY):
        raise BadInput(f"--device {one} is given twice, and two arms need a device each: name the other one")
    for address in devices:
        make_joined(settings, "", address, axes)


def as_flags(**options: object) -> list[str]:
    """Return options as the command line has them; those that are false and have no negative form are left out."""
    words: list[str] = []
    for name, value in options.items():
        flag = name.replace("_", "-")
        if isinstance(value, bool):
            words += [f"--{flag}"] if value else [f"--no-{flag}"] if flag in _NEGATABLE else []
        elif value not in (None, "", ()):
            for each in value if isinstance(value, tuple) else (value,):
                words += [f"--{flag}", str(each)]
    return words


class _TwoArms:
    """The children of one person, and what they say, which a thread each passes on: None at its end."""

    def __init__(self, target: str, devices: Sequence[str], flags: Sequence[str], stop: Stop, console: Console) -> None:
        self._target, self._devices, self._flags = target, devices, flags
        self._stop, self._console = stop, console
        self._arms: list[Arm] = []
        self._lines: queue.SimpleQueue[tuple[Arm, str | None]] = queue.SimpleQueue()

    def run(self, name: str, clutched: bool, view: Sequence[str], seconds: float | None) -> int:
        """Take both seats, hold until one ends, and return the exit code."""
        try:
            self._take_seats(name, view)
            self._console.print("an order goes to both arms, `1 ORDER` or `2 ORDER` to one of them; Ctrl-C ends both")
            if not clutched:
                self._order("c")
            self._hold(None if seconds is None else time.monotonic() + seconds)
            while not all(arm.ended for arm in self._arms):
                self._look()
        finally:
            children = {arm.label: arm.child for arm in self._arms}
            end_all(children, children)
        return max(code if code >= 0 else 1 for code in (arm.child.returncode for arm in self._arms))

    def _take_seats(self, name: str, first_flags: Sequence[str]) -> None:
        """Take a seat for each arm, with the clutch held. Raises Problem where there are not two."""
        names = [f"{name}.1", f"{name}.2"] if name else ["", ""]
        arm = self._seat(0, names[0], first_flags)
        if not arm.seated and name and NO_SUCH_SEAT in arm.reason:
            self._console.print(f"the room has no seat {names[0]!r}: two free ones are taken")
            self._arms, names = [], ["", ""]
            arm = self._seat(0, "", first_flags)
        if arm.seated:
            arm = self._seat(1, names[1])
        if not arm.seated:
            problem = BadInput if arm.child.returncode == BadInput.exit_code else Problem
            raise problem(f"arm {arm.number} with {arm.device}: {arm.reason or 'it ended and gave no reason'}")

    def _seat(self, index: int, name: str, flags: Sequence[str] = ()) -> Arm:
        """Return an arm once it has its seat, or has ended without one. Raises Problem."""
        arm = self._start(index + 1, self._devices[index], name, flags)
        while not arm.seated and not arm.ended:
            self._look()
            if arm.observes:
                raise BadInput("this link is for observing: two arms need a player's link")
            if self._stop.reason:
                raise Problem(f"{self._stop.reason} before both arms had a seat")
            for each in self._arms:
                if each.faulty or each.over or (each.ended and each is not arm):
                    raise Problem(f"{each.label} let go before both arms had a seat: {each.reason or 'it ended'}")
        return arm

    def _start(self, number: int, device: str, name: str, flags: Sequence[str]) -> Arm:
        label = name or f"arm {number}"
        named = ["--name", name] if name else []
        columns = str(max(40, self._console.width - len(label) - 2))
        child = start_tethered(
            subprocess.PIPE,
            ["join", "-", "--device", device, *named, "--clutched", *self._flags, *flags],
            COLUMNS=columns,
        )
        arm = Arm(number, device, label, child)
        self._arms.append(arm)
        arm.order(self._target)  # by the pipe, where no other user sees a link
        threading.Thread(target=self._listen, args=[arm], daemon=True).start()
        return arm

    def _listen(self, arm: Arm) -> None:
        assert arm.child.stdout is not None
        with arm.child.stdout as lines:
            for line in lines:
                self._lines.put((arm, line.decode("utf-8", "replace").rstrip()))
        self._lines.put((arm, None))

    def _look(self) -> None:
        """Follow and show what was said, for a moment; let one arm go while the other is in a fault."""
        try:
            arm, line = self._lines.get(timeout=LOOK_EVERY_S)
        except queue.Empty:
            return
        if line is None:
            arm.child.wait()
            arm.ended = True
            return
        was_faulty = arm.faulty
        arm.follow(line)
        if arm.faulty != was_faulty:
            for other in self._arms:
                if other is not arm:
                    other.order("hold" if arm.faulty else "engage")
        if arm.seated or not line.startswith("cogrip: "):  # else it is the reason, which is told at the end
            self._console.print(f"{arm.label}: {line.removeprefix(f'{arm.label}: ')}")

    def _order(self, line: str, number: int = 0) -> None:
        """Pass an order on to arm 1 or 2; to both for 0."""
        for arm in self._arms:
            if number in (0, arm.number):
                arm.order(line)

    def _hold(self, until_s: float | None) -> None:
        """Pass orders on until one arm lets go, the time is over or somebody stops; then let both leave."""
        why = ""
        while not why:
            self._look()
            if self._stop.take_rearm():
                self._order("r")
            for line in self._stop.take_typed():
                to_one = re.fullmatch(r"([12])\s+(.+)", line)
                order, number = (to_one[2], int(to_one[1])) if to_one else (line, 0)
                if order in ("hold", "engage"):
                    self._console.print(f"{order!r} is what one arm's fault does to the other: `c` holds the clutch")
                else:
                    self._order(order, number)
            over = [arm.label for arm in self._arms if arm.over or arm.ended]
            if over:
                why = f"{over[0]} has let go: the other arm lets go and leaves as well"
            elif until_s is not None and time.monotonic() >= until_s:
                why = "--seconds are over"
            else:
                why = self._stop.reason
        self._console.print(why)
        for arm in self._arms:
            if not arm.over and not arm.ended:
                system.interrupt(arm.child)
