"""The emulated hfab firmware by its own rules: what it refuses, what it does then, when it lets go. Virtual time."""

import ctypes
import os
import re
from math import inf

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from cogrip.devices.device import DeviceError
from cogrip.devices.emulated.faults import VERBS, Faults
from cogrip.devices.emulated.firmware import JUMP_COUNTS
from cogrip.devices.emulated.hfab_firmware import IDLE_PWM, LONGEST, MOST_MA, WATCHDOG_NS, HfabFirmware
from cogrip.devices.family.machines import make_firmware
from cogrip.devices.serial.frames import MODELS as NUMBERS
from cogrip.devices.serial.frames import BracketCodec
from cogrip.devices.settings import parse_address

ZERO = BracketCodec().encode((0, 0, 0))
MIDDLE = b"[2,0,-534,-36,0,0,0,0]\n"  # a reply from the middle of the workspace
FRESH = b"[2,0,0,0,0,0,0,0]\n"  # from where its counters began, or the button was pressed
MS = 1_000_000
NAMES = tuple(NUMBERS.values())


def firmware(name: str = "vintage", hand: str = "hold") -> HfabFirmware:
    """A device in a hand, whose keys stand as in an address."""
    arm = make_firmware(name, parse_address(f"sim:phantom?hand={hand}").query)
    assert isinstance(arm, HfabFirmware)
    return arm


def say(arm: HfabFirmware, data: bytes, at_ns: int | None = None) -> list[bytes]:
    at_ns = arm.now_ns if at_ns is None else at_ns
    arm.receive(data, at_ns)
    return arm.due(at_ns)


def errors(replies: list[bytes]) -> list[int]:
    return [int(reply[1:-2].split(b",")[7]) for reply in replies]


def counts(reply: bytes) -> tuple[int, ...]:
    return tuple(map(int, reply[1:-2].split(b",")))[1:4]


@pytest.mark.parametrize(("number", "name"), NUMBERS.items())
def test_each_frame_has_one_line_with_the_machine_and_its_counters(number: int, name: str) -> None:
    arm = firmware(name)
    assert arm.due(10**12) == []
    for _ in range(3):
        a, b, c = arm.mechanics.counters
        assert say(arm, ZERO) == [b"[%d,%d,%d,%d,0,0,0,0]\n" % (number, a, b, c)]
    assert say(arm, b"") == []


def test_the_counters_were_zero_where_the_arm_was_powered_up_and_are_by_the_button() -> None:
    arm = make_firmware("vintage", {"hand": "hold"}, powered_at_m=(0.0, 0.0, 0.0))
    assert say(arm, ZERO) == [FRESH]
    arm = firmware()
    assert say(arm, ZERO) == [MIDDLE]  # (0, -534, -36) from the home pose
    arm.press()
    assert say(arm, ZERO) == [FRESH]
    with pytest.raises(DeviceError, match="no arm can stand at"):
        make_firmware("vintage", {}, powered_at_m=(1.0, 0.0, 0.0))


