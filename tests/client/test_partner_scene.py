"""A client's copy of a scene: made of what is told and of nothing else, and bounded by the gate whatever it does."""

import sys
from collections.abc import Callable, Mapping
from math import dist
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from cogrip.client.coupling.partner.partner_scene import PartnerSceneCoupling
from cogrip.client.coupling.partner.scene_copy import CopyError, SceneCopy
from cogrip.client.coupling.partner.spring_gate import BUDGET_J
from cogrip.client.coupling.schemes import make_coupling
from cogrip.machine.rows import Row
from cogrip.protocol.drawing import MOST_COPIED, Shape, Solid
from cogrip.protocol.laws.partner_model import Model, ToolDrive, step_object
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.wire.clock import MessageClock
from cogrip.protocol.wire.messages import Geom, Intent, Partner, Stamp, decode

TICK_S = 1.0 / 1024
BOX = 0.2, 0.0, 0.0, 0.0, 1.2e-4, 1.2e-4, 1.2e-4, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -9.81
PLAIN = Solid((1.0, 0.005, 0.0001), (1, 1))
LEFT_M, RIGHT_M = (0.0, 0.0, 0.0), (0.136, 0.0, 0.0)
BOX_M = 0.068, 0.0, 0.0
SHAPES = (
    Shape("plane", (1.0, 1.0, 0.1), place_m=(0.0, 0.0, -0.03), solid=PLAIN),
    Shape("box", (0.03,) * 3, object=True, solid=replace(PLAIN, inertia=BOX)),
    Shape("sphere", (0.008, 0.0, 0.0), seat=0, solid=replace(PLAIN, inertia=(0.05,))),
    Shape("sphere", (0.008, 0.0, 0.0), seat=1, solid=replace(PLAIN, inertia=(0.05,))),
)
AT_REST = (0.0, 0.0, 0.0)
UPRIGHT = (1.0, 0.0, 0.0, 0.0)
NOBODY: Mapping[int, Model] = {}


SEAT = seat_settings(
    resolve({
        "object": {"kind": "scene", "file": "x.xml", "axes": 3},
        "coupling": {"kind": "partner", "stiffness_npm": 1000.0, "damping_nspm": 10.0},
        "users": [{"name": "a"}, {"name": "b"}],
    }),
    0,
)  # fmt: skip


def coupling_of(shapes: tuple[Shape, ...] = SHAPES) -> PartnerSceneCoupling:
    made = PartnerSceneCoupling(SEAT)
    for number in range(len(shapes)):
        made.receive_shape(Geom.of(shapes, number, 1))
    return made


def told(number: int, place_m: Row = BOX_M, intents: tuple[Intent, ...] = ()) -> Partner:
    return Partner(1, number, place_m + AT_REST, AT_REST + AT_REST, intents, 0, Stamp(1))


def frame(coupling: PartnerSceneCoupling, message: Partner) -> None:
    coupling.receive(message)
    coupling.end_frame()
    coupling.start_frame()


# The copy

MEND: dict[str, Callable[[tuple[Shape, ...]], tuple[Shape, ...]]] = {
    "no object": lambda shapes: (shapes[0], *shapes[2:]),
    "no tool of one's own": lambda shapes: (*shapes[:2], shapes[3]),
    "no mass of a tool": lambda shapes: (*shapes[:2], replace(shapes[2], solid=PLAIN), shapes[3]),
    "mass below 0": lambda shapes: (*shapes[:2], replace(shapes[2], solid=replace(PLAIN, inertia=(-1.0,))), shapes[3]),
    "no mass": lambda shapes: (*shapes[:2], replace(shapes[2], solid=replace(PLAIN, inertia=(0.0,))), shapes[3]),
    "object without mass": lambda shapes: (
        shapes[0], replace(shapes[1], solid=replace(PLAIN, inertia=(0.0, *BOX[1:]))), *shapes[2:]
    ),
    "moments that no body has": lambda shapes: (
        shapes[0], replace(shapes[1], solid=replace(PLAIN, inertia=(*BOX[:4], 1.0, 1e-6, 1e-6, *BOX[7:]))), *shapes[2:]
    ),
    "axes of no orientation": lambda shapes: (
        shapes[0], replace(shapes[1], solid=replace(PLAIN, inertia=(*BOX[:7], *[0.0] * 4, *BOX[11:]))), *shapes[2:]
    ),
    "a mesh": lambda shapes: (replace(shapes[0], kind="mesh"), *shapes[1:]),
    "a box without size": lambda shapes: (shapes[0], replace(shapes[1], size_m=(0.0, 0.1, 0.1)), *shapes[2:]),
    "a seat that no room has": lambda shapes: (*shapes[:3], replace(shapes[3], seat=200)),
    "a shape that is not solid": lambda shapes: (Shape("plane", (1.0, 1.0, 0.1)), *shapes[1:]),
}  # fmt: skip


