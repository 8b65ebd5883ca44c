"""An arm gives force where its pose is known, and inside its workspace. Virtual time."""

from math import hypot

import pytest

from cogrip.devices.arm.pose import Calibration
from cogrip.devices.device import DeviceError

from tests.devices.arm_bench import NAME, NO_FORCE, RATE_HZ, Bench, opened
from tests.devices.held_device import refused


def kept(**changed) -> Calibration:
    """A calibration of this arm as it stands, but for what is changed."""
    keys = {"model": "vintage", "offset_counts": (0, 7700, 0), "stamp": "plugging 1", "made": "before", **changed}
    return Calibration(device=NAME, **keys)


def jumped(calibration: Calibration) -> Bench:
    """An arm with this calibration whose encoder has jumped while it was open."""
    bench = Bench(keys="pose=stored")
    bench.notebook.keep(calibration)
    bench.open(RATE_HZ)
    bench.hold(NO_FORCE, 30)
    bench.arm.fault("jump")
    bench.fails(NO_FORCE, 3)
    return bench


def test_without_a_calibration_there_is_no_force() -> None:
    bench = Bench(keys="pose=stored")
    with refused("its pose is not known, so there would be no force", f"run `cogrip devices calibrate {NAME}`"):
        bench.open(RATE_HZ)
    bench.line.open()


def test_a_calibration_makes_up_for_where_it_was_powered_up() -> None:
    """Its counters began in the middle; in the home pose they say how far that is from there."""
    bench = Bench(keys="", powered_at_m=(0.0, 0.0, 0.0))
    bench.go_home()
    calibration = bench.calibrate()
    assert calibration.model == "vintage"
    assert calibration.offset_counts == (0, 7166, -36)  # counter + offset = calibrated: (0, 534, 36) there
    bench.open(RATE_HZ)
    bench.hold(NO_FORCE, 400)  # the hand pulls it back from there
    assert bench.read(bench.tick).position_m == pytest.approx(bench.position_m, abs=3e-5)
    assert hypot(*bench.position_m) < 1e-3


def test_a_refused_request_does_not_spoil_a_calibration() -> None:
    """Half a request of another program is in the firmware; what it answers is where the arm was before."""
    bench = Bench(keys="", powered_at_m=(0.0, 0.0, 0.0))
    bench.arm.receive(b"[0,0,0]\n", 0)
    bench.arm.due(0)
    bench.go_home()
    bench.arm.receive(b"[1,", 0)
    assert bench.calibrate().offset_counts == (0, 7166, -36)


def test_a_calibration_holds_until_it_is_plugged_in_again() -> None:
    bench = Bench(keys="")
    bench.go_home()
    bench.calibrate("yesterday")
    for _ in range(2):
        bench.open(RATE_HZ)
        bench.close()
    bench.arm.fault("unplug")
    bench.arm.mend()
    with refused("was plugged in again since it was calibrated on yesterday: put the arm in its home"):
        bench.open(RATE_HZ)
    bench.go_home()
    bench.calibrate()
    bench.open(RATE_HZ)


def test_a_calibration_of_another_model_or_where_pluggings_cannot_be_told_apart_is_not_taken() -> None:
    bench = Bench(keys="")
    bench.notebook.keep(kept(model="polhem"))
    with pytest.raises(DeviceError, match="was calibrated as polhem, but is vintage now"):
        bench.open(RATE_HZ)
    bench.line.stamp = lambda: ""  # type: ignore[method-assign]
    bench.go_home()
    bench.calibrate()
    with pytest.raises(DeviceError, match="cannot tell one plugging-in from another"):
        bench.open(RATE_HZ)


def test_pose_home_is_said_of_one_plugging_in() -> None:
    bench = opened()
    bench.hold(NO_FORCE, 3)
    bench.arm.fault("unplug")
    bench.arm.mend()
    assert "it was unplugged" in bench.fails(NO_FORCE, 2)[0]
    bench.close()
    with refused("was plugged in again, so its pose is not known any more: ", " run `cogrip devices calibrate"):
        bench.open(RATE_HZ)


