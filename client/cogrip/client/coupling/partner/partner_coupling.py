"""The client's end of the scheme with partners' models (`coupling.kind = "partner"`, theory 5b).

Each client steps its own copy of the object with its own spring and a model of every partner's hand about the intention that
the partner's client estimates. The hand pushes against that copy at once, whatever the delay; what the copy may give it the
gate at its own spring bounds (`spring_gate`). Symbols: x hand, o copy, s = x - o, K, B spring and damper of [coupling]:

    F = K s + B (x' - o')
"""

from collections.abc import Sequence
from math import inf

from msgspec.structs import replace

from cogrip.client.coupling.interface import Coupling, LatestStateCoupling
from cogrip.client.coupling.partner.hand_stiffness import DeviceDrag, HandStiffness
from cogrip.client.coupling.partner.intention import Intention
from cogrip.client.coupling.partner.release import Release
from cogrip.client.coupling.partner.spring_gate import BUDGET_J, SpringGate
from cogrip.client.coupling.partner.trust import Trust
from cogrip.devices.device import Capability
from cogrip.machine.addition import add_products
from cogrip.machine.rows import Row
from cogrip.protocol.laws.partner_model import HORIZON_S, Model, ahead, step_object
from cogrip.protocol.laws.poses import IN_PLACES, Places
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire.clock import MessageClock
from cogrip.protocol.wire.handle import Handle
from cogrip.protocol.wire.messages import Intent, Partner, encode

GROW_S = 0.5  # time in which the stiffness of a hand grows that has just come, here and at its partners
SILENT_S = 0.3  # time without news of a partner after which its model lets go, within as long
MOST_TICKS = 64  # most ticks that the copy makes up for at once, where the loop was late


class Known:
    """One partner as it was told last."""

    def __init__(self, place_m: Sequence[float], frame_s: float, space: Places) -> None:
        self.model = Model(place_m, space)
        self.trust = Trust(frame_s, space)
        self.intent: Intent | None = None
        self.trusted_npm = 0.0  # stiffness that it is told to have, as far as the model is trusted
        self.age_s = 0.0  # of the intention, now
        self.silent_s = 0.0  # since it was new
        self.share = 0.0  # of its stiffness that its model has: it grows in GROW_S
        self.donated_j: float | None = None  # counter that is credited
        self.stirred_m: list[float] | None = None  # where its intention was taken to be, a frame ago


