"""Effects of one seat: the force of all of them, a tick at a time, and the tank that pays for it (theory 7.8).

Symbols: w rendered fraction of an effect, 0 to 1, the ramp of safety included, w' that of the next tick; U its potential
[J], K its stiffness, P what its force may draw in a tick: the largest force, as it moves now, times v_m T, v_m the device's
speed limit.

    springs   w rises by what the tank pays: w' U - w U; w falls, and the tank gets that. Where U = 0 it costs nothing
    active    w is at most the share of P that is in the tank: it is empty before it is overdrawn
    dampers   fill the tank with what the hand puts into them

Springs are rendered with at most what the device carries, dampers and curl fields with what the coupling leaves of that.
"""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from math import hypot, inf

from cogrip.client.effects.active import Constant, CurlField, Grating, Perturbation, Vibration
from cogrip.client.effects.fields import ViscousField
from cogrip.client.effects.laws import ActiveLaw, Moment, PassiveForce, PassiveLaw
from cogrip.client.effects.springs import ForbiddenZone, GuidingPath, Magnet, Spring
from cogrip.client.effects.tank import EnergyTank
from cogrip.client.rows.delay_line import DelayLine
from cogrip.client.sources.force_source import AtHand, ForceSource
from cogrip.devices.device import MOST_SLOPE_NPS, Capability
from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Floats
from cogrip.protocol.axes import PLACES
from cogrip.protocol.settings.effects import MOST_EFFECTS, Effect, EffectKind, unfit_effect
from cogrip.protocol.wire.accounts import EffectAccount
from cogrip.protocol.wire.messages import Effects

RAMP_S = 0.02  # time in which an effect fades in or out where it is not at rest
MOST_STEP_N = 0.5  # largest change of the force in a tick by an effect that fades in or out

LAWS: Mapping[EffectKind, Callable[[Effect, int, float], PassiveLaw | ActiveLaw]] = {
    "viscous": ViscousField, "vibration": Vibration, "texture": Grating, "magnet": Magnet, "path": GuidingPath,
    "zone": ForbiddenZone, "curl": CurlField, "constant": Constant, "perturbation": Perturbation, "channel": GuidingPath,
    "spring": Spring,
}  # fmt: skip
"""Law of each kind, made of an effect, the places of the seat and the length of a tick [s]."""
_NO_ROWS: tuple[Floats, Floats, Floats] = (), (), ()


class _Entry:
    """One effect. share: w; ended: it goes away and is left out once it is 0."""

    __slots__ = ("active", "begun", "ended", "left_ticks", "passive", "share", "stored_j")

    def __init__(self, effect: Effect, places: int, tick_s: float, tick: int) -> None:
        law = LAWS[effect.kind](effect, places, tick_s)
        self.passive = law if isinstance(law, PassiveLaw) else None
        self.active = law if isinstance(law, ActiveLaw) else None
        self.begun = tick
        self.left_ticks = round(effect.seconds / tick_s) if effect.seconds and not effect.waits else inf
        self.share = self.stored_j = 0.0
        self.ended = False


