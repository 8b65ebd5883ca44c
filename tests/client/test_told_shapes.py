"""Shapes that a server tells a client with local contact: how many are taken in, and that they stay as they were told."""

from itertools import pairwise

import pytest
from msgspec import structs

from cogrip.client.coupling.local.local_contact import LocalCoupling
from cogrip.client.coupling.schemes import make_local
from cogrip.client.safety.force_limits import SOFT_SLOPE_NPS
from cogrip.client.safety.oscillation import OscillationDetector
from cogrip.protocol.drawing import MOST_LOCAL, MOST_PAIRS, Shape
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.wire.messages import Geom

from tests.client import test_local_contact as faces
from tests.client.live_safety import live
from tests.client.seated_client import ROOT, T_C, M, capability, next_waves, seat

K, HAND_KG = 1000.0, 0.15
STILL = (0.0, 0.0, 0.0)
FLOOR = Shape("plane", (0.0, 0.0, 0.0), place_m=(0.0, 0.0, -0.01))
BALL = Shape("sphere", (0.01, 0.0, 0.0), seat=0)
RAISED = structs.replace(FLOOR, place_m=(0.0, 0.0, -0.005))
DEEP = (0.0, 0.0, -0.002)


def scene(*shapes: Shape) -> LocalCoupling:
    """Return the contact of a client that has been told of these."""
    coupling = make_local(seat(object={"kind": "scene", "file": "x.xml", "axes": 3}, coupling={"kind": "local"}))
    coupling.fit(capability(3), 0.0)
    assert all(tell(coupling, *shapes))
    return coupling


def tell(coupling: LocalCoupling, *shapes: Shape) -> list[bool]:
    return [coupling.receive_shape(Geom.of(shapes, number, 1)) for number in range(len(shapes))]


def pressed_n(coupling: LocalCoupling, depth_m: float = 0.002) -> float:
    """Come from above and press the ball this deep into the floor. Returns the force at rest."""
    coupling.force((0.0, 0.0, 0.001), STILL)
    down = (0.0, 0.0, -(0.001 + depth_m) / T_C)
    coupling.elapse(down, down)
    return coupling.force((0.0, 0.0, -depth_m), STILL)[2]


def test_as_many_shapes_as_a_tick_has_time_for_and_no_more() -> None:
    far = [structs.replace(FLOOR, place_m=(0.0, 0.0, -0.5 - 0.001 * number)) for number in range(MOST_LOCAL)]
    assert pressed_n(scene(BALL, FLOOR, *far[: MOST_LOCAL - 2])) == pytest.approx(-K * 0.002)
    more = scene()
    assert not any(tell(more, BALL, FLOOR, *far[: MOST_LOCAL - 1]))
    assert pressed_n(more) == 0.0


@pytest.mark.parametrize(("balls", "force_n"), [(16, -K * 0.002), (17, 0.0)])
def test_as_many_pairs_as_a_tick_has_time_for_and_no_more(balls: int, force_n: float) -> None:
    assert MOST_PAIRS == 16 * 16
    assert pressed_n(scene(*[BALL] * balls, *[FLOOR] * 16)) == pytest.approx(force_n)


@pytest.mark.parametrize(
    "shape",
    [Shape("ellipsoid", (0.1, 0.1, 0.1)), structs.replace(FLOOR, body=1)],
    ids=["kind that is not rendered", "body that moves"],
)
def test_shape_that_no_client_renders_does_not_fit(shape: Shape) -> None:
    assert tell(scene(), BALL, shape) == [True, False]


def test_shapes_stay_as_they_were_told_first() -> None:
    coupling = scene(BALL, FLOOR)
    force_n = pressed_n(coupling)
    assert tell(coupling, BALL, RAISED) == [True, False]
    assert coupling.force(DEEP, STILL)[2] == force_n == pytest.approx(-K * 0.002)


