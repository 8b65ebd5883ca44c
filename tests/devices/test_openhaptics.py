"""`openhaptics:`, round by round of the servo: the library is bound, asked in its order, and calibrated before any force.

Which model it is and what that allows; what one frame reads and sends; what errors leave out, so that force is zero and the
error says why; and two devices on one servo, which has one current device and one stack of errors.
"""

import ctypes
from collections import Counter
from math import inf, nan

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.devices.device import DeviceError
from cogrip.devices.io.hd_library import SIGNATURES, ErrorInfo, load
from cogrip.devices.openhaptics.errors import CURES, FORCE_ERRORS, OTHER_ERRORS, cure_for, name_of
from cogrip.devices.openhaptics.mailbox import HOLD_FRAMES, MOST_WITHHELD, ZERO, Mailbox, to_library
from cogrip.devices.openhaptics.models import RECORDS, Facts, lowered, model_of
from cogrip.devices.registry import make

from tests.devices.compiled_stub import compile_stub
from tests.devices.openhaptics_bench import RATE_HZ

says = st.tuples(st.just("say"), st.tuples(*[st.floats(-5.0, 5.0)] * 3))
frames = st.tuples(st.just("frame"), st.integers(1, 60))
once = st.tuples(st.sampled_from(["frame", "nan", "skip", "fatal", "drop"]), st.just(1))


def test_types_are_those_of_the_headers(bench) -> None:
    assert ctypes.sizeof(ErrorInfo) == 12
    hd = load(str(bench.path))
    for name, (result, arguments) in SIGNATURES.items():
        assert getattr(hd, name).restype is result
        assert getattr(hd, name).argtypes == arguments
    bench.lib.stub_error_of_nobody(0x302)
    error = hd.hdGetError()
    assert (error.code, error.internal, error.handle) == (0x302, -7, 0xFFFFFFFF)
    assert hd.hdGetError().code == 0


def test_library_that_is_not_there_or_another_one(tmp_path) -> None:
    device = make(f"openhaptics:x?library={tmp_path}/libHD.so")
    with pytest.raises(DeviceError, match=r"cannot be loaded.*library=PATH"):
        device.open(RATE_HZ)
    source = tmp_path / "other.c"
    source.write_text("int hdInitDevice(void) { return 0; }")
    other = compile_stub(source, tmp_path / "libother.so", "-Werror")
    with pytest.raises(DeviceError, match="has no hdDisableDevice: it is not the OpenHaptics HD library"):
        make(f"openhaptics:x?library={other}").open(RATE_HZ)


def test_order_of_use(bench) -> None:
    device = bench.opened()
    bench.step(2)
    device.close()
    name = "Default Device"
    named, sent = f"check calibration {name}\nenable {name}\nschedule 65535\ndisable {name}", "stop\nunschedule"
    assert bench.journal() == f"init {name}\nstart\n{named}\n{sent}\ndisable device {name}".splitlines()


def test_no_name_is_the_default_device(bench) -> None:
    device = make(f"openhaptics:?library={bench.path}", axes=3)
    device.open(RATE_HZ)
    device.close()
    assert bench.journal()[0] == "init NULL"


def test_name_that_the_vendors_settings_do_not_have(bench) -> None:
    device = make(f"openhaptics:Nobody?library={bench.path}")
    with pytest.raises(DeviceError, match=r"openhaptics:Nobody: is not to be had: No such device.*0x303.*GTDD_HOME"):
        device.open(RATE_HZ)
    device.close()
    with pytest.raises(DeviceError, match="call open"):
        device.read(0)


def test_device_that_is_open_already_stays_open(bench) -> None:
    first = bench.opened()
    with pytest.raises(DeviceError, match="is open already as openhaptics:Default Device; close that one first"):
        bench.device().open(RATE_HZ)
    first.write((1.0, 0.0, 0.0))
    bench.step()
    assert first.read(1) is not None
    assert bench.force() == (0.0, 0.0, -1.0)
    first.close()


@pytest.mark.parametrize(("styles", "style"), [(2, 2), (4, 4), (6, 2), (5, 4)])
def test_calibration_that_the_library_can_do_itself(bench, styles, style) -> None:
    bench.lib.stub_calibration(0, 0x5001, styles, 3)
    device = bench.opened()
    lines = bench.journal()
    assert lines.count(f"update calibration Default Device {style}") == 3
    assert lines.index("enable Default Device") > lines.index(f"update calibration Default Device {style}")
    device.close()


