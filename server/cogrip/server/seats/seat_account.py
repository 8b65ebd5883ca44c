"""The account of a seat session, as summaries, rosters and recordings have it."""

from cogrip.protocol.wire.accounts import LinkCount, SeatAccount
from cogrip.server.seats.participants import Seat
from cogrip.server.worlds.world import World


def account_of(seat: Seat, world: World) -> SeatAccount:
    """Return the account of a seat session: the present one, else the last."""
    port = seat.port
    if port is None:
        return seat.last or SeatAccount((0.0,) * world.axes, None, None, LinkCount())
    return SeatAccount(
        world.proxy_of(seat.number), port.up_margin_j, seat.line_margin_j, port.count(), port.playout_account(),
        rendered_npm=world.accounts.stiffness(seat.number) if seat.on_object else None,
        up_reserve_j=port.up_reserve.reported_j, line_reserve_j=seat.line_reserve.reported_j,
    )  # fmt: skip
