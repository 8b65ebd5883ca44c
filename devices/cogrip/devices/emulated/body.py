"""An arm's tip in somebody's hand, in its own time: a simulated machine of three axes, stepped finely."""

from cogrip.devices.arm.kinematics import Vector
from cogrip.devices.simulated.device import SimulatedDevice
from cogrip.devices.simulated.hands import Hand

STEP_HZ = 4096


class Body:
    """Time 0 is when it was made; `advance` only goes forward."""

    def __init__(self, machine: SimulatedDevice, step_hz: int = STEP_HZ) -> None:
        self._machine = machine
        self._step_hz = step_hz
        self._tick = 0
        machine.open(step_hz)

    @property
    def hand(self) -> Hand:
        """Return who holds the tip; its ticks are of 1 / STEP_HZ."""
        return self._machine.hand

    @property
    def position_m(self) -> Vector:
        """True position of the tip [m]."""
        x, y, z = self._machine.position_m
        return x, y, z

    def advance(self, now_ns: int) -> None:
        tick = now_ns * self._step_hz // 1_000_000_000
        if tick > self._tick:
            self._tick = tick
            self._machine.read(tick)

    def carry(self, position_m: Vector) -> None:
        """Somebody carries the tip there, and it rests; what holds it pulls it back from then on."""
        self._machine.plant.position_m = list(position_m)
        self._machine.plant.velocity_mps = [0.0, 0.0, 0.0]

    def push(self, force_n: Vector) -> None:
        """The motors push the hand with this force [N] from now on."""
        x, y, z = force_n
        self._machine.write((-x, -y, -z))  # a device's force F loads the hand: it pushes with -F