@pytest.mark.parametrize("wrong", MEND)
def test_shapes_of_which_no_copy_can_be_made_are_dropped_and_the_hand_feels_nothing(wrong: str) -> None:
    shapes = MEND[wrong](SHAPES)
    with pytest.raises(CopyError):
        SceneCopy(shapes, 0, TICK_S)
    coupling = coupling_of()
    assert coupling.copy is not None
    coupling = coupling_of(())
    taken = [coupling.receive_shape(Geom.of(shapes, number, 1)) for number in range(len(shapes))]
    assert not all(taken)
    frame(coupling, told(0))
    assert list(coupling.force((0.05, 0.0, 0.0), AT_REST)) == [0.0] * 3
    assert coupling.copy is None


def test_more_shapes_than_a_copy_has_and_changed_ones_are_dropped() -> None:
    coupling = coupling_of(())
    many = (*SHAPES, *[SHAPES[0]] * MOST_COPIED)
    assert not coupling.receive_shape(Geom.of(many, 0, 1))
    assert coupling.receive_shape(Geom.of(SHAPES, 0, 1))
    assert coupling.receive_shape(Geom.of(SHAPES, 0, 1)), "told again"
    assert not coupling.receive_shape(replace(Geom.of(SHAPES, 0, 1), size_m=(2.0, 1.0, 0.1)))
    assert not coupling.receive_shape(replace(Geom.of(SHAPES, 1, 1), count=3))


@given(st.randoms(use_true_random=False))
def test_whatever_numbers_a_server_tells_the_copy_is_refused_or_the_force_is_finite_and_paid_for(
    random: Random,
) -> None:
    wild = (1e-9, 1e-3, 1.0, 1e3, 1e4, -1.0)
    shapes = tuple(
        replace(
            shape, size_m=tuple(abs(random.choice((each, *wild[:4]))) for each in shape.size_m),
            solid=replace(
                shape.solid, friction=tuple(abs(random.choice(wild[:4])) for _ in range(3)),
                inertia=tuple(random.choice((each, each, each, *wild)) for each in shape.solid.inertia),
            ),
        )
        for shape in SHAPES if isinstance(shape.solid, Solid)
    )  # fmt: skip
    coupling = coupling_of(shapes)
    x, force = 0.0, (0.0, 0.0, 0.0)
    for number in range(8):
        place = tuple(random.choice((0.0, 0.068, 1e3, -1e3)) for _ in range(3))
        there = Intent(1, number + 1, (random.uniform(-1e3, 1e3), 0.0, 0.0), AT_REST, 1e4, 0.0)
        frame(coupling, told(number, place, (there,)))
        for _ in range(8):
            before, x = x, random.uniform(-0.05, 0.05)
            coupling.applied_n = force
            coupling.elapse(((x - before) / TICK_S, 0.0, 0.0), AT_REST)
            force = tuple(coupling.force((x, 0.0, 0.0), AT_REST))  # type: ignore[assignment]
            assert all(np.isfinite(force))
            assert coupling.gate.stored_j <= max(0.0, coupling.gate.budget_j) + 1e-12


