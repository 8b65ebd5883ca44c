"""`summary.json`: one run in the keys of docs/summary.md, from what the ends know of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import msgspec
from msgspec.structs import replace

from cogrip.client.inputs import CloseLedger
from cogrip.machine.addition import add_integers
from cogrip.machine.tick_count import Percentiles, TickCount
from cogrip.protocol.axes import GRIP_AXES
from cogrip.protocol.settings.coupling_kinds import COUPLING_KINDS, GATE_MJ, Kind, lent_mj
from cogrip.protocol.settings.hand import HandChange
from cogrip.protocol.settings.room import seat_settings
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.settings.settable import LENT_J
from cogrip.protocol.texts import shown
from cogrip.protocol.wire.accounts import (
    ClientAccount,
    DelayAccount,
    DeviceAccount,
    LinkCount,
    RoomAccount,
    SeatAccount,
)
from cogrip.protocol.wire.messages import Farewell
from cogrip.results.reading.summary_values import seat_sessions, told_gates
from cogrip.results.verdict.felt_as_intended import not_predicted
from cogrip.results.verdict.incidents import INCIDENTS
from cogrip.results.verdict.verdict import passive_of

if TYPE_CHECKING:  # a client leaves a summary too, and has neither
    from cogrip.server.room import Room
    from cogrip.sim.laboratory import Laboratory


class UserRecord(msgspec.Struct, frozen=True):
    """One user's two ends; None where nothing came from an end. asked_npm: K of the settings; local: `local_contact`.

    goal_npm  stiffness to which the server's spring goes, None where that is not known
    """

    name: str
    client: ClientAccount | None
    seat: SeatAccount | None
    earlier: tuple[UserRecord, ...] = ()  # seat sessions of the same user before this one, oldest first
    asked_npm: float | None = None
    local: str | None = None
    hand: HandChange | None = None  # settings of the hand that held at the end
    goal_npm: float | None = None


def summarise(
    *,
    name: str,
    seed: int,
    seconds: float,
    kind: Kind = "wave",
    tank_mj: float,
    users: Sequence[UserRecord],
    room: RoomAccount | None,
    dropped: Mapping[str, int],
    playout_frames: int | str | None = None,
    claims: bool = False,
) -> dict[str, Any]:
    """The summary of a run. What only an end knew from which nothing came is null. playout_frames: as the settings have it.

    kind: of the coupling; tank_mj: `lent_mj`
    claims: the clients are others', so that what they alone say decides none of `passive`, `unstable`, `saturated` and
    `left`; it stands in `claimed` of each user, null elsewhere.
    """
    credit_j = tank_mj * 1e-3
    rows = [
        {
            **_user(user, claims, credit_j, kind),
            "earlier": [_user(before, claims, credit_j, kind) for before in user.earlier],
        }
        for user in users
    ]
    gated = COUPLING_KINDS[kind].gated
    gates = told_gates(len(rows), 1e-3 * GATE_MJ * len(seat_sessions(rows))) if gated else None
    clients = [each.client for user in users for each in (*user.earlier, user) if each.client and not claims]
    return {
        "name": name,
        "seed": seed,
        "seconds": seconds,
        "passive": passive_of(rows, credit_j, gates),
        "credit_j": credit_j,
        "unstable": bool(room and room.unstable) or any(client.unstable for client in clients),
        "saturated": any(client.saturated for client in clients),
        "left": bool(room and room.left) or any(client.left for client in clients),
        "playout_frames": playout_frames,
        "object": {
            "position_m": _of(room, "position_m"),
            "velocity_mps": _of(room, "velocity_mps"),
            "travel_m": _of(room, "travel_m"),
        },
        "users": rows,
        "gates": gates,
        "server": {
            "ticks": _ticks(_of(room, "ticks")),
            "energy_balance_error_j": _of(room, "energy_balance_error_j"),
            "dropped": dict(dropped),
        },
    }


def of_laboratory(laboratory: Laboratory) -> dict[str, Any]:
    """Return the summary of a session in virtual time."""
    room, accounts = (
        laboratory.room,
        [
            person.core.handle(CloseLedger(laboratory.ticks(number)), laboratory.now_ns)
            for number, person in enumerate(laboratory.people)
        ],
    )
    return _of_room(room, accounts, laboratory.seconds, laboratory.server.dropped, claims=False)


def of_room(room: Room, seconds: float, dropped: Mapping[str, int]) -> dict[str, Any]:
    """Return the summary of a live room: its clients' part as far as they said goodbye."""
    return _of_room(room, [seat.account for seat in room.seats], seconds, dropped, claims=True)