def test_shapes_do_not_vanish_under_a_hand_whose_line_begins_anew() -> None:
    before, coupling = scene(BALL, FLOOR), scene()
    pressed_n(before)
    coupling.go_on_from(before)
    assert coupling.contact.proxy_m == before.contact.proxy_m
    for shapes in ((), (BALL, FLOOR)):
        assert all(tell(coupling, *shapes))
        assert coupling.force(DEEP, STILL)[2] == pytest.approx(-K * 0.002)
    another = scene()
    another.go_on_from(coupling)
    assert all(tell(another, BALL, RAISED)), "another server may have another scene"
    assert another.force(DEEP, STILL)[2] == 0.0, "it is not there for a hand that it has come around"


@pytest.mark.parametrize("kind", ["wall", "faces"])
def test_surface_does_not_vanish_under_a_hand_whose_line_begins_anew(kind: str) -> None:
    settings = faces.seat_of(kind)
    before, coupling = make_local(settings), make_local(settings)
    hand = faces.Hand(before, -0.001)
    faces.send(before, LineSender(1, 8), 0.0, 0.0)
    hand.move(-0.001)
    hand.move(0.003)
    coupling.go_on_from(before)
    coupling.fit(capability(), 0.0)
    assert coupling.force((0.003,), (0.0,))[0] == pytest.approx(K * (0.003 - before.contact.surface_m))


def test_clear_tool_is_owed_nothing() -> None:
    """Once a tool is clear, what its engagement owed it is not sent: only waves of 0 are."""
    coupling = scene(BALL, FLOOR)
    place, line = (0.0, 0.0, 0.01), LineSender(3, 1)
    coupling.force(place, STILL)
    for engaged in (STILL, (), ()):
        assert coupling.receive(next_waves(line, *STILL, state=(*STILL, *STILL, *engaged)))
        coupling.start_frame()
        for _ in range(coupling.frame_ticks):
            coupling.elapse(STILL, STILL)
            coupling.force(place, STILL)
        coupling.end_frame(1.0)
        assert any(coupling.sent) == bool(engaged)


def test_hand_that_the_line_presses_onto_geometry_comes_to_rest_there() -> None:
    """A light hand above the floor, pressed down by 3 N of the line: what the floor carries does not come back at once."""
    coupling = scene(BALL, FLOOR)
    detector, line = OscillationDetector(3, T_C), LineSender(3, 8)
    z, speed = 0.002, 0.0
    for tick in range(round(2.0 / T_C)):
        if tick % M == 0:
            state = (*STILL, *STILL, 0.0, 0.0, 0.002)
            assert coupling.receive(next_waves(line, 0.0, 0.0, -3.0 / ROOT, state=state))
            coupling.end_frame(0.0)
            coupling.start_frame()
        force = coupling.force((0.0, 0.0, z), (0.0, 0.0, speed))
        detector.add(force, False, coupling.local_n)
        assert not detector.oscillates
        mean = speed - 0.5 * T_C * force[2] / HAND_KG
        speed -= T_C * force[2] / HAND_KG
        z += T_C * mean
        coupling.elapse((0.0, 0.0, mean), (0.0, 0.0, speed))
    assert -0.001 < z < 0.001


def test_force_of_a_line_that_ends_falls_softly_and_without_delay() -> None:
    """A line that pulls with 6 N while its tool comes clear: 0.4 N a tick, 15 ticks, and no more than the slope's energy."""
    coupling, safety, pull_n = scene(), live(capability(3), T_C), 6.0
    place, felt, line = (0.0, 0.0, 0.01), list[float](), LineSender(3, 8)
    for frame in range(80):
        wave, engaged = (0.0, ()) if frame >= 60 else (-pull_n / ROOT, place)
        assert coupling.receive(next_waves(line, wave, 0.0, 0.0, state=(*STILL, *STILL, *engaged)))
        coupling.start_frame()
        for _ in range(M):
            felt.append(safety.limit(coupling.force(place, STILL), coupling.gap())[0])
            coupling.elapse(STILL, STILL)
        coupling.end_frame()
    ends = felt[60 * M - 1 :]
    assert ends[0] == pytest.approx(pull_n)
    assert max(before - after for before, after in pairwise(ends)) <= SOFT_SLOPE_NPS * T_C * (1.0 + 1e-9)
    assert ends.index(0.0) <= pull_n / (SOFT_SLOPE_NPS * T_C) + 2
