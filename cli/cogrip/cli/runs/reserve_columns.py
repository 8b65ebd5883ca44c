"""Energy reserves as tables show them: those of now in a live table, the least of a run in its summary."""

from typing import Any

from cogrip.protocol.messages import shown
from cogrip.protocol.recording.records import SeatStep, Tick
from cogrip.sim.runs.summary_values import (
    ROUNDING_J,
    Summary,
    energy,
    least_reserve,
    people,
    seat_sessions,
    worst_margin,
)

HEADING_NOW = "reserve mJ: up,\ndown, line, port"
_NONE = "-"


def reserves_now(tick: Tick, seat: SeatStep | None) -> str:
    """Reserve of a person's line up, line down, whole line and device port [mJ]; a dash where no ledger is kept."""
    up_j, line_j = (seat.up_reserve_j, seat.line_reserve_j) if seat else (None, None)
    return " ".join(
        _NONE if reserve_j is None else f"{reserve_j * 1e3:.1f}"
        for reserve_j in (up_j, tick.reserve_j, line_j, tick.device_reserve_j)
    )


def least_of_line(seat_session: dict[str, Any], summary: Summary) -> str:
    """Least reserve of a whole line after the first second; of a run that was not passive, a margin that is below 0."""
    alone = [{**seat_session, "earlier": None}]
    worst, least = worst_margin(alone), least_reserve(alone, "line_reserve_j")
    if worst and worst[0] < -ROUNDING_J and summary.get("passive") is False:
        return energy(worst[0])
    return energy(least[0]) if least else _NONE


def device_ports(summary: Summary) -> str:
    """A line on the device ports, "" where nobody told of them: least reserve, and most leaked to a hand, and whose."""
    users = people(summary)
    reserve, margin = least_reserve(users, "device_reserve_j"), least_reserve(users, "device_margin_j")
    if margin and margin[0] < -ROUNDING_J:  # in the first second, or with what was forgiven
        reserve = margin
    leak = least_reserve(users, "device_leak_j")  # below 0: a hand was given more than was taken from it

    def of(least: tuple[float, str]) -> str:
        return f" ({shown(least[1])})" if len(seat_sessions(users)) > 1 else ""

    told = [f"least reserve {energy(reserve[0])}{of(reserve)}"] if reserve else []
    if leak:
        told.append(
            f"{energy(-leak[0])} leaked to the hand at most{of(leak)}" if leak[0] < 0.0 else "no leak to the hand"
        )
    claimed = ", say the clients" if any(user.get("claimed") for user in users) else ""
    return f"device ports: {', '.join(told)}{claimed}" if told else ""