def _of_room(
    room: Room, accounts: Sequence[ClientAccount | None], seconds: float, dropped: Mapping[str, int], claims: bool
) -> dict[str, Any]:
    users = []
    for number, (seat, account) in enumerate(zip(room.seats, accounts, strict=True)):
        now = replace(seat.settings, tool=seat.hand.holds.frame())
        asked = now.asked_npm, now.local_contact, seat.hand.holds
        earlier = [UserRecord(seat.name, each.client, each.seat, (), *asked) for each in seat.earlier]
        goal_npm = room.world.goal_npm(number)
        users.append(UserRecord(seat.name, account, room.seat_account(number), tuple(earlier), *asked, goal_npm))
    summary = _of_settings(
        room.settings, room.settings.name, seconds, users, room.account(), {**dropped, **_limited(room)}, claims
    )
    if (ledger := room.world.accounts.limiter()) is not None:
        summary["server"]["energy_limiter"] = ledger
    if (task := room.world.progress.account()) is not None:
        summary["task"] = task
    if (scene := room.world.accounts.scene()) is not None:
        summary["server"]["scene"] = scene
    if room.left:
        summary["server"]["left"] = [departure.table for departure in room.left]
    if room.unstable:
        summary["server"]["unstable"] = room.unstable
    if room.world.failed:
        summary["server"]["world_failed"] = room.world.failed
    return summary


def of_client(
    seat: SeatSettings,
    account: ClientAccount,
    farewell: Farewell | None,
    seconds: float,
    dropped: Mapping[str, int],
    trial: str = "",
) -> dict[str, Any]:
    """Return the summary that one live client can give: the server's part as far as it said goodbye."""
    told = farewell.seat if farewell else None
    user = UserRecord(seat.user, account, told, (), seat.asked_npm, seat.local_contact, seat.hand_change)
    summary = _of_settings(seat, seat.room, seconds, [user], farewell.room if farewell else None, dropped)
    if trial:
        summary["users"][0]["device_trial"] = trial
    return summary


def of_accounts(settings: Settings, accounts: Mapping[str, ClientAccount | None]) -> dict[str, Any]:
    """Return the summary of a live run whose server left nothing: what the clients knew."""
    users = [
        UserRecord(seat.user, accounts[seat.user], None, (), seat.asked_npm, seat.local_contact)
        for seat in (seat_settings(settings, number) for number in range(len(settings.users)))
        if seat.user in accounts
    ]
    return _of_settings(settings, settings.name, settings.seconds, users, None, {})


def _of_settings(
    settings: Settings | SeatSettings, name: str, seconds: float, users: Sequence[UserRecord], room: RoomAccount | None,
    dropped: Mapping[str, int], claims: bool = False,
) -> dict[str, Any]:  # fmt: skip
    return summarise(
        name=name, seed=settings.seed, seconds=seconds, users=users,
        kind=settings.coupling.kind, tank_mj=lent_mj(settings.coupling.kind, settings.playout.tank_mj),
        room=room, dropped=dropped, playout_frames=settings.playout.frames, claims=claims,
    )  # fmt: skip


def _limited(room: Room) -> dict[str, int]:
    """Count what people brought in beyond what seats may, and was taken off; how often their object had to be put back."""
    put_back = {"object put back from out of reach": room.put_back} if room.put_back else {}
    return put_back | {
        f"{seat.name}: {reason}": count
        for number, seat in enumerate(room.seats)
        for reason, count in room.limited(number).items()
    }


