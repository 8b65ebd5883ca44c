"""Contact of a scene at the client (theory 7.7): with fixed geometry by a proxy here, with bodies that move by the wave line.

Symbols: x hand, p proxy [m], e = (x - p) / |x - p|, K, B of [coupling], F_line force of the line.

    F = e max(0, K |x - p| + B e xdot) + P F_line        P leaves out what n does, the normals that hold the proxy

The line's port moves with the proxy. It carries something only while the server says that the tool is engaged: then a body
that moves is near. Before, the server puts the tool where the proxy is, and the hand feels nothing of the line. It begins with
a gain s that grows in GROW_S, so that its damper comes smoothly; what it does not show meanwhile, and how far the hand has gone
since, is sent later, as far as the hand's work pays for it. Where the proxy comes off geometry, P returns to 1 in GROW_S
as well: a line that presses the hand onto it would else throw it back at once, and the contact would chatter.
"""

from collections.abc import Sequence
from math import sqrt

from cogrip.client.coupling.local.fixed_shapes import KINDS, FixedShape
from cogrip.client.coupling.local.local_contact import Contact, LocalCoupling
from cogrip.client.coupling.local.proxy import Ball, Proxy, without
from cogrip.machine.rows import Row, Vector
from cogrip.protocol.axes import PLACES
from cogrip.protocol.drawing import MOST_LOCAL, MOST_PAIRS, Shape
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire.messages import Geom, Waves

GROW_S = 0.1


