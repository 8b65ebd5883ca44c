"""The shell that makes a `Device` of a plant and a hand: state of the connection, ticks, the held force."""

from collections.abc import Callable, Sequence
from math import inf, isfinite
from typing import Protocol

from cogrip.devices.device import Capability, Sample
from cogrip.devices.driver import Driver
from cogrip.devices.settings import fit_axes
from cogrip.devices.simulated.hands import Hand
from cogrip.devices.simulated.presses import Press
from cogrip.machine.addition import add_integers


class Plant(Protocol):
    """A machine in somebody's hand. Position [m] and velocity [m/s] are the true ones, shape (axes,)."""

    position_m: list[float]
    velocity_mps: list[float]

    def open(self, rate_hz: int, stiffness_npm: float, damping_nspm: float, start_m: Sequence[float]) -> None:
        """Rest at `start_m`, discretised for `rate_hz` with the hand's stiffness and damping. May raise DeviceError."""

    def release(self) -> None:
        """Go on without a hand: nothing of its impedance acts any more."""

    def step(self, drive_n: Sequence[float], force_n: Sequence[float]) -> None:
        """One tick with the hand's drive K_h x_int + B_h v_int + F_push [N] and the device force F [N] held."""

    def sense(self) -> Sample:
        """Return the present reading of the machine's sensors."""


class SimulatedDevice(Driver):
    """A `Device` in virtual time. At tick 0 the plant rests at its start; tick k is k steps of exactly 1/rate_hz later.

    read(k) gives the state at tick k; the force written after it is held to the next write, as is the hand's drive of
    each tick over that tick. Reading one tick again gives the same sample.
    """

    def __init__(
        self,
        capability: Capability,
        plant: Plant,
        hand: Hand,
        start_m: Sequence[float] = (),
        presses: Sequence[Press] = (),
        let_go_s: float = inf,
    ) -> None:
        """`start_m` [m]: where device and hand begin; empty: at 0, or where the hand's motion begins.

        let_go_s: time of the hand from which on nobody holds the device [s]
        """
        super().__init__(f"{capability.family}:{capability.model}", capability.axes)
        self.capability = capability
        self.plant = plant
        self.hand = hand
        self.presses = presses
        self._spans: list[range] = []  # ticks in which each lasts
        self._start_m = fit_axes(start_m, capability.axes, "x0_m") if start_m else None
        self._force: Sequence[float] = self._zero
        self._let_go_s = let_go_s
        self._last_held: float = inf  # last tick of the hand's own time in which it holds the device
        self._begins, self._waits = 0, False  # tick at which the hand's own time begins; it is still to come

    @property
    def plant(self) -> Plant:
        """The machine."""
        return self._plant

    @plant.setter
    def plant(self, plant: Plant) -> None:
        self._plant, self._step, self._sense = plant, plant.step, plant.sense  # what each tick calls

    @property
    def hand(self) -> Hand:
        """The person."""
        return self._hand

    @hand.setter
    def hand(self, hand: Hand) -> None:
        self._hand = hand
        self._drive: Callable[[int], Sequence[float]] = hand.drive

    @property
    def position_m(self) -> tuple[float, ...]:
        """True position [m], whatever the sensors say."""
        return tuple(self.plant.position_m)

    @property
    def velocity_mps(self) -> tuple[float, ...]:
        """True velocity [m/s]."""
        return tuple(self.plant.velocity_mps)

    @property
    def force_n(self) -> tuple[float, ...]:
        """The device force F [N] held now, as written."""
        return tuple(self._force)

    @property
    def buttons(self) -> int:
        """Buttons that are down now, one bit each."""
        now = self._tick - self._begins
        down = {press.button for press, span in zip(self.presses, self._spans, strict=True) if now in span}
        return add_integers([1 << button - 1 for button in down])

    def open(self, rate_hz: int) -> None:
        """Reads the hand's recording, if it has one: raises DeviceError when that is not usable."""
        self._check_open(rate_hz, self.capability)
        start = self.hand.open(rate_hz, self._start_m)
        for axis, (at, (low, high)) in enumerate(zip(start, self.capability.workspace_m, strict=False)):
            if not low <= at <= high:
                raise self._error(
                    f"starts at {at} m on axis {axis}, outside its workspace {low} to {high} m; set x0_m inside it, "
                    "or origin=start for a recording"
                )
        self.plant.open(rate_hz, self.hand.stiffness_npm, self.hand.damping_nspm, start)
        self._spans = [press.ticks(rate_hz) for press in self.presses]
        self._force, self._tick, self._open = self._zero, 0, True
        self._begins, self._waits = 0, False
        self._last_held, self._drive = self._let_go_s * rate_hz - 1.0, self._hand.drive

    def wait(self) -> None:
        """Hold the hand where it begins, until `begin`. To be called once open."""
        self._waits = True

    def begin(self) -> None:
        """Begin the hand's motion, and its presses, at the present tick."""
        self._waits = False

    def read(self, tick: int) -> Sample:
        if not self._open:
            self._need_open("read")
        last = self._tick
        if tick != last:
            if tick < last:
                raise self._fallen(tick)
            step, drive, force, begins, last_held = self._step, self._drive, self._force, self._begins, self._last_held
            for k in range(last, tick):
                at = 0 if self._waits else k - begins
                if at > last_held:
                    drive, last_held = self._let_go(len(drive(at))), inf
                step(drive(at), force)
            self._tick = tick
            if self._waits:
                self._begins = tick
        sample = self._sense()
        return sample.replaced(buttons=self.buttons) if self._spans else sample

    def _let_go(self, entries: int) -> Callable[[int], Sequence[float]]:
        """Have nobody hold the plant any more. Return the drive of nobody, of so many entries."""
        nothing = (0.0,) * entries
        self._last_held, self._drive = inf, lambda tick: nothing
        self.plant.release()
        return self._drive

    def write(self, force_n: Sequence[float]) -> Sequence[float] | None:
        if not self._open:
            self._need_open("write")
        if len(force_n) != self._axes:
            raise self._wrong_force(force_n)
        total = 0.0
        for part in force_n:
            total += part
        if not isfinite(total) and not all(map(isfinite, force_n)):
            raise self._wrong_force(force_n, f"; the held force stays {self.force_n}")
        self._force = tuple(force_n)
        return None

    def close(self) -> None:
        """Position and velocity stay readable for whoever inspects the plant."""
        self._force = self._zero
        self._open = False
