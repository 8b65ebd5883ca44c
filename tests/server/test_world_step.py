"""A world's step as its room calls it says what the world says, whatever was set before."""

import numpy as np
import pytest

from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.server.schemes import make_world
from cogrip.server.worlds.grip import GripWorld
from cogrip.server.worlds.world import REACH_M, WORKSPACE_M, Array, World

from tests.server.broken_worlds import Springs
from tests.server.test_guarded_world import guarded


def world_of(kind: str, seats: int) -> World:
    settings = resolve({"object": {"kind": kind, "axes": 2}, "users": [{"name": f"u{seat}"} for seat in range(seats)]})
    return make_world([seat_settings(settings, seat) for seat in range(seats)])


def hold(world: World) -> None:
    for user in range(len(world.holding)):
        world.join(user, np.zeros(world.axes))


def worlds() -> list[World]:
    return [*(world_of("cube", seats) for seats in (1, 2, 10)), world_of("faces", 2), guarded(Springs)]


@pytest.mark.parametrize("number", range(5))
def test_the_step_says_what_the_world_says(number: int) -> None:
    world = worlds()[number]
    step, seats, chance = world.as_step(), len(world.holding), np.random.default_rng(number)
    hold(world)
    for _ in range(80):  # as springs grow, and after
        rows = [tuple(row) for row in chance.normal(0.0, 0.1, (seats, world.axes)).tolist()]
        answers = step.advance(rows)
        assert len(answers) == seats
        assert step.motion() == world.motion() == tuple(world.position.tolist() + world.velocity.tolist())
        assert list(step.port_work_j()) == list(world.port_work_j())
    for user in range(seats):
        assert step.engaged_at(user) == world.engaged_at(user)
        assert (step.proxy_of(user), step.force_of(user)) == (world.proxy_of(user), world.force_of(user))
        assert step.contact_of(user) == world.accounts.contact(user)
        assert step.effects_of(user) == world.effects_of(user)


def test_what_is_set_between_two_steps_is_seen() -> None:
    world = world_of("cube", 2)
    step = world.as_step()
    before = step.motion()
    for place in (WORKSPACE_M, WORKSPACE_M * 1.001, REACH_M, REACH_M * 1.001, np.nan, 0.1):
        world.position = np.full(world.axes, place)
        world.velocity = np.full(world.axes, 2.0)
        assert step.motion() != before
        np.testing.assert_array_equal(step.motion(), [place] * world.axes + [2.0] * world.axes)
        assert step.left_workspace() == world.left_workspace == (not place <= WORKSPACE_M)
        assert step.out_of_reach() == world.out_of_reach == (not place <= REACH_M)


def test_events_are_taken_once() -> None:
    for world in worlds():
        step = world.as_step()
        assert not step.take_events()
        world.events.append("it rang")
        assert step.take_events() == ["it rang"]
        assert not step.take_events()


def test_two_steps_of_the_same_rows_are_the_same_in_world_and_step() -> None:
    """Where a spring has grown, the step does without the world; what comes of it is the same to the last bit."""
    one, other = world_of("cube", 2), world_of("cube", 2)
    step, chance = one.as_step(), np.random.default_rng(3)
    for world in (one, other):
        hold(world)
    for _ in range(300):
        rows = [tuple(row) for row in chance.normal(0.0, 0.05, (2, one.axes)).tolist()]
        assert [list(row) for row in step.advance(rows)] == other.advance(rows)
    assert (one.stiffness == one.target_stiffness).all()
    assert one.save() == other.save()


class Half(GripWorld):
    """A cube that gives back half of what the cube does."""

    def step(self, inputs: Array) -> Array:
        return 0.5 * super().step(inputs)

    def force_of(self, user: int) -> tuple[float, ...]:
        return (*super().force_of(user)[:-1], 7.0)


def test_a_world_derived_from_the_cube_is_stepped_its_own_way() -> None:
    whole = world_of("cube", 2)
    settings = resolve({"object": {"axes": 2}, "users": [{"name": "a"}, {"name": "b"}]})
    half = Half([seat_settings(settings, seat) for seat in range(2)])
    hold(whole)
    hold(half)
    rows = [(0.1, -0.2), (0.3, 0.05)]
    np.testing.assert_array_equal(half.as_step().advance(rows), 0.5 * np.array(whole.as_step().advance(rows)))
    assert half.as_step().force_of(1)[-1] == 7.0
    assert half.as_step().motion() == whole.as_step().motion()
