"""A client's own word decides nothing at the server: what it measured stays, and what is old moves nobody."""

from cogrip.machine.tick_count import Percentiles, TickCount
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.wire.accounts import ClientAccount, LinkCount, SeatAccount
from cogrip.protocol.wire.messages import Stamp, State, Waves
from cogrip.server.ports.seat_limits import SeatLimits
from cogrip.server.ports.state_port import StatePort
from cogrip.server.ports.wave_port import WavePort
from cogrip.server.seats.participants import MOST_EARLIER, Seat

from tests.server.test_resumption import Guarded
from tests.server.test_server_core import room, waves

SETTINGS = resolve({"coupling": {"kind": "coupling"}, "users": [{"name": "anna"}]})
WAVES = resolve({"users": [{"name": "anna"}]})


CLAIMED = ClientAccount(
    (0.0,), (0.0,), 0.0, 0.0, None, None, -1e300, 0.0, LinkCount(), Percentiles(), TickCount(), False, "idle", ""
)


def measured(margin_j: float) -> SeatAccount:
    return SeatAccount((0.0,), margin_j, margin_j, LinkCount())


def test_claims_push_out_no_seat_session_that_was_measured_as_bad() -> None:
    seat = Seat(seat_settings(SETTINGS, 0))
    seat.last = measured(-0.7)
    seat.close_seat_session()
    for _ in range(3 * MOST_EARLIER):
        seat.last, seat.account = measured(0.0), CLAIMED
        seat.close_seat_session()
    assert len(seat.earlier) == MOST_EARLIER
    assert min(seat_session.least_margin() for seat_session in seat.earlier) == -0.7


def test_a_state_that_is_old_or_of_another_line_does_not_say_where_the_hand_is() -> None:
    port = StatePort(seat_settings(SETTINGS, 0), SeatLimits(8.5, 2.0, 10.0))
    for position, velocity in (((0.0,), (0.0, 0.0)), ((0.0, 0.0), (0.0,)), ((0.0, 0.0), (0.0, 0.0))):
        assert not port.receive(State(7, 5, position, velocity, 0.0, 0, Stamp(1)), 0)
    assert port.pop(1) == (0.0, 0.0)
    assert port.receive(State(7, 5, (0.001,), (0.0,), 0.0, 0, Stamp(1)), 0)
    port.receive(State(7, 4, (1000.0,), (0.0,), 0.0, 0, Stamp(1)), 0)
    assert port.hand == (0.001,)


def test_waves_that_acknowledge_what_was_never_sent_are_behind_by_nothing() -> None:
    """Observers are told; a message with a number below 0 is none to them, and would hide the person."""
    port = WavePort(seat_settings(WAVES, 0), SeatLimits(8.5, 2.0, 10.0))
    zero = (0.0,)
    port.receive(Waves(7, 0, (0.1,), zero, zero, 0.0, 0.0, 2**53, Stamp(1), (0.0, 0.0)), 0)
    for _ in range(4):
        port.pop(1)
        port.push(zero)
    assert port.behind == 0


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
