"""Proxy on fixed shapes: distances against MuJoCo's, never inside, nearest to the hand, no energy from its moves."""

from math import dist, hypot, pi, sin

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from cogrip.client.coupling.local.fixed_shapes import KINDS, FixedShape
from cogrip.client.coupling.local.proxy import Proxy, without
from cogrip.machine.rows import Vector
from cogrip.protocol.drawing import Shape
from cogrip.protocol.laws.rotations import exp

mujoco = pytest.importorskip("mujoco")
ORIGIN = (0.0, 0.0, 0.0)
length = st.floats(0.01, 0.1)
coordinate = st.floats(-0.2, 0.2)
vectors = st.tuples(coordinate, coordinate, coordinate)
angles = st.tuples(*[st.floats(-3.0, 3.0)] * 3)
shapes = st.builds(
    lambda kind, size, place, turn: Shape(kind, size, None, place, exp(turn)),
    st.sampled_from(sorted(KINDS)),
    st.tuples(length, length, length),
    vectors,
    angles | st.just((0.0, 0.0, 0.0)),
)


def mujoco_gap(shape: Shape, centre: Vector, radius: float) -> float:
    """Return the distance by MuJoCo's own collision functions."""
    size, at, turn, place = (
        " ".join(map(repr, each)) for each in (shape.size_m, shape.place_m, shape.orientation, centre)
    )
    fixed = f'<geom name="fixed" type="{shape.kind}" size="{size}" pos="{at}" quat="{turn}"/>'
    ball = f'<body pos="{place}"><freejoint/><geom name="ball" size="{radius!r}"/></body>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{fixed}{ball}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return float(mujoco.mj_geomDistance(model, data, 0, 1, 10.0, np.zeros(6)))


def plane(*turn: float) -> FixedShape:
    return FixedShape(Shape("plane", (0.0, 0.0, 0.01), orientation=exp(turn or ORIGIN)))


def led(proxy: Proxy, begin: Vector, end: Vector, steps: int) -> Vector:
    """Lead the hand along a line. Returns where the proxy is then."""
    places = [proxy.follow(tuple(hand.tolist())) for hand in np.linspace(begin, end, steps)]
    return places[-1]


@example(shape=Shape("box", (0.05, 0.05, 0.05)), centre=(0.06, 0.0, 0.08), radius=0.005)  # above an edge
@given(shape=shapes, centre=vectors, radius=st.floats(0.002, 0.02))
def test_gaps_are_those_of_mujoco(shape: Shape, centre: Vector, radius: float) -> None:
    gap, normal = FixedShape(shape).gap(*centre, radius)
    theirs = mujoco_gap(shape, centre, radius)
    assert hypot(*normal) == pytest.approx(1.0, abs=1e-9)
    if theirs > 1e-4:
        assert gap == pytest.approx(theirs, abs=2e-5)
    else:
        assert gap <= 2e-4


@given(shape=shapes, centre=vectors)
def test_normal_is_the_way_the_gap_grows(shape: Shape, centre: Vector) -> None:
    fixed, step = FixedShape(shape), 1e-7
    gap, normal = fixed.gap(*centre, 0.0)
    if gap > 1e-4:
        there = tuple([c + step * n for c, n in zip(centre, normal, strict=True)])
        assert fixed.gap(there[0], there[1], there[2], 0.0)[0] - gap == pytest.approx(step, rel=1e-3)


def outside(fixed: list[FixedShape], place: Vector, radius: float) -> bool:
    return all(each.gap(*place, radius)[0] >= 0.0 for each in fixed)


@given(
    given_shapes=st.lists(shapes, min_size=1, max_size=3),
    start=vectors,
    way=st.lists(st.tuples(*[st.floats(-0.004, 0.004)] * 3), min_size=1, max_size=60),
    radius=st.floats(0.002, 0.02),
)
def test_proxy_is_never_inside_and_never_moves_away_from_the_hand(
    given_shapes: list[Shape], start: Vector, way: list[Vector], radius: float
) -> None:
    fixed = [FixedShape(shape) for shape in given_shapes]
    if not outside(fixed, start, radius):
        return
    proxy, hand = Proxy([((0.0, 0.0, 0.0), radius)], fixed), start
    before = proxy.follow(hand)
    for step in way:
        hand = (hand[0] + step[0], hand[1] + step[1], hand[2] + step[2])
        place = proxy.follow(hand)
        assert all(each.gap(*place, radius)[0] >= -1e-5 for each in fixed)
        # the energy law: a move of the proxy alone never loads the spring
        assert dist(hand, place) <= dist(hand, before) + 1e-9
        assert outside(fixed, hand, radius) or proxy.normals or place == hand
        before = place


