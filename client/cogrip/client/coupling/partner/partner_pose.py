"""Scenes with partners' models whose tools turn with their hands (theory 5b.4).

What is one's own is in lengths q, the angle travelled among them: work, intention, stiffness and release of the hand are as in
`partner_coupling`. What is compared with others, or with the copy, is a pose: of a q near the newest sample's q_s, whose
rotation R_s is told,

    R = exp((q - q_s) / l) R_s D^-1        p = (x - x_0, l log R)

x_0 and D are 0 and no rotation for a tool that is put into the hand; one that is welded to the object stays as it is when
somebody takes it, and they are what is between the two then.
"""

from collections.abc import Sequence

from msgspec.structs import replace

from cogrip.client.coupling.interface import Coupling
from cogrip.client.coupling.partner.partner_scene import PartnerSceneCoupling
from cogrip.machine.rows import Row, Vector
from cogrip.protocol.axes import PLACES
from cogrip.protocol.laws.poses import Places, Poses
from cogrip.protocol.laws.rotations import UNTURNED, exp, inverse, log, product
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire.clock import MessageClock
from cogrip.protocol.wire.handle import Handle
from cogrip.protocol.wire.messages import Intent

_NOWHERE: Vector = (0.0, 0.0, 0.0)


class PartnerPoseCoupling(PartnerSceneCoupling):
    """See above."""

    def __init__(self, seat: SeatSettings) -> None:
        super().__init__(seat)
        self.turns = True
        self._sample: tuple[Sequence[float], Sequence[float]] = self.still, UNTURNED  # q_s and R_s
        self._between: tuple[Sequence[float], Sequence[float]] = _NOWHERE, UNTURNED  # x_0 and D

    def _space_of(self, seat: SeatSettings) -> Places:
        self._poses = Poses(seat.coupling.length_scale)
        return self._poses

    def turn(self, position_m: Row, rotation_rad: Row) -> None:
        self._sample = position_m, exp(rotation_rad)

    def _hand(self, position_m: Sequence[float]) -> list[float]:
        at, orientation = self._sample
        nothing, held = self._between
        way = [here - before for here, before in zip(position_m, at, strict=True)]
        turned = product(product(exp(self._poses.radians(way)), orientation), inverse(held))
        place = [x - zero for x, zero in zip(position_m[:PLACES], nothing, strict=True)]
        return place + [self._poses.length_m * each for each in log(turned)]

    def _begin(self, position_m: Sequence[float]) -> None:
        self._between = _NOWHERE, UNTURNED
        super()._begin(position_m)
        assert self.copy is not None
        hand, tool = self._hand(position_m), self.copy.place_m
        radians = self._poses.radians
        self._between = (
            tuple([x - q for x, q in zip(hand[:PLACES], tool[:PLACES], strict=True)]),
            product(inverse(exp(radians(tool))), exp(radians(hand))),
        )

    def _own_m(self) -> Sequence[float]:
        return self._hand(self.intention.place_m)

    def _take(self, intent: Intent) -> None:
        place, rate, length = intent.intention_m, intent.rate_mps, self._poses.length_m
        super()._take(replace(
            intent, intention_m=(*place[:PLACES], *[length * each for each in place[PLACES:]]),
            rate_mps=(*rate[:PLACES], *[length * each for each in rate[PLACES:]]),
        ))  # fmt: skip

    def _as_told(self, row: Sequence[float]) -> Row:
        return (*row[:PLACES], *self._poses.radians(row))

    def go_on_from(self, before: Coupling) -> None:
        super().go_on_from(before)
        assert isinstance(before, PartnerPoseCoupling)
        self._sample, self._between = before._sample, before._between

    def message(
        self, session: int, clock: MessageClock, now_ns: int, origin_m: Row, position_m: Row, velocity_mps: Sequence[float],
        handle: Handle | None = None,
    ) -> bytes:  # fmt: skip
        pose, rates = position_m[: len(self.still)], self._as_told(velocity_mps)
        return super().message(session, clock, now_ns, origin_m, pose, rates, handle)
