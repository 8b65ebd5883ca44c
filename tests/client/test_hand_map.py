"""The map between a hand and its tool: power, places, bounds of its settings."""

from math import cos, sin
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy import dot

from cogrip.client.hand.hand_map import HandMap
from cogrip.client.hand.velocity import largest_impedance
from cogrip.client.safety.rendered_damper import refusal
from cogrip.devices.for_user import make_for
from cogrip.protocol.laws.rotations import exp
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.table import SettingsError
from cogrip.protocol.settings.tool_frame import ToolFrame, rotation_of

scales = st.floats(0.1, 10.0)
vectors = st.tuples(*[st.floats(-3.0, 3.0)] * 3)
sixes = st.tuples(*[st.floats(-10.0, 10.0)] * 6)


@given(scales, scales, vectors, sixes, sixes, st.sampled_from([3, 6]))
def test_the_power_of_the_hand_is_the_ratio_times_that_of_the_tool(
    g: float, s: float, rotation: tuple[float, ...], force: tuple[float, ...], velocity: tuple[float, ...], axes: int
) -> None:
    frame = HandMap(ToolFrame(g, s, exp(rotation)), axes)
    tool_n, hand_mps = force[:axes], velocity[:axes]
    hand_n, tool_mps = frame.hand_force(tool_n), frame.rates(hand_mps)
    size = 1.0 + sum(map(abs, tool_n)) * sum(map(abs, tool_mps))
    ratio = frame.power_ratio
    assert dot(hand_n, hand_mps) == pytest.approx(ratio * dot(tool_n, tool_mps), abs=1e-9 * size * ratio)
    assert ratio == pytest.approx(s / g**2)
    assert frame.tool_force(hand_n) == pytest.approx(tool_n, abs=1e-9)


@given(scales, scales, vectors, vectors, vectors)
def test_a_spring_at_the_tool_is_one_of_s_k_at_the_hand(
    g: float, s: float, rotation: tuple[float, ...], begun: tuple[float, ...], moved: tuple[float, ...]
) -> None:
    frame = HandMap(ToolFrame(g, s, exp(rotation)), 3)
    ends = frame.place(begun), frame.place([a + b for a, b in zip(begun, moved, strict=True)])
    tool_n = [500.0 * (after - before) for before, after in zip(*ends, strict=True)]
    assert frame.hand_force(tool_n) == pytest.approx([500.0 * s * way for way in moved], abs=1e-7)


@given(scales, vectors, st.lists(st.tuples(vectors, vectors, scales, vectors), min_size=1, max_size=6))
def test_no_clutch_and_no_change_moves_the_tool(g: float, rotation: Any, steps: list[Any]) -> None:
    frame, hand = HandMap(ToolFrame(g, 1.0, exp(rotation)), 6), (0.0,) * 6
    for to, held_to, scale, turn in steps:
        hand = (*to, 0.1, 0.0, 0.0)
        pose = hand
        before = frame.place(hand), frame.rotation(pose[3:])
        frame.hold(True, hand, pose)
        assert (frame.place((*held_to, 0.2, 0.0, 0.1)), frame.rotation((0.3, 0.0, 0.0))) == (
            pytest.approx(before[0]), pytest.approx(before[1], abs=1e-9),
        )  # fmt: skip
        hand = pose = (*held_to, 0.0, 0.2, 0.3)
        frame.change(ToolFrame(scale, 1.0, exp(turn)), hand, pose)
        frame.hold(False, hand, pose)
        frame.change(ToolFrame(g, 1.0, exp(rotation)), hand, pose)
        assert frame.place(hand) == pytest.approx(before[0], abs=1e-9)
        assert frame.rotation(pose[3:]) == pytest.approx(before[1], abs=1e-7)


def user(**keys: Any) -> dict[str, Any]:
    return {"object": {"axes": 3}, "users": [{"name": "anna", **keys}]}


def seat(**keys: Any) -> SeatSettings:
    return seat_settings(resolve(user(**keys)), 0)


@pytest.mark.parametrize(
    ("key", "low", "high", "beyond"),
    [("position_scale", 0.1, 10.0, 0.001), ("force_scale", 0.1, 10.0, 0.001), ("clutch_button", 0, 32, 1)],
)
def test_both_sides_of_each_bound(key: str, low: float, high: float, beyond: float) -> None:
    for value in (low, high):
        assert seat(**{key: value}).tool == (ToolFrame(**{key: value}) if value else None)
    for value in (low - beyond, high + beyond):
        with pytest.raises(SettingsError, match=key):
            resolve(user(**{key: value}))


def test_who_scales_nothing_has_no_frame() -> None:
    assert seat().tool is None
    assert seat(rotation=[0.0, 0.0, 0.0]).tool is None


def test_a_rotation_is_written_as_angles_or_as_axes() -> None:
    quarter = HandMap(ToolFrame(rotation=rotation_of("-y x z")), 3)
    assert quarter.rates((1.0, 0.0, 0.0)) == pytest.approx((0.0, 1.0, 0.0), abs=1e-12)
    assert quarter.rates((0.0, 1.0, 0.0)) == pytest.approx((-1.0, 0.0, 0.0), abs=1e-12)
    angles = HandMap(ToolFrame(rotation=rotation_of([0.0, 0.0, 0.3])), 3)
    assert angles.rates((1.0, 0.0, 0.0)) == pytest.approx((cos(0.3), sin(0.3), 0.0))
    for text, why in (("x y", "is none"), ("x y y", "is none"), ("--x y z", "is none"), ("-x y z", "reflection")):
        with pytest.raises(ValueError, match=why):
            rotation_of(text)
    with pytest.raises(SettingsError, match="out of its 1"):
        resolve({"object": {"axes": 1}, "users": [{"name": "anna", "rotation": "-y x z"}]})
    assert resolve({"object": {"axes": 1}, "users": [{"name": "anna", "rotation": "-x -y z"}]})


def test_a_device_carries_b_over_the_force_scale() -> None:
    record = make_for(resolve(user()).users[0], 3).capability
    assert not refusal(seat(force_scale=10.0), record)
    most = largest_impedance(record, seat().rates.tick_s).impedance_nspm / seat().coupling.impedance_nspm
    assert 0.1 < 0.999 * most < 1.001 * most < 10.0
    assert not refusal(seat(force_scale=0.999 * most, impedance_nspm=20.0), record)
    text = refusal(seat(force_scale=1.001 * most, impedance_nspm=20.0), record)
    assert "force_scale" in text
    assert "set coupling.impedance_nspm to" in text
