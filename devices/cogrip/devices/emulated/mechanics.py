"""Between the tip of an emulated arm and its electronics: where its encoders stand, what its motors push with.

The way round that no driver goes: the inverse kinematics, and its own slopes for the forces (F = (d theta / d x)^T tau).
"""

from collections.abc import Sequence

from cogrip.devices.arm.kinematics import Matrix
from cogrip.devices.arm.model import ArmModel
from cogrip.devices.simulated.hands import Hand
from cogrip.devices.simulated.simulated_device import SimulatedDevice
from cogrip.machine.rows import Vector

STEP_M = 1e-5  # step of the difference quotients that give the slopes
STEP_HZ = 4096  # rate of the body's steps


class HeldTip:
    """The arm's tip in somebody's hand: a simulated machine of three axes, stepped finely. Time 0 is when it was made."""

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

    @property
    def buttons(self) -> int:
        """Buttons that the hand holds down, one bit each."""
        return self._machine.buttons

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


class Mechanics:
    """Motors and encoders of one arm. powered_at_m: where the tip was when the counters began, the home pose if not given."""

    def __init__(self, model: ArmModel, body: HeldTip, powered_at_m: Vector | None = None) -> None:
        self.model = model
        self.body = body
        self.force_n: Vector = (0.0, 0.0, 0.0)  # what the motors push the hand with
        self.weight_n: Vector = (0.0, 0.0, 0.0)  # and what the arm's own weight does
        self.peak_force_n = 0.0
        self.reversed = False  # fault: motor a is wired the wrong way round
        self.currents_ma: Vector = (0.0, 0.0, 0.0)
        self._angles: Vector = (0.0, 0.0, 0.0)
        self._sloped: tuple[Vector, Matrix] | None = None  # the newest slopes, and where they are of
        self._zero: Vector = model.home_counts
        self._travel = [0.0, 0.0, 0.0]
        self._frozen: dict[int, int] = {}
        self._slip = [0, 0, 0]
        self._follow()
        self._travel = [0.0, 0.0, 0.0]
        if powered_at_m is not None:
            angles = model.kinematics.inverse(powered_at_m)
            if angles is None:
                raise ValueError(f"no arm can stand at {powered_at_m} m")
            self._zero = model.drive.counts(angles)

    def advance(self, now_ns: int) -> None:
        """The motors push with the same currents, wherever the arm goes, until now."""
        self.body.advance(now_ns)
        self._follow()
        self.drive(self.currents_ma)

    def _follow(self) -> None:
        angles = self.model.kinematics.inverse(self.body.position_m)
        if angles is not None:  # else the links are stretched: the joints stand at their stops
            self._travel = [
                sense + abs(new - old) for sense, new, old in zip(self._travel, angles, self._angles, strict=True)
            ]
            self._angles = angles

    @property
    def counters(self) -> tuple[int, int, int]:
        """The counters as the firmware reads them."""
        a, b, c = (
            self._frozen.get(joint, round(count - zero) + slip)
            for joint, (count, zero, slip) in enumerate(
                zip(self.model.drive.counts(self._angles), self._zero, self._slip, strict=True)
            )
        )
        return a, b, c

    @property
    def home_m(self) -> Vector:
        """Position of the tip in the home pose [m]."""
        home = self.model.kinematics.forward(self.model.drive.angles(self.model.home_counts))
        assert home is not None
        return home

    def carry(self, position_m: Vector) -> None:
        """Somebody carries the tip there."""
        travel = self._travel
        self.body.carry(position_m)
        self._follow()
        self._travel = travel

    def load(self, counters: Vector) -> None:
        """The firmware sets its counters."""
        a, b, c = (count - there for count, there in zip(self.model.drive.counts(self._angles), counters, strict=True))
        self._zero = (a, b, c)
        self._slip = [0, 0, 0]
        self._frozen.clear()

    def slip(self, joint: int, counts: int) -> None:
        """Fault: an encoder jumps."""
        self._slip[joint] += counts

    def stick(self) -> None:
        """Fault: the encoder of the joint that has moved most gives no pulses any more."""
        joint = self._travel.index(max(self._travel))
        self._frozen[joint] = self.counters[joint]

    def unstick(self) -> None:
        """They are counted again from where they stood: what was missed is missed."""
        for joint, stood in self._frozen.copy().items():
            del self._frozen[joint]
            self._slip[joint] += stood - self.counters[joint]

    def drive(self, currents_ma: Vector) -> None:
        """Currents flow; the tip is pushed by what they make of torque, and by the arm's weight."""
        self.currents_ma = currents_ma
        a, b, c = currents_ma
        flowing = (-a, b, c) if self.reversed else currents_ma
        self.force_n = self._at_the_tip(self.model.drive.torque(flowing)) if any(currents_ma) else (0.0, 0.0, 0.0)
        holding = self.model.kinematics.gravity(self._angles)
        self.weight_n = self._at_the_tip([-torque for torque in holding]) if any(holding) else (0.0, 0.0, 0.0)
        (fx, fy, fz), (wx, wy, wz) = self.force_n, self.weight_n
        self.peak_force_n = max(self.peak_force_n, (fx * fx + fy * fy + fz * fz) ** 0.5)
        self.body.push((fx + wx, fy + wy, fz + wz))

    def _at_the_tip(self, torque: Sequence[float]) -> Vector:
        at = self.body.position_m
        if self._sloped is None or self._sloped[0] != at:
            self._sloped = at, self._slopes(at)
        ta, tb, tc = torque
        (xa, xb, xc), (ya, yb, yc), (za, zb, zc) = self._sloped[1]
        return (
            0.0 + xa * ta + xb * tb + xc * tc,  # 0.0: never -0.0
            0.0 + ya * ta + yb * tb + yc * tc,
            0.0 + za * ta + zb * tb + zc * tc,
        )

    def _slopes(self, position_m: Vector) -> Matrix:
        """(d theta / d x)^T: what each joint turns by along each axis; 0 along an axis on which the links are stretched."""
        x, y, z = position_m
        inverse = self.model.kinematics.inverse
        rows: list[Vector] = []
        for dx, dy, dz in ((STEP_M, 0.0, 0.0), (0.0, STEP_M, 0.0), (0.0, 0.0, STEP_M)):
            ahead, behind = inverse((x + dx, y + dy, z + dz)), inverse((x - dx, y - dy, z - dz))
            if ahead is None or behind is None:
                rows.append((0.0, 0.0, 0.0))
                continue
            a, b, c = ((new - old) / (2.0 * STEP_M) for new, old in zip(ahead, behind, strict=True))
            rows.append((a, b, c))
        return rows[0], rows[1], rows[2]
