"""A room with local models over messages: what a player is told, where its tool goes, what a hostile client can do."""

import math

import msgspec
import numpy as np
import pytest

from cogrip.cli.settings.shipped_settings import shipped_scene
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.settings.room import SettingsError, resolve
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import Geom, Stamp, Waves
from cogrip.server.ports.local_port import LocalPort
from cogrip.server.ports.seat_limits import FASTER, ClaimedRecord
from cogrip.server.room import Room
from cogrip.server.worlds.scenes.local_scene import LocalSceneWorld

T = 1 / 128
FRAME_NS = 7_812_500
SPEED_MPS = 2.0
RECORD = ClaimedRecord("sim:ideal", 3, 1024.0, 10.0, SPEED_MPS)
Place = tuple[float, float, float]


def room_of(scene: str = "lift", people: int = 2, **tables: object) -> Room:
    users = [{"name": f"user{number}", "side": ("left", "right")[number % 2]} for number in range(people)]
    thing = {"kind": "scene", "axes": 3, "file": str(shipped_scene(f"{scene}.xml"))}
    return Room(resolve({"object": thing, "coupling": {"kind": "local"}, "users": users, **tables}))


class Player:
    """A client of one seat, in plain code: it sends a proxy and a wave each frame, and reads what comes."""

    def __init__(self, room: Room, seat: int) -> None:
        self.seat, self.session = seat, 100 + seat
        room.take_seat(seat, self.session, 1, 0, RECORD)
        room.seats[seat].address = ("seat", seat)
        port = room.seats[seat].port
        assert isinstance(port, LocalPort)
        self.port, self.sender, self.made_j = port, LineSender(3, 8), 0.0
        self.geoms: dict[int, Geom] = {}
        self.state: tuple[float, ...] = ()
        self.heard_ns = 0  # clock reading of the newest message

    def send(self, proxy: Place, wave: Place, now_ns: int) -> bool:
        self.sender.push(wave)
        self.made_j += 0.5 * T * math.fsum(value * value for value in wave)
        stamp, state = Stamp(now_ns + 1, self.heard_ns), (0.0, 0.0, 0.0, *proxy, *proxy)
        message = Waves(self.session, *self.sender.contents(), self.made_j, self.made_j, 0, stamp, state)
        return self.port.receive(messages.decode(messages.encode(message)), now_ns)

    def read(self, datagram: bytes) -> None:
        message = messages.decode(datagram)
        assert message.session == self.session  # type: ignore[union-attr]
        if isinstance(message, Geom):
            self.geoms[message.number] = message
        elif isinstance(message, Waves):
            self.state, self.heard_ns = message.state, message.stamp.sent_ns


class Session:
    """Everybody of a room, frame by frame."""

    def __init__(self, room: Room) -> None:
        self.room, self.frame = room, 0
        self.players = [Player(room, seat) for seat in range(len(room.seats))]

    def step(self, *proxies: Place, wave: Place = (0.0, 0.0, 0.0)) -> int:
        """Step the room; return the largest number of shapes that one player was told."""
        now_ns = self.frame * FRAME_NS
        self.frame += 1
        for player, proxy in zip(self.players, proxies, strict=True):
            assert player.send(proxy, wave, now_ns)
        out = self.room.tick(now_ns)
        told = [0] * len(self.players)
        for address, datagram in out:
            assert isinstance(address, tuple)
            player = self.players[int(address[1])]
            before = len(player.geoms)
            player.read(datagram)
            told[player.seat] += len(player.geoms) - before
        return max(told)


AWAY: tuple[Place, Place] = ((-0.03, 0.0, 0.05), (0.03, 0.0, 0.05))


def test_a_clear_tool_is_where_its_client_says_and_its_line_brings_nothing() -> None:
    room = room_of()
    session = Session(room)
    for frame in range(200):
        shift = 0.01 * math.sin(0.1 * frame)
        proxies = [(x, y + shift, z) for x, y, z in AWAY]
        session.step(*proxies, wave=(0.5, 0.0, 0.0))
        if frame > 5:
            for player, proxy in zip(session.players, proxies, strict=True):
                assert len(player.state) == 6
                # as the playout of waves has no say in it, the tool is where the newest frame says
                assert room.world.proxy_of(player.seat) == pytest.approx(proxy, abs=1e-9)
    world = room.world
    assert isinstance(world, LocalSceneWorld)
    assert world.limiter.level_j == pytest.approx(1e-3, abs=2e-5)  # the box settles on the floor
    absorbed_j = session.players[0].port.absorbed_j
    assert absorbed_j == pytest.approx(0.5 * T * 0.25 * 200, rel=0.05)  # it has left the line
    assert world.port_work_j()[0] == 0.0
    assert room.seats[0].line_margin_j > -1e-12


