"""Trial of motors before a seat is taken: what it names, what it leaves open, and that no hand is taken for a fault."""

import csv
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import combinations, product
from pathlib import Path
from random import Random

import numpy as np
import pytest
from scipy.linalg import expm  # type: ignore[import-untyped]

from cogrip.devices.device import DeviceError
from cogrip.devices.motor_trial import DECOYS, SHARES, STROKES, TOLD_TICKS, Tried, _exponential, try_motors
from cogrip.devices.registry import make

from tests.devices.faulty_device import FAULTS, MOTOR_GAIN, POSITION_GAIN, POSITION_SIGN, SIGN, SWAP, FaultyDevice
from tests.extent import every

RATE_HZ = 1024
MOST_TICKS = 2 * RATE_HZ
ARMS = tuple(f"emulated:{name}" for name in ("vintage", "woodenhaptics", "polhem", "inverse3", "2diy", "pantograph"))
FREE, SOFT, FIRM = (
    "hold&hand_stiffness_npm=0&hand_damping_nspm=0",
    "hold&hand_stiffness_npm=60&hand_damping_nspm=1",
    "hold",
)
RIGID = "hold&hand_stiffness_npm=20000&hand_damping_nspm=100"
MOVING = ("reach&stroke_s=0.5&amplitude_m=0.05", "tremor&tremor_m=0.0005", "sine&frequency_hz=3", "push&force_n=0.5")
WORDS = {
    SIGN: "x: it moves against its force",
    POSITION_SIGN: "x: it moves against its force",
    SWAP: "these axes are swapped",
    MOTOR_GAIN: "times as far as its record's mass would",
    POSITION_GAIN: "times as far as its record's mass would",
}
DATA = Path(__file__).parents[2].parent / "shared" / "data"
COARSE = ("emulated:2diy",)  # Its counts are 0.09 mm, and a push may move it by less.


def tried(arm: str, hand: str, fault: str = "", late_ticks: int = 0) -> Tried:
    """Return the outcome, of a trial that is short and weak, and leaves no force."""
    axes = 2 if arm.endswith(("2diy", "pantograph")) else 3
    device = FaultyDevice(make(f"{arm}?hand={hand}", axes=axes), fault, late_ticks)
    asked: list[tuple[float, ...]] = []
    write, ticks = device.write, [0]

    def written(force_n: Sequence[float]) -> Sequence[float] | None:
        asked.append(tuple(force_n))
        return write(force_n)

    device.write = written  # type: ignore[method-assign]

    def clock(tick: int) -> int:
        ticks[0] = tick
        return tick

    device.open(RATE_HZ)
    outcome = try_motors(device, clock, RATE_HZ)
    device.close()
    assert ticks[0] < MOST_TICKS
    assert not any(asked[-1])
    assert max(np.linalg.norm(force) for force in asked) <= 1.001 * SHARES[1] * device.capability.peak_force_n
    return outcome


def test_strokes_leave_a_device_where_it_was_and_have_little_in_common() -> None:
    rows = [np.array([1 if sign == "+" else -1 for sign in row]) for row in (*STROKES, *DECOYS[0], *DECOYS[1])]
    for row in rows:
        assert row.sum() == 0, "at rest afterwards"
        assert (row * np.arange(len(row))).sum() == 0, "and in its place"
    for one, other in combinations(STROKES, 2):
        assert abs(sum((a == b) - (a != b) for a, b in zip(one, other, strict=True))) <= 4
    assert len({*STROKES, *DECOYS[0], *DECOYS[1]}) == 9


def test_exponentials_are_scipys() -> None:
    rows = np.random.default_rng(1).normal(size=(20, 3, 3)) * np.geomspace(1e-3, 30, 20)[:, None, None]
    assert _exponential(rows) == pytest.approx(np.array([expm(row) for row in rows]), rel=1e-6, abs=1e-9)


@pytest.mark.parametrize(("arm", "hand"), every(5, product(ARMS, (FREE, SOFT, FIRM, RIGID, *MOVING))))
def test_no_device_that_is_well_is_refused(arm: str, hand: str) -> None:
    if (arm, hand) == ("emulated:polhem", FREE):
        pytest.skip("nobody holds it while its motors take up its weight")
    if hand.startswith("push"):  # a force that nothing stops may carry an arm out of its workspace, as in any session
        with suppress(DeviceError):
            assert tried(arm, hand).faults == ()
        return
    assert tried(arm, hand).faults == ()


