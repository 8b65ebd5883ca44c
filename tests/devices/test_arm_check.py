"""The verdict on an arm before it is held: from both sides of every bound, and the measurement in virtual time."""

from dataclasses import replace
from itertools import product
from math import ceil, nan

import pytest

from cogrip.devices.arm import check as bounds
from cogrip.devices.arm.check import LEAST_MOVED_COUNTS, MOST_NOISE_COUNTS, ArmFindings, VerdictRow, verdict
from cogrip.devices.arm.exchange import RequestExchange
from cogrip.devices.device import DeviceError
from cogrip.devices.emulated.emulated_line import EmulatedLine
from cogrip.devices.emulated.hfab_firmware import HfabFirmware
from cogrip.devices.emulated.mechanics import Mechanics
from cogrip.devices.family.machines import make_firmware
from cogrip.devices.io import arm_check
from cogrip.devices.io.arm_check import MOST_TEST_MA, ArmCheck
from cogrip.devices.serial.frames import MODELS as NUMBERS
from cogrip.devices.serial.frames import BracketCodec
from cogrip.devices.settings import parse_address

from tests.extent import every, long

SLOWEST_HZ, LATEST_US = bounds.LEAST_RATE_HZ, bounds.MOST_LATENCY_US
WELL = ArmFindings(
    requests=2000, missed=0, rate_hz=4000.0, latency_p50_us=200.0, latency_p99_us=300.0, noise=(0, 1, 0),
    forward=(60, 60, 60), backward=(-60, -60, -60), lowest=(-500, -500, -500), highest=(500, 500, 500),
)  # fmt: skip


def bad(measured: ArmFindings) -> dict[str, VerdictRow]:
    return {row.what: row for row in verdict(measured, 200.0) if not row.good}


def test_a_well_arm_has_a_line_for_everything_and_all_are_good() -> None:
    rows = verdict(WELL, 150.0)
    assert bad(WELL) == {}
    assert len(rows) == 3 + 3 * 3
    assert len({row.what for row in rows}) == len(rows)
    assert all(row.what and row.found and row.wanted for row in rows)
    assert "+-150 mA" in next(row.wanted for row in rows if row.what == "sign, axis a")


@pytest.mark.parametrize(
    ("what", "fine", "wrong"),
    [
        ("requests answered", {"missed": 2}, {"missed": 3}),
        ("requests answered", {"requests": 1000, "missed": 1}, {"requests": 999, "missed": 1}),
        ("rate, one request after the other", {"rate_hz": SLOWEST_HZ}, {"rate_hz": SLOWEST_HZ - 0.1}),
        ("latency, 50 and 99 %", {"latency_p99_us": LATEST_US}, {"latency_p99_us": LATEST_US + 0.1}),
        ("noise at rest, encoder b", {"noise": (0, MOST_NOISE_COUNTS, 0)}, {"noise": (0, MOST_NOISE_COUNTS + 1, 0)}),
        ("range seen, encoder c", {"highest": (9, 9, -499)}, {"highest": (9, 9, -500)}),
        ("sign, axis a", {"forward": (LEAST_MOVED_COUNTS, 9, 9)}, {"forward": (LEAST_MOVED_COUNTS - 1, 9, 9)}),
        ("sign, axis c", {"backward": (-9, -9, -LEAST_MOVED_COUNTS)}, {"backward": (-9, -9, 1 - LEAST_MOVED_COUNTS)}),
    ],
)
def test_both_sides_of_every_bound(what: str, fine: dict, wrong: dict) -> None:
    assert bad(replace(WELL, **fine)) == {}
    rows = bad(replace(WELL, **wrong))
    assert list(rows) == [what]
    assert rows[what].cure


@pytest.mark.parametrize(
    ("forward", "backward", "cure"),
    [
        (-60, 60, "motor or encoder of axis b is wired the other way round: force would push the wrong way; swap one"),
        (-4, 4, "wired the other way round"),
        (0, 0, "it did not move"),
        (3, -3, "it did not move"),
        (-3, 3, "it did not move"),
        (60, 0, "it moved one way only"),
        (0, -60, "it moved one way only"),
        (60, 60, "it moved one way only"),
        (-60, -60, "it moved one way only"),
    ],
)
def test_what_is_wrong_with_a_sign(forward: int, backward: int, cure: str) -> None:
    rows = bad(replace(WELL, forward=(60, forward, 60), backward=(-60, backward, -60)))
    assert list(rows) == ["sign, axis b"]
    assert cure in rows["sign, axis b"].cure
    assert rows["sign, axis b"].found == f"{forward:+d}, {backward:+d} counts"


