"""Sessions whose settings tests change as an operator does."""

from typing import Any

from cogrip.client.inputs import CloseLedger
from cogrip.protocol.settings.hand import parsed
from cogrip.protocol.settings.settable import room_change
from cogrip.protocol.wire.accounts import ClientAccount
from cogrip.server.inputs import SetHand, SetRoom
from cogrip.sim.laboratory import Laboratory


def wall(**more: Any) -> dict[str, Any]:
    """One hand presses on a wall from the first second on."""
    return {
        "seconds": 60.0, "object": {"kind": "wall", "axes": 3}, "coupling": {"impedance_nspm": 20.0, "stiffness_npm": 400.0},
        "users": [{"name": "anna", "device": "sim:ideal", "hand": "approach&amplitude_m=0.006&lag_s=0.3"}], **more,
    }  # fmt: skip


def two(**more: Any) -> dict[str, Any]:
    return {
        "seconds": 60.0, "object": {"kind": "cube", "axes": 3}, "coupling": {"impedance_nspm": 20.0, "stiffness_npm": 600.0},
        "users": [{"name": "anna", "hand": "reach"}, {"name": "ben", "hand": "hold", "side": "right"}], **more,
    }  # fmt: skip


def set_of(laboratory: Laboratory, name: str, *pairs: str) -> None:
    assert laboratory.server.handle(SetHand(name, parsed(pairs)), laboratory.now_ns) == 1


def set_room(laboratory: Laboratory, *pairs: str) -> int:
    return laboratory.server.handle(SetRoom(room_change(pairs)), laboratory.now_ns)


def account_of(laboratory: Laboratory, number: int = 0) -> ClientAccount:
    return laboratory.people[number].core.handle(CloseLedger(laboratory.ticks(number)), laboratory.now_ns)


def assert_passive(laboratory: Laboratory) -> None:
    for number in range(len(laboratory.people)):
        account, seat = account_of(laboratory, number), laboratory.room.seat_account(number)
        margins = [account.down_margin_j, seat.up_margin_j, seat.line_margin_j]
        assert min([margin for margin in margins if margin is not None], default=0.0) >= -1e-3
        assert account.device.margin_j >= 0.0
    assert laboratory.room.world.balance_error_j < 1e-9