def test_pose_home_is_lost_with_the_wire_where_pluggings_cannot_be_told_apart() -> None:
    bench = Bench()
    bench.line.stamp = lambda: ""  # type: ignore[method-assign]
    bench.open(RATE_HZ)
    bench.close()
    bench.open(RATE_HZ)  # nothing happened meanwhile
    bench.arm.fault("unplug")
    bench.fails(NO_FORCE, 2)
    bench.arm.mend()
    bench.close()
    with pytest.raises(DeviceError, match="it may have been without power, so its pose is not known any more"):
        bench.open(RATE_HZ)


def test_without_a_pose_there_are_positions_but_no_current() -> None:
    bench = opened(keys="pose=none")
    samples = bench.hold((3.0, 3.0, 3.0), 20)
    assert all(samples[1:])
    assert bench.arm.mechanics.peak_force_n == 0.0
    assert bench.write((1.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("keys", ["pose=home", "pose=stored"])
def test_after_a_jump_it_must_be_calibrated(keys: str) -> None:
    bench = Bench(keys=keys, hand="reach&amplitude_m=0.02&direction=0,1,0")
    if keys == "pose=stored":
        bench.notebook.keep(kept())
    bench.open(RATE_HZ)
    bench.hold((0.3, 0.0, 0.0), 300)
    bench.arm.fault("jump")
    said, when, sizes = bench.fails((0.3, 0.0, 0.0), 100)
    assert "encoder a jumped by" in said
    assert said.endswith("calibrate, then re-arm")
    assert when <= 2
    assert max(sizes) < 0.32
    assert not any(sizes[50:])
    bench.close()
    with pytest.raises(DeviceError, match=r"encoder a jumped by .* counts, so its pose is not known any more"):
        bench.open(RATE_HZ)
    another = Bench(keys=keys, arm=bench.arm, store=bench.notebook)  # another program, later
    if keys == "pose=stored":
        with pytest.raises(DeviceError, match=r"encoder a jumped by .* counts, so its pose is not known any more"):
            another.open(RATE_HZ)
        bench.go_home()
        bench.calibrate()
        for one in (bench, another):
            one.open(RATE_HZ)
            one.close()
        bench.open(RATE_HZ)
        bench.tick = round(2.0 * RATE_HZ)
        bench.hold(NO_FORCE, 300)
        assert bench.read(bench.tick).position_m == pytest.approx(bench.position_m, abs=1e-3)
        bench.close()


def test_a_loss_that_cannot_be_kept_is_counted() -> None:
    bench = jumped(kept())

    def keep(calibration: Calibration) -> None:
        raise DeviceError("full")

    bench.notebook.keep = keep  # type: ignore[method-assign]
    bench.close()
    assert bench.counts["loss of the pose not kept"] == 1


def test_a_newer_calibration_is_not_overwritten_by_an_older_loss() -> None:
    bench = jumped(kept())
    newer = kept(offset_counts=(-400, 7700, 0), made="after")
    bench.notebook.keep(newer)
    bench.close()
    assert bench.notebook.find(NAME) == newer
    bench.open(RATE_HZ)


@pytest.mark.parametrize(("y_m", "inside"), [(0.0999, True), (0.1001, False)])
def test_both_sides_of_the_workspace(y_m: float, inside: bool) -> None:
    bench = opened()
    bench.hold((0.2, 0.0, 0.0), 20)
    force = bench.arm.mechanics.force_n
    assert any(force)

    def carry() -> None:
        for step in range(402):
            z = min(1.0, step / 400)
            bench.arm.mechanics.carry((0.0, y_m * z * z * (3.0 - 2.0 * z), 0.0))
            bench.driver.read(bench.tick)
            bench.driver.write((0.2, 0.0, 0.0))
            bench.tick += 1

    if inside:
        carry()
        assert bench.driver.read(bench.tick).position_m[1] == pytest.approx(y_m, abs=1e-4)
        return
    with refused("the tip is at (", "0.100", ") m, outside its workspace of 0.1 m; move it "):
        carry()
    bench.close()
    with pytest.raises(DeviceError, match="outside its workspace"):
        bench.open(RATE_HZ)
    bench.arm.mechanics.carry(NO_FORCE)
    bench.open(RATE_HZ)  # its pose was never in doubt


def test_counts_at_which_no_linkage_closes_are_wrong() -> None:
    bench = Bench("polhem")
    bench.arm.mechanics.slip(1, -5000)
    with pytest.raises(DeviceError, match=r"the linkage does not close at counts .*; calibrate, then re-arm"):
        bench.open(RATE_HZ)
