"""Every coupling scheme and every kind of object has its row in each table that is indexed by it."""

from typing import get_args

import numpy as np
import pytest

from cogrip.cli.session.joined_device import MOST_ADVISED_FRAMES
from cogrip.cli.session.shipped_settings import shipped_scene
from cogrip.client import schemes as client_schemes
from cogrip.protocol.messages import Frame
from cogrip.protocol.object_kinds import KINDS as OBJECT_KINDS
from cogrip.protocol.session import FOR_CLIENTS
from cogrip.protocol.setting_types import Kind
from cogrip.protocol.settings import resolve, seat_settings
from cogrip.server import schemes as server_schemes
from cogrip.server.worlds.registry import WORLDS
from cogrip.sim.experiments.methods.method import METHODS

KINDS = get_args(Kind)


@pytest.mark.parametrize("table", [client_schemes.SCHEMES, server_schemes.SCHEMES, MOST_ADVISED_FRAMES])
def test_every_scheme_has_a_row(table: dict[str, object]) -> None:
    assert tuple(table) == KINDS


def test_every_scheme_is_compared() -> None:
    assert {method.overrides["coupling.kind"] for method in METHODS.values()} == set(KINDS)


@pytest.mark.parametrize("kind", KINDS)
def test_both_ends_of_a_scheme_speak_the_same_message(kind: Kind) -> None:
    message = client_schemes.SCHEMES[kind].message
    assert message is server_schemes.SCHEMES[kind].frame
    assert message in FOR_CLIENTS
    assert message in get_args(Frame)


@pytest.mark.parametrize("kind", OBJECT_KINDS)
def test_every_kind_of_object_has_a_world(kind: str) -> None:
    scene = {"axes": 3, "file": str(shipped_scene("wall.xml"))} if kind == "scene" else {}
    settings = resolve({"object": {"kind": kind, **scene}})
    seat = seat_settings(settings, 0)
    assert server_schemes.make_room_world(settings, [seat]).axes == seat.object.axes
    assert (kind in WORLDS) == (kind != "scene")


@pytest.mark.parametrize("kind", KINDS)
def test_every_scheme_has_scenes_of_its_own(kind: Kind) -> None:
    scene = {"kind": "scene", "axes": 3, "file": str(shipped_scene("wall.xml"))}
    settings = resolve({"object": scene, "coupling": {"kind": kind}})
    world = server_schemes.make_room_world(settings, [seat_settings(settings, 0)])
    row = (0.0,) * world.axes * world.inputs_per_axis
    world.join(0, np.zeros(3))
    assert len(world.advance([row])[0]) == 3 * (1 if kind in ("wave", "local") else 2)
    assert (world.limiter_account() is not None) == (kind in ("wave", "local"))
