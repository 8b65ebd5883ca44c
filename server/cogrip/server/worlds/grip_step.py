"""One step of an object that people grip from all sides, in plain floats: state, ports and ledgers of a `GripWorld`.

Rows of people and axes lie one behind the other, entry `user * axes + axis`; each is an array of its own, which a compiled form
reads in place (docs/decisions/0028-typed-classes.md). Symbols, of theory sections 3.3 and 3.7: K, B stiffness and damping of
each person's spring, e its stretch, b wave impedance of its port, c wave gain, m_o mass of the object, T frame.
"""

from array import array
from collections.abc import Sequence
from typing import Any

from cogrip.machine import in_place
from cogrip.machine.rows import Row
from cogrip.protocol.axes import PLACES
from cogrip.protocol.settings.effects import Effect
from cogrip.server.worlds.accounts import NO_CONTACT, Contact
from cogrip.server.worlds.world_step import REACH_M, WORKSPACE_M, WorldStep

MOST_SAVED_J = 0.05  # most energy that a spring may save to grow stiffer: what can be spent at once is bounded
RAMP_S = 0.3  # time in which a newcomer's stiffness grows, energy permitting


def zeros(count: int) -> "array[float]":
    """Return so many numbers, all 0."""
    return array("d", bytes(8 * count))


