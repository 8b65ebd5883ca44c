"""`sim:gripper`: the arm of `sim:phantom` with a gripper that has force, in a hand whose fingers close, hold and open.

The opening is the axis behind the places: one axis of a `PhantomPlant` of its own, between finger and thumb. The fingers are an
impedance as the hand is (`hands`), whose intended opening goes from open_m to squeeze_m and back.
"""

from collections.abc import Sequence
from dataclasses import replace

from msgspec.structs import replace as with_values

from cogrip.devices.device import Capability, DeviceError, Gripper, Sample
from cogrip.devices.settings import Finite, NotNegative, Positive
from cogrip.devices.simulated.hands import DirectedHand, Hand, ImpedanceSettings, ReachSettings, reach_course
from cogrip.devices.simulated.ideal import ADVISED_AT_HZ
from cogrip.devices.simulated.phantom import PhantomPlant, PhantomSettings
from cogrip.devices.simulated.phantom import capability as phantom_record
from cogrip.devices.simulated.simulated_device import Plant
from cogrip.machine.rows import Row
from cogrip.protocol.axes import GRIP_AXES, PLACES

GRIP_M = (0.0, 0.03)  # opening at the end stops, closed and open
CONTINUOUS_N = 4.0


class GripperSettings(PhantomSettings, frozen=True, kw_only=True):
    """Query keys of `sim:gripper`: those of the arm, of the gripper, and of the fingers that hold it.

    The fingers begin at open_m and close from squeeze_s on to squeeze_m, which may lie below 0 to press harder, each way in
    fingers_s; they stay for hold_s, open, stay as long, and so on.
    """

    grip_mass_kg: Positive = 0.05
    grip_damping_nspm: NotNegative = 0.0
    grip_friction_n: NotNegative = 0.02
    grip_resolution_m: NotNegative = 1e-5
    grip_peak_force_n: Positive = 8.0
    fingers_stiffness_npm: NotNegative = 500.0
    fingers_damping_nspm: NotNegative = 2.0
    open_m: Finite = 0.025
    squeeze_m: Finite = 0.005
    squeeze_s: NotNegative = 0.5
    fingers_s: Positive = 0.5
    hold_s: NotNegative = 1.0


def record(settings: GripperSettings, axes: int) -> Capability:
    """Return the record: of the first axes of the arm, or of both."""
    arm = replace(phantom_record(settings, min(axes, PLACES)), model="gripper")
    if axes != GRIP_AXES:
        return arm
    peak = settings.grip_peak_force_n
    gripper = Gripper(
        peak_force_n=peak, continuous_force_n=min(CONTINUOUS_N, peak),
        damping_nspm=0.5 * settings.grip_mass_kg * ADVISED_AT_HZ, slew_nps=settings.slew_nps,
        speed_mps=settings.speed_mps, resolution_m=settings.grip_resolution_m, apparent_mass_kg=settings.grip_mass_kg,
        own_damping_nspm=settings.grip_damping_nspm, own_friction_n=settings.grip_friction_n,
    )  # fmt: skip
    return replace(arm, axes=axes, grip_m=GRIP_M, gripper=gripper)


def plant(settings: GripperSettings, axes: int) -> Plant:
    """Return the plant. Raises DeviceError where the fingers begin beyond the gripper's range."""
    low, high = GRIP_M
    if not low <= settings.open_m <= high:
        raise DeviceError(f"sim:gripper: open_m={settings.open_m:g} is out of {low:g} to {high:g} m; begin within")
    arm = PhantomPlant(settings, min(axes, PLACES))
    return GripperPlant(arm, settings) if axes == GRIP_AXES else arm


class GripperPlant:
    """The arm and, as the last axis, the opening. See `Plant`."""

    def __init__(self, arm: Plant, settings: GripperSettings) -> None:
        self._arm = arm
        self._fingers = settings.fingers_stiffness_npm, settings.fingers_damping_nspm
        own = with_values(
            settings, mass_kg=settings.grip_mass_kg, damping_nspm=settings.grip_damping_nspm,
            friction_n=settings.grip_friction_n, resolution_m=settings.grip_resolution_m,
            peak_force_n=settings.grip_peak_force_n, handle_mass_kg=0.0,
        )  # fmt: skip
        self._gripper = PhantomPlant(own, 1, (GRIP_M,))
        self._show()

    def _show(self) -> None:
        self.position_m = [*self._arm.position_m, *self._gripper.position_m]
        self.velocity_mps = [*self._arm.velocity_mps, *self._gripper.velocity_mps]

    def open(self, rate_hz: int, stiffness_npm: float, damping_nspm: float, start_m: Sequence[float]) -> None:
        self._arm.open(rate_hz, stiffness_npm, damping_nspm, start_m[:PLACES])
        self._gripper.open(rate_hz, *self._fingers, start_m[PLACES:])
        self._show()

    def release(self) -> None:
        """See `Plant.release`. The fingers let go, too."""
        self._arm.release()
        self._gripper.release()

    def step(self, drive_n: Sequence[float], force_n: Sequence[float]) -> None:
        self._arm.step(drive_n[:PLACES], force_n[:PLACES])
        self._gripper.step(drive_n[PLACES:], force_n[PLACES:])
        self._show()

    def sense(self) -> Sample:
        """Return the arm's sample with the opening, an axis of it and the handle's."""
        opening_m = self._gripper.sense().position_m
        return Sample(self._arm.sense().position_m + opening_m, None, grip_m=opening_m[0])


class SqueezingHand:
    """A hand of places whose fingers close and open."""

    def __init__(self, hand: Hand, settings: GripperSettings) -> None:
        self._hand = hand
        self.stiffness_npm, self.damping_nspm = hand.stiffness_npm, hand.damping_nspm
        impedance = ImpedanceSettings(
            hand_stiffness_npm=settings.fingers_stiffness_npm, hand_damping_nspm=settings.fingers_damping_nspm
        )
        course = ReachSettings(
            amplitude_m=settings.squeeze_m - settings.open_m, stroke_s=settings.fingers_s, rest_s=settings.hold_s,
            delay_s=settings.squeeze_s,
        )  # fmt: skip
        self._fingers = DirectedHand(impedance, reach_course(course), (1.0,))
        self._open_m = settings.open_m

    def open(self, rate_hz: int, home_m: Row | None) -> Row:
        """See `Hand.open`. A start has a place and an opening."""
        place = self._hand.open(rate_hz, home_m[:PLACES] if home_m else None)
        return place + self._fingers.open(rate_hz, (self._open_m,))

    def intended(self, tick: int) -> tuple[Row, Row]:
        """Intended place and opening [m], and their rates."""
        (place, velocity), (opening, rate) = self._hand.intended(tick), self._fingers.intended(tick)
        return place + opening, velocity + rate

    def drive(self, tick: int) -> Sequence[float]:
        return (*self._hand.drive(tick), *self._fingers.drive(tick))
