"""`cogrip devices conform`: the conformance suite on one device, for authors of drivers."""

from cogrip.cli.devices.opened_arm import wait_for_enter
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput, Problem, within
from cogrip.devices.conformance import CHECKS, Subject, UnfitError
from cogrip.devices.device import Device, DeviceError, defects_named
from cogrip.devices.registry import axes_of, is_input_only, is_real, make, record_of
from cogrip.devices.response import most_push_n
from cogrip.machine.platform import time
from cogrip.protocol.settings.rates import due_ns

PUSH_N = 0.2  # largest push on a real device
MOVED_BY_NOBODY = ("replay:", "web:")  # schemes that no hand moves: a recording, or a mass in a page
PLANT_PUSH_N = 1.0  # largest push on a simulated machine, which takes any force: more would tear its hand off


def device_conform(address: str, /, *, axes: int | None = None, rate_hz: int = 1024, yes: bool = False) -> int:
    """Run the conformance suite on one device.

    That is `cogrip.devices.conformance`; a real device is only pushed gently. Exit code 0 when all promises are kept.

    Parameters
    ----------
    address
        Device address (`cogrip devices`).
    axes
        Count of axes; all it has if not given.
    rate_hz
        Rate of the loop.
    yes
        Do not ask whether a real device is free.
    """
    console = make_console(soft_wrap=True)
    with BadInput.of(DeviceError):
        count = axes_of(address) if axes is None else axes
        device = make(address, axes=count)
        real = is_real(address)
    _try(device, address, rate_hz)
    yields = not is_input_only(address) and not address.startswith(MOVED_BY_NOBODY)
    knows = not real and hasattr(device, "force_n")
    subject = Subject(
        lambda: make(address, axes=count), rate_hz, Clock(rate_hz).wait if real else lambda tick: None,
        (lambda held: held.force_n) if knows else None,  # type: ignore[attr-defined]
        PUSH_N if real else PLANT_PUSH_N if address.startswith("sim:") else float("inf"),
        time.monotonic_ns if real else None,
        yields,
    )  # fmt: skip
    if real and not yes:
        most_n = max(PUSH_N, most_push_n(device.capability)) if yields else PUSH_N
        wait_for_enter(
            console, f"Nobody holds the device, it is in mid-range; it is pushed with at most {most_n:.2g} N."
        )
    broken = 0
    for check in CHECKS:
        try:
            check(subject)
        except (UnfitError, DeviceError) as error:
            broken += 1
            console.print(f"✗ {check.__name__}: {error}")
        except Exception as error:  # noqa: BLE001 (a driver's author has to see it)
            broken += 1
            found = f"{type(error).__name__}: {error}"
            console.print(f"✗ {check.__name__}: only DeviceError may be raised, not {found}")
        else:
            console.print(f"✓ {check.__name__}")
    console.print(f"{len(CHECKS) - broken} of {len(CHECKS)} promises kept")
    return 1 if broken else 0


def _try(device: Device, address: str, rate_hz: int) -> None:
    """Open and close the device. Raises BadInput, or Problem."""
    with Problem.of(DeviceError):
        within("--rate-hz", rate_hz, 1, record_of(device, address).rate_hz)
        with defects_named(repr(address), "open"):
            device.open(rate_hz)
        with defects_named(repr(address), "close"):
            device.close()


class Clock:
    """Clock of a loop that begins anew with every tick 0."""

    def __init__(self, rate_hz: int) -> None:
        self._rate_hz = rate_hz
        self._start_ns = time.monotonic_ns()

    def wait(self, tick: int) -> None:
        """Wait until a tick is due."""
        if tick == 0:
            self._start_ns = time.monotonic_ns()
        rest_ns = due_ns(self._start_ns, tick, self._rate_hz) - time.monotonic_ns()
        if rest_ns > 0:
            time.sleep(rest_ns * 1e-9)

    def newest(self, tick: int) -> int:
        """Wait, and return the newest tick that is due then, which is a later one after a stall."""
        self.wait(tick)
        return max(tick, (time.monotonic_ns() - self._start_ns) * self._rate_hz // 10**9)
