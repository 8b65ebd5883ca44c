"""`summary.json`: one run in the keys that the README fixes, from what the ends know of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import msgspec

from cogrip.client.inputs import CloseLedger
from cogrip.protocol.accounts import (
    ClientAccount,
    DelayAccount,
    DeviceAccount,
    LinkCount,
    Percentiles,
    RoomAccount,
    SeatAccount,
    TickCount,
)
from cogrip.protocol.messages import Farewell, shown
from cogrip.protocol.passivity_control import lent_mj
from cogrip.protocol.settings import SeatSettings, Settings, coupling_of
from cogrip.sim.runs.verdict import not_predicted, passive_of

if TYPE_CHECKING:  # a client leaves a summary too, and has neither
    from cogrip.server.room import Room
    from cogrip.sim.session.laboratory import Laboratory


class UserRecord(msgspec.Struct, frozen=True):
    """One user's two ends; None where an end was never heard. asked_npm: K of the settings."""

    name: str
    client: ClientAccount | None
    seat: SeatAccount | None
    earlier: tuple[UserRecord, ...] = ()  # sittings of the same user before this one, oldest first
    asked_npm: float | None = None


def summarise(
    *,
    name: str,
    seed: int,
    seconds: float,
    tank_mj: float,
    users: Sequence[UserRecord],
    room: RoomAccount | None,
    dropped: Mapping[str, int],
    playout_frames: int | str | None = None,
    claims: bool = False,
) -> dict[str, Any]:
    """The summary of a run. What an end that was not heard alone knew is null. playout_frames: as the settings have it.

    claims: the clients are others', so that what they alone say decides neither `passive` nor `diverged`; it stands in
    `claimed` of each user, null elsewhere.
    """
    rows = [{**_user(user, claims), "earlier": [_user(before, claims) for before in user.earlier]} for user in users]
    sittings = [seat_session for user in users for seat_session in (*user.earlier, user)]
    said = not claims and any(each.client.diverged for each in sittings if each.client)
    diverged = said or bool(room and room.diverged)
    return {
        "name": name,
        "seed": seed,
        "seconds": seconds,
        "passive": passive_of(rows, tank_mj * 1e-3),
        "diverged": diverged,
        "playout_frames": playout_frames,
        "object": {
            "position_m": list(room.position_m) if room else None,
            "velocity_mps": list(room.velocity_mps) if room else None,
            "travel_m": room.travel_m if room else None,
        },
        "users": rows,
        "server": {
            "ticks": _ticks(room.ticks if room else None),
            "energy_balance_error_j": room.energy_balance_error_j if room else None,
            "dropped": dict(dropped),
        },
    }


def of_laboratory(laboratory: Laboratory) -> dict[str, Any]:
    """The summary of a session in virtual time."""
    settings: Settings = laboratory.settings
    dropped: dict[str, int] = {**laboratory.server.dropped, **_limited(laboratory.room)}
    return summarise(
        name=settings.name,
        seed=settings.seed,
        seconds=laboratory.seconds,
        tank_mj=lent_mj(settings.coupling, settings.playout),
        playout_frames=settings.playout.frames,
        users=[
            UserRecord(
                person.name,
                person.core.handle(CloseLedger(laboratory.ticks(number)), laboratory.now_ns),
                laboratory.room.seat_account(number),
                _earlier(laboratory.room, number),
                laboratory.room.seats[number].settings.coupling.stiffness_npm,
            )
            for number, person in enumerate(laboratory.people)
        ],
        room=laboratory.room.account(),
        dropped=dropped,
    )


def of_room(room: Room, seconds: float, dropped: Mapping[str, int]) -> dict[str, Any]:
    """The summary of a live room: its clients' part as far as they said goodbye."""
    settings = room.settings
    return summarise(
        name=settings.name,
        seed=settings.seed,
        seconds=seconds,
        tank_mj=lent_mj(settings.coupling, settings.playout),
        playout_frames=settings.playout.frames,
        users=[
            UserRecord(
                seat.settings.user,
                seat.account,
                room.seat_account(number),
                _earlier(room, number),
                seat.settings.coupling.stiffness_npm,
            )
            for number, seat in enumerate(room.seats)
        ],
        room=room.account(),
        dropped={**dropped, **_limited(room)},
        claims=True,
    )


def of_client(
    seat: SeatSettings, account: ClientAccount, farewell: Farewell | None, seconds: float, dropped: Mapping[str, int]
) -> dict[str, Any]:
    """The summary that one live client can give: the server's part as far as it said goodbye."""
    return summarise(
        name=seat.room,
        seed=seat.seed,
        seconds=seconds,
        tank_mj=lent_mj(seat.coupling, seat.playout),
        playout_frames=seat.playout.frames,
        users=[
            UserRecord(seat.user, account, farewell.seat if farewell else None, asked_npm=seat.coupling.stiffness_npm)
        ],
        room=farewell.room if farewell else None,
        dropped=dropped,
    )


def of_accounts(settings: Settings, accounts: Mapping[str, ClientAccount | None]) -> dict[str, Any]:
    """The summary of a live run whose server left nothing: what the clients knew."""
    return summarise(
        name=settings.name,
        seed=settings.seed,
        seconds=settings.seconds,
        tank_mj=lent_mj(settings.coupling, settings.playout),
        playout_frames=settings.playout.frames,
        users=[
            UserRecord(user.name, accounts[user.name], None, asked_npm=coupling_of(settings, user).stiffness_npm)
            for user in settings.users
            if user.name in accounts
        ],
        room=None,
        dropped={},
    )