@pytest.mark.parametrize(
    ("state", "style", "updates", "words"),
    [
        (0x5002, 4, 0, "by hand: put the stylus into the inkwell"),
        (0x5002, 2, 0, "by hand: move the arm slowly"),
        (0x5002, 1, 0, "by hand: bring all links to right angles"),
        (0x5001, 1, 1, "needs to be calibrated: bring all links to right angles"),
        (0x5001, 4, 1000, "needs to be calibrated: put the stylus"),
        (0x1234, 4, 0, r"unknown state of calibration \(0x1234\)"),
    ],
)
def test_no_force_before_it_is_calibrated(bench, state, style, updates, words) -> None:
    bench.lib.stub_calibration(0, state, style, updates)
    device = bench.device()
    with pytest.raises(DeviceError, match=words):
        device.open(RATE_HZ)
    assert not [line for line in bench.journal() if line.startswith(("enable", "schedule", "update")) and style == 1]
    assert "enable Default Device" not in bench.journal()
    bench.lib.stub_calibration(0, 0x5000, style, 0)
    device.open(RATE_HZ)
    device.close()


@pytest.mark.parametrize(
    ("said", "model"),
    [
        ("Touch", "touch"), ("Geomagic Touch", "touch"), ("Touch X", "desktop"), ("PHANTOM Omni", "omni"),
        ("PHANTOM Desktop", "desktop"), ("PHANTOM Premium 1.0", "premium1.0"),
        ("PHANTOM Premium 1.5 6DOF", "premium1.5"), ("PHANTOM Premium 3.0 6DOF", "premium3.0"), ("Falcon", None),
        ("", None),
    ],
)  # fmt: skip
def test_models_by_what_they_call_themselves(said, model) -> None:
    assert model_of(said) == model


@given(peak=st.floats(0.01, 50.0), continuous=st.floats(0.01, 50.0), stiffness=st.floats(0.001, 1.0))
def test_a_device_can_only_lower_its_record(peak, continuous, stiffness) -> None:
    for record in RECORDS.values():
        low = lowered(record, Facts("Touch", peak, continuous, stiffness), "", "here")
        assert low.peak_force_n == min(record.peak_force_n, peak)
        assert low.continuous_force_n == min(record.continuous_force_n, continuous, low.peak_force_n)
        assert low.stiffness_npm == min(record.stiffness_npm, 1000.0 * stiffness)


@pytest.mark.parametrize(
    ("said", "keys", "words"),
    [
        ("PHANTOM Omni", "&model=touch", "that is model=omni, not touch; correct the key model"),
        ("Falcon", "", "calls itself 'Falcon', which is not known; known are touch, omni"),
        ("Falcon", "&model=touch", "which is not known"),
    ],
)
def test_another_model_is_refused(bench, said, keys, words) -> None:
    bench.call_itself(said, 3.3, 0.88, 0.5)
    with pytest.raises(DeviceError, match=words):
        bench.opened(keys=keys)
    assert "enable Default Device" not in bench.journal()


@pytest.mark.parametrize("bad", [(0.0, 0.88, 0.5), (3.3, -1.0, 0.5), (3.3, 0.88, nan), (inf, 0.88, 0.5)])
def test_limits_that_are_none_are_refused(bench, bad) -> None:
    bench.call_itself("Touch", *bad)
    with pytest.raises(DeviceError, match=r"the library states a largest .*not above 0"):
        bench.opened()


def test_model_that_is_not_stated_has_the_limits_of_the_weakest(bench) -> None:
    bench.call_itself("PHANTOM Premium 3.0", 22.0, 3.0, 1.0)
    device = bench.opened()
    assert device.capability.peak_force_n == 3.3
    device.close()