class SceneContact(Contact):
    """Fixed geometry of a scene, and the line where a body that moves is near.

    engaged_m: where the tool was when it was engaged, in the hand's own frame; None while it is clear
    """

    def __init__(self, seat: SeatSettings, line: LocalCoupling) -> None:
        super().__init__(seat, line)
        self._number = seat.seat
        self._geoms: dict[int, Geom] = {}
        self._proxy = Proxy((), ())
        self._shapes: tuple[Shape, ...] = ()  # of `_proxy`
        self.engaged_m: Row | None = None
        self._share = 0.0  # s of the line's beginning
        self._leaving = False  # the tick at which the line's force ends
        self._left: Sequence[Vector] = ()  # normals that hold the proxy, or have until less than GROW_S ago
        self._regained = 0.0  # share of the line's force along them that is rendered again
        self._depth, self._along = 0.0, (0.0, 0.0, 0.0)  # |x - p| less what has yielded of it, e
        self._yielded, self._gated = 0.0, False  # part of |x - p| that is not paid for; whether the gate keeps count
        self._growth = seat.rates.frame_s / GROW_S
        self._frame_s, self._rate_hz = seat.rates.frame_s, float(seat.rates.device_hz)

    # Geometry

    def receive_shape(self, geom: Geom) -> bool:
        """Take in a shape; all are used once all are there, and stay so. False for one that does not fit."""
        known = self._geoms.setdefault(geom.number, geom) if self._fits(geom) else None
        if known is None or known.shape != geom.shape:
            return False
        if known is geom and len(self._geoms) == geom.count:
            self._build()
        return True

    def _fits(self, geom: Geom) -> bool:
        """Return whether a shape may be one of those that are told: few enough that a tick has time for them."""
        counts = {geom.count, *[each.count for each in self._geoms.values()]}
        few = geom.number < geom.count <= MOST_LOCAL and len(counts) == 1
        return few and geom.body is None and geom.kind in KINDS

    def _build(self) -> None:
        shapes = tuple(self._geoms[number].shape for number in sorted(self._geoms))
        if shapes == self._shapes:
            return  # those of the line before: the proxy stays on them
        balls: list[Ball] = []
        for shape in shapes:
            if shape.seat == self._number and shape.kind == "sphere":
                x, y, z = shape.place_m
                balls.append(((x, y, z), shape.size_m[0]))
        fixed = [FixedShape(shape) for shape in shapes if shape.seat is None]
        if len(fixed) * len(balls) > MOST_PAIRS:
            fixed = []
        proxy = Proxy(balls, fixed)
        proxy.place_m = self._proxy.place_m
        self._proxy, self._shapes = proxy, shapes

    # The line

    def go_on_from(self, before: Contact) -> None:
        super().go_on_from(before)
        if isinstance(before, SceneContact):
            self._proxy, self._shapes = before._proxy, before._shapes
            self._yielded, self._gated = before._yielded, before._gated

    def fits(self, message: Waves) -> bool:
        """Return whether a message has the object's state, and where the tool is engaged the place of that behind it."""
        own = len(self._line.object_state)
        return len(message.state) in (own, own + PLACES)

    def told(self, state: Row) -> None:
        line, engaged = self._line, state or None
        if engaged is not None and engaged != self.engaged_m and self.position_m is not None:
            behind = [line.root * (p - q) / self._frame_s for p, q in zip(self.proxy_m, engaged, strict=True)]
            line.up.withhold(behind, anew=True)
            self._share = 0.0
        elif engaged is None and self.engaged_m is not None:
            line.up.withhold((0.0,) * PLACES, anew=True)  # a tool that is clear has no deficit
            self._leaving = True
        self.engaged_m = engaged

    def start_frame(self) -> None:
        if self.engaged_m is not None:
            self._grow()
            self._line.down.gain *= self._share

    def _grow(self) -> None:
        self._share = min(1.0, self._share + self._growth)

    def gap(self) -> bool:
        """True where the line's force ends, too: it falls softly."""
        return self._leaving or (self.engaged_m is not None and self._line.down.receiver.gap)

    @property
    def pressed(self) -> tuple[float, Sequence[float]]:
        return self._depth + self._yielded, self._along

    @property
    def stored_j(self) -> float:
        return self.spring.stored_j(self._depth, self._line.ramp_gain)

    # The law

    def release(self) -> None:
        super().release()
        self._proxy.release()
        self._gated = True

    def elapse(self, applied_n: Sequence[float], mean_velocity_mps: Sequence[float]) -> None:
        line, velocity_mps = self._line, self._go_on(applied_n, mean_velocity_mps)
        if self.engaged_m is None:
            line.leave_line()
            self._leaving = False
            return
        if self._share == 1.0:
            line.enter_line(velocity_mps)
            return
        written_off, line.down.written_off = line.down.written_off, [0.0] * PLACES
        line.enter_line(velocity_mps)
        # what the gain at the beginning leaves is no deficit of the line: it is this end that shows it later
        line.up.withhold([each / line.frame_ticks for each in line.down.written_off])
        line.down.written_off = written_off

    def _go_on(self, applied_n: Sequence[float], mean_velocity_mps: Sequence[float]) -> Vector:
        """Enter a tick of the hand's places, where there is one. Return the mean velocity of the proxy."""
        p, q, r = self.proxy_m
        if self.position_m is not None:
            (x, y, z), T = self.position_m, self._tick_s
            i, j, k = mean_velocity_mps
            if self._gated and self._depth > 0.0:
                (a, b, c), (f, g, h) = self._along, applied_n
                self.spring.gate.saved_j += (a * f + b * g + c * h) * (a * i + b * j + c * k) * T
            self.position_m = x + T * i, y + T * j, z + T * k
            self._follow()
        (x, y, z), rate = self.proxy_m, self._rate_hz
        return rate * (x - p), rate * (y - q), rate * (z - r)

    def _follow(self) -> None:
        proxy, hand = self._proxy, self.position_m
        assert hand is not None
        x, y, z = hand
        self.proxy_m = p, q, r = proxy.follow((x, y, z))
        if proxy.normals:
            x, y, z = x - p, y - q, z - r
            self._depth = depth = sqrt(x * x + y * y + z * z)
            if depth > 0.0:
                self._along = x / depth, y / depth, z / depth
        else:
            self._depth = 0.0

    def _yield(self) -> None:
        """Render no more of the depth than has been paid for, and all of it again as the hand leaves or pays."""
        whole, gain = self._depth, self._line.ramp_gain
        if not self._gated:
            self._gated = True
            self.spring.gate.begin(self.spring.stored_j(whole, gain))
        self._depth = depth = max(0.0, whole - self._yielded)
        if (kept := self.spring.kept_m(depth, gain)) < depth:
            self._depth = kept
        elif depth < whole:
            self._depth = self.spring.gate.grown(depth, whole, self.spring.stiffness)
            self.spring.gate.move(self.stored_j)
        self._yielded = whole - self._depth

    def _free(self, line_n: Sequence[float]) -> Row:
        """Return the line's force without what geometry carries, or has carried until just now."""
        x, y, z = line_n
        a, b, c = without(line_n, self._left)
        gain = self._regained
        return a + gain * (x - a), b + gain * (y - b), c + gain * (z - c)

    def force(self, position_m: Sequence[float], velocity_mps: Sequence[float]) -> list[float]:
        self._press(tuple(position_m))
        line, spring = self._line, self.spring
        total: Sequence[float] = [0.0] * PLACES
        line.local_n = total
        if self.engaged_m is not None:
            reduced = line.reduced
            total = line.line_force(position_m, velocity_mps)
            if self._left:
                total, line.local_n = self._free(total), self._free(line.local_n)
            line.reduced = line.reduced or reduced
        if self._depth > 0.0:
            i, j, k = self._along
            speed = spring.damping * (i * velocity_mps[0] + j * velocity_mps[1] + k * velocity_mps[2])
            size = max(0.0, spring.stiffness * self._depth + speed)
            (a, b, c), watched = line.local_n, spring.watched * size
            line.local_n = a + watched * i, b + watched * j, c + watched * k
            a, b, c = total
            return [a + size * i, b + size * j, c + size * k]
        return list(total)

    def _press(self, place_m: Row) -> None:
        """Enter where the hand is: how deep, on which surfaces."""
        self.spring.carry(self._line.carried_nspm)
        self._line.reduced = self.spring.reduced
        anew = self.position_m is None
        self.position_m = place_m
        if anew:
            self._follow()
        if self._line.ramp_gain < 1.0 or self._yielded > 0.0:
            self._yield()
        else:
            self._gated = False
        if normals := self._proxy.normals:
            self._left, self._regained = normals, 0.0
        elif self._left:
            self._regained += self._tick_s / GROW_S
            self._left = self._left if self._regained < 1.0 else ()
