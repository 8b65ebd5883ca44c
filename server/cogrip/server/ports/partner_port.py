"""Port of the scheme with partners' models: each intention goes to the object's model of that hand, and on to the others.

A row for the world has, for all axes: where the intention is now, as far as the horizon; the intention; its rate. Behind these,
each on all axes: the hand's stiffness, the energy that it has donated, and when its intention was made [s]. What goes back has
the object's place and velocity, in a scene on 6 axes, then for each seat intention, rate, stiffness, energy and time, in this
hand's frame.
"""

from cogrip.machine.rows import Row
from cogrip.protocol.axes import POSE_AXES
from cogrip.protocol.laws.partner_model import ahead
from cogrip.protocol.laws.poses import IN_PLACES, IN_RADIANS
from cogrip.protocol.settings.object_kinds import kind_of
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire.clock import MessageClock
from cogrip.protocol.wire.messages import Intent, Partner, encode
from cogrip.server.ports.seat_limits import PowerBucket, SeatLimits
from cogrip.server.ports.state_port import LatestStatePort

FIELDS = 6  # rows of a seat, for all axes each
ANSWERED = 5  # rows of each seat in what goes back


class DonationLimiter(PowerBucket):
    """Bounds what a hand may say that it has donated: in any time no more than its mean power and the burst of its bucket."""

    def __init__(self, frame_s: float, limits: SeatLimits, power_left: float = 1.0) -> None:
        super().__init__(frame_s, limits, power_left)
        self._told_j: float | None = None  # as the client said last
        self.given_j = 0.0  # what it said that it has donated since it came
        self.passed_j = 0.0  # counter that goes to the others

    def limit(self, donated_j: float) -> float:
        """Return the counter to pass on for the one that a client tells in this step."""
        grown = 0.0 if self._told_j is None else max(0.0, donated_j - self._told_j)
        self._told_j = donated_j if self._told_j is None else max(self._told_j, donated_j)
        self.given_j += grown
        allowed = min(grown, max(0.0, self._level_j))
        if allowed < grown:
            self.counts["power limited"] += 1
        self._level_j = min(self._burst_j, self._level_j + self._refill_j - allowed)
        self.passed_j += allowed
        return self.passed_j


class PartnerPort(LatestStatePort[Partner]):
    """See `Port`. The line up carries what the hand donates, the line down the parts of what the others do.

    Each hand's own gate bounds what it gets: of the whole line only its client knows, which tells it.
    """

    def __init__(self, seat: SeatSettings, limits: SeatLimits, power_left: float = 1.0) -> None:
        super().__init__(seat, limits)
        self._counters_j: dict[int, float] = {}  # of each partner, as passed to this hand last
        self._passed_down_j, self._others = 0.0, max(1, seat.people - 1)
        self._seat, self._frame_ns = seat.seat, round(1e9 * seat.rates.frame_s)
        self._space = IN_RADIANS if self.axes == POSE_AXES else IN_PLACES
        self._object_axes = POSE_AXES if kind_of(seat.object.kind).scene else self.axes
        self._row: Row = (0.0,) * (2 * self._object_axes)
        self._donations = DonationLimiter(seat.rates.frame_s, limits, power_left)

    def receive(self, message: Partner, now_ns: int) -> bool:
        fits = message.of_axes(self.axes) and len(message.intents) <= 1
        return fits and self._accept(message)

    def set_limits(self, limits: SeatLimits) -> None:
        super().set_limits(limits)
        self._donations.set_limits(limits)

    @property
    def power_left(self) -> float:
        return self._donations.fullness

    @property
    def limited(self) -> dict[str, int]:
        return {**self._states.counts, **self._donations.counts}

    @property
    def neutral(self) -> Row:
        """An object that rests where the hand is, and no partners."""
        return (self.hand or (0.0,) * self.axes) + (0.0,) * (2 * self._object_axes - self.axes)

    @property
    def used_j(self) -> float:
        """Energy that the hand has donated, as far as it was passed on."""
        return self._donations.passed_j

    @property
    def made_j(self) -> float:
        """Energy that was passed to the hand of what the others have donated: its part."""
        return self._passed_down_j

    def pop(self, frames: int) -> Row:
        newest, axes = self._pop(frames), self.axes
        self.up_reserve.elapse(frames)
        if newest is None or not newest.intents:
            place = self.hand or (0.0,) * axes
            return place + place + (0.0,) * ((FIELDS - 2) * axes)
        (intent,) = newest.intents
        now_ns = self.next_step_ns - self._frame_ns
        age_s = 1e-9 * max(0, now_ns - intent.made_ns) if intent.made_ns else 0.0
        there = tuple(ahead(intent.intention_m, intent.rate_mps, age_s, self._space))
        told = intent.stiffness_npm, self._donations.limit(intent.donated_j), 1e-9 * intent.made_ns
        self.up_reserve.update(self._donations.given_j - self._donations.passed_j)
        return there + intent.intention_m + intent.rate_mps + tuple([number for number in told for _ in range(axes)])

    def push(self, row: Row) -> None:
        self._row = row
        self._number += 1

    def rounding_j(self) -> float:
        return 0.0

    def message(self, session: int, clock: MessageClock, now_ns: int, object_state: Row, port_j: float) -> bytes:
        row, axes = self._row, self.axes
        wide, told, intents = ANSWERED * axes, self._object_axes, []
        for seat, first in enumerate(range(2 * told, len(row), wide)):
            numbers = row[first : first + wide]
            if seat == self._seat or numbers[-1] <= 0.0:
                continue
            stiffness, donated, made_s = numbers[2 * axes], numbers[3 * axes], numbers[4 * axes]
            self._passed_down_j += max(0.0, donated - self._counters_j.get(seat, donated)) / self._others
            self._counters_j[seat] = donated
            intents.append(
                Intent(
                    seat,
                    round(1e9 * made_s),
                    tuple(numbers[:axes]),
                    tuple(numbers[axes : 2 * axes]),
                    stiffness,
                    donated,
                )
            )
        return encode(Partner(
            session, self._number, row[:told], row[told : 2 * told], tuple(intents), self._receiver.acknowledged,
            clock.stamp(now_ns), edges=self.handle.taken,
        ))  # fmt: skip