def test_limits_are_lowered_at_open_and_hold(bench) -> None:
    bench.call_itself("PHANTOM Premium 1.5", 6.0, 9.0, 0.6)
    device = bench.device(keys="&model=premium1.5")
    assert (device.capability.peak_force_n, device.capability.stiffness_npm) == (8.5, 800.0)
    device.open(RATE_HZ)
    record = device.capability
    assert (record.peak_force_n, record.continuous_force_n, record.stiffness_npm) == (6.0, 1.4, 600.0)
    device.write((8.0, 0.0, 0.0))
    bench.step()
    assert bench.force() == (0.0, 0.0, -6.0)
    device.close()


def test_each_frame_is_read_once(bench) -> None:
    device = bench.opened()
    assert device.read(0) is None
    bench.step()
    assert device.read(1) is not None
    assert device.read(1) is None
    bench.step(3)
    assert device.read(2) is not None
    device.close()


def test_close_sends_zero_within_a_frame_of_its_own_and_to_a_servo_that_does_not_answer_too(bench) -> None:
    device = bench.pushed()
    frames = bench.lib.stub_frames(0)
    device.close()
    assert bench.force() == (0.0, 0.0, 0.0)
    assert bench.lib.stub_frames(0) == frames + 1
    device = bench.pushed()
    bench.lib.stub_deaf(1)
    device.close()
    assert bench.force() == (0.0, 0.0, 0.0)
    with pytest.raises(DeviceError, match="0x501"):
        device.open(RATE_HZ)


@given(st.lists(says | frames | once, max_size=30))
@settings(max_examples=200)
def test_what_is_sent_is_the_newest_force_or_zero(events) -> None:
    """An independent account of the rule: zero when lost, dropped, untrusted, or not renewed for HOLD_FRAMES frames."""
    mailbox = Mailbox(Counter())
    newest, since, drop, lost = ZERO, HOLD_FRAMES, False, False
    for event, argument in events:
        if event == "say":
            newest, since = argument, 0
            mailbox.say(argument)
        elif event == "fatal":
            lost = True
            mailbox.trouble(0x302, "gone")
        elif event == "drop":
            drop = True
            mailbox.trouble(0x201, "")
        else:
            for _ in range(argument):
                good = event == "frame" and not drop and not lost and since < HOLD_FRAMES
                place = (nan if event == "nan" else 0.0, 0.0, 0.0)
                sent = mailbox.skip("why") if event == "skip" else mailbox.frame(place)
                assert sent == (to_library(newest) if good else ZERO)
                drop, since = False, since + 1
    assert bool(mailbox.lost) == lost


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


@pytest.mark.parametrize("code", [0x101, 0x201, 0x202, 0x302])
@pytest.mark.parametrize("times", [1, 2, 50])
def test_a_force_that_cannot_be_set_leaves_none(bench, code: int, times: int) -> None:
    """Before, the force of the frame before it stayed on the hand for as long as none could be set."""
    device = bench.pushed()
    assert bench.load() == (1.0, 0.0, 0.0)
    bench.lib.stub_error_at_set(0, code, times)
    device.write((1.1, 0.0, 0.0))
    bench.step()
    assert bench.load() == (0.0, 0.0, 0.0)
    assert device.write((1.1, 0.0, 0.0)) == (0.0, 0.0, 0.0), "and the ledger is told so"
    if times > 1:
        with pytest.raises(DeviceError, match=f"its force cannot be set|error 0x{code:x}"):
            device.read(1)
    for _ in range(60):
        device.write((1.1, 0.0, 0.0))
        bench.step()
        assert times == 1 or bench.load() == (0.0, 0.0, 0.0)
    bench.lib.stub_error_at_set(0, code, 0)
    device.close()
    assert bench.load() == (0.0, 0.0, 0.0)