def _of(end: object, name: str) -> Any:
    """Return a field of an account, None where there is no account; a row of numbers as a list."""
    value = getattr(end, name, None)
    return list(value) if isinstance(value, tuple) else value


def _user(user: UserRecord, claims: bool, credit_j: float, kind: Kind) -> dict[str, Any]:
    client, seat, gated = user.client, user.seat, COUPLING_KINDS[kind].gated
    claimed = (*INCIDENTS, "down_margin_j", *(["line_margin_j"] if gated else []))
    lent_j = 1e-3 * GATE_MJ if gated else 2.0 * credit_j
    if user.hand is not None and user.hand.stiffness_npm is not None:
        lent_j += LENT_J
    device = client.device if client else DeviceAccount()
    row: dict[str, Any] = {
        "name": user.name,
        "position_m": _of(client, "position_m"),
        "proxy_m": _of(seat, "proxy_m"),
        "force_n": _of(client, "force_n"),
        "peak_force_n": _of(client, "peak_force_n"),
        "peak_torque_nm": _of(client, "peak_torque_nm"),
        "peak_force_step_n": _of(client, "peak_step_n"),
        "travel_m": _of(client, "travel_m"),
        "asked_stiffness_npm": user.asked_npm,
        "local": user.local,
        "hand": user.hand.plain if user.hand else None,
        "felt_stiffness_npm": _of(client, "felt_stiffness_npm"),
        "predicted_stiffness_npm": _of(client, "predicted_stiffness_npm"),
        "energy": {
            "up_margin_j": _of(seat, "up_margin_j"),
            "down_margin_j": _of(client, "down_margin_j"),
            "line_margin_j": _of(seat, "line_margin_j"),
            "device_leak_j": _of(client, "device_leak_j"),
            "device_margin_j": device.margin_j,
            "up_reserve_j": _of(seat, "up_reserve_j"),
            "down_reserve_j": _of(client, "down_reserve_j"),
            "line_reserve_j": _of(seat, "line_reserve_j"),
            "device_reserve_j": device.reserve_j,
            "budget_j": None if device.budget_j is None else device.budget_j + lent_j,
        },
        # null where nobody looked at the device port: the margin says whether somebody did
        **{key: getattr(device, key) if device.margin_j is not None else None for key in _DEVICE},
        "link": _link(seat.up if seat else None, client.down if client else None, client.rtt_ms if client else None),
        "playout": {"up": _struct(_of(seat, "playout")), "down": _struct(_of(client, "playout"))},
        "delay": _delay(client.delay if client else DelayAccount()),
        "rendered_npm": _of(seat, "rendered_npm"),
        "line": _struct(_of(client, "line")),
        "effects": _struct(_of(client, "effects")),
        "ticks": _ticks(_of(client, "ticks")),
        **{key: _of(client, key) for key in INCIDENTS},
        "state": shown(client.state) if client else None,
        "reason": shown(client.reason) if client else None,
        "claimed": {key: _of(seat if key == "line_margin_j" else client, key) for key in claimed} if claims else None,
    }
    if client and len(client.force_n) == GRIP_AXES:  # the account has one number for what is behind the places
        row["peak_grip_n"], row["peak_torque_nm"] = client.peak_torque_nm, 0.0
    why = not_predicted(row, credit_j, user.goal_npm) if row["predicted_stiffness_npm"] is not None else ""
    return {
        **row,
        "predicted_stiffness_npm": None if why else row["predicted_stiffness_npm"],
        "not_predicted": why or None,
    }


_DEVICE = ("oscillates", "at_limit", "controlled", "leak_j", "let_go", "shake_n")


def _link(up: LinkCount | None, down: LinkCount | None, rtt_ms: Percentiles | None) -> dict[str, Any]:
    """Return both directions together in the flat keys, each beside them."""
    both = {name: add_integers(getattr(one, name) for one in (up, down) if one) for name in LinkCount.__struct_fields__}
    rtt = rtt_ms or Percentiles()
    return {**both, "up": _struct(up), "down": _struct(down), "rtt_ms": {"p50": rtt.p50, "p99": rtt.p99}}


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
