"""Checkpoints of rooms in the memory of the actors of two hosts, in place of a shared folder.

The host of a room has its newest one, and sends it to the next host of a ring of all that are alive. An object of Ray's own
store would end with the host that made it.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

KEPT_S, LATEST_S = 1.0, 5.0
"""Longest wait for the answers of other hosts, and the same where none of them has a checkpoint."""


class Kept(NamedTuple):
    """Checkpoint of a room. number: of the process that made it; turn: counts its checkpoints; data: "" none is needed."""

    number: int
    turn: int
    data: bytes


NOTHING = Kept(0, 0, b"")


def newest(found: Sequence[Kept]) -> Kept:
    """Return the newest of some, NOTHING for none."""
    return max(found, default=NOTHING, key=lambda each: each[:2])


def gather(own: Kept, come: Callable[[float], tuple[Sequence[Kept], int]]) -> Kept:
    """Return the newest checkpoint of a room among what is here and what other hosts answer.

    A host under load may answer late: where nobody else has one it is waited for, or the room would begin without.
    come: waits so many seconds, and returns what came and the number of hosts that have not answered
    """
    found = [own]
    for limit_s in (KEPT_S, LATEST_S - KEPT_S):
        answers, silent = come(limit_s)
        found += answers
        if not silent or newest(found) != NOTHING:
            break
    return newest(found)


def next_host(host: str, hosts: Sequence[str]) -> str:
    """Return the host that is to keep what this one has: the next of a ring. "" where there is no other."""
    ring = sorted({*hosts, host})
    following = ring[(ring.index(host) + 1) % len(ring)]
    return "" if following == host else following


class Replicas:
    """Newest checkpoints that a host has, of its rooms and of others' by their names."""

    def __init__(self) -> None:
        self._kept: dict[str, Kept] = {}
        self._sent: dict[str, Kept] = {}
        self._peer = ""

    def keep(self, kept: Mapping[str, Kept]) -> None:
        """Keep what is newer than what is here."""
        for room, each in kept.items():
            self._kept[room] = newest([self._kept.get(room, NOTHING), Kept(*each)])

    def get(self, room: str) -> Kept:
        """Return the newest checkpoint of a room that is here, NOTHING for none."""
        return self._kept.get(room, NOTHING)

    def to_send(self, peer: str, rooms: Sequence[str]) -> dict[str, Kept]:
        """Return what the other host does not have, of these rooms. All of it, where it is another host than before."""
        if peer != self._peer:
            self._peer, self._sent = peer, {}
        news = {room: self._kept[room] for room in rooms if room in self._kept}
        return {room: each for room, each in news.items() if self._sent.get(room) != each}

    def sent(self, kept: Mapping[str, Kept]) -> None:
        """Note that the other host has these."""
        self._sent.update(kept)
