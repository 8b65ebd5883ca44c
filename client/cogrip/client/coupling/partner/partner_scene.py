"""Scenes with partners' models: the copy of the object is one of a scene, in which tools hold it by contact (theory 5b.3).

All else is as in `partner_coupling`. There o is the object, here it is one's own tool, which the same spring holds; the gate at
that spring is the same, and knows nothing of the copy.
"""

from collections.abc import Sequence

from cogrip.client.coupling.interface import Coupling
from cogrip.client.coupling.partner.partner_coupling import PartnerCoupling
from cogrip.client.coupling.partner.scene_copy import CopyError, SceneCopy
from cogrip.protocol.axes import PLACES, POSE_AXES
from cogrip.protocol.drawing import MOST_COPIED
from cogrip.protocol.laws.rotations import exp
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire.messages import Geom, Intent, Partner


class PartnerSceneCoupling(PartnerCoupling):
    """copy: None until the server has told all of its shapes: the hand feels nothing, and its partners are told of none."""

    def __init__(self, seat: SeatSettings) -> None:
        super().__init__(seat)
        self._geoms: dict[int, Geom] = {}
        self.copy: SceneCopy | None = None
        self._begun_anew = ""  # name under which that is counted
        self._told = -1  # number of the newest state that the copy knows

    # The copy

    def receive_shape(self, geom: Geom) -> bool:
        """Take in a shape; the copy is made once all are there, and stays so. False for one that does not fit."""
        counts = {geom.count, *[each.count for each in self._geoms.values()]}
        if not geom.number < geom.count <= MOST_COPIED or len(counts) > 1 or geom.solid is None:
            return False
        known = self._geoms.setdefault(geom.number, geom)
        if known.shape != geom.shape:
            return False
        if self.copy is None and len(self._geoms) == geom.count:
            shapes = [self._geoms[number].shape for number in range(geom.count)]
            try:
                self.copy = SceneCopy(shapes, self._seat.seat, self._tick_s, self.space)
            except CopyError:
                self._geoms.clear()
                return False
        return True

    def start_frame(self) -> int:
        ticks = super().start_frame()
        self.implausible, self._begun_anew = self._begun_anew, ""
        latest = self._receiver.latest
        if self.copy is not None and latest is not None and latest.number != self._told:
            self._told = latest.number
            age_s = 1e-9 * max(0, self._clock_ns - latest.stamp.sent_ns) if self._clock_ns else 0.0
            place, velocity = latest.position_m[:PLACES], latest.velocity_mps[:PLACES]
            self.copy.tell(place, velocity, exp(latest.position_m[PLACES:]), age_s)
        return ticks

    def force(self, position_m: Sequence[float], velocity_mps: Sequence[float]) -> Sequence[float]:
        if self.copy is None or not self.copy.placed:
            return self.still
        return super().force(position_m, velocity_mps)

    def _begin(self, position_m: Sequence[float]) -> None:
        super()._begin(position_m)
        assert self.copy is not None
        self.copy.begin(self._hand(position_m))

    def _hand(self, position_m: Sequence[float]) -> Sequence[float]:
        """Return a place of the hand as the copy has places."""
        return position_m

    def _stretch(self, position_m: Sequence[float]) -> list[float]:
        return super()._stretch(self._hand(position_m))

    def _beginning(self, intent: Intent | None, place_m: Sequence[float] | None) -> Sequence[float]:
        """Return where the model of a partner begins: where that hand means to be, a tool as at rest there."""
        return intent.intention_m if intent is not None else super()._beginning(intent, place_m)

    def _step(self, position_m: Sequence[float], velocity_mps: Sequence[float], K: float, B: float) -> None:
        copy = self.copy
        assert copy is not None
        self._here_s += self._tick_s
        held = {
            seat: model
            for seat, known in self.partners.items()
            if known.intent is not None and (model := self._aged(known)) and known.share > 0.0
        }
        try:
            copy.step(self._hand(position_m), velocity_mps, (K, B), held)
        except CopyError:  # of numbers that no scene has: the hand feels nothing, and begins anew
            self._begin(position_m)
            self._begun_anew = "copy of the scene begun anew"
        self.place_m, self.velocity_mps = copy.place_m, copy.velocity_mps

    def _yield(self, position_m: Sequence[float], stretch: Sequence[float], part: float, ticks: int) -> None:
        """Move the whole copy to where the gate lets one's own tool be: what tools hold in it is not moved against them."""
        assert self.copy is not None
        self.copy.move([(1.0 - part) * each for each in stretch])
        self.place_m = self.copy.place_m

    def go_on_from(self, before: Coupling) -> None:
        super().go_on_from(before)
        assert isinstance(before, PartnerSceneCoupling)
        self.copy, self._geoms = before.copy, before._geoms

    def receive(self, message: Partner) -> bool:
        return message.of_axes(len(self.still), POSE_AXES) and self._receiver.receive(message)