def _earlier(room: Room, number: int) -> tuple[UserRecord, ...]:
    """The sittings at a seat before the last."""
    seat = room.seats[number]
    asked_npm = seat.settings.coupling.stiffness_npm
    return tuple(
        UserRecord(seat.name, seat_session.client, seat_session.seat, asked_npm=asked_npm)
        for seat_session in seat.earlier
    )


def _limited(room: Room) -> dict[str, int]:
    """Count what people brought in beyond what seats may, and was taken off; how often their object had to be put back."""
    put_back = {"object put back from out of reach": room.put_back} if room.put_back else {}
    return put_back | {
        f"{seat.name}: {reason}": count
        for number, seat in enumerate(room.seats)
        for reason, count in room.limited(number).items()
    }


def _claimed(client: ClientAccount | None) -> dict[str, Any]:
    """Return what a client alone says that would decide the verdict, if it were believed."""
    return {"diverged": client.diverged if client else None, "down_margin_j": client.down_margin_j if client else None}


def _user(user: UserRecord, claims: bool) -> dict[str, Any]:
    client, seat = user.client, user.seat
    row: dict[str, Any] = {
        "name": user.name,
        "position_m": list(client.position_m) if client else None,
        "proxy_m": list(seat.proxy_m) if seat else None,
        "force_n": list(client.force_n) if client else None,
        "peak_force_n": client.peak_force_n if client else None,
        "peak_force_step_n": client.peak_step_n if client else None,
        "travel_m": client.travel_m if client else None,
        "asked_stiffness_npm": user.asked_npm,
        "felt_stiffness_npm": client.felt_stiffness_npm if client else None,
        "predicted_stiffness_npm": client.predicted_stiffness_npm if client else None,
        "energy": {
            "up_margin_j": seat.up_margin_j if seat else None,
            "down_margin_j": client.down_margin_j if client else None,
            "line_margin_j": seat.line_margin_j if seat else None,
            "device_leak_j": client.device_leak_j if client else None,
            "device_margin_j": client.device.margin_j if client else None,
            "up_reserve_j": seat.up_reserve_j if seat else None,
            "down_reserve_j": client.down_reserve_j if client else None,
            "line_reserve_j": seat.line_reserve_j if seat else None,
            "device_reserve_j": client.device.reserve_j if client else None,
        },
        **_device(client.device if client else DeviceAccount()),
        "link": _link(seat.up if seat else None, client.down if client else None, client.rtt_ms if client else None),
        "playout": {
            "up": _struct(seat.playout if seat else None),
            "down": _struct(client.playout if client else None),
        },
        "delay": _delay(client.delay if client else DelayAccount()),
        "rendered_npm": seat.rendered_npm if seat else None,
        "ticks": _ticks(client.ticks if client else None),
        "state": shown(client.state) if client else None,
        "reason": shown(client.reason) if client else None,
        "claimed": _claimed(client) if claims else None,
    }
    return {**row, **_prediction(row)}


def _device(device: DeviceAccount) -> dict[str, Any]:
    """Return what was seen at the device port; null where nobody looked: the margin says whether somebody did."""
    keys = ("oscillates", "at_limit", "controlled", "leak_j", "let_go")
    return {key: getattr(device, key) if device.margin_j is not None else None for key in keys}


def _prediction(row: dict[str, Any]) -> dict[str, Any]:
    """The stiffness that the linear line predicts, null with the reason where it does not hold of this run."""
    why = not_predicted(row) if row["predicted_stiffness_npm"] is not None else ""
    return {"predicted_stiffness_npm": None if why else row["predicted_stiffness_npm"], "not_predicted": why or None}


def _link(up: LinkCount | None, down: LinkCount | None, rtt_ms: Percentiles | None) -> dict[str, Any]:
    """Both directions together in the flat keys, each beside them."""
    fields = LinkCount.__struct_fields__
    both = {name: sum(getattr(one, name) for one in (up, down) if one) for name in fields}
    rtt = rtt_ms or Percentiles()
    return {
        **both,
        "up": _struct(up),
        "down": _struct(down),
        "rtt_ms": {"p50": rtt.p50, "p99": rtt.p99},
    }


def _delay(delay: DelayAccount) -> dict[str, Any]:
    return {
        "up_ms": {"p50": delay.up_ms.p50, "p99": delay.up_ms.p99},
        "down_ms": {"p50": delay.down_ms.p50, "p99": delay.down_ms.p99},
        "clock_offset_ms": delay.offset_ms,
        "uncertainty_ms": delay.uncertainty_ms,
    }


def _struct(struct: msgspec.Struct | None) -> dict[str, Any] | None:
    return msgspec.structs.asdict(struct) if struct is not None else None


def _ticks(ticks: TickCount | None) -> dict[str, Any]:
    ticks = ticks or TickCount()
    late, work = ticks.late_us, ticks.work_us
    return {
        "due": ticks.due,
        "run": ticks.run,
        "late_us": {"p50": late.p50, "p99": late.p99, "p999": late.p999, "max": late.max},
        "work_us": {"p50": work.p50, "p99": work.p99},
    }