class GripStep(WorldStep):
    """State of the object and of each person's spring, and the step of a `GripWorld`.

    place, speed, external  of each axis [m, m/s, N]
    stretch, force          of each person and axis [m, N]
    K, B, b, c              of each person: stiffness, damping, wave impedance, wave gain
    work, excess            of each person: energy out of the line so far, and how much that is above the exact sum [J]
    paid                    of each person: energy that the spring may spend on growing stiffer [J]
    loan                    of each person: energy that the spring may borrow to grow stiffer [J]
    target, held, adapts    of each person: the stiffness to which K grows; 1 while the object is held; 1 where the spring saves
                            what its damper takes, while it does not grow too
    settled                 `settle` has been called since K, B, b or c was changed
    growing                 a spring may still grow stiffer
    saving                  a spring saves energy to grow stiffer with
    mass_kg, damping        of the object
    offsets                 from the object to each person's frame, of those who were asked about [m]; the world clears them
    error_j                 largest error of the energy balance so far
    """

    def __init__(self, world: Any, users: int, axes: int, frame_s: float) -> None:
        super().__init__(world)
        self.users, self.axes = users, axes
        self.growing = self.saving = False
        self.offsets: dict[int, Row] = {}
        self._motion: Row | None = None  # as `motion` returned it last
        self._frame_s, self.mass_kg, self.damping = frame_s, 1.0, 0.0
        entries = users * axes
        self.place, self.speed, self.external = zeros(axes), zeros(axes), zeros(axes)
        self.stretch, self.force = zeros(entries), zeros(entries)
        self.K, self.B, self.b, self.c = zeros(users), zeros(users), zeros(users), zeros(users)
        self.target, self.held, self.adapts = zeros(users), zeros(users), zeros(users)
        self._drive, self._gain, self._beta = zeros(users), zeros(users), zeros(users)  # see `settle`
        self._beta_sum = 0.0
        self.work, self.excess, self.paid, self.loan = zeros(users), zeros(users), zeros(users), zeros(users)
        # Of a step
        self._waves, self._mids, self._taken, self._sent = zeros(entries), zeros(axes), zeros(users), zeros(axes)
        self.settled = False
        self.error_j = 0.0

    def settle(self) -> None:
        """Compute the constants of all ports: G = K T / 2 + B, drive = G c, gain = 1 / (1 + G / b), beta = G gain."""
        beta_sum = 0.0
        for user in range(self.users):
            G = self.K[user] * (0.5 * self._frame_s) + self.B[user]
            gain = 1.0 / (1.0 + G / self.b[user])
            self._drive[user], self._gain[user], self._beta[user] = G * self.c[user], gain, G * gain
            beta_sum += G * gain
        self._beta_sum = beta_sum
        self.settled = True

    def put(self, user: int, damping: float) -> None:
        """Let a person take hold: an unstretched spring without stiffness."""
        for at in range(user * self.axes, (user + 1) * self.axes):
            self.stretch[at] = 0.0
        self.K[user], self.B[user], self.paid[user] = 0.0, damping, 0.0
        self.held[user] = 1.0
        self.growing, self.settled = True, False

    def take_away(self, user: int) -> None:
        """Let a person go."""
        for at in range(user * self.axes, (user + 1) * self.axes):
            self.stretch[at] = self.force[at] = 0.0
        self.K[user] = self.B[user] = self.held[user] = 0.0
        self.settled = False

    def advance(self, rows: Sequence[Row]) -> list[Row]:
        """Advance by one frame as `step` does; let springs grow before the next one."""
        if not self.settled:
            self.settle()
        answers = self.step(rows)
        if self.growing or self.saving:
            self.grow()
        return answers

    def step(self, rows: Sequence[Row]) -> list[Row]:
        """Advance by one frame; take a row of waves of each person, and return the rows that go back."""
        self._motion = None
        users, axes, period, mass = self.users, self.axes, self._frame_s, self.mass_kg
        K, B, b, c = (
            in_place.numbers(self.K),
            in_place.numbers(self.B),
            in_place.numbers(self.b),
            in_place.numbers(self.c),
        )
        drive, gains, betas = in_place.numbers(self._drive), in_place.numbers(self._gain), in_place.numbers(self._beta)
        place, speed, stretch, force = (
            in_place.numbers(self.place),
            in_place.numbers(self.speed),
            in_place.numbers(self.stretch),
            in_place.numbers(self.force),
        )
        waves, mids, sent = in_place.numbers(self._waves), in_place.numbers(self._mids), in_place.numbers(self._sent)
        inertia = 2.0 * mass / period
        weight = inertia + self.damping + self._beta_sum
        for user in range(users):
            row = tuple(rows[user])
            for axis in range(axes):
                waves[user * axes + axis] = row[axis]
        gained = lost = supplied = 0.0  # of object and springs [J / 2, W, W]
        for axis in range(axes):
            was, external = speed[axis], self.external[axis]
            pull = inertia * was + external
            at = axis
            for user in range(users):
                pull += (K[user] * stretch[at] + drive[user] * waves[at]) * gains[user]
                at += axes
            mid = pull / weight
            mids[axis] = mid
            speed[axis] = now = 2.0 * mid - was
            place[axis] += period * mid
            gained += mass * (now * now - was * was)
            lost += self.damping * mid * mid
            supplied += external * mid
        came = 0.0
        answers: list[Row] = []
        for user in range(users):
            squares = relatives = springs = 0.0
            stiffness, impedance, factor = K[user], b[user], c[user]
            for axis in range(axes):
                at, mid = user * axes + axis, mids[axis]
                wave, was = waves[at], stretch[at]
                f = (stiffness * was + drive[user] * wave) * gains[user] - betas[user] * mid
                force[at] = f
                back = wave - factor * f  # `server_wave` and `proxy_velocity` inline: a call costs 6 % of the step
                sent[axis] = back
                relative = factor * wave - f / impedance - mid
                now = was + period * relative
                stretch[at] = now
                squares += wave * wave - back * back
                relatives += relative * relative
                springs += now * now - was * was
            work = (0.5 * period) * squares
            came += work
            before = self.work[user]  # `add_compensated` inline: calls cost 6 % of this step
            work -= self.excess[user]
            total = before + work
            self.work[user] = total
            self.excess[user] = (total - before) - work
            gained += stiffness * springs
            taken = B[user] * relatives
            lost += taken
            self._taken[user] = taken
            if axes == PLACES:  # as below, without a list
                answers.append((sent[0], sent[1], sent[2]))
            else:
                answers.append(tuple([sent[axis] for axis in range(axes)]))
        error = abs(came + period * supplied - 0.5 * gained - period * lost)
        if error > self.error_j:
            self.error_j = error
        return answers

    def grow(self) -> None:
        """Save what dampers have taken in the step, and move each K towards its target (theory 3.7).

        To raise it by dK costs dK e^2 / 2, which is paid from what the person's own damper has taken; to lower it takes as
        much from the spring, which is saved.
        """
        for user in range(self.users):
            self.paid[user] += self._frame_s * self._taken[user]
        if self.growing:
            self.growing = False
            for user in range(self.users):
                if self.held[user] != 0.0:
                    self._raise_stiffness(user, self.target[user])
        if self.saving:
            for user in range(self.users):
                if self.adapts[user] != 0.0 and self.paid[user] > MOST_SAVED_J:
                    self.paid[user] = MOST_SAVED_J

    def _raise_stiffness(self, user: int, target: float) -> None:
        square = 0.0
        for at in range(user * self.axes, (user + 1) * self.axes):
            square += self.stretch[at] * self.stretch[at]
        step = min(target * (self._frame_s / RAMP_S), target - self.K[user])
        if square > 0.0:
            step = min(step, 2.0 * (self.paid[user] + self.loan[user]) / square)
        self.paid[user] -= 0.5 * step * square
        self.K[user] += step
        self.settled = False
        self.growing = self.growing or self.K[user] != target

    def engaged_at(self, user: int) -> Row:
        return ()

    def effects_of(self, user: int) -> Sequence[Effect]:
        effects: Sequence[Effect] = self._world.effects
        return effects

    def take_events(self) -> Sequence[str]:
        return WorldStep.take_events(self) if self._world.events else ()

    def left_workspace(self) -> bool:
        return not self._within(WORKSPACE_M)

    def out_of_reach(self) -> bool:
        return not self._within(REACH_M)

    def _within(self, most_m: float) -> bool:
        """Return whether the object is at most so far from the middle on each axis."""
        for axis in range(self.axes):  # noqa: SIM110 - compiled, a loop in plain C
            if not abs(self.place[axis]) <= most_m:
                return False
        return True

    def moved(self) -> None:
        """Let `motion` read place and speed anew, which have been set."""
        self._motion = None

    def motion(self) -> Row:
        """Return position [m], then velocity [m/s]."""
        if self._motion is not None:
            return self._motion
        place, speed, axes = in_place.numbers(self.place), in_place.numbers(self.speed), self.axes
        if axes == PLACES:  # as below, without lists
            motion: Row = place[0], place[1], place[2], speed[0], speed[1], speed[2]
        else:
            motion = *[place[axis] for axis in range(axes)], *[speed[axis] for axis in range(axes)]
        self._motion = motion
        return motion

    def port_work_j(self) -> list[float]:
        """Return the energy that came out of each person's line so far [J]."""
        work = self.work
        return [work[user] for user in range(self.users)]

    def start_ledger(self, user: int) -> None:
        """Count a person's work from here."""
        self.work[user] = self.excess[user] = 0.0

    def force_of(self, user: int) -> Row:
        """Return the force of a person's coupling [N]."""
        force, first = in_place.numbers(self.force), user * self.axes
        return tuple([force[first + axis] for axis in range(self.axes)])

    def proxy_of(self, user: int) -> Row:
        """Return a person's proxy [m], in the frame of their hand."""
        offset = self.offsets.get(user)
        if offset is None:
            offset = self.offsets[user] = tuple(self._world.offset[user].tolist())
        place, stretch, first = in_place.numbers(self.place), in_place.numbers(self.stretch), user * self.axes
        return tuple([place[axis] + stretch[first + axis] + offset[axis] for axis in range(self.axes)])

    def contact_of(self, user: int) -> Contact:
        return NO_CONTACT
