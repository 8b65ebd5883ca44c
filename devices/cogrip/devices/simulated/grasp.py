"""Hand that grasps: it goes beside a thing, approaches, presses, lifts, carries, lowers and lets go.

Each stage that moves is a stroke of the hand `waypoints`, from start_s on; n is `direction`, z up, home where the hand begins:

    beside      first_m                 approach    + gap_m n, where it touches
    press       + press_n (1/K_h + 1/line_npm) n    lift        + lift_m z
    carry       + carry_m along x and y, then hold_s of rest
    lower       back by lift_m, and by carry_m along z                 release     back by the press and gap_m

A hand feels a thing through its line: both are springs in series, and the thing is pressed with press_n where line_npm is the
stiffness that `cogrip advise` foretells; where none is given, the line is taken for rigid.
"""

from math import inf

from cogrip.devices.device import DeviceError
from cogrip.devices.settings import Finite, NotNegative, Positive, fit_axes
from cogrip.devices.simulated.hands import ImpedanceSettings
from cogrip.devices.simulated.waypoints import WaypointHand, WaypointSettings
from cogrip.protocol.axes import PLACES


class GraspSettings(ImpedanceSettings, frozen=True, kw_only=True):
    """Query keys of `grasp`: stroke_s for each stage that moves, hold_s between carrying and lowering."""

    direction: tuple[Finite, ...] = (1.0,)
    gap_m: NotNegative = 0.03
    press_n: NotNegative = 5.0
    line_npm: Positive | None = None
    first_m: tuple[Finite, ...] = ()
    lift_m: NotNegative = 0.0
    carry_m: tuple[Finite, ...] = ()
    start_s: NotNegative = 0.5
    stroke_s: Positive = 1.0
    hold_s: NotNegative = 0.0


def make_grasp(settings: GraspSettings, axes: int) -> WaypointHand:
    """Return the hand. Raises DeviceError for a device of fewer than three axes, or a hand that cannot press."""
    s = settings
    if axes < PLACES:
        raise DeviceError(
            f"hand=grasp: the device has {axes} axes, and grasping takes places; set object.axes = 3 or 6"
        )
    if s.press_n and not s.hand_stiffness_npm:
        raise DeviceError("hand=grasp: hand_stiffness_npm=0 presses with nothing; raise it, or set press_n=0")
    nx, ny, nz = fit_axes(s.direction, PLACES, "direction")
    cx, cy, cz = fit_axes(s.carry_m, PLACES, "carry_m")
    squeeze_m = s.press_n * (1.0 / s.hand_stiffness_npm + 1.0 / (s.line_npm or inf)) if s.press_n else 0.0
    strokes = (
        fit_axes(s.first_m, PLACES, "first_m"),
        (s.gap_m * nx, s.gap_m * ny, s.gap_m * nz),
        (squeeze_m * nx, squeeze_m * ny, squeeze_m * nz),
        (0.0, 0.0, s.lift_m),
        (cx, cy, 0.0),
        None,
        (0.0, 0.0, cz - s.lift_m),
        tuple([-(squeeze_m + s.gap_m) * n for n in (nx, ny, nz)]),
    )
    times, places = [s.start_s], [(0.0, 0.0, 0.0)]
    for stroke in strokes:
        x, y, z = stroke or (0.0, 0.0, 0.0)
        duration_s = s.hold_s if stroke is None else s.stroke_s if any(stroke) else 0.0
        if duration_s:
            before = places[-1]
            times.append(times[-1] + duration_s)
            places.append((before[0] + x, before[1] + y, before[2] + z))
    x_m, y_m, z_m = zip(*places, strict=True)
    course = WaypointSettings(
        times_s=tuple(times), x_m=x_m, y_m=y_m, z_m=z_m,
        hand_stiffness_npm=s.hand_stiffness_npm, hand_damping_nspm=s.hand_damping_nspm,
    )  # fmt: skip
    return WaypointHand(course, axes)
