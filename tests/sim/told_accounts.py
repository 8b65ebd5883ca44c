"""Accounts of a session as its ends tell them, and the summary of a run of which they tell this."""

from typing import Any

from msgspec.structs import replace

from cogrip.machine.tick_count import Percentiles, TickCount
from cogrip.protocol.wire.accounts import (
    ClientAccount,
    DeviceAccount,
    LinkCount,
    PlayoutAccount,
    RoomAccount,
    SeatAccount,
)
from cogrip.results.writing.summary import UserRecord, summarise

CLIENT = ClientAccount(
    position_m=(0.0,), force_n=(1.0,), peak_force_n=2.0, travel_m=0.1, felt_stiffness_npm=None, predicted_stiffness_npm=363.0,
    down_margin_j=0.0, device_leak_j=-0.03, down=LinkCount(sent=1000, received=1000, applied=1000), rtt_ms=Percentiles(),
    ticks=TickCount(1000, 1000), unstable=False, state="live", reason="", playout=PlayoutAccount(),
    device=DeviceAccount(margin_j=0.1),
)  # fmt: skip
SEAT = SeatAccount((0.0,), 0.0, 0.0, LinkCount(sent=1000, received=1000, applied=1000), PlayoutAccount())
ROOM = RoomAccount((0.0,), (0.0,), 0.1, False, 0.0, TickCount(128, 128))


def person(name: str = "anna", seat: SeatAccount | None = SEAT, **client: Any) -> UserRecord:
    """Return what both ends tell of somebody: all is well, but for these of the client's numbers."""
    return UserRecord(name, replace(CLIENT, **client), seat)


def summarised(*users: UserRecord, tank_mj: float = 0.0) -> dict[str, Any]:
    return summarise(name="lab", seed=1, seconds=1.0, tank_mj=tank_mj, users=users, room=ROOM, dropped={})
