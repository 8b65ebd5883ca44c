"""The way back into a workspace, and the home poses of arms, which lie outside of it."""

from math import hypot

import pytest

from cogrip.devices.arm.models import MODELS
from cogrip.devices.way_in import into_box, into_sphere


def test_ways_are_told_along_each_axis_and_none_from_inside() -> None:
    assert into_sphere((0.025, 0.0, 0.205), 0.1) == "15 mm away from you, 126 mm down"
    assert into_sphere((-0.2, -0.1, 0.0), 0.1) == "128 mm toward you, 64 mm to your right"
    assert into_sphere((0.0, 0.0, 0.1), 0.1) == ""
    assert into_box((-0.058, 0.01), ((-0.04, 0.04), (-0.06, 0.06))) == "26 mm toward you"
    assert into_box((0.0, 0.08), ((-0.04, 0.04), (-0.06, 0.06))) == "32 mm to your left"
    assert into_box((0.04, 0.06), ((-0.04, 0.04), (-0.06, 0.06))) == ""


@pytest.mark.parametrize("name", MODELS)
def test_only_the_vintage_arm_stands_in_its_workspace_in_its_home_pose(name: str) -> None:
    """By the makers' lengths, origins and counts; `calibrate` says which way to move the others."""
    model = MODELS[name]
    home = model.kinematics.forward(model.drive.angles(model.home_counts))
    assert home is not None
    assert bool(into_sphere(home, model.reach_m)) is (name != "vintage") is (hypot(*home) > model.reach_m)
