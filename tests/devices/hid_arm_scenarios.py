"""Scenarios of an arm's driver on a HID port, by hidapi on its stub."""

from cogrip.devices.arm.driver import ArmDevice
from cogrip.devices.arm.models import MODELS

from tests.devices.hid_bench import Bench, Scenarios, fails

scenario = Scenarios()

MODEL = MODELS["woodenhaptics"]


def centre() -> tuple[int, int, int]:
    angles = MODEL.kinematics.inverse((0.0, 0.0, 0.0))
    assert angles is not None
    a, b, c = (round(count - home) for count, home in zip(MODEL.drive.counts(angles), MODEL.home_counts, strict=True))
    return a, b, c


def step(bench: Bench, device: ArmDevice, tick: int, force=(0.0, 0.0, 0.0)):
    """A tick, and then time for the wire."""
    sample = device.read(tick)
    device.write(force)
    while not bench["left_in_queue"] and not bench["silent"]:
        pass
    return sample


@scenario
def an_arm_is_opened_read_pushed_and_let_go(bench: Bench) -> None:
    bench.set(stale=1)
    bench.stand_at(centre())
    device = bench.device()
    device.open(1000)
    assert bench.currents == (0, 0, 0)
    samples = [step(bench, device, tick, (1.0, 0.0, 0.0)) for tick in range(5)]
    assert samples[0] is None
    position = samples[-1].position_m
    assert max(map(abs, position)) < MODEL.record.resolution_m, position
    assert samples[-1].age_ticks == 1
    assert device.angles is not None
    expected, _ = MODEL.currents(device.angles, (-1.0, 0.0, 0.0))
    assert bench.currents == expected
    assert expected != (0, 0, 0)
    fails(lambda: (device.read(5), device.write((float("nan"), 0.0, 0.0))), "not finite")
    while not bench["left_in_queue"]:
        pass
    assert bench.currents == (0, 0, 0)
    step(bench, device, 6, (1.0, 0.0, 0.0))
    assert bench.currents == expected
    device.close()
    assert bench.currents == (0, 0, 0)
    assert not bench["is_open"]
