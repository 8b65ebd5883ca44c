"""`cogrip devices wizard`: from what is plugged in to an address in a settings file, step by step."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, TypeVar

from cyclopts import Parameter
from rich.console import Console

from cogrip.cli.devices.calibrate import device_calibrate
from cogrip.cli.devices.check import device_check
from cogrip.cli.devices.conform import TickClock
from cogrip.cli.devices.device_setting import placed, starting_text
from cogrip.cli.devices.listing import handle_words
from cogrip.cli.devices.opened_arm import drop_early_lines, termination_raised
from cogrip.cli.devices.tried_response import try_response
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.cli.terminal.tables import say
from cogrip.cli.terminal.typed_line import typed_line
from cogrip.client.hand.velocity import largest_impedance
from cogrip.devices import trial
from cogrip.devices.arm.driver import ArmDevice
from cogrip.devices.device import Device, DeviceError, Sample, defects_named
from cogrip.devices.io.plugged_in import FINDERS
from cogrip.devices.registry import axes_of, is_input_only, is_real, make, record_of
from cogrip.machine.realtime import engage, release

SIGN = "the sign of "
STEPS = ("device", "who it is", "check", "calibration", "signs of its axes", "felt stiffness", "settings file")
SHOWN_TICKS = trial.RATE_HZ // 16
CLOSE = 0.1  # relative difference of the felt from the asked stiffness above which it is told
SKIP, LEAVE = "s", "q"
_Answer = TypeVar("_Answer")


def device_wizard(
    address: str = "",
    /,
    *,
    settings: Path | None = None,
    name: str = "",
    unfit: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Set up a device step by step: find, check, calibrate, try, write its address into a settings file.

    The trials are short and weak: without force for the signs, then a spring of at most 200 N/m and 1 N. Answers are lines:
    Enter goes on, s skips a step, q leaves; at a terminal an Enter from before its question starts no force. It stops at a
    check that finds the arm not fit to be held. Exit code 0 when nothing that was tried is wrong.

    Parameters
    ----------
    address
        Device address (`cogrip devices`); chosen from what is plugged in if not given.
    settings
        Settings file for the address, made if it is not there; asked for if not given.
    name
        The person in the settings whose device it is; the first if not given.
    unfit
        Go on with an arm that the check found not fit to be held: its spring may push otherwise than it should.
    """
    wizard = _Wizard(make_console(), unfit)
    try:
        return wizard.run(address, settings, name)
    except _Left as why:
        wizard.tell(str(why))
        return 1


class _Left(Exception):  # noqa: N818 (somebody wants to leave)
    """An answer of q, or an arm that is not fit to be held."""