def test_proxy_of_a_plane_is_the_hand_put_on_it() -> None:
    proxy = Proxy([((0.0, 0.0, -0.01), 0.005)], [plane()])
    proxy.follow((0.0, 0.0, 0.1))
    assert led(proxy, (0.03, 0.0, 0.1), (-0.015, 0.0, -0.05), 400) == pytest.approx((-0.015, 0.0, 0.015), abs=1e-12)
    assert proxy.normals == [(0.0, 0.0, 1.0)]


def test_corner_holds_the_proxy_by_all_three_planes() -> None:
    proxy = Proxy([(ORIGIN, 0.01)], [plane(), plane(0.0, 0.5 * pi, 0.0), plane(-0.5 * pi, 0.0, 0.0)])
    place = led(proxy, (0.05, 0.05, 0.05), (-0.05, -0.03, -0.01), 100)
    assert place == pytest.approx((0.01, 0.01, 0.01), abs=1e-9)
    assert len(proxy.normals) == 3
    assert without((1.0, 2.0, 3.0), proxy.normals) == pytest.approx(ORIGIN, abs=1e-9)


def test_no_wall_is_too_thin() -> None:
    proxy = Proxy([(ORIGIN, 0.002)], [FixedShape(Shape("box", (0.0005, 0.1, 0.1)))])
    place = led(proxy, (-0.05, 0.0, 0.0), (0.05, 0.0, 0.0), 30)  # by more than its thickness a tick
    assert place[0] == pytest.approx(-0.0025, abs=1e-9)


def test_shape_in_which_the_hand_begins_holds_it_only_once_it_has_left() -> None:
    proxy = Proxy([(ORIGIN, 0.01)], [plane()])
    for z in (-0.02, -0.01, 0.005):
        assert proxy.follow((0.0, 0.0, z)) == (0.0, 0.0, z)
    proxy.follow((0.0, 0.0, 0.02))
    assert proxy.follow((0.0, 0.0, -0.02))[2] == pytest.approx(0.01)


def test_a_tool_of_several_balls_slides_with_the_one_that_touches() -> None:
    proxy = Proxy([((0.0, 0.02, 0.0), 0.01), ((0.0, -0.02, 0.01), 0.01)], [plane()])
    place = led(proxy, (0.0, 0.0, 0.1), (0.1, 0.0, -0.1), 200)
    assert place == pytest.approx((0.1, 0.0, 0.01), abs=1e-9)


def test_round_surface_lets_the_proxy_slide_to_the_nearest_point() -> None:
    proxy = Proxy([(ORIGIN, 0.01)], [FixedShape(Shape("sphere", (0.05, 0.0, 0.0)))])
    hand = (-0.02, 0.02, 0.0)
    led(proxy, (-0.1, 0.02, 0.0), hand, 200)
    place = led(proxy, hand, hand, 50)
    assert place == pytest.approx(tuple(0.06 * each / hypot(*hand) for each in hand), abs=1e-6)


@pytest.mark.parametrize("half_angle", [0.05, 0.1, 0.3, 0.7])
def test_acute_groove_holds_the_proxy_and_no_move_loads_the_spring(half_angle: float) -> None:
    """The hand goes deep into the groove between two walls, along it and out: the proxy slides along its bottom."""
    groove = [plane(0.0, sign * (pi / 2 - half_angle), 0.0) for sign in (-1, 1)]
    radius = 0.005
    bottom = radius / sin(half_angle)
    proxy = Proxy([(ORIGIN, radius)], groove)
    place = proxy.follow((0.0, 0.0, bottom + 0.01))
    ways = [(1e-6 * k, 0.0, bottom + 0.01 - 1e-4 * k) for k in range(600)]
    ways += [(6e-4, 1e-4 * k, bottom - 0.05) for k in range(300)]
    for hand in ways:
        before = dist(hand, place)
        place = proxy.follow(hand)
        assert dist(hand, place) <= before + 1e-9
        assert all(each.gap(*place, radius)[0] >= -1e-8 for each in groove)
    assert place == pytest.approx((0.0, 0.03 - 1e-4, bottom), abs=1e-6)
    assert len(proxy.normals) == 2


@pytest.mark.long
def test_hundreds_of_planes_hold_the_proxy_where_it_is_allowed() -> None:
    """As many shapes about a tool as there may be: the proxy stays outside of them all, and reaches the nearest place."""
    tilts = np.random.default_rng(1).uniform(-0.5, 0.5, (200, 2))
    fixed = [plane(*tilt, 0.0) for tilt in tilts.tolist()]
    proxy = Proxy([(ORIGIN, 0.005)], fixed)
    place = proxy.follow((0.0, 0.0, 0.1))
    for k in range(300):
        hand = (1e-5 * k, 2e-5 * k, 0.1 - 1e-3 * k)
        before = dist(hand, place)
        place = proxy.follow(hand)
        assert dist(hand, place) <= before + 1e-9
    gaps = [each.gap(*place, 0.005)[0] for each in fixed]
    assert min(gaps) == pytest.approx(0.0, abs=1e-6)