FRAMES = {  # what stands before a frame is skipped; numbers are read from the last bracket on, as "%d" reads
    0: (
        b"[1,2,3]\n", b"[1,2,3]", b"[1,2,3]\r\n\0\0\n", b"\n\0 xyz[1,2,3]\n", b"[ 1,\t2, +3]\n", b"[1,2,3x]\n", b"[-0,007,3]\n",
        b"[1[1,2,3]\n",
    ),
    8: (b"[1,2,3]x", b"[1,2,3] \n", b"[1,2,3]\n[", b"[1,2,3]\n\0x"),
    256: (b"]\n", b"1,2,3]\n"),
    512: (b"[]\n", b"[1,2]\n", b"[1,2,3,4]\n", b"[1,2[1,2,3]\n", b",[1,2,3]\n"),  # commas are counted wherever they stand
    1024: (
        b",[1,2]\n", b"[1,2[3,4]\n", b"[1,[2,3]\n", b"[,,]\n", b"[1,2,]\n", b"[1 ,2,3]\n", b"[1.5,2,3]\n", b"[x1,2,3]\n",
        b"[- 1,2,3]\n", b"[0x1,2,3]\n",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("frame", "error"), [(frame, error) for error, frames in FRAMES.items() for frame in frames])
def test_every_rule_from_both_sides(frame: bytes, error: int) -> None:
    assert errors(say(firmware(), frame)) == [error]


@pytest.mark.parametrize(
    ("data", "replies", "currents"),
    [
        (b"[1,2]\n[4,5,6]\n", [512, 0], (4, 5, 6)),  # a wrong number of commas leaves the rest unread
        (b"[1,2,3]\n[4,5,6]\n", [8, 256], (7, 8, 9)),
        (b"[a,b,c]\n[4,5,6]\n", [8, 256], (7, 8, 9)),  # numbers are read after what follows was looked at
        (b"][4,5,6]\n", [256, 0], (4, 5, 6)),
        (b"[1][2][4,5,6]\n", [512, 512, 0], (4, 5, 6)),
        (b"[1,2,3]x[4,5,6]\n", [8, 0], (4, 5, 6)),  # only the one wrong byte is gone
        (b"[1,2,3]xx,[4,5,6]\n", [8, 512], (7, 8, 9)),
    ],
)
def test_frames_that_follow_one_another(data: bytes, replies: list[int], currents: tuple[int, ...]) -> None:
    """Golden: what the firmware's own loop does with them, byte by byte."""
    arm = firmware()
    say(arm, b"[7,8,9]\n")
    assert errors(say(arm, data)) == replies
    assert arm.mechanics.currents_ma == currents


def test_what_stands_before_a_frame_counts_towards_its_127_bytes() -> None:
    frame = b"[1,2,3]"
    assert errors(say(firmware(), bytes(LONGEST - len(frame)) + frame)) == [0]
    assert errors(say(firmware(), bytes(LONGEST - len(frame) + 1) + frame)) == [128, 256]
    arm = firmware()
    assert say(arm, b"x" * 126) == []
    assert errors(say(arm, b"x")) == [128]


class ByteByByte:
    """The firmware's reader as a loop over single bytes, with C's own sscanf: what `HfabFirmware` is held against."""

    def __init__(self) -> None:
        self.waiting = bytearray()
        self.read = bytearray()
        self.currents = [0, 0, 0]

    def take(self, data: bytes) -> list[int]:
        self.waiting += data
        said = []
        while self.waiting:
            self.read.append(self.waiting.pop(0))
            if self.read.endswith(b"]"):
                said.append(self.end())
                self.read.clear()
            elif len(self.read) == LONGEST:
                said.append(128)
                self.read.clear()
        return said

    def end(self) -> int:
        if b"[" not in self.read:
            return 256
        if self.read.count(b",") != 2:
            return 512
        while self.waiting:
            if self.waiting.pop(0) not in b"\n\r\0":
                return 8
        a, b, c = (ctypes.c_int() for _ in range(3))
        frame = bytes(self.read[self.read.rindex(b"[") :])
        if SSCANF(frame, b"[%d,%d,%d]", ctypes.byref(a), ctypes.byref(b), ctypes.byref(c)) != 3:
            return 1024
        self.currents = [each.value if abs(each.value) <= 6000 else 0 for each in (a, b, c)]
        return 0


SSCANF = getattr(ctypes.CDLL(None), "sscanf", None) if os.name == "posix" else None
number = st.integers(1 - 10**9, 10**9 - 1).map(str) | st.integers(-7000, 7000).map(str)
piece = (
    st.binary(max_size=40).map(lambda data: data.decode("latin-1"))
    | st.text("[],,-+0123456789 \n\r\0x", max_size=8)
    | st.builds("[{},{},{}]\n".format, number, number, number)
)
stretch = st.lists(piece, max_size=10).map("".join) | st.text("[ x\0", max_size=140)


@pytest.mark.skipif(SSCANF is None, reason="needs the C library's sscanf")
@given(st.lists(stretch.map(lambda text: text.encode("latin-1")), max_size=5))
def test_it_reads_as_the_firmware_s_loop_over_single_bytes(parts: list[bytes]) -> None:
    """Whatever comes; and after that a good frame is answered."""
    assume(not re.search(rb"\d{10}", b"".join(parts)))  # C leaves open what comes of a number that an int cannot hold
    arm, loop = firmware(), ByteByByte()
    for part in parts:
        assert errors(say(arm, part)) == loop.take(part)
        assert list(arm.mechanics.currents_ma) == loop.currents
    say(arm, b"]" + ZERO)
    assert errors(say(arm, ZERO)) == [0]


PWM = {6000: 7371, -6000: 819, 0: 4095, 1: 4096, -1: 4094, 3000: 5733}  # of currents [mA]


@pytest.mark.parametrize("ma", [*PWM, 6001, -6001, 99999, 2**40])
def test_the_pwm_of_a_current_and_none_for_a_motor_that_is_asked_for_too_much(ma: int) -> None:
    arm = firmware()
    assert errors(say(arm, b"[%d,6000,-6000]\n" % ma)) == [0]
    assert arm.pwm == [PWM.get(ma, IDLE_PWM), 7371, 819]
    assert arm.mechanics.currents_ma == (ma if ma in PWM else 0, MOST_MA, -MOST_MA)
    assert PWM[0] == IDLE_PWM


@pytest.mark.parametrize(
    "frame", [b"[1,2]\n", b"[a,b,c]\n", b"]", b"[1,2,3]x", b"[" * 127], ids=["512", "1024", "256", "8", "128"]
)
def test_a_refused_frame_changes_nothing_and_shows_old_counters(frame: bytes) -> None:
    arm = firmware(hand="tremor&tremor_m=0.003&direction=1,1,1")
    say(arm, ZERO, 0)
    [good] = say(arm, b"[300,-200,100]\n", 50 * MS)
    pwm = list(arm.pwm)
    [refused] = say(arm, frame, 90 * MS)
    assert counts(refused) == counts(good) != arm.mechanics.counters
    assert arm.pwm == pwm != [IDLE_PWM] * 3
    assert arm.mechanics.currents_ma == (300, -200, 100)
    arm.advance(50 * MS + WATCHDOG_NS)
    assert arm.enabled
    arm.advance(50 * MS + WATCHDOG_NS + 1)  # it did not feed the watchdog
    assert not arm.enabled


def test_the_watchdog_lets_go_after_a_tenth_of_a_second_and_any_good_frame_ends_that() -> None:
    arm = firmware()
    assert not arm.enabled
    say(arm, b"[500,500,500]\n", 0)
    assert arm.enabled
    arm.advance(WATCHDOG_NS)
    assert arm.enabled
    assert any(arm.mechanics.force_n)
    arm.advance(WATCHDOG_NS + 1)
    assert not arm.enabled
    assert arm.pwm == [IDLE_PWM] * 3
    assert arm.mechanics.force_n == (0.0, 0.0, 0.0)
    say(arm, b"[500,500]\n")
    assert not arm.enabled
    say(arm, ZERO)
    assert arm.enabled
    assert arm.mechanics.force_n == (0.0, 0.0, 0.0)
    say(arm, b"[500,500,500]\n")
    assert any(arm.mechanics.force_n)


def test_it_lets_go_on_time_also_where_nobody_looks() -> None:
    """Time that passes in one step has the same hand at its end as time that passes in many."""
    arms = [firmware() for _ in range(2)]
    for arm in arms:
        say(arm, b"[300,0,0]\n", 0)
    arms[0].advance(110 * MS)
    for at in range(1, 111):
        arms[1].advance(at * MS)
    assert arms[0].mechanics.body.position_m == pytest.approx(arms[1].mechanics.body.position_m, abs=5e-5)
    assert arms[0].mechanics.peak_force_n == pytest.approx(arms[1].mechanics.peak_force_n, rel=1e-3)
    assert not any(arm.enabled for arm in arms)


@pytest.mark.parametrize(("verb", "currents"), [("silence", (1, 2, 3)), ("deaf", (0, 0, 0))])
def test_silence_does_what_it_is_told_and_deaf_hears_nothing(verb: str, currents: tuple[int, ...]) -> None:
    arm = failing(verb, 0.01)
    assert say(arm, b"[1,2,3]\n", 9 * MS) == []
    assert arm.mechanics.currents_ma == currents
    assert errors(say(arm, b"[4,5,6]\n", 10 * MS)) == [0]


def failing(verb: str, seconds: float = inf, name: str = "vintage") -> HfabFirmware:
    arm = firmware(name)
    arm.fault(verb, seconds)
    return arm


def test_garbage_is_as_long_and_the_same_each_time_and_short_cuts_the_end_off() -> None:
    [first], again = (say(failing("garbage"), ZERO) for _ in range(2))
    assert [first] == again
    assert len(first) == len(MIDDLE)
    assert BracketCodec().feed(first) == []
    arm = failing("short")
    for _ in range(30):
        [part] = say(arm, ZERO)
        assert MIDDLE.startswith(part)
        assert 1 <= len(part) < len(MIDDLE)


def test_split_comes_in_two_parts_a_millisecond_apart_and_merge_lets_every_other_reply_wait() -> None:
    arm = failing("split")
    [first] = say(arm, ZERO)
    assert arm.faults.waiting
    assert arm.due(MS - 1) == []
    [second] = arm.due(MS)
    assert first + second == MIDDLE
    arm = failing("merge")
    assert [say(arm, ZERO) for _ in range(3)] == [[], [MIDDLE * 2], []]
    arm.mend()
    assert [say(arm, ZERO) for _ in range(2)] == [[MIDDLE * 2], [MIDDLE]]


def test_slow_is_30_ms_late_and_nothing_overtakes_it() -> None:
    arm = failing("slow", 0.005)
    assert say(arm, ZERO, 0) == []
    assert say(arm, ZERO, 6 * MS) == []  # not slow any more, but behind one that is
    assert arm.due(30 * MS - 1) == []
    assert len(arm.due(30 * MS)) == 2


def test_stale_puts_one_old_reply_before_the_next() -> None:
    arm = firmware()
    say(arm, ZERO)
    arm.press()
    arm.fault("stale")
    assert say(arm, ZERO) == [MIDDLE, FRESH]
    assert say(arm, ZERO) == [FRESH]


def test_model_says_that_it_is_the_next_machine() -> None:
    for number, name in NUMBERS.items():
        arm = failing("model", 0.01, name)
        assert say(arm, ZERO)[0][:3] == b"[%d," % (number % 3 + 1)
        assert say(arm, ZERO, 10 * MS)[0][:3] == b"[%d," % number


def test_jump_slips_for_good() -> None:
    arm = firmware()
    before = arm.mechanics.counters
    arm.fault("jump")
    assert arm.mechanics.counters == (before[0] + JUMP_COUNTS, before[1], before[2])
    arm.mend()
    arm.advance(100 * MS)
    assert arm.mechanics.counters[0] == before[0] + JUMP_COUNTS


def test_a_stuck_encoder_misses_what_was_moved_meanwhile() -> None:
    arm = firmware(hand="reach&direction=0,1,0&amplitude_m=0.02")
    say(arm, ZERO, 0)
    arm.advance(200 * MS)
    stood = arm.mechanics.counters
    arm.fault("stuck", 0.2)
    arm.advance(399 * MS)
    moved = [new - old for new, old in zip(arm.mechanics.counters, stood, strict=True)]
    assert moved[0] == 0
    arm.advance(800 * MS)
    true = arm.mechanics.model.drive.counts(arm.mechanics.model.kinematics.inverse(arm.mechanics.body.position_m))
    assert abs(true[0] - arm.mechanics.counters[0]) > 100


def test_unplugged_it_has_no_power_and_its_counters_are_gone() -> None:
    arm = firmware()
    say(arm, b"[300,300,300]\n")
    say(arm, b"[1,2,")  # half a frame is forgotten with the power
    arm.fault("unplug")
    assert not arm.plugged
    assert arm.mechanics.force_n == (0.0, 0.0, 0.0)
    assert say(arm, b"[1,2,3]\n") == []
    arm.mend()
    assert arm.plugging == 2
    assert not arm.enabled
    assert say(arm, b"[1]\n") == [b"[2,0,0,0,0,0,0,512]\n"]
    assert say(arm, ZERO) == [FRESH]


def test_an_unknown_verb_is_refused() -> None:
    with pytest.raises(ValueError, match="no fault 'fire'; there are: silence"):
        firmware().fault("fire")


STEPS = st.tuples(st.sampled_from((*VERBS, "mend")), st.integers(0, 30), st.integers(0, 30))


@given(st.lists(STEPS, min_size=1, max_size=12), st.booleans())
def test_faults_may_meet_in_any_order(plan: list[tuple[str, int, int]], reports: bool) -> None:
    """Nothing is raised, replies keep their order, and once all is mended and has come through all is well."""
    arm = firmware()
    arm.faults = Faults(3, reports=reports)
    at = 0
    for verb, milliseconds, later in plan:
        if verb == "mend":
            arm.mend()
        else:
            arm.fault(verb, max(1, milliseconds) / 1e3)
        for _ in range(later):
            at += MS
            say(arm, ZERO, at)
    arm.mend()
    at += 100 * MS
    say(arm, ZERO, at)
    arm.due(at + 100 * MS)
    assert errors(say(arm, ZERO, at + 100 * MS)) == [0]
