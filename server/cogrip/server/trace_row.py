"""One row of a room's trace: object, proxies and books after a step."""

from cogrip.server.room import Room

_SEAT_SCALARS = ("seated", "up_margin_j", "line_margin_j", "up_used_j", "down_made_j", "lost")
_SEAT_VECTORS = ("proxy_m", "force_n")


def columns(axes: int, users: int) -> tuple[str, ...]:
    """Column names; those of a seat begin with its number (`0.proxy_m.0`)."""
    names = ["time_s", "step", "late_us", "work_us", "skipped"]
    names += [f"{name}.{axis}" for name in ("object_m", "object_mps") for axis in range(axes)]
    for user in range(users):
        names += [f"{user}.{name}" for name in _SEAT_SCALARS]
        names += [f"{user}.{name}.{axis}" for name in _SEAT_VECTORS for axis in range(axes)]
    return tuple(names)


def row(room: Room, time_s: float, late_us: float, work_us: float, skipped: int) -> list[float]:
    """Values in the order of `columns`."""
    world = room.world
    values = [time_s, room.steps, late_us, work_us, skipped, *world.position.tolist(), *world.velocity.tolist()]
    for number, seat in enumerate(room.seats):
        port = seat.port
        if port is None:
            values += [0.0] * (len(_SEAT_SCALARS) + 2 * world.axes)
            continue
        values += [
            1.0, port.up_margin_j or 0.0, seat.line_margin_j, port.used_j, port.made_j, port.count().lost,
            *world.proxy(number).tolist(), *world.force[number].tolist(),
        ]  # fmt: skip
    return values
