"""An object that nobody can reach any more is put back: whatever a room computes, and whatever its people send."""

from math import isfinite

import pytest

from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import Stamp, State, Waves
from cogrip.server.ports.seat_limits import Record
from cogrip.server.room import Room
from cogrip.server.worlds.world import REACH_M

FRAME_NS = 7_812_500
ANY = Record("sim:ideal", 1, 1024.0, messages.NO_BOUND, messages.NO_BOUND)
KINDS = {
    "paper": {"server_step": "paper", "stiffness_npm": 20000.0},  # unstable by itself: theory section 6
    "coupling": {"kind": "coupling", "stiffness_npm": 20000.0},
    "passive": {"stiffness_npm": 500.0},
}


class Line:
    """A room with one person, and what that person sends, frame by frame."""

    def __init__(self, kind: str) -> None:
        self.room = Room(resolve({"users": [{"name": "anna"}], "coupling": KINDS[kind]}))
        self.room.take_seat(0, 1, 1, 0, ANY)
        self.sender = LineSender(1, 8)
        self.frame = 0
        self.made_j = 0.0
        self.sent: list[messages.AnyMessage] = []

    def step(self, value: float) -> None:
        """A wave [sqrt(W)], or a place [m], then a tick; what comes back is a message that a client can read."""
        port, now_ns = self.room.seats[0].port, self.frame * FRAME_NS
        assert port is not None
        message: State | Waves
        if self.room.settings.coupling.kind == "coupling":
            message = State(1, self.frame, (value,), (0.0,), 0.0, 0, Stamp(1))
        else:
            self.sender.push((value,))
            self.made_j += 0.5e-9 * FRAME_NS * value * value
            message = Waves(1, *self.sender.contents(), self.made_j, self.made_j, 0, Stamp(1), (0.0, 0.0))
        assert port.receive(message, now_ns)
        self.sent = [messages.decode(datagram) for _, datagram in self.room.tick(now_ns)]
        self.frame += 1


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("kind", "values"), [("paper", (0.1, 0.0)), ("coupling", (0.01, 0.0)), ("passive", (1.0, 1.0))]
)
def test_an_object_beyond_reach_is_put_back_and_every_number_stays_bounded(
    kind: str, values: tuple[float, float]
) -> None:
    line = Line(kind)
    room = line.room
    for frame in range(4000):
        line.step(values[min(frame, 1)])
        (place,), (speed,) = room.world.position.tolist(), room.world.velocity.tolist()
        assert abs(place) <= REACH_M
        assert isfinite(speed)
        assert len(line.sent) == 1
    assert room.put_back > 0
    assert bool(room.unstable) == (kind != "passive"), room.unstable
    assert room.left or kind != "passive", "what is passive has left, and no more"
    assert isfinite(room.travel_m)
    assert room.seats[0].state == "seated"  # nobody loses a seat by it


def test_where_it_is_put_back_everybody_holds_it_anew_without_a_force() -> None:
    line = Line("passive")
    room = line.room
    while not room.put_back:
        line.step(1.0)
    assert room.world.motion() == (0.0, 0.0)
    assert room.world.force_of(0) == (0.0,)
    assert room.seats[0].on_object
    (answer,) = line.sent
    assert isinstance(answer, Waves)
    assert answer.waves[-1] == 0.0
    assert answer.state == (0.0, 0.0)
    assert room.seats[0].line_margin_j >= -1e-12


def test_an_object_within_reach_stays_where_it_is_taken() -> None:
    line = Line("passive")
    room = line.room
    for frame in range(400):
        line.step(1.0 if frame < 250 else 0.0)
        if abs(room.world.position[0]) > 0.9 * REACH_M:
            break
    assert room.put_back == 0
    assert room.world.left_workspace