class _Wizard:
    """The steps. wrong: what was found that is not as it should be."""

    def __init__(self, console: Console, unfit: bool) -> None:
        self._console = console
        self._unfit = unfit
        self.wrong: list[str] = []

    def tell(self, text: str) -> None:
        say(self._console, text)

    def _step(self, number: int) -> None:
        self._console.print(f"\n{number} of {len(STEPS)}  {STEPS[number - 1]}", style="bold")

    def _ask(self, text: str) -> str:
        """Return the answer. Raises _Left, or Problem where nobody answers."""
        say(self._console, text)
        self._console.print("> ", end="")
        try:
            answer = typed_line().strip()
        except EOFError:
            raise Problem("nobody is there to answer: run it at a terminal, or give its answers as lines") from None
        if answer == LEAVE:
            raise _Left("left; nothing more was changed")
        return answer

    def _wanted(self, text: str, *, force: bool = False) -> bool:
        """Return whether a step is wanted. force: the motors push in it, so only an answer to this very question counts."""
        if force:
            drop_early_lines()
        return self._ask(f"{text} Enter to go on, {SKIP} to skip, {LEAVE} to leave.") != SKIP

    def run(self, address: str, settings: Path | None, name: str) -> int:
        self._step(1)
        address = address or self._chosen()
        with BadInput.of(DeviceError):
            device = make(address, axes=axes_of(address))
        self._step(2)
        self._introduce(device, address)
        self._step(3)
        self._check(device, address)
        self._step(4)
        self._calibrate(device, address)
        for number, part in ((5, self._signs), (6, self._spring)):
            self._step(number)
            with Problem.of(DeviceError), termination_raised():
                part(address)
        self._step(7)
        self._write(address, settings, name)
        self.tell(f"not as it should be: {'; '.join(self.wrong)}" if self.wrong else "nothing that was tried is wrong")
        return 1 if self.wrong else 0

    def _chosen(self) -> str:
        """Return the address of what is plugged in, or of what is typed."""
        found = []
        for what, finder in FINDERS.items():
            try:
                found += [each for each in finder() if each.address]
            except DeviceError as error:
                self.tell(f"{what}: {error}")
        for number, each in enumerate(found, 1):
            self.tell(f"{number}  {each.address}  {each.text}")
        if not found:
            self.tell("none found; on Linux a device needs a udev rule (configs/99-cogrip.rules)")
        while True:
            answer = self._ask("Which one? Its number, or any address of `cogrip devices list`.")
            if answer.isdigit() and 1 <= int(answer) <= len(found):
                return found[int(answer) - 1].address
            if ":" in answer:
                return answer
            self.tell(f"{answer!r} is neither a number from 1 to {len(found)} nor an address, such as sim:phantom")

    def _introduce(self, device: Device, address: str) -> None:
        with Problem.of(DeviceError):
            record = record_of(device, address)
        size = " x ".join(f"{1e3 * (high - low):.0f}" for low, high in record.workspace_m)
        self.tell(f"{address}: {record.family}, {record.model}, {record.axes} axes, {size} mm")
        if handle := handle_words(record):
            self.tell(f"its handle has {', '.join(handle)}")
        if is_input_only(address):
            self.tell("input only: no force reaches the hand; it moves a simulated mass")
        else:
            self.tell(f"force at most {record.peak_force_n:.3g} N, {record.continuous_force_n:.3g} N for long")

    def _check(self, device: Device, address: str) -> None:
        if not isinstance(device, ArmDevice):
            self.tell("left out: only arms on serial: and hid: are pushed by `cogrip devices check`")
            return
        if not device.has_watchdog:
            self.tell("left out: its firmware has no watchdog, so `cogrip devices check` does not push it")
            return
        text = "Put the arm in mid-range, take your hands off it, keep one at the power switch."
        if not self._wanted(text, force=True) or device_check(address, moving_s=0.0, yes=True) == 0:
            return
        self.wrong.append("the check")
        if not self._unfit:
            raise _Left(
                "stopped before the trials, and nothing was written: mend what the check names; --unfit goes on"
            )

    def _calibrate(self, device: Device, address: str) -> None:
        if not isinstance(device, ArmDevice):
            self.tell("left out: it knows its pose, or its maker's tools do")
        elif self._wanted("Put the arm into its home pose (docs/devices.md) and hold it still."):
            device_calibrate(address, yes=True)

    def _signs(self, address: str) -> None:
        """Ask for a motion along each axis. Raises DeviceError."""
        axes = min(len(trial.AXES), axes_of(address))
        if not self._wanted(
            f"No force flows. For each of {axes} axes, move the tip as asked within {trial.SIGN_S:.0f} s."
        ):
            return
        for axis in range(axes):
            self._ask(f"Hold the tip in the middle. After Enter move it 3 cm {trial.TOWARD[axis]}.")
            found = self._held(address, trial.watch)
            name = trial.AXES[axis]
            if found is None:
                self.tell(f"{name}: it was not moved, so its sign is not known")
            elif found.is_right(axis):
                self.tell(f"{name}: grows {trial.TOWARD[axis]}, as it should")
            else:
                seen = f"{'-' if found.sense < 0 else '+'}{trial.AXES[found.axis]}"
                self.tell(
                    f"{name}: moved {trial.TOWARD[axis]} the device says {seen}: see the key dir in docs/devices.md"
                )
                self.wrong.append(f"{SIGN}{name}")

    def _spring(self, address: str) -> None:
        """Let the person feel a spring. Raises DeviceError."""
        if is_input_only(address):
            self.tell("left out: no force reaches the hand")
            return
        if any(text.startswith(SIGN) for text in self.wrong):
            self.tell("left out: with a wrong sign a spring may push away; mend the signs first")
            return
        if self._wanted("Let go of it in mid-range: small forces push it to and fro, an axis at a time.", force=True):
            if found := try_response(address):
                self.tell(f"it does not move as its record says: {'; '.join(found)}")
                self.wrong.append("its motion under force")
                if not self._unfit:
                    self.tell("the spring is left out; mend that first, or go on with --unfit")
                    return
            else:
                self.tell("it moves along its own axes, the right way, by what its record says, and on time")
        text = f"A weak spring holds the tip for {trial.SPRING_S:.0f} s: move it to and fro by a few millimetres."
        if not self._wanted(text, force=True):
            return
        felt = self._held(address, trial.feel)
        if felt.ended:
            self.wrong.append(f"the spring let go: {felt.ended}")
        if not felt.felt_npm:
            self.tell(f"it was moved by {1e3 * felt.most_m:.1f} mm only: nothing can be said")
            return
        self.tell(
            f"asked for {felt.asked_npm:.0f} N/m, given {felt.felt_npm:.0f} N/m over {1e3 * felt.most_m:.1f} mm, at most "
            f"{felt.most_n:.2f} N"
        )
        if abs(felt.felt_npm / felt.asked_npm - 1.0) > CLOSE:
            self.wrong.append("the stiffness")

    def _held(self, address: str, run: Callable[[Device, trial.Clock, trial.Show], _Answer]) -> _Answer:
        """Return the answer of a trial on the device, opened anew. Raises DeviceError."""
        device = make(address, axes=axes_of(address))
        real = is_real(address)
        clock: trial.Clock = TickClock(trial.RATE_HZ).newest if real else lambda tick: tick
        seen = 0

        def show(sample: Sample) -> None:
            nonlocal seen
            seen += 1
            if seen % SHOWN_TICKS == 1 and self._console.is_terminal:
                places = zip(trial.AXES, sample.position_m, strict=False)
                text = "  ".join(f"{name} {1e3 * at:+z7.1f} mm" for name, at in places)
                self._console.file.write(f"\r{text} ")  # the console itself would leave out what is no text
                self._console.file.flush()

        with defects_named(repr(address), "open"):
            device.open(trial.RATE_HZ)
        measures = engage(["gc-frozen", "fifo"]) if real else []
        try:
            return run(device, clock, show)
        finally:
            device.close()
            release(measures)
            if self._console.is_terminal:
                self._console.print()

    def _write(self, address: str, settings: Path | None, name: str) -> None:
        if settings is None:
            answer = self._ask(f"Settings file to write the address into; a new one is made; {SKIP} for none.")
            if answer in ("", SKIP):
                self.tell(f"not written; use it as --device '{address}'")
                return
            settings = Path(answer)
        with Problem.of_files(settings, doing="cannot be read or written: "):
            text = settings.read_text(encoding="utf-8") if settings.exists() else starting_text()
            with Problem.of(DeviceError):
                record = record_of(make(address, axes=axes_of(address)), address)
            carried = largest_impedance(record, 1.0 / trial.RATE_HZ).impedance_nspm
            new, person, own = placed(text, name, address, str(settings), carried)
            settings.write_text(new, encoding="utf-8")
        if own is not None:
            self.tell(f"the device carries {carried:.3g} N s/m: {person} gets impedance_nspm = {own:g}")
        self.tell(f"{settings}: the device of {person} is {address}; start with `cogrip demo {settings}`")
