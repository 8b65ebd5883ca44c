"""Contact of a scene at the client, with a tool that its hand turns (theory 7.7): `local_scene` in places, its line in turning.

The tool is a ball about its own place, which touches the same however it is turned: contact without friction makes no torque.
So turning is a wave port as under waves, all the time, and the port of the places is behind a transformer of ratio s:

    port's velocity s pdot        hand's force P s F_line        s = 0 while the tool is clear, then growing to 1 in GROW_S

It neither makes nor loses energy. At s = 0 the places' end of the line stands still and sends back what comes, which is nothing
as the server's end is clear as well. What the hand has moved and s has not shown is sent later, as without turning.
"""

from collections.abc import Sequence

from cogrip.client.coupling.local.local_contact import LocalCoupling
from cogrip.client.coupling.local.local_scene import SceneContact
from cogrip.machine.rows import Row
from cogrip.protocol.axes import PLACES
from cogrip.protocol.settings.seat import SeatSettings

_NONE = (0.0,) * PLACES


class PoseContact(SceneContact):
    """Contact of a tool that its hand turns. Rows have the axes of turning, as lengths, behind those of the places."""

    late = True  # Turning is a wave port at the hand: what an old sample shows was done against the wave of then.

    def __init__(self, seat: SeatSettings, line: LocalCoupling) -> None:
        super().__init__(seat, line)
        self._turning: Row = (0.0,) * (seat.object.axes - PLACES)

    def gap(self) -> bool:
        return self._leaving or self._line.down.receiver.gap

    def start_frame(self) -> None:
        if self.engaged_m is not None:
            self._grow()

    def elapse_absent(self) -> None:
        if self.position_m is not None:
            self.release()
        self._line.leave_line()
        self._end_leaving()

    def elapse(self, applied_n: Sequence[float], mean_velocity_mps: Sequence[float]) -> None:
        line = self._line
        x, y, z = self._go_on(applied_n[:PLACES], mean_velocity_mps[:PLACES])
        s, cut_n = self._port_share(), line.cut_n
        if cut_n is not None:  # of the places it is mostly the contact's, which the line does not see at all
            lost_n = self._free(cut_n[:PLACES]) if s == 1.0 else _NONE
            line.cut_n = *lost_n, *cut_n[PLACES:]
        line.enter_line((s * x, s * y, s * z, *mean_velocity_mps[PLACES:]))
        line.cut_n = cut_n
        self._end_leaving()
        if s < 1.0 and self.engaged_m is not None:
            hidden = (1.0 - s) * line.root / line.frame_ticks
            line.up.withhold((hidden * x, hidden * y, hidden * z, *self._turning))

    def _end_leaving(self) -> None:
        if self.engaged_m is None:
            self._leaving = False

    def force(self, position_m: Sequence[float], velocity_mps: Sequence[float]) -> list[float]:
        self._press(tuple(position_m[:PLACES]))
        line, spring, s = self._line, self.spring, self._port_share()
        x, y, z, *turning = velocity_mps
        reduced = line.reduced
        line_n = line.line_force(position_m, (s * x, s * y, s * z, *turning))
        line.reduced = line.reduced or reduced
        size, (i, j, k) = 0.0, self._along
        if self._depth > 0.0:
            size = max(0.0, spring.stiffness * self._depth + spring.damping * (i * x + j * y + k * z))
        (a, b, c), local_n = self._shown(line.local_n[:PLACES], s), line.local_n
        watched = spring.watched * size
        line.local_n = (a + watched * i, b + watched * j, c + watched * k, *local_n[PLACES:])
        a, b, c = self._shown(line_n[:PLACES], s)
        return [a + size * i, b + size * j, c + size * k, *line_n[PLACES:]]

    def _port_share(self) -> float:
        """Return s."""
        return 0.0 if self.engaged_m is None else self._share

    def _shown(self, port_n: Sequence[float], s: float) -> Sequence[float]:
        """Return the hand's force, at the places, for one at the port."""
        if s == 0.0:
            return _NONE
        shown = [s * each for each in port_n]
        return self._free(shown) if self._left else shown
