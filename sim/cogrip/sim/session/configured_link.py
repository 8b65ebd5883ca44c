"""The links that [link] describes, with what no welcome carries: scripts of outages, and recorded traces."""

from collections.abc import Iterable
from pathlib import Path

from cogrip.protocol.link_profile import Link, Way
from cogrip.sim.session.delay_trace import read_trace
from cogrip.sim.session.link import LinkEmulator


def configured_link(
    link: Link,
    way: Way,
    seed: str,
    outages: Iterable[tuple[float, float]] = (),
    origin_ns: int | None = None,
) -> LinkEmulator:
    """One direction. outages: (start_s, length_s) of each, besides [link]'s. Raises TraceError where its trace cannot be read.

    origin_ns: what outages and trace count from, else the first datagram.
    """
    path = link.trace_of(way)
    trace = read_trace(Path(path)) if path else None
    return LinkEmulator(link.direction(way), seed, (*link.script(way), *outages), trace, origin_ns)