LOOSE = "hold&hand_stiffness_npm=20&hand_damping_nspm=2&friction_n=0.01"
ON_A_THREAD = f"{LOOSE}&x0_m=-0.0304,0,0.04877"  # which holds the weight of a Polhem at its centre


class Clock:
    """The firmware's own time, as the module `time`."""

    def __init__(self, arm: HfabFirmware) -> None:
        self._arm = arm

    def perf_counter(self) -> float:
        return 1e-9 * self._arm.now_ns

    def sleep(self, seconds: float) -> None:
        assert seconds > 0.0
        self._arm.advance(self._arm.now_ns + round(1e9 * seconds))


class RealPort(EmulatedLine):
    """Time passes: a request takes `wire_s` to and fro, and a reply that is waited for is waited for."""

    def __init__(self, arm: HfabFirmware, wire_s: float = 0.0002) -> None:
        super().__init__("serial:test", arm)
        self.arm = arm
        self.wire_s = wire_s
        self.sent: list[bytes] = []

    def write(self, frame: bytes) -> None:
        self.sent.append(frame)
        super().write(frame)
        self._pass(self.wire_s)

    def read(self, wait_s: float = 0.0) -> bytes:
        data = super().read()
        until = self.arm.now_ns + ceil(1e9 * wait_s)
        while not data and self.arm.now_ns < until:
            self._pass(min(1e-4, 1e-9 * (until - self.arm.now_ns)))
            data = super().read()
        return data

    def _pass(self, seconds: float) -> None:
        self.arm.advance(self.arm.now_ns + max(1, round(1e9 * seconds)))


def checked(
    monkeypatch: pytest.MonkeyPatch, name: str = "vintage", hand: str = LOOSE, current_ma: float = MOST_TEST_MA,
    wire_s: float = 0.0002,
) -> tuple[ArmCheck, RealPort]:  # fmt: skip
    """Nobody holds it, and something like a cable pulls it back a little."""
    arm = make_firmware(name, parse_address(f"sim:phantom?hand={hand}").query)
    assert isinstance(arm, HfabFirmware)
    monkeypatch.setattr(arm_check, "time", Clock(arm))
    port = RealPort(arm, wire_s)
    return ArmCheck(RequestExchange(port, BracketCodec()), current_ma), port


def begun(monkeypatch: pytest.MonkeyPatch, **keys) -> tuple[ArmCheck, RealPort]:
    check, port = checked(monkeypatch, **keys)
    check.begin()
    return check, port