class PartnerCoupling(LatestStateCoupling):
    """One's own copy of the object, models of the partners, and the gate at one's own spring.

    space: of the rows of copy, models and intentions
    """

    def __init__(self, seat: SeatSettings) -> None:
        super().__init__(seat)
        self.space = self._space_of(seat)
        axes, self._tick_s = seat.object.axes, seat.rates.tick_s
        self._spring = seat.coupling.stiffness_npm, seat.coupling.damping_nspm
        self._mass_kg, self._damping_nspm = seat.object.mass_kg, seat.object.damping_nspm
        self._frame_s, self._others = seat.rates.frame_s, max(1, seat.people - 1)
        self._spring_now = self._spring
        self.gate = SpringGate(self._tick_s)
        self._second = True  # every other tick is one of the intention, and the rest of the release: both are slower
        self._fitted: tuple[DeviceDrag, float] | None = None
        self._fit(DeviceDrag(0.0, 0.0, 0.0), 0.0)
        self.partners: dict[int, Known] = {}
        self.place_m: list[float] | None = None  # of the copy; None before there is a hand
        self.velocity_mps = [0.0] * axes
        self._at_m: Sequence[float] = self.still  # of the hand, as its force was asked for last
        self._elapsed = 0  # ticks since the copy was stepped
        self._here_s = 0.0  # since this hand came
        self._hold = 1.0  # factor on the stiffness of a hand that is leaving
        self._stored_j = 0.0
        self._clock_ns = 0  # server's time at the newest message, less what has passed here since
        self._worked_j = self._granted_j = 0.0  # of the gate as this line began, where the hand had one before

    def _space_of(self, seat: SeatSettings) -> Places:
        """Return the space of a seat."""
        return IN_PLACES

    # The ledger

    @property
    def port_j(self) -> float:
        return self.gate.work.value - self._worked_j

    def given_j(self) -> float:
        """Return what the seat's budget, its partners and the refill gave, less what it gave them."""
        return self.gate.granted_j - self._granted_j

    @property
    def refilled_j(self) -> float:
        return self.gate.refilled_j

    @property
    def reserve_j(self) -> float:
        """Return what the hand has put in and was given, less what it took and gave away: b - E_0 (theory 5b)."""
        return self.gate.budget_j - BUDGET_J

    @property
    def stored_j(self) -> float:
        return self.ramp_gain * self._stored_j

    def fit(self, record: Capability, lag_s: float) -> None:
        super().fit(record, lag_s)
        self._fit(DeviceDrag.of(record), record.resolution_m)

    def _fit(self, drag: DeviceDrag, step_m: float) -> None:
        axes = len(self.still)
        self._carried_nspm = -1.0  # for which `_spring_now` is
        if (drag, step_m) == self._fitted:  # of a line before this one: what it knows of the hand stays
            return
        self._fitted = drag, step_m
        self.grip = HandStiffness(axes, self._tick_s, self._frame_s, drag)
        self.intention = Intention(axes, 2.0 * self._tick_s, drag.mass_kg, step_m, self._spring[0])
        self.release = Release(axes, 2.0 * self._tick_s, drag)

    def elapse(self, mean_velocity_mps: Sequence[float], velocity_mps: Sequence[float], hold: float = 1.0) -> None:
        if hold == 1.0:  # of a hand that leaves these velocities are how it moved before: `force` sees how it moves
            power = add_products(self.applied_n, mean_velocity_mps)
            self.gate.work.add(power * self._tick_s)
        self._elapsed += 1
        self._hold = hold

    def elapse_absent(self) -> None:
        """Enter a tick without a hand: its partners are told that it lets go, and the copy begins anew with the next one."""
        self.place_m, self._here_s, self._elapsed = None, 0.0, 0
        self.grip.begin()

    def end_frame(self, spare_j: float = inf) -> int:
        self._number += 1
        self.down_reserve.elapse()
        self.down_reserve.update(reserve_j := self.reserve_j)
        self.down_margin_j = min(self.down_margin_j or 0.0, reserve_j)
        return self.frame_ticks

    def start_frame(self) -> int:
        self._stir()
        self.grip.end_frame()
        own_m = self._own_m()
        for known in self.partners.values():
            known.silent_s += self._frame_s
            known.trust.enter(own_m, known.model.intention_m)
        if self._receiver.pop() and (latest := self._receiver.latest) is not None:
            places = len(self.still)  # the object's; in a scene its rotation is behind them
            self.object_state = latest.position_m[:places] + latest.velocity_mps[:places]
            for intent in latest.intents:
                self._take(intent)
        own, spring = self.grip.stiffness_npm, self._spring[0]
        for known in self.partners.values():
            if known.intent is not None:
                known.model.follow(known.intent.rate_mps if known.silent_s <= HORIZON_S else self.still, self._frame_s)
                known.trusted_npm = known.trust.stiffness_npm(known.intent.stiffness_npm, own, spring)
        return self.frame_ticks

    def _stir(self) -> None:
        """Tell the estimate of the own grip how far the partners have moved their intentions."""
        for known in self.partners.values():
            model, before = known.model, known.stirred_m
            if before is not None and model.stiffness_npm:
                share = 1.0 / (1.0 + self._spring[0] / model.stiffness_npm) if self._spring[0] else 0.0
                for axis, moved in enumerate(self.space.way(before, model.intention_m)):
                    self.grip.stir(axis, share * moved)
            known.stirred_m = list(model.intention_m)

    def _own_m(self) -> Sequence[float]:
        """Return what this hand intends, as its partners are told it."""
        return self.intention.place_m

    def _take(self, intent: Intent) -> None:
        known = self.partners.get(intent.seat)
        if known is None:
            begun_m = self._beginning(intent, self.place_m)
            known = self.partners[intent.seat] = Known(begun_m, self._frame_s, self.space)
        before = known.intent
        if before is not None and before.made_ns >= intent.made_ns > 0:
            return
        known.intent, known.silent_s = intent, 0.0
        known.age_s = self._age_s(intent)
        if known.age_s:
            known.trust.learn(intent.intention_m, known.age_s)
        if known.donated_j is None:
            known.donated_j = intent.donated_j
        else:
            self.gate.credit(max(0.0, intent.donated_j - known.donated_j) / self._others)
            known.donated_j = intent.donated_j  # a later intention with a smaller counter: it counts anew

    def _age_s(self, intent: Intent) -> float:
        """Return how old an intention was as its message came; 0 where no clock tells."""
        return 1e-9 * max(0, self._clock_ns - intent.made_ns) if intent.made_ns and self._clock_ns else 0.0

    # The law

    def force(self, position_m: Sequence[float], velocity_mps: Sequence[float]) -> Sequence[float]:
        if self.place_m is None:
            self._begin(position_m)
        assert self.place_m is not None
        if self._hold < 1.0:
            moved = [x - before for x, before in zip(position_m, self._at_m, strict=True)]
            self.gate.work.add(add_products(self.applied_n, moved))
        self._at_m = position_m
        K, B = self._rendered()
        ticks, self._elapsed = min(MOST_TICKS, max(1, self._elapsed)), 0
        self.grip.enter(position_m, velocity_mps, self.applied_n)
        self._second = not self._second
        if self._second:
            self.release.enter(velocity_mps, self.applied_n)
        else:
            self.intention.update(position_m, velocity_mps, self.applied_n, self.grip.stiffness_npm)
        for _ in range(ticks):
            self._step(position_m, velocity_mps, K, B)
        stretch = self._stretch(position_m)
        part = self.gate.cut(stretch, K)
        if part < 1.0:
            self._yield(position_m, stretch, part, ticks)
            stretch = [part * each for each in stretch]
        damper: Sequence[float] = [B * (rate - own) for rate, own in zip(velocity_mps, self.velocity_mps, strict=True)]
        damper = self.gate.pay(stretch, K, damper, velocity_mps, B)
        self._stored_j = self.gate.stored_j
        force = [K * each + more for each, more in zip(stretch, damper, strict=True)]
        self.local_n = [K * x + B * rate for x, rate in zip(position_m, velocity_mps, strict=True)]
        return force

    def _stretch(self, position_m: Sequence[float]) -> list[float]:
        """Return s."""
        assert self.place_m is not None
        return self.space.way(self.place_m, position_m)

    def _begin(self, position_m: Sequence[float]) -> None:
        """Begin with the object in the hand, at rest, its spring unstretched."""
        self.place_m, self.velocity_mps = list(position_m), [0.0] * len(position_m)
        self.intention.begin(position_m)
        self.release.begin()
        for known in self.partners.values():
            known.model = Model(self._beginning(known.intent, position_m), self.space)
            known.share, known.stirred_m = 0.0, None

    def _beginning(self, intent: Intent | None, place_m: Sequence[float] | None) -> Sequence[float]:
        """Return where the model of a partner begins who intends this: at the copy, if it is anywhere, it pulls at nothing."""
        if place_m is not None:
            return place_m
        assert intent is not None
        return intent.intention_m

    def _rendered(self) -> tuple[float, float]:
        """Return K and B that the device carries."""
        if self.carried_nspm != self._carried_nspm:
            self._carried_nspm = carried = self.carried_nspm
            K, B = self._spring
            self._spring_now = min(K, carried / self._lag_s if self._lag_s else inf), min(B, carried)
            self.reduced = self._spring_now != self._spring
        return self._spring_now

    def _step(self, position_m: Sequence[float], velocity_mps: Sequence[float], K: float, B: float) -> None:
        """Step copy and models by a tick."""
        T, place, velocity = self._tick_s, self.place_m, self.velocity_mps
        assert place is not None
        self._here_s += T
        models = [self._aged(known) for known in self.partners.values() if known.intent is not None]
        own = position_m, velocity_mps
        step_object(T, place, velocity, self._mass_kg, self._damping_nspm, (K, B), models, own)

    def _aged(self, known: Known) -> Model:
        """Return a partner's model for the next tick."""
        intent, model = known.intent, known.model
        assert intent is not None
        known.age_s = model.age_s = known.age_s + self._tick_s
        if known.silent_s > SILENT_S:
            known.share = max(0.0, min(known.share, 2.0 - known.silent_s / SILENT_S))
        elif known.share < 1.0:
            known.share = min(1.0, known.share + self._tick_s / GROW_S)
        model.stiffness_npm = known.trusted_npm * known.share
        model.intention_m = ahead(intent.intention_m, intent.rate_mps, known.age_s, self.space)
        return model

    def _yield(self, position_m: Sequence[float], stretch: Sequence[float], part: float, ticks: int) -> None:
        """Move the copy to where the gate lets it be, and let its speed be no more than that move."""
        place = self.place_m
        assert place is not None
        for axis, x in enumerate(position_m):
            before = place[axis]
            place[axis] = x - part * stretch[axis]
            moved = self.velocity_mps[axis] + (place[axis] - before) / (ticks * self._tick_s)
            kept = self.velocity_mps[axis]
            if moved * kept < 0.0:
                self.velocity_mps[axis] = 0.0
            elif abs(moved) < abs(kept):
                self.velocity_mps[axis] = moved

    # Messages

    def go_on_from(self, before: Coupling) -> None:
        """Begin as the line before ended: what its hand may take is left as it was, and so is where copy and models are."""
        super().go_on_from(before)
        assert isinstance(before, PartnerCoupling)
        self.gate = before.gate
        self._worked_j, self._granted_j = self.gate.work.value, self.gate.granted_j
        self.place_m, self.velocity_mps = before.place_m, before.velocity_mps
        self._fitted, self._second = before._fitted, before._second
        self.intention, self.grip, self.release = before.intention, before.grip, before.release
        self.partners, self._here_s = before.partners, before._here_s
        for known in self.partners.values():  # whatever counters and clock the server has now
            known.donated_j, known.intent = None, known.intent and replace(known.intent, made_ns=0)

    def message(
        self, session: int, clock: MessageClock, now_ns: int, origin_m: Row, position_m: Row, velocity_mps: Sequence[float],
        handle: Handle | None = None,
    ) -> bytes:  # fmt: skip
        offset = clock.offset_ns
        self._clock_ns = now_ns + offset if offset is not None else 0
        intents: tuple[Intent, ...] = ()
        if self.place_m is not None:
            own, stiffness = self.intention, self.grip.stiffness_npm * self._hold * min(1.0, self._here_s / GROW_S)
            stiffness *= self.release.share
            rate = own.rate_mps if self.release.held else self.still
            place, rate = self._as_told(self._own_m()), self._as_told(rate)
            intents = (Intent(self._seat.seat, self._clock_ns, place, rate, stiffness, self.gate.donated_j),)
        return encode(Partner(
            session, self._number, position_m, tuple(velocity_mps), intents, self._receiver.acknowledged, clock.stamp(now_ns),
            handle, port_j=self.reserve_j,
        ))  # fmt: skip

    def _as_told(self, row: Sequence[float]) -> Row:
        """Return a row as messages have it."""
        return tuple(row)

    def receive(self, message: Partner) -> bool:
        if not message.of_axes(len(self.still)):
            return False
        return self._receiver.receive(message)
