"""The base of emulated firmwares: bytes in, bytes out, a watchdog, and verbs for a person beside the device."""

from abc import ABC, abstractmethod

from cogrip.devices.emulated.faults import Faults
from cogrip.devices.emulated.mechanics import Mechanics

JUMP_COUNTS = 400
STEP_NS = 2_000_000  # longest step of time, so that a watchdog lets go on time also where nobody looks for long


class Firmware(ABC):
    """A firmware without I/O, in its own time. Requests go into `receive`, replies come out of `due`."""

    def __init__(self, mechanics: Mechanics, faults: Faults) -> None:
        self.mechanics = mechanics
        self.faults = faults
        self.now_ns = 0
        self.plugged = True
        self.plugging = 1  # how often it was plugged in: names this plugging-in
        self._begun_ns: int | None = None  # the hand takes hold when the host first speaks
        self._stuck = False

    @abstractmethod
    def take(self, data: bytes) -> None:
        """Bytes (or one report) from the host, now."""

    @abstractmethod
    def tick(self) -> None:
        """Time has passed: watchdogs."""

    @abstractmethod
    def stop_motors(self) -> None:
        """Motors off, nothing half received: as after power-up."""

    def connect(self) -> None:  # noqa: B027 (most firmwares say nothing)
        """A program opens the wire."""

    def receive(self, data: bytes, now_ns: int) -> None:
        if self._begun_ns is None:
            self._begun_ns = now_ns
        self.advance(now_ns)
        if self.plugged and not self.faults.on("deaf", now_ns):
            self.take(data)

    def advance(self, now_ns: int) -> None:
        """Mechanics and watchdogs up to now."""
        while self.now_ns < now_ns:
            self._step(now_ns if self._begun_ns is None else min(now_ns, self.now_ns + STEP_NS))

    def _step(self, now_ns: int) -> None:
        self.now_ns = now_ns
        if self._begun_ns is not None:
            self.mechanics.advance(now_ns - self._begun_ns)
        self.mechanics.reversed = self.faults.on("reversed", now_ns)
        self.tick()
        if self.plugged and self.faults.on("unplug", now_ns):
            self.unplug()
        if self._stuck and not self.faults.on("stuck", now_ns):
            self._stuck = False
            self.mechanics.unstick()

    def due(self, now_ns: int) -> list[bytes]:
        """Return the bytes that have reached the host by now."""
        return self.faults.due(now_ns) if self.plugged else []

    def fault(self, verb: str, seconds: float = float("inf")) -> None:
        """Let something go wrong from now on. Raises ValueError for what is no verb."""
        until_ns = self.now_ns + seconds * 1e9
        self.faults.start(verb, until_ns)
        if verb == "jump":
            self.faults.stop("jump")
            self.mechanics.slip(0, JUMP_COUNTS)
        elif verb == "stuck":
            self._stuck = True
            self.mechanics.stick()
        elif verb == "unplug":
            self.unplug()

    def mend(self) -> None:
        """Every fault ends; a device that was unplugged is plugged in again, with its counters at zero where the arm is."""
        for verb in self.faults.running:
            self.faults.stop(verb)
        if self._stuck:
            self._stuck = False
            self.mechanics.unstick()
        if not self.plugged:
            self.plugged = True
            self.plugging += 1
            self.mechanics.load((0.0, 0.0, 0.0))

    def unplug(self) -> None:
        """The wire carries the power too: motors off, replies lost."""
        self.plugged = False
        self.faults.clear()
        self.stop_motors()

    def press(self) -> None:
        """The calibrate button on the board."""
        self.mechanics.load((0.0, 0.0, 0.0))