def test_forces_that_the_library_switched_off_are_a_fault(bench) -> None:
    device = bench.pushed()
    device.read(1)
    bench.lib.stub_off(0)
    device.write((1.0, 0.0, 0.0))
    bench.step()
    with pytest.raises(DeviceError, match="the library has switched its forces off"):
        device.read(2)
    assert device.write((1.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)
    device.close()
    device.open(RATE_HZ)
    device.write((1.0, 0.0, 0.0))
    bench.step()
    assert bench.load() == (1.0, 0.0, 0.0)
    device.close()


def test_a_force_error_that_stays_is_told_to_the_ledger_and_becomes_a_fault(bench) -> None:
    """Warm motors: the library drops every force, frame by frame."""
    device = bench.pushed()
    bench.lib.stub_error_for_ever(0, 0x200)
    told = []
    for tick in range(1, MOST_WITHHELD + 1):
        bench.step()
        device.read(tick)
        told.append(device.write((1.0, 0.0, 0.0)))
        assert bench.load() == (0.0, 0.0, 0.0)
    assert set(told) == {(0.0, 0.0, 0.0)}
    bench.step(2)
    with pytest.raises(DeviceError, match="error 0x200"):
        device.read(MOST_WITHHELD + 1)
    bench.lib.stub_error_for_ever(0, 0)
    device.close()


def test_error_of_no_device_is_everybodys(bench) -> None:
    left, right = bench.opened(1), bench.opened(2)
    bench.lib.stub_error_of_nobody(0x304)
    bench.step()
    for device in (left, right):
        with pytest.raises(DeviceError, match="0x304"):
            device.read(1)
        device.close()


def test_a_frame_that_fails_is_reported_and_sends_zero(bench, monkeypatch) -> None:
    device = bench.pushed()
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


def test_two_devices_come_and_go_while_the_servo_runs(bench) -> None:
    left = bench.opened(1)
    bench.step()
    right = bench.opened(2)
    bench.move(1, 1.0, 0.0, 0.0)
    bench.move(2, 2.0, 0.0, 0.0)
    left.write((1.0, 0.0, 0.0))
    right.write((2.0, 0.0, 0.0))
    bench.step()
    assert (left.read(1).position_m[1], right.read(1).position_m[1]) == pytest.approx((0.001, 0.002))
    assert (bench.force(1)[2], bench.force(2)[2]) == (-1.0, -2.0)
    left.close()
    bench.step(2)
    assert bench.force(1) == (0.0, 0.0, 0.0)
    assert bench.force(2)[2] == -2.0
    assert right.read(2) is not None
    left.open(RATE_HZ)
    bench.step()
    assert left.read(0) is not None
    right.close()
    left.close()
    assert [line for line in bench.journal() if line in ("start", "stop")] == ["start", "stop"]


@pytest.mark.parametrize("servo_first", [False, True])
def test_a_second_device_that_cannot_be_had_does_not_hurt_the_first(bench, servo_first) -> None:
    """The library files the error under the device that was current, which is the first one, whoever takes it."""
    left = bench.opened(1)
    left.write((1.0, 0.0, 0.0))
    bench.lib.stub_round_at_init(servo_first)
    with pytest.raises(DeviceError, match="Nobody: is not to be had: No such device"):
        make(f"openhaptics:Nobody?library={bench.path}").open(RATE_HZ)
    bench.step()
    assert left.read(1) is not None
    assert bench.force(1) == (0.0, 0.0, -1.0)
    assert left.counts == {}
    left.close()


def test_a_second_device_is_asked_and_enabled_itself(bench) -> None:
    """Frames of the first one go on while the second is opened, and make the first one current again."""
    left = bench.opened(1)
    bench.call_itself("PHANTOM Omni", 2.0, 0.5, 0.5, number=2)
    bench.lib.stub_calibration(2, 0x5001, 4, 1)
    bench.lib.stub_round_at_init(1)
    right = bench.opened(2, keys="&model=omni")
    assert right.capability.peak_force_n == 2.0
    assert "update calibration Right Device 4" in bench.journal()
    assert "enable Right Device" in bench.journal()
    left.close()
    right.close()


def test_a_frame_that_another_device_was_made_current_in_is_not_used(bench) -> None:
    left, right = bench.opened(1), bench.opened(2)
    bench.move(1, 1.0, 1.0, 1.0)
    bench.move(2, 2.0, 2.0, 2.0)
    bench.step()
    assert left.read(1) is not None
    left.write((1.0, 0.0, 0.0))
    bench.lib.stub_steal_current(2)
    bench.step()
    assert left.read(2) is None
    assert bench.force(1) == bench.force(2) == (0.0, 0.0, 0.0)
    assert left.counts == {"another device was current": 1}
    bench.step()
    assert left.read(3).position_m == pytest.approx((0.001,) * 3)
    assert bench.force(1) == (0.0, 0.0, -1.0)
    left.close()
    right.close()
