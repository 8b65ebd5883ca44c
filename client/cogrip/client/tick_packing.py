"""MessagePack of a client's tick, part by part. Compiled, `tick_packing.pyx` takes its place."""

from cogrip.protocol.recording.records import Row, Tick, TickHead
from cogrip.protocol.recording.sink import pack

BEGIN = b"\xde" + len(Tick.__struct_fields__).to_bytes(2, "big")
"""Header of a map with as many entries as a `Tick` has fields."""


def pack_tick(
    tick: int, late_us: int, work_us: int, position_m: Row | None, velocity_mps: Row, force_n: Row, work_j: float,
    port_j: float, rest: bytes, device_reserve_j: float,
) -> bytes:  # fmt: skip
    """Return a `Tick`, packed. rest: the packed fields between those of `TickHead` and the last one, `device_reserve_j`."""
    head = pack(TickHead(tick, late_us, work_us, position_m, velocity_mps, force_n, work_j, port_j))
    return BEGIN + head[1:] + rest + pack(device_reserve_j)