def test_a_copy_that_leaves_all_bounds_begins_anew_in_the_hand() -> None:
    coupling = coupling_of()
    frame(coupling, told(0))
    coupling.force(LEFT_M, AT_REST)
    copy = coupling.copy
    assert copy is not None
    copy._data.qvel[:] = np.nan
    assert list(coupling.force((0.01, 0.0, 0.0), AT_REST)) == pytest.approx([0.0] * 3)
    assert not coupling.implausible
    frame(coupling, told(1))
    assert coupling.implausible == "copy of the scene begun anew"
    frame(coupling, told(2))
    assert not coupling.implausible, "it is counted once"
    assert copy.place_m == pytest.approx((0.01, 0.0, 0.0))
    assert copy.object_m == pytest.approx(BOX_M)
    coupling.force((0.011, 0.0, 0.0), AT_REST)
    assert all(np.isfinite(copy.velocity_mps))


def test_where_there_is_no_mujoco_the_hand_feels_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    for name in ("partner_scene", "scene_copy"):
        monkeypatch.delitem(sys.modules, f"cogrip.client.coupling.partner.{name}")
    coupling = make_coupling(SEAT)
    for number in range(len(SHAPES)):
        assert coupling.receive_shape(Geom.of(SHAPES, number, 1))
    for number in range(4):
        assert coupling.receive(told(number))
        coupling.end_frame()
        coupling.start_frame()
        assert list(coupling.force((0.03, 0.0, 0.0), AT_REST)) == [0.0] * 3
    message = decode(coupling.message(1, MessageClock(), 0, AT_REST, AT_REST, AT_REST))
    assert isinstance(message, Partner)
    assert not message.intents


# The law


@pytest.mark.parametrize("seed", range(6))
def test_no_hand_takes_more_than_it_put_in_was_given_and_may_borrow(seed: int) -> None:
    """Hands are thrown about in and out of the box, partners intend anything, the server puts the object anywhere."""
    random = Random(seed)
    coupling = coupling_of()
    place, velocity, force = np.zeros(3), np.zeros(3), np.zeros(3)
    work = most = least = 0.0
    counter = 0.0
    stiffness = random.choice((300.0, 800.0, 1500.0))
    aim = np.zeros(3)
    for number in range(256):
        if number % 16 == 0:
            aim = np.array([random.uniform(-0.1, 0.25) for _ in range(3)])
        counter += random.choice((0.0, 0.0, 0.002))
        intended = tuple(random.uniform(-0.1, 0.2) for _ in range(3))
        there = Intent(1, number + 1, intended, AT_REST, random.choice((0.0, 150.0, 1e4)), counter)
        seen = tuple(random.uniform(-0.2, 0.2) for _ in range(3)) if random.random() < 0.1 else BOX_M
        frame(coupling, told(number, seen, (there,) if random.random() < 0.8 else ()))
        for _ in range(8):
            before = place.copy()
            velocity = (0.1 * velocity + TICK_S * (stiffness * (aim - place) - force)) / (0.1 + 5.0 * TICK_S)
            place = place + TICK_S * velocity
            done = float(force @ (place - before))
            work, most = work + done, max(most, -done)
            coupling.applied_n = force.tolist()
            coupling.elapse(((place - before) / TICK_S).tolist(), velocity.tolist())
            force = np.array(coupling.force(place.tolist(), velocity.tolist()))
            gate = coupling.gate
            given_j = BUDGET_J + gate.credited_j + gate.refilled_j - gate.donated_j - gate.spilt_j
            assert gate.credited_j <= counter + 1e-12
            least = min(least, given_j + work)
    assert coupling.copy is not None
    assert least >= -2.0 * most - 1e-9
    assert coupling.gate.gated > 0, "the gate was needed"


