"""Buttons in whole sessions in virtual time: every edge comes to the world once, in order, and soon."""

import dataclasses
from math import atan2, cos, log, nan, sin, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from cogrip.devices.device import Device, Sample
from cogrip.devices.for_user import make_for
from cogrip.protocol.settings.coupling_kinds import Kind
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.wire.handle import MOST_AT_ONCE, Handle
from cogrip.protocol.wire.messages import Edges, Stamp, encode
from cogrip.results.reading.records import open_run
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.server.rate_limit import limits_for
from cogrip.server.seats.observers import _person
from cogrip.sim import laboratory as session_laboratory
from cogrip.sim.laboratory import Laboratory

from tests.extent import every, long
from tests.kinds import SCHEMES, object_of
from tests.sim.session_measures import assert_plays_again, run_frames

M = 8  # device ticks in a frame
Edge = tuple[int, int, bool]  # person, button, down


class Told:
    """Watches what a laboratory's world is told of buttons, and the tick of the session at which."""

    def __init__(self, laboratory: Laboratory) -> None:
        self.laboratory = laboratory
        self.edges: list[Edge] = []
        self.ticks: list[int] = []
        laboratory.room.world.button = self._button

    def _button(self, user: int, button: int, down: bool) -> None:
        self.edges.append((user, button, down))
        self.ticks.append(self.laboratory.tick)


def pressing(presses: list[str], **more: Any) -> Settings:
    users = [
        {"name": name, "device": f"sim:phantom?press={press}" if press else "sim:phantom", "side": side}
        for name, side, press in zip("abc", ("left", "right", "left"), presses, strict=False)
    ]
    return resolve({"seconds": 3.0, "users": users, **more})


def told_in(presses: list[str], **more: Any) -> Told:
    """Run a session to its end; return what its world was told."""
    told = Told(Laboratory(pressing(presses, **more)))
    told.laboratory.run()
    return told


def taps(button: int, first_s: float, every_s: float, count: int) -> str:
    return ",".join(f"{button}@{first_s + n * every_s:.4f}+{0.5 * every_s:.4f}" for n in range(count))


