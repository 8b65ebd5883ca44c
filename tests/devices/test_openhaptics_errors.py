"""`openhaptics:`: what the library reports and what it leaves out; force is zero, and the error says why."""

import pytest

from cogrip.devices.device import DeviceError
from cogrip.devices.openhaptics.errors import CURES, FORCE_ERRORS, OTHER_ERRORS, cure_for, name_of

from tests.devices.openhaptics_bench import RATE_HZ


def test_every_code_of_the_headers_has_a_name_of_its_own_and_a_cure() -> None:
    codes = [*FORCE_ERRORS, *OTHER_ERRORS]
    assert sorted(FORCE_ERRORS) == list(range(0x200, 0x205))
    assert len(set(map(name_of, codes))) == len(codes) == 21
    assert name_of(0x999) == "error 0x999"
    assert all(map(cure_for, [*codes, 0x999]))
    assert set(CURES) <= set(OTHER_ERRORS)


@pytest.mark.parametrize("code", sorted(FORCE_ERRORS))
@pytest.mark.parametrize("at", ["begin", "end"])
def test_force_error_drops_the_force_of_one_frame(bench, code, at) -> None:
    device = bench.opened()
    getattr(bench.lib, f"stub_error_at_{at}")(0, code)
    forces = []
    for tick in range(4):
        device.write((1.0, 0.0, 0.0))
        bench.step()
        forces.append(-bench.force()[2])
        assert device.read(tick) is not None
    assert forces == ([0.0, 1.0, 1.0, 1.0] if at == "begin" else [1.0, 0.0, 1.0, 1.0])
    assert device.counts == {FORCE_ERRORS[code]: 1}
    device.close()


@pytest.mark.parametrize("code", [*OTHER_ERRORS, 0x999])
def test_any_other_error_ends_it_for_this_device_alone(bench, code) -> None:
    left, right = bench.opened(1), bench.opened(2)
    bench.lib.stub_error_for_ever(1, code)
    for device in (left, right):
        device.write((1.0, 0.0, 0.0))
    bench.step(3)
    with pytest.raises(DeviceError, match=rf"openhaptics:Left Device: lost: .*\(error 0x{code:x}\)") as caught:
        left.read(1)
    assert str(caught.value).endswith(cure_for(code))
    assert left.write((1.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)
    bench.step()
    assert bench.force(1) == (0.0, 0.0, 0.0)
    assert left.counts[name_of(code)] == 4
    assert right.read(1) is not None
    assert bench.force(2) == (0.0, 0.0, -1.0)
    assert right.counts == {}
    left.close()
    bench.lib.stub_error_for_ever(1, 0)
    left.open(RATE_HZ)
    bench.step()
    assert left.read(0) is not None
    left.close()
    right.close()


def test_error_of_no_device_is_everybodys(bench) -> None:
    left, right = bench.opened(1), bench.opened(2)
    bench.lib.stub_error_of_nobody(0x304)
    bench.step()
    for device in (left, right):
        with pytest.raises(DeviceError, match="0x304"):
            device.read(1)
        device.close()


def test_a_frame_that_fails_is_reported_and_sends_zero(bench, monkeypatch) -> None:
    device = bench.opened()
    device.write((1.0, 0.0, 0.0))
    bench.step()
    monkeypatch.setattr(device._mailbox, "frame", lambda *_: 1 / 0)
    bench.step(2)
    assert bench.force() == (0.0, 0.0, 0.0)
    monkeypatch.undo()
    with pytest.raises(DeviceError, match=r"a frame failed: ZeroDivisionError.*please report"):
        device.read(1)
    device.write((1.0, 0.0, 0.0))
    bench.step()
    assert bench.force() == (0.0, 0.0, 0.0)
    device.close()


def test_a_servo_that_does_not_answer_gets_its_zero_all_the_same(bench) -> None:
    device = bench.opened()
    device.write((1.0, 0.0, 0.0))
    bench.step()
    bench.lib.stub_deaf(1)
    device.close()
    assert bench.force() == (0.0, 0.0, 0.0)
    with pytest.raises(DeviceError, match="0x501"):
        device.open(RATE_HZ)
