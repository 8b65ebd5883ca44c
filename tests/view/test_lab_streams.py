"""Streams of a session, from what an observer of a laboratory session received."""

from math import isnan
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cogrip.client.inputs import Mark
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.wire.messages import Mark as Told
from cogrip.protocol.wire.messages import Stamp, View
from cogrip.view.lab_streams import LabStreams, channels, rate_hz

from tests.view.test_live_scene import Watched

Moment = tuple[int, float, list[float], tuple[float, ...], tuple[float, ...]]


def watched(axes: int = 2) -> tuple[list[Moment], list[tuple[float, str]], int]:
    """Return samples beside what the room was, markers, and the number of channels."""
    session = Watched(object={"axes": axes}, link={"delay_ms": 20.0})
    streams = LabStreams(session.lab.people[0].core.seat)
    samples: list[Moment] = []
    markers: list[tuple[float, str]] = []
    rooms: dict[int, tuple[tuple[float, ...], tuple[float, ...]]] = {}

    def each_frame(lab) -> None:
        world = lab.room.world
        rooms[lab.room.steps] = tuple(world.position), tuple(world.force_of(1))
        if lab.room.steps in (100, 200):
            lab.people[1].core.handle(Mark(f"step {lab.room.steps}"), lab.now_ns)
        found = streams.state(session.observer)
        markers.extend(streams.markers(session.observer))
        if found is not None:
            number = int(found[1][0])
            samples.append((number, found[0], found[1], *rooms[number]))

    session.run(each_frame)
    return samples, markers, len(channels(session.lab.people[0].core.seat))


def test_samples_are_what_the_room_was_at_their_step() -> None:
    samples, markers, width = watched()
    assert len(samples) > 150
    for _, _, sample, place, force in samples:
        assert len(sample) == width == 2 + 2 * 2 + 2 * 2 * 2
        assert sample[2:4] == list(place)
        ben = sample[10:14]
        assert ben[2:] == list(force) or all(map(isnan, ben))
    steps, times = np.array([[number, at_s] for number, at_s, *_ in samples]).T
    assert np.all(np.diff(steps) == 2)
    offset_s = times - (steps - 1) / 128  # step n is made at (n - 1) / 128
    assert np.abs(offset_s).max() < 1e-6, "the clocks of a laboratory are one"
    assert [text for _, text in markers] == ["ben: step 100", "ben: step 200"]
    for (at_s, _), step in zip(markers, (100, 200), strict=True):
        assert at_s == pytest.approx((step - 1) / 128 + 0.02, abs=2 / 128)


def test_a_marker_of_a_server_that_began_anew_has_its_time() -> None:
    """Its steps are counted from 0 again; the first marker comes before the clocks' offset is known."""
    settings = resolve({"users": [{"name": "a"}]})
    streams, clock = LabStreams(seat_settings(settings, 0)), SimpleNamespace(offset_ns=0, uncertainty_ns=1)
    core: Any = SimpleNamespace(view=None, views=0, people={}, marked=[], session=SimpleNamespace(clock=clock))

    def view(session: int, step: int, at_s: float) -> None:
        core.session.welcome = SimpleNamespace(session=session)
        core.view = View(session, step, (0.0, 0.0), (), (), (), Stamp(round(at_s * 1e9), 0, 0))
        core.views += 1

    view(7, 100_000, 50.0)
    assert streams.state(core) is not None
    core.marked.append(Told(7, 1, "before", 100_000 - 64))
    assert streams.markers(core) == [(49.5, "before")]
    clock.offset_ns = None
    view(8, 4, 60.0)
    core.marked += [Told(8, 1, "at once", 2), Told(7, 2, "late", 100_064)]
    assert streams.state(core) is None
    assert streams.markers(core) == [(50.5, "late")]
    clock.offset_ns = 10_000_000_000  # another machine's
    view(8, 66, 70.5)
    assert streams.state(core) is not None
    assert streams.markers(core) == [(pytest.approx(60.0), "at once")]
    assert core.marked == []


@pytest.mark.parametrize(("network_hz", "rate"), [(128, 64.0), (64, 64.0), (512, 64.0)])
def test_the_rate_is_that_of_views(network_hz: int, rate: float) -> None:
    settings = resolve({"rates": {"network_hz": network_hz}, "users": [{"name": "a"}]})
    assert rate_hz(seat_settings(settings, 0)) == rate


def test_channels_say_their_units() -> None:
    settings = resolve({"users": [{"name": "a"}, {"name": "b"}], "object": {"axes": 1}})
    assert [(each.label, each.unit) for each in channels(seat_settings(settings, 0))] == [
        ("step", "frames"), ("clock_uncertainty", "seconds"), ("object_x", "meters"), ("object_vx", "meters/second"),
        ("seat0_x", "meters"), ("seat0_fx", "newtons"), ("seat1_x", "meters"), ("seat1_fx", "newtons"),
    ]  # fmt: skip
