"""A tool in free air is felt by its own mass and its line's, whatever a scene has as defaults for everything in it."""

from itertools import pairwise
from math import pi

import numpy as np
import pytest

from tests.server.scene_worlds import Person, T, world_of

DEFAULTS = {
    "none": "",
    "joints": '<default><joint range="-.001 .001" limited="true" damping="5" frictionloss="3" armature="1"/></default>',
    "density and friction": '<default><geom density="9000" friction="5" group="4" contype="0" conaffinity="0"/></default>',
    "compiler": '<compiler settotalmass="80" boundmass="2" boundinertia="1" autolimits="false" angle="radian"/>',
    "medium of thin air": '<option viscosity="1.8e-5" density="1.2" gravity="0 0 -20" integrator="implicitfast"/>',
}
BOX = (
    '<worldbody><geom type="plane" size="1 1 .1"/>'
    '<body pos="0 0 .03"><freejoint/><geom type="box" size=".03 .03 .03" mass=".2"/></body></worldbody></mujoco>'
)
A_M, CYCLES = 0.02, 3


@pytest.mark.sample(13)
@pytest.mark.parametrize("kind", ["pad", "ball", "box"])
@pytest.mark.parametrize("defaults", DEFAULTS)
@pytest.mark.parametrize(("delay", "b", "hz"), [(0, 20.0, 1.0), (3, 20.0, 0.5), (3, 40.0, 0.5)])
def test_the_force_in_free_air_is_that_of_the_predicted_mass(
    defaults: str, kind: str, delay: int, b: float, hz: float
) -> None:
    """F = M a + C v is fitted to a swing along y, past nothing: M within 5 % of m + b (2d + 1) T/2, and no drag beside it."""
    world = world_of(f"<mujoco>{DEFAULTS[defaults]}{BOX}", [kind], b=b)
    world.join(0, np.zeros(3))
    person = Person(delay, b)

    def serve(u: float) -> float:
        back: float = world.step(np.array([[0.0, u, 0.0]]))[0, 1]
        return back

    frames = round(CYCLES / (hz * T))
    phase = 2.0 * pi * hz * T * np.arange(frames + 1)
    x = A_M * np.sin(phase) * np.minimum(1.0, phase / (2.0 * pi))  # begins gently
    forces = []
    for before, after in pairwise(x):
        person.exchange(after - before, serve)
        forces.append(person.force_n)
    v = np.diff(x) / T
    a = np.gradient(v, T)
    last = slice(frames - round(1.0 / (hz * T)), frames)  # one cycle
    (mass_kg, drag_nspm), *_ = np.linalg.lstsq(np.stack([a[last], v[last]], axis=1), np.array(forces)[last], rcond=None)
    predicted_kg = 0.05 + 0.5 * b * (2 * delay + 1) * T
    assert mass_kg == pytest.approx(predicted_kg, rel=0.05)
    assert abs(drag_nspm) * 2.0 * pi * hz * A_M <= 0.05 * predicted_kg * (2.0 * pi * hz) ** 2 * A_M
    assert world.contacts.touches[0].normal_n == 0.0
