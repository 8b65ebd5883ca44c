"""Room in the loop of a live server: its pacer, and what its last step took."""

from collections.abc import Sequence

from cogrip.machine.pacing import Pacer
from cogrip.machine.platform import time
from cogrip.server.io.datagram_path import DatagramPath
from cogrip.server.recorder import RecordedServer
from cogrip.server.room import Room

TOGETHER_NS = 100_000  # datagrams of rooms that are stepped so closely one after the other are sent together


class PacedRoom:
    """A room that is stepped at its own rate. `take` before datagrams are received, then `step`.

    Of a deserted room no step is run: `pass_by` counts its ticks, `count_passed` steps it by all that have passed since.

    rested  whether nobody was there in the last step
    """

    def __init__(self, room: Room, pacer: Pacer) -> None:
        self.room, self.pacer, self.rested = room, pacer, False
        self._last = -1  # tick
        self._steps = self._work_us = self._passed = 0

    def take(self, now_ns: int) -> None:
        """Take the tick that is due, if one is."""
        tick = self.pacer.take(now_ns)
        self._steps = 0 if tick is None else tick - self._last
        self._last += self._steps

    def step(self, core: RecordedServer, now_ns: int, early_ns: int) -> int:
        """Step the room by the tick taken. Returns when it was done, 0 where none was due.

        early_ns: what was done ahead of the tick, which is work of this step, too.
        """
        if not self._steps:
            return 0
        room, pacer = self.room, self.pacer
        self.rested = room.is_deserted()
        core.note_timing(room, pacer.late_ns // 1000, self._work_us, pacer.skipped)
        core.step(room, now_ns, self._steps)
        done_ns = time.monotonic_ns()
        self._work_us = (done_ns - now_ns + early_ns) // 1000
        pacer.done_at(done_ns, early_ns)
        return done_ns

    def pass_by(self, now_ns: int) -> None:
        """Let the ticks that are due pass, of a room where nobody is."""
        steps = self.pacer.pass_by(now_ns)
        self._last += steps
        self._passed += steps

    def count_passed(self, core: RecordedServer, now_ns: int) -> None:
        """Step a room where nobody holds the object by all ticks that have passed."""
        self.pass_by(now_ns)
        if self._passed:
            core.idle(self.room, self._passed)
        self._passed = 0


def take_due(rooms: Sequence[PacedRoom], now_ns: int) -> None:
    """Take the tick that is due of each room."""
    for each in rooms:
        each.take(now_ns)


def step_due(rooms: Sequence[PacedRoom], core: RecordedServer, path: DatagramPath, now_ns: int, early_ns: int) -> None:
    """Step the rooms by the ticks that were taken, and send what comes of it; only then is the last step recorded."""
    sent_ns = now_ns
    for each in rooms:
        done_ns = each.step(core, now_ns, early_ns)
        if done_ns - sent_ns >= TOGETHER_NS:
            path.send()
            sent_ns = done_ns
    path.send()
    core.finish_step()


def deserted_among(rooms: Sequence[PacedRoom]) -> list[PacedRoom]:
    """Return those where nobody is, and nobody was in the last step, which brought the object to rest."""
    found = []
    for each in rooms:
        if each.rested and each.room.is_deserted():
            found.append(each)  # noqa: PERF401 - compiled, a loop whose variable has a type
    return found


def next_due_ns(rooms: Sequence[PacedRoom]) -> int:
    """Return when the first of these rooms, one at least, is due."""
    due_ns = rooms[0].pacer.next_due_ns
    for each in rooms:
        if each.pacer.next_due_ns < due_ns:
            due_ns = each.pacer.next_due_ns
    return due_ns
