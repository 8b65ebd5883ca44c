"""The links that [link] describes, with what a welcome does not carry: scripts of outages, and recorded traces."""

from collections.abc import Iterable
from pathlib import Path

from cogrip.protocol.link_profile import Direction, Link
from cogrip.sim.session.delay_trace import read_trace
from cogrip.sim.session.link import LinkEmulator


def configured_link(
    link: Link,
    direction: Direction,
    seed: str,
    outages: Iterable[tuple[float, float]] = (),
    origin_ns: int | None = None,
) -> LinkEmulator:
    """Return one direction of a link. Raises TraceError where its trace cannot be read.

    outages: (start_s, length_s) of each, besides [link]'s; origin_ns: the time that outages and trace count from, else that of
    the first datagram.
    """
    path = link.trace_of(direction)
    trace = read_trace(Path(path)) if path else None
    return LinkEmulator(link.direction(direction), seed, (*link.script(direction), *outages), trace, origin_ns)