def test_the_gate_moves_the_copy_and_not_the_tool_in_it() -> None:
    """A tool that is put elsewhere would push what it touches."""
    coupling = coupling_of()
    frame(coupling, told(0))
    coupling.force(LEFT_M, AT_REST)
    copy = coupling.copy
    assert copy is not None
    thrown = (0.1, 0.0, 0.0)
    coupling.force(thrown, AT_REST)
    assert 0.5 * 1000.0 * dist(thrown, copy.place_m) ** 2 == pytest.approx(coupling.gate.stored_j)
    assert coupling.gate.stored_j < BUDGET_J
    assert copy.tool_places()[0][0] < 0.01
    assert copy.place_m[0] > 0.08
    assert copy.shift_m[0] == pytest.approx(copy.place_m[0] - copy.tool_places()[0][0])


# Its parts


@given(st.integers(0, 2**32))
def test_a_tool_that_is_held_by_a_model_moves_as_an_object_that_is(seed: int) -> None:
    """Force and damper of `ToolDrive`, entered implicitly, are what `step_object` does with an object in the tool's place."""
    random = Random(seed)
    spring = random.uniform(0.0, 5000.0), random.uniform(0.0, 20.0)
    models = []
    for _ in range(2):
        model = Model([random.uniform(-0.1, 0.1) for _ in range(3)])
        model.velocity_mps = [random.uniform(-1.0, 1.0) for _ in range(3)]
        model.intention_m = [random.uniform(-0.1, 0.1) for _ in range(3)]
        model.drift_mps = [random.uniform(-1.0, 1.0) for _ in range(3)]
        model.stiffness_npm, model.age_s = random.uniform(0.0, 400.0), random.uniform(0.0, 0.1)
        models.append(model)
    models[1].__init__(models[0].place_m)  # type: ignore[misc]
    for key in ("velocity_mps", "intention_m", "drift_mps", "stiffness_npm", "age_s"):
        setattr(models[1], key, getattr(models[0], key))
    models[1].velocity_mps = list(models[0].velocity_mps)
    place = [random.uniform(-0.1, 0.1) for _ in range(3)]
    velocity = [random.uniform(-1.0, 1.0) for _ in range(3)]
    mass = random.uniform(0.01, 1.0)
    for _ in range(4):
        drive = ToolDrive(TICK_S, spring, models[1], place)
        whole = [
            (mass * v + TICK_S * push) / (mass + TICK_S * drive.damping_nspm)
            for v, push in zip(velocity, drive.force_n, strict=True)
        ]
        drive.end(whole)
        step_object(TICK_S, place, velocity, mass, 0.0, spring, [models[0]])
        assert velocity == pytest.approx(whole, abs=1e-9)
        assert models[0].place_m == pytest.approx(models[1].place_m, abs=1e-9)
        assert models[0].velocity_mps == pytest.approx(models[1].velocity_mps, abs=1e-9)


def stepped(copy: SceneCopy, ticks: int, hand_m: Row = LEFT_M, models: Mapping[int, Model] = NOBODY) -> None:
    for _ in range(ticks):
        copy.step(hand_m, AT_REST, (1000.0, 10.0), models)


def test_what_no_tool_touches_comes_to_where_the_server_has_it_and_what_is_held_stays() -> None:
    copy = SceneCopy(SHAPES, 0, TICK_S)
    copy.tell(BOX_M, AT_REST, UPRIGHT)
    copy.begin(LEFT_M)
    copy.tell((0.08, 0.01, 0.0), AT_REST, UPRIGHT)
    stepped(copy, 1024)
    assert copy.object_m[:2] == pytest.approx((0.08, 0.01), abs=1e-5)
    model = Model((0.126, 0.01, 0.0))
    model.intention_m, model.stiffness_npm = [0.06, 0.01, 0.0], 300.0
    stepped(copy, 1024, (0.05, 0.01, 0.0), {1: model})
    held = copy.object_m
    copy.tell((0.08, 0.03, 0.0), AT_REST, UPRIGHT)
    stepped(copy, 256, (0.05, 0.01, 0.0), {1: model})
    assert copy.object_m == pytest.approx(held, abs=2e-4)