@pytest.mark.sample(3)
@pytest.mark.parametrize("arm", ARMS)
def test_one_that_is_held_loosely_is_said_to_be_well(arm: str) -> None:
    outcome = tried(arm, SOFT)
    if arm == "emulated:inverse3":  # 4 N nominal, of 0.15 kg: too little is seen along z
        assert not outcome.faults
        assert not any("x" in text.partition(":")[0] for text in outcome.unknown if "held" in text)
        return
    assert outcome.seen
    assert "as its record says" in outcome.text
    assert all(text.startswith(("gain along", "age of samples, within 3")) for text in outcome.unknown)


@pytest.mark.sample(3)
@pytest.mark.parametrize("arm", ARMS)
def test_one_that_is_held_like_a_rock_is_never_said_to_be_well(arm: str) -> None:
    text = tried(arm, RIGID).text
    assert "not determined: " in text
    assert "held firmly" in text


@pytest.mark.parametrize(("arm", "hand", "fault"), every(11, product(ARMS, (SOFT, FIRM), FAULTS)))
def test_signs_axes_and_gains_are_named(arm: str, hand: str, fault: str) -> None:
    outcome = tried(arm, hand, fault)
    if arm in COARSE and hand == FIRM and fault in (MOTOR_GAIN, POSITION_GAIN):
        assert "gain" in outcome.text
        return
    assert WORDS[fault] in outcome.text
    assert ("sign" in fault) == all("against its force" in each for each in outcome.faults)


@pytest.mark.parametrize(("arm", "hand", "late_ticks"), every(13, product(ARMS, (SOFT, FIRM), range(1, 9))))
def test_samples_that_are_late_untold_are_named_or_not_determined(arm: str, hand: str, late_ticks: int) -> None:
    outcome = tried(arm, hand, late_ticks=late_ticks)
    if late_ticks > TOLD_TICKS + 1 and arm not in COARSE:
        assert any("ticks later than they say" in each for each in outcome.faults), outcome
    if late_ticks > TOLD_TICKS:
        assert outcome.faults or any("age of samples" in each for each in outcome.unknown), outcome


def pieces(folder: Path, seed: int, count: int) -> Iterator[str]:
    """Pieces of recorded hands, as hands of an arm."""
    random = Random(seed)
    sources = [
        ("touch_freehand_wpi_100hz.csv", "t_s", ("pz_mm", "px_mm", "py_mm"), 1e-3, None),
        ("pen_wacom_bdalab_133hz.csv", "t_s", ("x_mm", "y_mm", "x_mm"), 1e-3, None),
        *[(f"tue_1dof_{kind}.csv", "t_s", ("theta_m_rad",) * 3, 0.04, run)
          for kind, run in product(("PF_kp15", "PP_kp8"), ("free", "spring", "rigid"))],
    ]  # fmt: skip
    for number in range(count):
        name, time, columns, scale, run = random.choice(sources)
        with (DATA / name).open() as file:
            rows = [row for row in csv.DictReader(file) if run is None or row["run"] == run]
        begin = random.uniform(float(rows[0][time]), float(rows[-1][time]) - 1.6)
        kept = [row for row in rows if begin <= float(row[time]) <= begin + 1.6]
        path = folder / f"{number}.csv"
        lines = [
            ",".join([str(float(row[time]) - begin), *[str(scale * float(row[key])) for key in columns]])
            for row in kept
        ]
        path.write_text("\n".join(["t_s,x_m,y_m,z_m", *lines]) + "\n")
        stiffness, damping = random.choice(((60, 1), (150, 3), (300, 5), (1000, 15)))
        yield f"csv:{path}&time=t_s&x=x_m&y=y_m&hand_stiffness_npm={stiffness}&hand_damping_nspm={damping}"


@pytest.mark.skipif(not DATA.is_dir(), reason="no recorded hands in ../shared/data")
@pytest.mark.parametrize("seed", every(8, (0, 1, 2, 3, 11, 5, 6, 7)))
def test_no_recorded_hand_is_taken_for_a_fault(tmp_path: Path, seed: int) -> None:
    for hand in pieces(tmp_path, seed, 4):
        for arm in ARMS:
            with suppress(DeviceError):  # the hand left the arm's workspace
                assert tried(arm, hand).faults == (), (arm, hand)


def test_a_motor_that_is_wired_the_wrong_way_round_is_found() -> None:
    """By the emulated board's own verb, as a session's device has it: joint a moves along y where the arm stands."""
    outcome = tried("emulated:vintage", "reach&faults=reversed@0")
    assert [text[:26] for text in outcome.faults] == ["y: it moves against its fo"]
