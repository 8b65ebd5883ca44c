"""`openhaptics:` against a stand-in for libHD compiled here: what the library is asked, in which order, what a hand would feel.

Most tests run the library's scheduler round by round on their own thread; those named "servo" let its thread run.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import sys
from dataclasses import dataclass
from math import hypot, inf, nan
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.devices.conformance import CHECKS, Subject
from cogrip.devices.device import DeviceError
from cogrip.devices.io.hd_library import SIGNATURES, ErrorInfo, load
from cogrip.devices.openhaptics.axes import to_common, to_library
from cogrip.devices.openhaptics.errors import CURES, FORCE_ERRORS, OTHER_ERRORS, cure_for, name_of
from cogrip.devices.openhaptics.family import family
from cogrip.devices.openhaptics.mailbox import HOLD_FRAMES, ZERO, Mailbox
from cogrip.devices.openhaptics.models import RECORDS, Facts, lowered, model_of
from cogrip.devices.settings import parse_address

SOURCE = Path(__file__).parent / "stubs" / "libhd.c"
RATE_HZ = 1000
NAMES = ("Default Device", "Left Device", "Right Device")
three = st.tuples(*[st.floats(-5.0, 5.0)] * 3)


def compile_stub(source: Path, target: Path) -> Path:
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler: the stand-in for libHD cannot be made")
    flags = ["-O1", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-pthread"]
    subprocess.run([compiler, *flags, "-o", str(target), str(source), "-lm"], check=True)
    return target


def make(address: str, axes: int = 3):
    return family().make(parse_address(address), axes, {})


@dataclass
class Bench:
    """The library in the test's hands. Devices are numbered as in NAMES; forces and positions are in the library's axes."""

    path: Path
    lib: ctypes.CDLL

    def device(self, number: int = 0, axes: int = 3, keys: str = ""):
        return make(f"openhaptics:{NAMES[number]}?library={self.path}{keys}", axes)

    def opened(self, number: int = 0, axes: int = 3, keys: str = ""):
        device = self.device(number, axes, keys)
        device.open(RATE_HZ)
        return device

    def step(self, times: int = 1) -> None:
        for _ in range(times):
            self.lib.stub_step()

    def force(self, number: int = 0) -> tuple[float, ...]:
        force = (ctypes.c_double * 3)()
        self.lib.stub_force(number, force)
        return tuple(force)

    def move(self, number: int, *position_mm: float) -> None:
        self.lib.stub_position(number, *map(ctypes.c_double, position_mm))

    def journal(self) -> list[str]:
        return self.lib.stub_journal().decode().splitlines()


@pytest.fixture(scope="module")
def built(tmp_path_factory) -> Path:
    return compile_stub(SOURCE, tmp_path_factory.mktemp("openhaptics") / "libHD.so")


@pytest.fixture
def servo(built, tmp_path):
    """A library of its own for each test; whatever order of calls it finds wrong fails the test."""
    path = tmp_path / "libHD.so"
    shutil.copy(built, path)
    lib = ctypes.CDLL(str(path))
    lib.stub_journal.restype = lib.stub_wrongs.restype = ctypes.c_char_p
    lib.stub_worst.restype = ctypes.c_double
    lib.stub_frames.restype = lib.stub_torn.restype = ctypes.c_long
    lib.stub_wait.argtypes = [ctypes.c_long]
    yield Bench(path, lib)
    assert lib.stub_wrongs().decode() == ""
    assert lib.stub_running() == 0
    assert lib.stub_scheduled() == 0


@pytest.fixture
def bench(servo):
    servo.lib.stub_manual(1)
    return servo


# -- axes, errors, models, mailbox -------------------------------------------------------------------------------------


def test_axes_of_the_vectors() -> None:
    assert to_common((10.0, -20.0, 30.0)) == pytest.approx((0.030, 0.010, -0.020))
    assert to_library((1.0, 2.0, 3.0)) == (2.0, 3.0, 1.0)


@given(force=three, step_mm=three)
def test_work_is_the_same_in_both_frames(force, step_mm) -> None:
    """F dx does not depend on how axes are named: force and position are mapped alike."""
    there = sum(f * s for f, s in zip(to_library(force), step_mm, strict=True))
    here = sum(f * s for f, s in zip(force, to_common(step_mm), strict=True))
    assert 1e-3 * there == pytest.approx(here, abs=1e-12)


def test_every_code_of_the_headers_has_a_name_of_its_own_and_a_cure() -> None:
    codes = [*FORCE_ERRORS, *OTHER_ERRORS]
    assert sorted(FORCE_ERRORS) == list(range(0x200, 0x205))
    assert len(set(map(name_of, codes))) == len(codes) == 21
    assert name_of(0x999) == "error 0x999"
    assert all(map(cure_for, [*codes, 0x999]))
    assert set(CURES) <= set(OTHER_ERRORS)


@pytest.mark.parametrize(
    ("said", "model"),
    [
        ("Touch", "touch"),
        ("Geomagic Touch", "touch"),
        ("Touch X", "desktop"),
        ("PHANTOM Omni", "omni"),
        ("PHANTOM Desktop", "desktop"),
        ("PHANTOM Premium 1.0", "premium1.0"),
        ("PHANTOM Premium 1.5 6DOF", "premium1.5"),
        ("PHANTOM Premium 3.0 6DOF", "premium3.0"),
        ("Falcon", None),
        ("", None),
    ],
)
def test_models_by_what_they_call_themselves(said, model) -> None:
    assert model_of(said) == model


@given(peak=st.floats(0.01, 50.0), continuous=st.floats(0.01, 50.0), stiffness=st.floats(0.001, 1.0))
def test_a_device_can_only_lower_its_record(peak, continuous, stiffness) -> None:
    for record in RECORDS.values():
        low = lowered(record, Facts("Touch", peak, continuous, stiffness), "", "here")
        assert low.peak_force_n == min(record.peak_force_n, peak)
        assert low.continuous_force_n == min(record.continuous_force_n, continuous, low.peak_force_n)
        assert low.stiffness_npm == min(record.stiffness_npm, 1000.0 * stiffness)


def test_force_is_held_for_fifty_frames_and_not_for_one_more() -> None:
    mailbox = Mailbox({})
    mailbox.say((1.0, 2.0, 3.0))
    sent = [mailbox.frame(ZERO, 0) for _ in range(HOLD_FRAMES + 3)]
    assert sent == [(2.0, 3.0, 1.0)] * HOLD_FRAMES + [ZERO] * 3
    assert mailbox.counts == {"force not renewed": 1}
    mailbox.say((1.0, 2.0, 3.0))  # the same force again is a new order
    assert mailbox.frame(ZERO, 0) == (2.0, 3.0, 1.0)


@given(
    st.lists(
        st.one_of(
            three.map(lambda force: ("say", force)),
            st.sampled_from([("frame", None), ("nan", None), ("skip", None), ("fatal", None), ("drop", None)]),
            st.integers(1, 60).map(lambda many: ("frames", many)),
        ),
        max_size=30,
    )
)
@settings(max_examples=200)
def test_what_is_sent_is_the_newest_force_or_zero(events) -> None:
    """An independent account of the rule: zero when lost, dropped, untrusted, or not renewed for HOLD_FRAMES frames."""
    mailbox = Mailbox({})
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
            for _ in range(argument or 1):
                good = event in ("frame", "frames") and not drop and not lost and since < HOLD_FRAMES
                sent = (
                    mailbox.skip("why")
                    if event == "skip"
                    else mailbox.frame((nan if event == "nan" else 0.0, 0.0, 0.0), 0)
                )
                assert sent == (to_library(newest) if good else ZERO)
                drop, since = False, since + 1
    assert bool(mailbox.lost) == lost


# -- the binding -------------------------------------------------------------------------------------------------------


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
    other = compile_stub(_write(tmp_path / "other.c", "int hdInitDevice(void) { return 0; }"), tmp_path / "libother.so")
    with pytest.raises(DeviceError, match="has no hdDisableDevice: it is not the OpenHaptics HD library"):
        make(f"openhaptics:x?library={other}").open(RATE_HZ)


def _write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


# -- opening and closing -----------------------------------------------------------------------------------------------


def test_order_of_use(bench) -> None:
    device = bench.opened()
    bench.step(2)
    device.close()
    name = "Default Device"
    assert bench.journal() == [
        f"init {name}",
        "start",
        f"check calibration {name}",
        f"enable {name}",
        "schedule 65535",
        f"disable {name}",
        "stop",
        "unschedule",
        f"disable device {name}",
    ]


def test_no_name_is_the_default_device(bench) -> None:
    device = make(f"openhaptics:?library={bench.path}")
    device.open(RATE_HZ)
    device.close()
    assert bench.journal()[0] == "init NULL"


def test_closed_device_refuses_and_closes_twice(bench) -> None:
    device = bench.device()
    for _ in range(2):
        for verb in (lambda: device.read(0), lambda: device.write((0.0,) * 3)):
            with pytest.raises(DeviceError, match=r"while it is closed; call open\(rate_hz\) first"):
                verb()
        device.close()
        device.close()
        device.open(RATE_HZ)
        with pytest.raises(DeviceError, match="open already"):
            device.open(RATE_HZ)
        device.close()


@pytest.mark.parametrize("rate_hz", [0, 1025])
def test_rates_out_of_bounds(bench, rate_hz) -> None:
    with pytest.raises(DeviceError, match=f"rate_hz={rate_hz} is out of 1 to 1024"):
        bench.device().open(rate_hz)
    assert bench.journal() == []


@pytest.mark.parametrize("rate_hz", [1, 1024])
def test_rates_within_bounds(bench, rate_hz) -> None:
    device = bench.device()
    device.open(rate_hz)
    device.close()


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


@pytest.mark.parametrize(
    ("said", "keys", "words"),
    [
        ("PHANTOM Omni", "&model=touch", "that is model=omni, not touch; correct the key model"),
        ("Falcon", "", "calls itself 'Falcon', which is not known; known are touch, omni"),
        ("Falcon", "&model=touch", "which is not known"),
    ],
)
def test_another_model_is_refused(bench, said, keys, words) -> None:
    bench.lib.stub_model(0, said.encode(), ctypes.c_double(3.3), ctypes.c_double(0.88), ctypes.c_double(0.5))
    with pytest.raises(DeviceError, match=words):
        bench.opened(keys=keys)
    assert "enable Default Device" not in bench.journal()


@pytest.mark.parametrize("bad", [(0.0, 0.88, 0.5), (3.3, -1.0, 0.5), (3.3, 0.88, nan), (inf, 0.88, 0.5)])
def test_limits_that_are_none_are_refused(bench, bad) -> None:
    bench.lib.stub_model(0, b"Touch", *map(ctypes.c_double, bad))
    with pytest.raises(DeviceError, match=r"the library states a largest .*not above 0"):
        bench.opened()


def test_limits_are_lowered_at_open_and_hold(bench) -> None:
    bench.lib.stub_model(0, b"PHANTOM Premium 1.5", ctypes.c_double(6.0), ctypes.c_double(9.0), ctypes.c_double(0.6))
    device = bench.device(keys="&model=premium1.5")
    assert (device.capability.peak_force_n, device.capability.stiffness_npm) == (8.5, 800.0)
    device.open(RATE_HZ)
    record = device.capability
    assert (record.peak_force_n, record.continuous_force_n, record.stiffness_npm) == (6.0, 1.4, 600.0)
    device.write((8.0, 0.0, 0.0))
    bench.step()
    assert bench.force() == (0.0, 0.0, -6.0)
    device.close()


def test_model_that_is_not_stated_has_the_limits_of_the_weakest(bench) -> None:
    bench.lib.stub_model(0, b"PHANTOM Premium 3.0", ctypes.c_double(22.0), ctypes.c_double(3.0), ctypes.c_double(1.0))
    device = bench.opened()
    assert device.capability.peak_force_n == 3.3
    device.close()


# -- calibration -------------------------------------------------------------------------------------------------------


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


# -- samples and forces ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("axes", [1, 2, 3])
def test_samples_and_forces_on_fewer_axes(bench, axes) -> None:
    device = bench.opened(axes=axes)
    assert device.capability.axes == axes == len(device.capability.workspace_m)
    bench.move(0, 10.0, -20.0, 30.0)
    bench.lib.stub_buttons(0, 2)
    bench.step()
    sample = device.read(1)
    assert sample.position_m == pytest.approx((0.030, 0.010, -0.020)[:axes])
    assert (sample.velocity_mps, sample.age_ticks) == (None, device.capability.latency_ticks)
    assert device.buttons == 2
    device.write((0.5, 1.0, -1.5)[:axes])
    bench.step()
    want = (0.5, 1.0, -1.5)[:axes] + (0.0,) * (3 - axes)
    assert bench.force() == tuple(-f for f in to_library(want))
    device.close()


def test_each_frame_is_read_once(bench) -> None:
    device = bench.opened()
    assert device.read(0) is None
    bench.step()
    assert device.read(1) is not None
    assert device.read(1) is None
    bench.step(3)
    assert device.read(2) is not None
    with pytest.raises(DeviceError, match="read\\(tick=1\\) after tick 2; ticks must not fall"):
        device.read(1)
    device.close()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_positive_force_moves_the_device_towards_minus(bench, axis) -> None:
    """The sign of P eq. 9, m x'' = F_hand - F, felt through mapping, callback and library."""
    bench.lib.stub_mass(0, ctypes.c_double(0.1))
    device = bench.opened()
    for tick in range(100):
        device.read(tick)
        device.write([1.0 if i == axis else 0.0 for i in range(3)])
        bench.step()
    moved = device.read(100).position_m
    assert moved[axis] == pytest.approx(-0.5 * 1.0 / 0.1 * 0.1**2, rel=0.02)
    assert [value for i, value in enumerate(moved) if i != axis] == [0.0, 0.0]
    device.close()


@given(force=st.tuples(*[st.floats(-100.0, 100.0)] * 3))
@settings(max_examples=50)
def test_force_is_limited_and_keeps_its_direction(force) -> None:

    device = make("openhaptics:x")
    device._link = _NoLink()
    device._mailbox = Mailbox({})
    acting = device.write(force)
    sent = device._mailbox.order.force_n
    assert tuple(-f for f in sent) == (acting or force)
    assert hypot(*sent) <= 3.3 * (1 + 1e-12)
    share = min(1.0, 3.3 / max(hypot(*force), 1e-300))
    assert sent == pytest.approx([-share * f for f in force], abs=1e-12)
    assert device.counts.get("force limited", 0) == (hypot(*force) > 3.3)


class _NoLink:
    def close(self) -> None: ...


def test_both_sides_of_the_limit(bench) -> None:
    device = bench.opened(keys="&peak_force_n=2")
    device.write((2.0, 0.0, 0.0))
    assert device.counts == {}
    device.write((2.0000001, 0.0, 0.0))
    assert device.counts == {"force limited": 1}
    bench.step()
    assert bench.force() == (0.0, 0.0, -2.0)
    device.close()


@pytest.mark.parametrize(
    "bad", [(nan, 0.0, 0.0), (0.0, inf, 0.0), (0.0, 0.0, -inf), (1.7e308,) * 3, (1.0, 1.0), (1.0,) * 4]
)
def test_a_force_that_is_none_makes_it_zero(bench, bad) -> None:
    device = bench.opened()
    device.write((1.0, 1.0, 1.0))
    bench.step()
    assert bench.force() == (-1.0, -1.0, -1.0)
    with pytest.raises(DeviceError, match="axes" if len(bad) != 3 else "not finite"):
        device.write(bad)
    bench.step()
    assert bench.force() == (0.0, 0.0, 0.0)
    device.write((0.0, 0.0, 1.0))
    bench.step()
    assert bench.force() == (0.0, -1.0, 0.0)
    device.close()


def test_a_loop_that_stops_leaves_no_force(bench) -> None:
    device = bench.opened()
    device.write((1.0, 0.0, 0.0))
    bench.step(HOLD_FRAMES)
    assert bench.force() == (0.0, 0.0, -1.0)
    bench.step()
    assert bench.force() == (0.0, 0.0, 0.0)
    assert device.counts == {"force not renewed": 1}
    assert device.read(60) is not None
    device.close()


def test_close_sends_zero_within_a_frame_of_its_own(bench) -> None:
    device = bench.opened()
    device.write((1.0, 0.0, 0.0))
    bench.step()
    frames = bench.lib.stub_frames(0)
    device.close()
    assert bench.force() == (0.0, 0.0, 0.0)
    assert bench.lib.stub_frames(0) == frames + 1


@pytest.mark.parametrize("axes", [1, 2, 3])
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_it_keeps_what_every_device_promises(bench, check, axes) -> None:
    def acting(_) -> tuple[float, ...]:
        right, up, near = bench.force()
        return (-near, -right, -up)[:axes]

    def pace(_) -> None:
        bench.step()

    check(Subject(lambda: bench.device(0, axes), RATE_HZ, pace, acting))


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_servo_keeps_what_every_device_promises(servo, check) -> None:
    """In the time of the thread."""
    check(Subject(lambda: servo.device(0), RATE_HZ, lambda _: servo.lib.stub_wait(1)))


# -- errors ------------------------------------------------------------------------------------------------------------


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


@pytest.mark.parametrize("bad", [(nan, 0.0, 0.0), (0.0, inf, 0.0)])
def test_position_that_is_no_number_is_no_sample_and_no_force(bench, bad) -> None:
    device = bench.opened()
    device.write((1.0, 0.0, 0.0))
    bench.move(0, *bad)
    bench.step(2)
    assert device.read(1) is None
    assert bench.force() == (0.0, 0.0, 0.0)
    assert device.counts == {"position not finite": 2}
    bench.move(0, 1.0, 2.0, 3.0)
    bench.step()
    assert device.read(2).position_m == pytest.approx((0.003, 0.001, 0.002))
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


# -- two devices -------------------------------------------------------------------------------------------------------


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
    bench.lib.stub_model(2, b"PHANTOM Omni", ctypes.c_double(2.0), ctypes.c_double(0.5), ctypes.c_double(0.5))
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


# -- the servo's own thread --------------------------------------------------------------------------------------------


def test_servo_two_devices_exchange_whole_values_with_its_thread(servo) -> None:
    """Positions have three equal parts and so have the forces: a mixture of two values would show."""
    servo.lib.stub_ramp(1)
    devices = [servo.opened(1), servo.opened(2)]
    for tick in range(400):
        servo.lib.stub_wait(1 if tick % 8 == 0 else 0)  # mostly in the midst of frames
        for device in devices:
            sample = device.read(tick)
            assert sample is None or len(set(sample.position_m)) == 1
            device.write((0.001 * tick,) * 3)
    servo.lib.stub_wait(2)
    for number, device in enumerate(devices, 1):
        assert servo.lib.stub_worst(number) == pytest.approx(0.399 * 3**0.5)  # the last one has been sent
        assert servo.lib.stub_torn(number) == 0
        assert set(device.counts) <= {"force not renewed"}  # the machine may be busy
        device.close()
        assert servo.force(number) == (0.0, 0.0, 0.0)


def test_servo_drops_the_force_of_a_loop_that_hangs(servo) -> None:
    device = servo.opened()
    device.write((1.0, 0.0, 0.0))
    servo.lib.stub_wait(HOLD_FRAMES + 3)
    assert servo.force() == (0.0, 0.0, 0.0)
    assert device.counts == {"force not renewed": 1}
    device.close()


def test_servo_devices_come_and_go(servo) -> None:
    """The library's lock is held in every callback: a call from here that kept the interpreter's lock would never come back."""
    left = servo.opened(1)
    for _ in range(20):
        right = servo.opened(2)
        left.write((1.0, 0.0, 0.0))
        servo.lib.stub_wait(2)
        right.close()
    left.close()
    assert servo.lib.stub_worst(1) == 1.0
    assert set(left.counts) <= {"force not renewed"}


SCRIPT = """
import atexit, ctypes, sys
from cogrip.devices.openhaptics.family import family
from cogrip.devices.settings import parse_address
lib = ctypes.CDLL(sys.argv[1])
lib.stub_wrongs.restype = ctypes.c_char_p
force = (ctypes.c_double * 3)()
def tell():
    lib.stub_force(0, force)
    print([f + 0.0 for f in force], lib.stub_running(), lib.stub_wrongs())