@pytest.mark.parametrize(("age_s", "way_m"), [(0.0, 0.1), (0.06, 0.1), (0.3, 0.1)])
def test_an_object_goes_on_by_its_velocity_no_further_than_the_horizon(age_s: float, way_m: float) -> None:
    copy = SceneCopy(SHAPES[1:], 0, TICK_S)
    copy.tell(BOX_M, AT_REST, UPRIGHT)
    copy.begin((-1.0, 0.0, 0.0))
    copy.tell(BOX_M, (1.0, 0.0, 0.0), UPRIGHT, age_s)
    stepped(copy, 2048, (-1.0, 0.0, 0.0))
    assert copy.object_m[0] == pytest.approx(BOX_M[0] + way_m, abs=2e-3)


def test_an_object_is_turned_to_where_the_server_has_it_also_while_it_is_held() -> None:
    copy = SceneCopy((SHAPES[1], *SHAPES[2:]), 0, TICK_S)
    copy.tell(BOX_M, AT_REST, UPRIGHT)
    copy.begin((-1.0, 0.0, 0.0))
    half = np.sqrt(0.5)
    copy.tell((0.068, 0.0, 0.0), AT_REST, (half, 0.0, 0.0, half))
    stepped(copy, 512, (-1.0, 0.0, 0.0))
    assert abs(np.dot(copy.object_pose[3], (half, 0.0, 0.0, half))) == pytest.approx(1.0, abs=1e-6)


def test_a_tool_that_begins_inside_of_the_box_touches_it_once_it_has_left_it() -> None:
    copy = SceneCopy(SHAPES, 0, TICK_S)
    copy.tell(BOX_M, AT_REST, UPRIGHT)
    copy.begin((0.068, 0.0, 0.0))
    stepped(copy, 64, (0.068, 0.0, 0.0))
    assert copy.object_m == pytest.approx(BOX_M, abs=1e-4), "it is not thrown out"
    for tick in range(1024):
        stepped(copy, 1, (0.068 - 0.1 * tick / 1024, 0.0, 0.0))
    stepped(copy, 512, (0.1, 0.0, 0.0))
    assert copy.object_m[0] > 0.09, "now it is pushed"


@pytest.mark.parametrize("place_m", [(0.09, 0.0, 0.0), (0.0685, 0.0, 0.001), BOX_M, (0.068, 0.02, 0.0)])
def test_a_partner_who_presses_as_it_comes_begins_beside_the_box_and_presses(place_m: Row) -> None:
    copy = SceneCopy(SHAPES, 0, TICK_S)
    copy.tell(BOX_M, AT_REST, UPRIGHT)
    copy.begin((-0.2, 0.0, 0.0))
    model = Model(place_m)
    stepped(copy, 1, (-0.2, 0.0, 0.0), {1: model})
    begun = copy.tool_places()[1]
    assert max(abs(a - b) for a, b in zip(begun, BOX_M, strict=True)) == pytest.approx(0.038, abs=0.002)
    stepped(copy, 64, (-0.2, 0.0, 0.0), {1: model})
    assert copy.object_m == pytest.approx(BOX_M, abs=1e-4), "it comes without a push"
    model.intention_m, model.stiffness_npm = list(BOX_M), 300.0
    stepped(copy, 256, (-0.2, 0.0, 0.0), {1: model})
    assert dist(model.place_m, copy.object_m) > 0.025, "the box is between"


def test_a_partner_who_lets_go_has_no_tool_in_the_copy() -> None:
    copy = SceneCopy(SHAPES, 0, TICK_S)
    copy.tell(BOX_M, AT_REST, UPRIGHT)
    copy.begin((-0.2, 0.0, 0.0))
    model = Model((0.12, 0.0, 0.0))
    model.intention_m, model.stiffness_npm = [0.05, 0.0, 0.0], 300.0
    stepped(copy, 512, (-0.2, 0.0, 0.0), {1: model})
    pushed = copy.object_m[0]
    assert pushed < 0.067
    stepped(copy, 1024, (-0.2, 0.0, 0.0))
    assert copy.object_m == pytest.approx(BOX_M, abs=1e-4), "drawn through where that tool was"