def waits(told: Told) -> list[int]:
    """Return the ticks that each edge took to the world, of people who press by schedule."""
    late = []
    for number, person in enumerate(told.laboratory.people):
        happened = sorted(
            tick for press in person.device.presses
            for span in [press.ticks(1024)] for tick in (span.start, span.stop)
        )  # fmt: skip
        mine = [(down, tick) for (user, _, down), tick in zip(told.edges, told.ticks, strict=True) if user == number]
        assert [down for down, _ in mine] == [True, False] * (len(happened) // 2)
        late += [there - then for then, (_, there) in zip(happened, mine, strict=True)]
    return late


@pytest.mark.sample(1)
@pytest.mark.parametrize("loss", [0.0, long(0.1), long(0.3)])
@pytest.mark.parametrize("kind", every(3, SCHEMES))
def test_an_edge_comes_within_one_frame_and_the_delay_and_loss_delays_it_by_frames(kind: Kind, loss: float) -> None:
    """Edges at every phase of a frame. The world takes what has come at its next step: 20 ms are 20.48 ticks, a frame is 8.

    As many edges as datagrams arrive come in time, within two standard deviations; none waits longer than the run of lost
    datagrams that one edge in ten thousand meets.
    """
    presses = [taps(1, 0.5, 0.0333, 70), taps(3, 0.51, 0.0441, 50)]
    tables = {"object": {"kind": object_of(kind)}, "coupling": {"kind": kind}}
    late = np.array(waits(told_in(presses, **tables, link={"delay_ms": 20, "loss": loss})))
    assert len(late) == 240
    assert late.min() >= 0.020 * 1024
    assert np.mean(late <= 0.020 * 1024 + M) >= 1.0 - loss - 2.0 * sqrt(loss * (1.0 - loss) / len(late))
    run_of_lost = log(1e-4) / log(loss) if loss else 0.0
    assert late.max() <= 0.020 * 1024 + M * (1.0 + run_of_lost)


@pytest.mark.sample(1)
@pytest.mark.parametrize("kind", every(3, SCHEMES))
def test_no_edge_is_lost_or_comes_twice_at_thirty_percent_loss(kind: Kind) -> None:
    told = told_in(
        [taps(1, 0.5, 0.05, 40), taps(32, 0.51, 0.07, 25)],
        coupling={"kind": kind},
        object={"kind": object_of(kind)},
        link={"delay_ms": 30, "jitter_ms": 8, "loss": 0.3, "duplicate": 0.2, "reorder": 0.2},
    )
    for number, (button, count) in enumerate([(1, 40), (32, 25)]):
        mine = [edge for edge in told.edges if edge[0] == number]
        assert mine == [(number, button, True), (number, button, False)] * count
        assert not told.laboratory.people[number].core.session.dropped["button edges"]


def test_edges_at_once_that_cannot_be_are_dropped_by_name_and_repeated_ones_given_once() -> None:
    laboratory = Laboratory(pressing(["", ""]))
    told = Told(laboratory)
    run_frames(laboratory, 32)
    person, server = laboratory.people[0], laboratory.server
    session, now_ns = person.core.session, laboratory.now_ns
    number = session.welcome.session

    def edges(number: int, first: int) -> bytes:
        return encode(Edges(number, Stamp(now_ns), Handle(first, (4, -4), (1, 0))))

    for datagram in (edges(number, 1), edges(number + 1, 0), edges(number, 0), edges(number, 0)):
        server.receive(datagram, person.address, now_ns)
    laboratory.frame()
    assert (server.dropped["unfit"], server.dropped["other session"]) == (1, 1)
    assert told.edges == [(0, 4, True), (0, 4, False)]
    person.core.receive(edges(number, 0), now_ns)
    assert session.dropped["unexpected"] == 1, "no client is told edges"


@pytest.mark.parametrize("network_hz", [64, 128, 1024])
def test_a_server_takes_all_that_a_button_that_never_rests_sends(network_hz: int) -> None:
    assert (1 + MOST_AT_ONCE) * network_hz < limits_for(network_hz).peer.per_second


def test_a_seat_that_is_left_releases_its_buttons() -> None:
    laboratory = Laboratory(pressing(["2@0.2+9,5@0.2+9"]))
    told = Told(laboratory)
    run_frames(laboratory, 64)
    assert told.edges == [(0, 2, True), (0, 5, True)]
    laboratory.leave(0)
    while not laboratory.people[0].gone:
        laboratory.frame()
    laboratory.frame()
    assert told.edges[2:] == [(0, 2, False), (0, 5, False)]


class Turning:
    """A device whose handle turns about z and whose gripper closes; every 50th reading is none."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self.capability = dataclasses.replace(device.capability, gives_orientation=True, grip_m=(0.0, 0.05))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._device, name)

    def read(self, tick: int) -> Sample | None:
        sample = self._device.read(tick)
        angle, bad = 1e-3 * tick, tick % 50 == 49
        turned = (nan if bad else cos(angle), 0.0, 0.0, sin(angle))
        return sample.replaced(orientation=turned, grip_m=0.2 if bad else 0.05 - 1e-5 * tick)


@pytest.fixture
def turning(monkeypatch: pytest.MonkeyPatch) -> Settings:
    """Give people such devices; one person, for a second, over a lossy link."""
    monkeypatch.setattr(session_laboratory, "make_for", lambda user, axes: Turning(make_for(user, axes)))
    settings = pressing(["1@0.2+0.3"], seconds=1.0, link={"delay_ms": 10, "loss": 0.3})
    return replace(settings, users=settings.users[:1])


def test_orientation_and_grip_come_to_world_and_observers_as_newest_values(turning: Settings) -> None:
    """Readings that cannot be are counted, and the last one stands."""
    laboratory = Laboratory(turning)
    told: list[tuple[int, Any, Any]] = []
    laboratory.room.world.handle = lambda *given: told.append(given)
    laboratory.run()
    seat = laboratory.room.seats[0]
    handle = seat.port.handle
    assert laboratory.people[0].core.session.dropped["implausible handle"] == 2 * (1017 // 50)
    w, x, y, z = handle.orientation
    tick = atan2(z, w) / 1e-3
    assert (x, y) == (0.0, 0.0)
    assert 1016 - 8 * 8 <= tick <= 1016 - 10, "some frames may be lost, and the delay has passed"
    assert handle.grip_m == pytest.approx(0.05 - 1e-5 * tick)
    assert told[-1] == (0, handle.orientation, handle.grip_m)
    person = _person(1, laboratory.room.world, seat, laboratory.now_ns)
    assert (person.buttons, person.edges) == (0, 2)
    assert (person.orientation, person.grip_m) == (handle.orientation, handle.grip_m)


def test_a_recording_has_the_handle_and_plays_again(turning: Settings, tmp_path: Path) -> None:
    run_laboratory(turning, tmp_path)
    run = open_run(tmp_path)
    assert_plays_again(tmp_path)
    seats = [timed.record.seats[0] for timed in run.steps()]
    assert [edge for seat in seats for edge in seat.edges] == [1, -1]
    assert [seat.buttons for seat in seats if seat.edges] == [1, 0]
    assert seats[-1].orientation is not None
    events = [timed.record.text for timed in run.server.records("event") if "button" in timed.record.text]
    assert events == [f"{turning.name}: a {does} button 1" for does in ("presses", "releases")]
    ticks = run.clients["a"].columns("tick", "buttons", "orientation", "grip_m")
    assert ticks["buttons"].sum() == round(0.5 * 1024) - round(0.2 * 1024)
    assert ticks["orientation"].shape == (len(ticks["buttons"]), 4)
    assert ticks["grip_m"][10] == pytest.approx(0.05 - 1e-4)


class Closed(Turning):
    """A gripper that is closed, whose zero changes its sign in the last tick of a frame; a frame begins without a sample."""

    def read(self, tick: int) -> Sample | None:
        sample = self._device.read(tick)
        zero = -0.0 if tick % M == M - 1 else 0.0
        return None if tick % M == 0 else sample.replaced(orientation=(1.0, zero, 0.0, 0.0), grip_m=zero)


def test_a_recording_tells_the_signs_of_zeros(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A frame encodes what stays the same once; -0.0 equals 0.0, and is sent as another number."""
    monkeypatch.setattr(session_laboratory, "make_for", lambda user, axes: Closed(make_for(user, axes)))
    run_laboratory(pressing([""], seconds=0.25), tmp_path)
    assert_plays_again(tmp_path)
    ticks = open_run(tmp_path).clients["a"].columns("tick", "orientation", "grip_m")
    last = np.arange(len(ticks["grip_m"])) % M == M - 1
    assert np.signbit(ticks["grip_m"][last]).all()
    assert np.array_equal(np.signbit(ticks["orientation"][:, 1]), last)


def test_a_new_seat_session_begins_with_the_buttons_that_are_down() -> None:
    """The server dies and another one takes its place: it learns what is pressed now, and no more."""
    laboratory = Laboratory(pressing(["2@0.2+9,3@0.3+0.1"], seconds=9.0))
    run_frames(laboratory, 96)
    checkpoints = laboratory.kill()
    run_frames(laboratory, 32)
    laboratory.restart(checkpoints)
    told = Told(laboratory)
    run_frames(laboratory, 256)
    assert told.edges == [(0, 2, True)]