atexit.register(tell)  # runs last
device = family().make(parse_address("openhaptics:Default Device?library=" + sys.argv[1]), 3, {})
device.open(1000)
device.write((1.0, 0.0, 0.0))
lib.stub_wait(3)
lib.stub_worst.restype = ctypes.c_double
print(lib.stub_worst(0))
exec(sys.argv[2])
"""


@pytest.mark.parametrize("end", ["pass", "raise RuntimeError", "raise KeyboardInterrupt", "sys.exit(3)"])
def test_servo_of_a_process_that_ends_without_closing(servo, end) -> None:
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(servo.path), end], capture_output=True, text=True, check=False
    )
    assert done.stdout.splitlines() == ["1.0", "[0.0, 0.0, 0.0] 0 b''"]


# -- addresses ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("address", "axes", "words"),
    [
        ("openhaptics:x?modle=touch", 3, "unknown key 'modle'; did you mean 'model'"),
        ("openhaptics:x?model=falcon", 3, "model='falcon' is not accepted: expected one of , touch, omni"),
        ("openhaptics:x?peak_force_n=0", 3, "peak_force_n='0' is not accepted"),
        ("openhaptics:x?peak_force_n=41", 3, "peak_force_n='41' is not accepted"),
        ("openhaptics:x", 0, "axes=0 is out of 1 to 3"),
        ("openhaptics:x", 4, "axes=4 is out of 1 to 3"),
    ],
)
def test_addresses_that_are_wrong(address, axes, words) -> None:
    with pytest.raises(DeviceError, match=words):
        make(address, axes)


@pytest.mark.parametrize("example", family().examples)
@pytest.mark.parametrize("axes", [1, 2, 3])
def test_capability_is_there_before_opening_and_makes_sense(example, axes) -> None:
    record = make(example, axes).capability
    assert record.axes == axes == len(record.workspace_m)
    assert all(low < high for low, high in record.workspace_m)
    assert 0.0 < record.continuous_force_n <= record.peak_force_n < inf
    assert (
        min(record.stiffness_npm, record.damping_nspm, record.slew_nps, record.speed_mps, record.apparent_mass_kg) > 0.0
    )
    assert record.resolution_m > 0.0
    assert record.rate_hz >= 1024


def test_peak_force_key_lowers_and_never_raises() -> None:
    assert make("openhaptics:x?peak_force_n=0.5").capability.continuous_force_n == 0.5
    assert make("openhaptics:x?peak_force_n=30").capability.peak_force_n == 3.3
