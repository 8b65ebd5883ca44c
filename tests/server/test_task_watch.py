"""Progress of a task: heights, angles over whole turns, places and tilts, both sides of each bound."""

from math import cos, pi, sin

import pytest

from cogrip.protocol.laws.rotations import UNTURNED, exp, product
from cogrip.protocol.settings.task import EVERYBODY, Task
from cogrip.server.worlds.scenes.task_watch import TaskWatch

T = 1 / 128
START = (0.1, 0.2, 0.3)


def watch_of(**task: object) -> TaskWatch:
    """A watch of a task that is reached at the first moment, if no dwell time is given."""
    return TaskWatch(Task(**{"dwell_s": 0.0, **task}), T, START, UNTURNED)


def moved(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> tuple[float, float, float]:
    return START[0] + x, START[1] + y, START[2] + z


@pytest.mark.parametrize(("height_m", "reached"), [(0.0399, False), (0.0401, True)])
def test_a_body_is_lifted_above_its_start(height_m: float, reached: bool) -> None:
    watch = watch_of(lifted_m=0.04)
    for _ in range(3):
        watch.step(moved(z=height_m), UNTURNED)
    assert watch.lifted_m == pytest.approx(height_m)
    assert watch.at_s == (T if reached else None)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_whole_turns_are_counted_either_way(sign: float, axis: str) -> None:
    watch = watch_of(turned_rad=5 * pi, axis=axis)
    unit = [float(each == axis) for each in "xyz"]
    for step in range(1, 600):
        watch.step(START, exp([0.03 * step * sign * part for part in unit]))
        assert (watch.at_s is not None) == (0.03 * step >= 5 * pi)
    assert watch.turned_rad == pytest.approx(sign * 5 * pi, abs=0.03)


def test_what_was_lifted_is_then_to_be_in_its_place() -> None:
    watch = watch_of(lifted_m=0.04, place_m=(0.05, 0.0, 0.0), within_m=0.002)
    watch.step(moved(x=0.05), UNTURNED)
    assert watch.at_s is None, "never lifted"
    watch.step(moved(x=0.05, z=0.05), UNTURNED)
    assert watch.at_s is None, "not down"
    watch.step(moved(x=0.047), UNTURNED)
    assert watch.at_s is None, "3 mm off"
    watch.step(moved(x=0.0485), UNTURNED)
    assert watch.at_s == 4 * T
    account = watch.account()
    assert account["reached"]
    assert account["goals"]["within_m"] == {"asked": 0.002, "value": pytest.approx(0.0015), "met": True}
    watch.step(moved(), UNTURNED)
    assert watch.account() == account, "what was reached stands"


@pytest.mark.parametrize(("tilt_rad", "reached"), [(0.099, True), (0.101, False)])
def test_what_was_tilted_too_far_stays_spilt(tilt_rad: float, reached: bool) -> None:
    """A turn about the upright is no tilt."""
    watch = watch_of(lifted_m=0.01, tilt_rad=0.1)
    lying = exp([tilt_rad * cos(1.0), tilt_rad * sin(1.0), 0.0])
    watch.step(START, product(lying, exp([0.0, 0.0, 2.0])))
    assert watch.tilted_rad == pytest.approx(tilt_rad)
    watch.step(moved(z=0.02), UNTURNED)
    assert (watch.at_s is not None) is reached


@pytest.mark.parametrize(("frames", "reached"), [(10, True), (11, False)])
def test_time_runs_from_when_somebody_took_hold(frames: int, reached: bool) -> None:
    watch = TaskWatch(Task(lifted_m=0.01, by_s=10 * T, dwell_s=0.0), T, START, UNTURNED)
    for _ in range(100):
        watch.step(moved(z=1.0), UNTURNED, held=False)
    assert watch.lifted_m == 0.0
    for _ in range(frames - 1):
        watch.step(START, UNTURNED)
    watch.step(moved(z=0.02), UNTURNED)
    assert (watch.at_s is not None) is reached


@pytest.mark.parametrize("cut", [0, 1, 40, 199])
def test_it_goes_on_after_being_saved(cut: int) -> None:
    """Whole turns, the worst tilt, the height and the time are those of one watch that saw it all."""
    task = {"turned_rad": 5.0, "lifted_m": 0.02, "tilt_rad": 1.0, "place_m": (0.01, 0.0, 0.0), "within_m": 0.05}
    whole, first, second = (watch_of(**task) for _ in range(3))
    poses = [(moved(z=0.03 * sin(0.05 * k)), exp([0.1 * sin(0.1 * k), 0.0, 0.04 * k])) for k in range(200)]
    for number, (place, turned) in enumerate(poses):
        if number == cut:
            second.restore(first.save(), poses[cut - 1][1] if cut else UNTURNED)
        whole.step(place, turned)
        (first if number < cut else second).step(place, turned)
    assert second.account() == whole.account()
    assert second.save() == whole.save()
    assert whole.account()["reached"]


def test_a_task_that_is_begun_together_begins_when_every_seat_is_held() -> None:
    """It takes nothing of what one person does before. Somebody who comes back completes the room anew."""
    watch = watch_of(lifted_m=0.02, by_s=2 * T, together=True)
    high = moved(z=0.03)
    assert watch.frame(high, UNTURNED, [True, False]) == []
    assert watch.lifted_m == 0.0
    assert watch.frame(START, UNTURNED, [True, True]) == [EVERYBODY]
    assert watch.frame(high, UNTURNED, [True, True]) == ["the task is reached"]
    assert watch.at_s == 2 * T
    assert watch.frame(START, UNTURNED, [False, True]) == []
    assert watch.frame(START, UNTURNED, [True, True]) == [EVERYBODY]


def test_else_it_begins_when_somebody_takes_hold_and_tells_nobody() -> None:
    watch = watch_of(lifted_m=0.02)
    assert watch.frame(moved(z=0.03), UNTURNED, [False, False]) == []
    assert watch.frame(START, UNTURNED, [True, True]) == []
    assert watch.frame(moved(z=0.03), UNTURNED, [False, True]) == ["the task is reached"]


DWELL = 8  # frames


@pytest.mark.parametrize(("frames", "reached"), [(DWELL, False), (DWELL + 1, True)])
def test_a_task_is_reached_once_all_has_been_met_for_its_dwell_time(frames: int, reached: bool) -> None:
    """It counts from the first moment of these: as a goal of a study does."""
    watch = watch_of(place_m=(0.05, 0.0, 0.0), within_m=0.002, dwell_s=DWELL * T)
    for _ in range(3):
        watch.step(moved(x=0.05), UNTURNED)
    watch.step(moved(x=0.06), UNTURNED)  # through it, and on
    for frame in range(frames):
        assert watch.step(moved(x=0.05), UNTURNED) == (reached and frame == DWELL)
    assert watch.at_s == (5 * T if reached else None)
    assert watch.account()["dwell_s"] == DWELL * T


def test_what_is_met_at_the_start_is_nobodys_doing_until_it_was_lost() -> None:
    watch = watch_of(within_m=0.002, dwell_s=DWELL * T)
    for _ in range(10 * DWELL):
        assert not watch.step(START, UNTURNED)
    watch.step(moved(x=0.01), UNTURNED)
    assert [watch.step(START, UNTURNED) for _ in range(DWELL + 1)] == [False] * DWELL + [True]
    assert watch.at_s == (10 * DWELL + 2) * T


@pytest.mark.parametrize("lost", [None, 0, 3 * DWELL])
def test_what_is_to_be_kept_is_reached_once_it_was_kept_until_its_time(lost: int | None) -> None:
    watch = watch_of(within_m=0.002, dwell_s=DWELL * T, by_s=4 * DWELL * T)
    for frame in range(6 * DWELL):
        watch.step(moved(x=0.01) if frame == lost or lost == 3 * DWELL <= frame else START, UNTURNED)
    assert watch.at_s == {None: 4 * DWELL * T, 0: 2 * T, 3 * DWELL: None}[lost]


def test_a_body_that_is_put_back_has_not_come_back() -> None:
    watch = watch_of(within_m=0.002, dwell_s=DWELL * T)
    watch.step(moved(x=2.0), UNTURNED)
    watch.put_back()
    for _ in range(10 * DWELL):
        assert not watch.step(START, UNTURNED)


@pytest.mark.parametrize("cut", [0, 3, 15])
def test_a_dwell_time_goes_on_after_being_saved(cut: int) -> None:
    task = {"within_m": 0.002, "dwell_s": DWELL * T}
    whole, first, second = (watch_of(**task) for _ in range(3))
    for number, place in enumerate([START] * 4 + [moved(x=0.01)] + [START] * 20):
        if number == cut:
            second.restore(first.save(), UNTURNED)
        whole.step(place, UNTURNED)
        (first if number < cut else second).step(place, UNTURNED)
    assert second.account() == whole.account()
    assert whole.at_s == 6 * T


def test_a_progress_of_an_earlier_version_goes_on() -> None:
    watch = watch_of(lifted_m=0.04)
    watch.restore((10.0, 0.03, 0.0, 0.0, 0.0, -1.0), UNTURNED)
    assert watch.step(moved(z=0.05), UNTURNED)
    assert watch.at_s == 11 * T