def wrong(check: ArmCheck, moving_s: float = 0.2) -> dict[str, VerdictRow]:
    """The lines of a measurement that are not good."""
    check.begin()
    rows = bad(check.measured(lambda _: None, moving_s))
    check.end()
    return rows


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", NUMBERS.values())
def test_a_well_arm_is_found_well(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    check, port = begun(monkeypatch, name=name, hand=ON_A_THREAD if name == "polhem" else LOOSE)
    port.arm.mechanics.carry((0.0, 0.0, 0.0))
    said: list[str] = []
    measured = check.measured(said.append, 0.5)
    check.end()
    assert bad(measured) == {}
    assert measured.rate_hz == pytest.approx(5000.0, rel=0.01)
    assert measured.latency_p50_us == pytest.approx(200.0, rel=0.01)
    assert measured.missed == 0
    assert measured.requests > 2000
    assert said == [
        "rate and latency",
        "noise at rest: do not touch the arm",
        *[f"axis {axis} under 200 mA: do not touch the arm" for axis in "abc"],
        "now move the arm through its whole range, for 0.5 s",
    ]
    assert port.sent[-1] == port.sent[-2] == BracketCodec().encode((0, 0, 0))
    assert port.arm.mechanics.force_n == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("current_ma", [50.0, long(200.0)])
def test_only_one_axis_at_a_time_and_no_more_than_was_said(monkeypatch: pytest.MonkeyPatch, current_ma: float) -> None:
    check, port = checked(monkeypatch, current_ma=current_ma)
    wrong(check, 0.0)
    seen = set()
    last = [0, 0, 0]
    for frame in port.sent:
        currents = [int(part) for part in frame.strip(b"[]\n\0").split(b",")]
        assert sum(map(bool, currents)) <= 1
        assert max(map(abs, currents)) <= current_ma
        assert all(abs(new) - abs(old) <= 0.06 * current_ma + 1 for new, old in zip(currents, last, strict=True))
        seen |= {(axis, value > 0) for axis, value in enumerate(currents) if value}
        last = currents
    assert seen == {(axis, sense) for axis in range(3) for sense in (True, False)}


@pytest.mark.sample(1)
@pytest.mark.parametrize(("name", "axis"), every(2, product(("vintage", "woodenhaptics-serial"), range(3))))
def test_a_motor_that_is_wired_the_other_way_round_is_found(
    monkeypatch: pytest.MonkeyPatch, name: str, axis: int
) -> None:
    check, port = checked(monkeypatch, name)
    mechanics = port.arm.mechanics
    right = mechanics.drive

    def swapped(currents) -> None:
        right(tuple(-value if number == axis else value for number, value in enumerate(currents)))
        mechanics.currents_ma = currents

    monkeypatch.setattr(mechanics, "drive", swapped)
    rows = wrong(check)
    assert list(rows) == [f"sign, axis {'abc'[axis]}"]
    assert "wired the other way round" in rows[f"sign, axis {'abc'[axis]}"].cure


@pytest.mark.parametrize(("sense", "found"), [(-1, ["sign, axis b"]), (0, ["sign, axis b", "range seen, encoder b"])])
def test_an_encoder_that_counts_the_other_way_or_not_at_all(
    monkeypatch: pytest.MonkeyPatch, sense: int, found: list[str]
) -> None:
    right = Mechanics.counters.fget

    def turned(mechanics: Mechanics) -> tuple[int, int, int]:
        a, b, c = right(mechanics)  # type: ignore[misc]
        return a, sense * b, c

    monkeypatch.setattr(Mechanics, "counters", property(turned))
    assert list(wrong(checked(monkeypatch)[0])) == found


def test_an_amplifier_that_is_off_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    check, port = checked(monkeypatch)
    monkeypatch.setattr(port.arm.mechanics, "drive", lambda currents: None)
    rows = wrong(check, 0.0)
    assert [row for row in rows if row.startswith("sign")] == [f"sign, axis {axis}" for axis in "abc"]
    assert all("it did not move" in rows[f"sign, axis {axis}"].cure for axis in "abc")


def test_a_hand_on_the_arm_is_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    check, _ = begun(monkeypatch, hand="tremor&tremor_m=0.001&direction=1,1,1")
    assert min(check.noise()) > MOST_NOISE_COUNTS


def test_a_slow_wire_is_found_slow(monkeypatch: pytest.MonkeyPatch) -> None:
    rate_hz, latencies = begun(monkeypatch, wire_s=0.0012)[0].speed(200)
    assert rate_hz == pytest.approx(1 / 0.0012, rel=0.01)
    assert latencies[0] == pytest.approx(1200.0, rel=0.01)


def test_what_is_late_or_refused_is_missed_and_not_taken_for_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    check, port = begun(monkeypatch)
    port.arm.fault("slow", 0.001)  # one reply comes after 30 ms; it is waited for 20
    latencies = check.speed(100)[1]
    assert len(latencies) == 99
    assert latencies[0] == pytest.approx(200.0, rel=0.01)
    right = port.arm._act
    answers = iter([512, 0, 512, 0])
    monkeypatch.setattr(port.arm, "_act", lambda frame: next(answers, 0) or right(frame))
    assert len(check.speed(100)[1]) == 98


@pytest.mark.parametrize("fault", ["", "silence", "unplug"])
def test_a_device_is_let_go_whatever_goes_wrong(monkeypatch: pytest.MonkeyPatch, fault: str) -> None:
    check, port = checked(monkeypatch)
    if not fault:
        port.arm.fault("silence")
        with pytest.raises(DeviceError, match="no reply to 10 requests"):
            check.begin()
    else:
        check.begin()
        port.arm.fault(fault)
        if fault == "silence":
            with pytest.raises(DeviceError, match="serial:test: answered none of 5 requests"):
                check.speed(5)
        check.end()
    port.arm.mend()
    port.open()


def test_both_sides_of_the_test_current(monkeypatch: pytest.MonkeyPatch) -> None:
    for good_ma in (0.1, 200.0):
        checked(monkeypatch, current_ma=good_ma)
    for bad_ma in (-1.0, 0.0, 200.1, nan):
        with pytest.raises(DeviceError, match=r"test current .* mA is out of 0 to 200"):
            checked(monkeypatch, current_ma=bad_ma)
