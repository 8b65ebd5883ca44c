"""One's own seat: a live client around a device of one's own."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from cogrip.api import frames
from cogrip.api.errors import ApiError, as_api_error
from cogrip.api.runs import OnFrame
from cogrip.cli.devices.tried_response import try_device
from cogrip.cli.session.join_target import target_of
from cogrip.cli.session.joined_device import judge_seat
from cogrip.client.loop import LiveClient
from cogrip.client.recorder import RecordedClient
from cogrip.devices.device import Capability, Device, DeviceError, Sample, check_rate
from cogrip.devices.simulated.ideal import IdealSettings, capability
from cogrip.devices.steered.steered_device import INPUT_ONLY
from cogrip.machine.stop import Stop
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire.accounts import ClientAccount
from cogrip.protocol.wire.session import ClientSession
from cogrip.results.reading.folder import client_recording
from cogrip.sim.link import LinkEmulator

Move = Callable[[float, tuple[float, ...]], Sequence[float]]
"""(time [s], force on the hand [N]) -> position [m], shape (axes,)"""
FUNCTION = "function"  # family of devices that are a function
UNTRIED = (FUNCTION, "sim", "web", "replay")  # families of devices that have no motors


class Client:
    """One person in a running session. `run` blocks until it ends; call it in a thread to go on meanwhile.

    Parameters
    ----------
    target
        The join link that the server printed, or HOST:PORT of an unencrypted server on this machine.
    device
        What the person holds: a `Device`, or what `device_of` returns.
    name
        Seat to take; the first free one if not given.
    seconds
        Leave after this time.
    on_frame
        Called once a network frame, inside the loop: it has to return within a fraction of a tick, 1 ms at 1024 Hz.
    folder
        Existing folder for the recording; None to record nothing.
    say
        Called with each line that `cogrip join` would print.
    trial
        Try the device's motors before the seat is taken, as `cogrip join` does: `False` leaves it out. What has no motors (what
        `device_of` returns, a simulated device, one that is input only) is not tried.
    """

    def __init__(
        self, target: str, device: Device, *, name: str = "", seconds: float | None = None, on_frame: OnFrame | None = None,
        folder: str | Path | None = None, say: Callable[[str], None] = lambda text: None, trial: bool = True,
    ) -> None:  # fmt: skip
        self._target, self._device, self._name, self._seconds = target, device, name, seconds
        self._on_frame, self._folder, self._say = on_frame, folder, say
        self._trial = trial
        self._stop = Stop()

    def stop(self) -> None:
        """Release the hand and leave; `run` then returns. Any thread may call it."""
        self._stop.reason = "stopped by its program"

    def run(self) -> ClientAccount:
        """Hold the object until the session ends, and return the account of this end. Raises ApiError."""
        say, address = self._say, f"{self._device.capability.family}:{self._device.capability.model}"
        with as_api_error():
            target = target_of(self._target, "", False, self._name, "")
            tried = self._try_motors(address)
            paths = target.paths(insecure=False)
            live = LiveClient(
                self._device, target.player(self._device.capability, address), paths, self._stop, say, LinkEmulator,
                self._record_at, self._seconds, judge=lambda seat, record: judge_seat(address, False, say, seat, record),
                each_frame=self._each_frame if self._on_frame else None, trial=tried,
            )  # fmt: skip
            try:
                ended = live.run()
            finally:
                paths.close()
        if isinstance(ended, ClientSession):
            raise ApiError("this link is for observing: give a player's link, or watch with Session(on_frame=...)")
        if ended.failed:
            raise ApiError(ended.failed)
        return ended.account

    def _try_motors(self, address: str) -> str:
        """Return what a trial of the motors found, "" of a device that has none. Raises Problem where one is refused."""
        record = self._device.capability
        if record.family in UNTRIED or record.model == INPUT_ONLY:
            return ""
        return try_device(self._device if self._trial else None, address, self._say, "trial=False", real=True)

    def _each_frame(self, core: RecordedClient, number: int) -> None:
        if self._on_frame:
            self._on_frame(frames.of_client(core, number))

    def _record_at(self, seat: SeatSettings) -> Path | None:
        return None if self._folder is None else Path(self._folder) / client_recording(seat.user)


def device_of(move: Move, axes: int = 1, **limits: Any) -> Device:
    """Return a device that is a function of time and of the force on it.

    Parameters
    ----------
    move
        Called each tick with the time since `open` [s] and the force F on the hand [N], shape (axes,): the device pushes
        with -F. Returns the position [m].
    axes
        1 to 3.
    limits
        Fields of `Capability` that differ from those of `sim:ideal`: `peak_force_n=3.0`, `speed_mps=0.5`. A
        `peak_force_n` without `continuous_force_n` is both.
    """
    base = capability(IdealSettings(), axes)
    record = replace(base, family=FUNCTION, model=getattr(move, "__name__", "device"), gives_velocity=False)
    if "peak_force_n" in limits:
        limits.setdefault("continuous_force_n", limits["peak_force_n"])
    try:
        return _FunctionDevice(move, replace(record, **limits))
    except (TypeError, DeviceError) as error:
        raise ApiError(str(error)) from None


class _FunctionDevice:
    """A device whose place is computed."""

    def __init__(self, move: Move, record: Capability) -> None:
        self.capability = record
        self.counts: Mapping[str, int] = {}
        self._move = move
        self._rate_hz = 0
        self._force: tuple[float, ...] = (0.0,) * record.axes

    def open(self, rate_hz: int) -> None:
        if self._rate_hz:
            raise DeviceError("function: is open already; close it first")
        check_rate(rate_hz, self.capability, "function")
        self._rate_hz = rate_hz

    def read(self, tick: int) -> Sample | None:
        if not self._rate_hz:
            raise DeviceError("function: read while it is closed; call open(rate_hz) first")
        return Sample(tuple(map(float, self._move(tick / self._rate_hz, self._force))), None)

    def write(self, force_n: Sequence[float]) -> None:
        if not self._rate_hz:
            raise DeviceError("function: write while it is closed; call open(rate_hz) first")
        self._force = tuple(force_n)

    def close(self) -> None:
        self._rate_hz = 0
        self._force = (0.0,) * self.capability.axes
