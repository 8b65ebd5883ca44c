"""`cogrip devices calibrate`: the pose of an arm at the start of its counters, and the losses of its mechanism."""

import time

from rich.console import Console

from cogrip.cli.devices.conform import TickClock
from cogrip.cli.devices.opened_arm import arm_at, termination_raised, try_line, wait_for_enter
from cogrip.cli.devices.tried_response import try_response
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.devices.arm.driver import ArmDevice
from cogrip.devices.arm.identification import RATE_HZ, force_within, identify
from cogrip.devices.device import DeviceError
from cogrip.devices.io.arm_check import MOST_TEST_MA
from cogrip.devices.io.calibration_store import CalibrationStore
from cogrip.devices.way_in import into_sphere
from cogrip.machine.realtime import engage, release


def device_calibrate(address: str, /, *, yes: bool = False, damping: bool = False) -> int:
    """Calibrate a device, and keep the calibration.

    For arms; until the arm is plugged in again, and no motor gets current. With --damping, of an arm whose pose is known:
    try how it moves under small forces, then swing it for up to a minute, nobody holding it, and keep the least damping and
    friction of its mechanism permanently. Sessions then count on them; without, on none.

    Parameters
    ----------
    address
        Device address (`cogrip devices`), as you will join with it.
    yes
        Do not ask: the arm is in its home pose already (--damping: free in mid-range).
    damping
        Identify damping and friction instead. Off by default: the motors move the arm, by themselves.
    """
    console = make_console(soft_wrap=True)
    arm = arm_at(address)
    if damping:
        return _identify(arm, address, console, yes=yes)
    console.print(f"Home pose: {arm.home_words()} (see docs/devices.md).")
    if not yes:
        try_line(arm)
        wait_for_enter(console, "Put the arm there and hold it still.")
    with Problem.of(DeviceError):
        calibration = arm.calibrate(_now())
        path = CalibrationStore().keep(calibration)
    home = arm.model.kinematics.forward(arm.model.drive.angles(arm.model.home_counts))
    where = "" if home is None else f"; the tip of the home pose is at ({', '.join(f'{at:z.3f}' for at in home)}) m"
    way = "" if home is None else into_sphere(home, arm.model.reach_m)
    console.print(f"{calibration.model} is calibrated{where}")
    if way:
        console.print(
            f"that is outside its workspace of {arm.model.reach_m:g} m, by its makers' numbers: move the tip {way} before you"
            " join, check or conform it"
        )
    if not calibration.stamp:
        console.print(
            "this system cannot tell when it is plugged in again, so join with the key pose=home instead, each time anew"
        )
    console.print(f"kept in {path}, until the arm is plugged in again or loses power")
    return 0


def _identify(arm: ArmDevice, address: str, console: Console, *, yes: bool) -> int:
    if arm.reads_only:
        raise BadInput(
            f"{address}: pose=none gives no force, so nothing can be identified; calibrate it, and leave that key out"
        )
    if not yes:
        try_line(arm)
        wait_for_enter(console, "Put the arm in mid-range, take your hands off it, keep one at the power switch.")
    with Problem.of(DeviceError):
        # Where it takes torques, half of the motors' continuous torque is small enough
        force_n = force_within(arm.model, float("inf") if arm.model.takes_torques else MOST_TEST_MA)
        console.print("  how it moves under small forces")
        if wrong := try_response(address):
            raise DeviceError(f"it does not move as its record says, and nothing is kept: {'; '.join(wrong)}")
        clock = TickClock(min(RATE_HZ, arm.model.record.rate_hz))
        measures = engage(["gc-frozen", "fifo"])
        try:
            with termination_raised():
                found = identify(arm, arm.model, force_n, clock.newest, lambda text: console.print(f"  {text}"))
        finally:
            release(measures)
        path = CalibrationStore().keep_losses(arm.losses(found.damping_nspm, found.friction_n, _now()))
    console.print(
        f"{arm.model.record.model}: its mechanism takes at least {found.damping_nspm:.3g} N s/m of damping and "
        f"{found.friction_n:.3g} N of friction, anywhere in its workspace"
    )
    console.print(f"kept in {path}; sessions count on it from now on. Delete it if the mechanism changes")
    return 0


def _now() -> str:
    return time.strftime("%Y-%m-%d %H:%M:%S")