class EffectForce(ForceSource):
    """Effects of a seat of `axes` axes, the first three of them places; forces are shape (axes,) [N].

    tank    what pays for active effects, and for springs that appear around a hand
    held_j  energy in springs, as far as they are rendered
    """

    def __init__(self, axes: int, tick_s: float, base_nspm: float) -> None:
        """base_nspm: damping that the coupling has of what the device carries."""
        super().__init__(present=False)  # until the first effect is told
        self._axes, self._places, self._tick_s, self._base = axes, min(axes, PLACES), tick_s, base_nspm
        self._entries: dict[int, _Entry] = {}
        self._known: deque[int] = deque(maxlen=8 * MOST_EFFECTS)
        self._step_share = tick_s / RAMP_S
        self._rows: DelayLine[tuple[Floats, Floats, Floats]] = DelayLine()  # in all, active, damper: as asked
        self._held: tuple[Floats, Floats, Floats] = _NO_ROWS
        self._reserved: deque[float] = deque(maxlen=1)  # for active forces that have yet to act, this tick's the last
        self.tank = EnergyTank()
        self.held_j = 0.0
        self._version = 0
        self._told = self._less_ticks = 0
        self._short = False  # whether the tank has not paid for all of this tick

    def leave(self, base_nspm: float) -> None:
        """Leave the coupling so much damping of what the device carries from now on [N s/m]."""
        self._base = base_nspm

    # Told by the server

    def fit(self, record: Capability, own: Capability, free_j: float) -> None:
        self._step_m = record.speed_mps * self._tick_s
        self._slope_nps = min(record.slew_nps, MOST_SLOPE_NPS)
        self._free_j = free_j
        self._rows.set_ticks(record.latency_ticks, _NO_ROWS)
        self._reserved = deque(self._reserved, maxlen=record.latency_ticks + 1)
        if self.tank.capacity_j:
            self.tank.set_capacity(min(self.tank.capacity_j, free_j))

    def tell(self, told: Effects, tick: int) -> str:
        """Take in what the server tells. Returns why it is dropped, "" where it is not."""
        if told.version < self._version:
            return "late effects"
        numbers, number, effect = told.numbers, told.number, told.effect
        self._version = told.version
        self.tank.set_capacity(min(told.tank_mj * 1e-3, self._free_j))
        for known, entry in self._entries.items():
            entry.ended = entry.ended or known not in numbers
        if effect is None or number in self._known or number not in numbers:
            return ""
        self._known.append(number)
        if unfit_effect(effect, self._axes) or len(self._entries) >= 2 * MOST_EFFECTS:
            return "unfit effect"
        self._entries[number] = _Entry(effect, self._places, self._tick_s, tick)
        self.present = True
        self._told += 1
        return ""

    def known(self, numbers: Sequence[int]) -> tuple[int, ...]:
        """Return which of these effects have come, those that were refused included."""
        return tuple([number for number in numbers if number in self._known])

    def forget(self) -> None:
        """End all effects: another server tells its own."""
        self._version = 0
        self._known.clear()
        for entry in self._entries.values():
            entry.ended = True
        self._entries = {-place - 1: entry for place, entry in enumerate(self._entries.values())}

    # The ledger

    def enter(self, elapsed: int, part: float, start_m: Floats, end_m: Floats | None) -> Floats:
        rows = self._held
        if rows[0] and part != 1.0:
            rows = tuple([[part * each for each in row] for row in rows])  # type: ignore[assignment]
        acted, active, damper = self._rows.push(rows) if elapsed == 1 else self._rows.push_many(rows, elapsed)[-1]
        if acted and end_m is not None:
            self.tank.worked(_work(active, start_m, end_m))
            self.tank.damped(_work(damper, start_m, end_m))
            self.work_j += _work(acted, start_m, end_m)
        return acted

    # The force

    def force(self, at: AtHand) -> tuple[float, ...] | None:
        self._held, self.asked_n, self.reduced = _NO_ROWS, None, False
        if not self._entries:
            self.held_j = 0.0
            self._reserved.append(0.0)
            return None
        self._leave_out()
        for entry in self._entries.values():
            if at.tick - entry.begun >= entry.left_ticks:
                entry.ended = True
        self._short = False
        frame, gain, carried = at.frame, at.gain, (at.carried_nspm, at.carried_npm)
        position_m, velocity_mps = frame.place(at.position_m), frame.shown(at.velocity_mps)
        per_tool = frame.tool.force_scale / frame.tool.position_scale
        felt = [
            (entry, spring, spring.felt(position_m, velocity_mps))
            for entry in self._entries.values() if (spring := entry.passive) is not None
        ]  # fmt: skip
        present = [
            (entry, law, not entry.ended and law.present(position_m, at.tick - entry.begun))
            for entry in self._entries.values() if (law := entry.active) is not None
        ]  # fmt: skip
        damping = add_floats([each.damping_nspm for _, each, found in felt if found.damper_n])
        damping += add_floats([law.damping_nspm for _, law, here in present if here])
        most_b = min(1.0, max(0.0, carried[0] - self._base) / damping) if damping else 1.0
        self.reduced = most_b < 1.0
        moment = Moment(position_m, velocity_mps, at.tick, self.tank.missing)
        rows = (
            *self._active(moment, present, gain, (most_b, carried[1]), per_tool),
            *self._passive(felt, gain, (most_b, carried[1]), frame.power_ratio),
        )
        self._less_ticks += self.reduced or self._short
        timed, moving, springs, dampers = [frame.hand_force(row) for row in rows]
        active = [t + m for t, m in zip(timed, moving, strict=True)]
        total = tuple([a + s + d for a, s, d in zip(active, springs, dampers, strict=True)])
        self.active_n = timed
        self.local_n = [m + s + d for m, s, d in zip(moving, springs, dampers, strict=True)]
        self._held = total, active, dampers
        self.asked_n = total
        return total

    def stored_j(self, position_m: Floats) -> float:
        return self.held_j

    def begin_anew(self) -> None:
        super().begin_anew()
        self.held_j = 0.0
        for entry in self._entries.values():
            entry.share = entry.stored_j = 0.0
        self._leave_out()

    def _leave_out(self) -> None:
        for number in [number for number, entry in self._entries.items() if entry.ended and not entry.share]:
            del self._entries[number]

    def _active(
        self, at: Moment, present: Sequence[tuple[_Entry, ActiveLaw, bool]], gain: float, most: tuple[float, float],
        per_tool: float,
    ) -> tuple[list[float], list[float]]:  # fmt: skip
        """Return the forces of the active effects, of those that follow time or place and of those that follow the motion.

        All within what the tank holds. most: share of dampers, and stiffness [N/m], that the device carries; per_tool: force
        at the hand by the tool's.
        """
        timed, moving, most_j, acting = [0.0] * self._axes, [0.0] * self._axes, 0.0, []
        slope_nps = per_tool * add_floats([law.slope_nps for _, law, here in present if here])
        texture_npm = add_floats([law.stiffness_npm for _, law, here in present if here])
        for entry, law, here in present:
            goal = gain if here else 0.0
            if law.slope_nps and slope_nps > self._slope_nps:
                goal *= self._slope_nps / slope_nps
            elif law.stiffness_npm and texture_npm > most[1]:
                goal *= most[1] / texture_npm
            elif law.damping_nspm:
                goal *= most[0]
            self.reduced = self.reduced or 0.0 < goal < gain
            if entry.share == 0.0 and law.at_zero(at.ticks - entry.begun):
                entry.share = goal
            size_n = per_tool * law.size_n(at.velocity_mps)
            step = min(self._step_share, MOST_STEP_N / size_n) if size_n else self._step_share
            entry.share = min(_towards(entry.share, goal, step), gain)
            if entry.share:
                most_j += entry.share * size_n * self._step_m
                acting.append((entry, law))
        if len(self._reserved) == self._reserved.maxlen:
            self._reserved.popleft()  # has acted
        spare_j = self._spare_j()
        if most_j > spare_j:
            part = spare_j / most_j
            for entry, _ in acting:
                entry.share *= part
            most_j *= part
            self._short = True
        self._reserved.append(most_j)
        for entry, law in acting:
            total = moving if law.damping_nspm else timed
            for axis, force in enumerate(law.force(at._replace(ticks=at.ticks - entry.begun))):
                total[axis] += (entry.share / gain) * force
        return timed, moving

    def _spare_j(self) -> float:
        return max(0.0, self.tank.level_j - add_floats(self._reserved))

    def _passive(
        self, found: Sequence[tuple[_Entry, PassiveLaw, PassiveForce]], gain: float, most: tuple[float, float],
        power_ratio: float,
    ) -> tuple[list[float], list[float]]:  # fmt: skip
        """Return the forces of springs and dampers; what springs cost is paid. most: as in `_active`."""
        springs, dampers = [0.0] * self._axes, [0.0] * self._axes
        stiffness = add_floats([law.stiffness_npm for _, law, felt in found if felt.spring_n])
        most_k = min(1.0, most[1] / stiffness) if stiffness else 1.0
        self.reduced = self.reduced or most_k < 1.0
        self.held_j = 0.0
        for entry, _, felt in found:
            goal = 0.0 if entry.ended else gain * most_k
            self._pay(entry, goal, gain, power_ratio * felt.stored_j, felt.spring_n)
            self.held_j += entry.stored_j
            if not entry.share or not gain:
                continue
            part = entry.share / gain
            for axis, force in enumerate(felt.spring_n):
                springs[axis] += part * force
            for axis, force in enumerate(felt.damper_n):
                dampers[axis] += part * most[0] * force
        return springs, dampers

    def _pay(self, entry: _Entry, goal: float, gain: float, potential_j: float, spring_n: Floats) -> None:
        """Let w of a spring go towards its goal, as far as the tank pays for it."""
        before = entry.share
        if potential_j == 0.0 and not spring_n:
            share = goal if goal > before else _towards(before, goal, self._step_share)
        else:
            size = hypot(*spring_n) if spring_n else 0.0
            step = min(self._step_share, MOST_STEP_N / size) if size else self._step_share
            share = _towards(before, goal, step)
            if share > before and potential_j and share > (paid := before + self._spare_j() / potential_j):
                share, self._short = paid, True
        entry.share = share = min(share, gain)
        if share > before:
            self.tank.pay((share - before) * potential_j)
        elif share < before:
            self.tank.fill((before - share) * potential_j)
        entry.stored_j = share * potential_j

    def account(self) -> EffectAccount | None:
        """Return the account; None where no effect was ever told."""
        tank = self.tank
        if not self._told:
            return None
        return EffectAccount(tank.least_j - tank.overdrawn_j, tank.drawn_j, self._less_ticks * self._tick_s)


def _towards(value: float, goal: float, step: float) -> float:
    return min(goal, value + step) if goal > value else max(goal, value - step)


def _work(force_n: Floats, start_m: Sequence[float], end_m: Sequence[float]) -> float:
    return add_floats([force * (end - start) for force, start, end in zip(force_n, start_m, end_m, strict=True)])
