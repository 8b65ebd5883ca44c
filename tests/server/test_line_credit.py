"""Credit of the lines up: what a seat lends in all, whoever takes it and however often."""

from tests.server.test_resumption import Guarded
from tests.server.test_server_core import room, waves


def test_taking_the_seat_anew_brings_no_new_credit() -> None:
    """A hostile player falls silent after a frame and takes its seat again: all its lines together lend one credit."""
    desk = Guarded(room(playout={"tank_mj": 1.0, "frames": 0}))
    lent_j, seat = 0.0, desk.core.rooms[0].seats[0]
    for session in range(1, 41):
        player = desk.welcome("x", nonce=session)
        desk.core.receive(waves(player.session, 0, 0.5), "x", desk.now_ns)
        for _ in range(8):
            desk.tick()
        desk.core.outbox.clear()
        assert seat.port is not None
        lent_j += seat.port.used_j - 0.5**2 / 256.0
        desk.now_ns += 1_000_000_000
        assert lent_j <= 1e-3 + 1e-12
    assert lent_j > 0.5e-3, "it was asked for"