@pytest.mark.parametrize("delay", [0, 3, 20])
def test_waves_of_before_an_engagement_was_known_move_no_tool(delay: int) -> None:
    """A client that sends the same wave all the time, and hears of what the server does `delay` frames late."""
    session = Session(room_of())
    left = session.players[0]
    heard: list[int] = []
    engaged, moved = [], []
    for frame in range(120):
        heard.append(left.heard_ns)
        left.heard_ns = heard[max(0, frame - delay)]
        session.step((min(0.002 * frame, 0.06), 0.0, 0.0), AWAY[1], wave=(0.05, 0.0, 0.0))
        engaged.append(len(left.state) == 9)
        moved.append(session.room.world.proxy_of(0)[0])
    began = engaged.index(True)
    assert all(engaged[began:])
    assert len(session.players[1].state) == 6
    place = left.state[6]
    moves = [number for number in range(began, 120) if abs(moved[number] - place) > 1e-6]
    assert moves[0] - began == pytest.approx(delay + 2, abs=1), (
        "heard in the next frame, and played in the one after it"
    )
    assert left.port.absorbed_j == pytest.approx(0.5 * T * 0.05**2 * moves[0], rel=0.05)
    assert session.room.seats[0].line_margin_j > -1e-12


@pytest.mark.parametrize(
    ("scene", "place", "size"),
    [("wall", (0.08, 0.0, 0.0), (0.02, 0.1, 0.1)), ("lift", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))],
)
def test_all_shapes_are_told_in_the_hands_own_frame_and_again(scene: str, place: Place, size: Place) -> None:
    session = Session(room_of(scene))
    session.step(*AWAY)
    assert max(session.step(*AWAY) for _ in range(62)) <= 2
    world = session.room.world
    for seat, player in enumerate(session.players):
        shapes = [player.geoms[number].shape for number in range(player.geoms[0].count)]
        balls = [shape for shape in shapes if shape.seat is not None]
        assert {shape.seat for shape in balls} == {seat}
        assert [shape.kind for shape in balls] == ["sphere"] * 4  # a pad
        (fixture,) = [shape for shape in shapes if shape.seat is None]
        in_scene = np.array(fixture.place_m) - world.offset[seat] + world.object.start  # type: ignore[attr-defined]
        assert in_scene == pytest.approx(place)
        assert fixture.size_m == pytest.approx(size)
        player.geoms.clear()
    for _ in range(200):
        session.step(*AWAY)
    assert len(session.players[0].geoms) == 4 + 1  # one that was lost comes again


def test_a_proxy_goes_no_faster_than_the_devices_record() -> None:
    player = Player(room_of(), 0)
    port = player.port
    player.send((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0)
    port.pop(1)
    player.send((0.5, 0.0, 0.0), (0.0, 0.0, 0.0), FRAME_NS)
    places = []
    for _ in range(60):
        port.pop(1)
        assert port.proxy is not None
        places.append(port.proxy[0])
    assert max(np.diff([0.0, *places])) == pytest.approx(FASTER * SPEED_MPS * T)
    assert places[-1] == 0.5


def test_a_late_frame_takes_no_proxy_back_and_other_lengths_are_unfit() -> None:
    player = Player(room_of(), 0)
    port = player.port
    for number in range(3):
        player.send((0.001 * number, 0.0, 0.0), (0.0, 0.0, 0.0), number * FRAME_NS)
    zero = (0.0,) * 3
    late = Waves(100, 1, zero, zero, zero, 0.0, 0.0, 0, Stamp(1), (0.009,) * 9)
    port.receive(late, 3 * FRAME_NS)
    port.pop(1)
    assert port.proxy == (0.002, 0.0, 0.0)
    for length in (6, 15):
        assert not port.receive(msgspec.structs.replace(late, first=3, state=(0.0,) * length), 3 * FRAME_NS)
    with pytest.raises(messages.MalformedError):
        messages.decode(messages.encode(late).replace(np.float64(0.009).tobytes()[::-1], b"\x7f\xf8" + bytes(6)))


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        (
            {"object.axes": 6, "playout.redundancy": 13},
            "13 of 6 axes is more than a datagram holds; set it to at most 12",
        ),
        ({"coupling.server_step": "paper"}, 'with coupling.kind = "local" leave it "passive"'),
    ],
)
def test_settings_that_it_does_not_fit(tables: dict[str, object], words: str) -> None:
    thing = {"kind": "scene", "axes": 3, "file": str(shipped_scene("lift.xml"))}
    with pytest.raises(SettingsError, match=words):
        resolve({"object": thing, "coupling": {"kind": "local"}, "users": [{"name": "anna"}]}, tables)
