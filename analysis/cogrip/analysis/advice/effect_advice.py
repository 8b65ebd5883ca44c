"""Advice on haptic effects: what a device renders of those that settings tell (theory 7.8)."""

from math import inf
from typing import NamedTuple

from cogrip.client.effects.effect_force import LAWS
from cogrip.client.effects.laws import ActiveLaw
from cogrip.client.hand.velocity import lag_ticks, largest_impedance
from cogrip.client.safety.rendered_damper import damper_on
from cogrip.devices.device import MOST_SLOPE_NPS, Capability
from cogrip.protocol.axes import PLACES
from cogrip.protocol.settings.effects import Effect
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.sections import Settings


def effect_advice(settings: Settings, seat: SeatSettings, record: Capability) -> tuple[str, bool]:
    """Return a sentence on one person's effects, and whether all of them are rendered as asked; "" where there are none."""
    own = [(place, each) for place, each in enumerate(settings.effects) if not each.users or seat.user in each.users]
    if not own:
        return "", True
    tick_s = seat.rates.tick_s
    carried, lag_s = largest_impedance(record, tick_s).impedance_nspm, lag_ticks(record, tick_s) * tick_s
    stiffest, left = carried / lag_s if lag_s else inf, max(0.0, carried - damper_on(seat, record).value_nspm)
    slope = min(record.slew_nps, MOST_SLOPE_NPS)
    tank_n = 1e-3 * settings.effect_tank_mj / (record.speed_mps * tick_s)
    most = _Most(stiffest, left, slope, tank_n, tick_s)
    said = [f"effects.{place}.{text}" for place, each in own if (text := _too_much(each, most))]
    if said:
        return f"{seat.user}: of haptic effects the device renders less: {'; '.join(said)}", False
    text = (
        f"{len(own)} haptic effects, each rendered as asked: springs to {stiffest:.4g} N/m, dampers to {left:.3g} N s/m"
    )
    return f"{seat.user}: {text}", True


class _Most(NamedTuple):
    """Most that one person's device renders. tank_n: force that a full tank pays for at the device's speed limit."""

    stiffness_npm: float
    damping_nspm: float
    slope_nps: float
    tank_n: float
    tick_s: float


def _too_much(effect: Effect, most: _Most) -> str:
    """Return which value of an effect is more than a device renders, and the most that it does; "" where none is."""
    if effect.stiffness_npm > most.stiffness_npm:
        return f"stiffness_npm = {effect.stiffness_npm:g}, of which at most {most.stiffness_npm:.4g}"
    if effect.damping_nspm > most.damping_nspm:
        return f"damping_nspm = {effect.damping_nspm:g}, of which at most {most.damping_nspm:.3g}, what the coupling leaves"
    law = LAWS[effect.kind](effect, PLACES, most.tick_s)
    if not isinstance(law, ActiveLaw) or not law.most_n:
        return ""
    key = "force_n" if effect.force_n else "amplitude_n"
    asked_n, parts = getattr(effect, key), [(most.tank_n / law.most_n, ", what a full tank pays for")]
    if law.slope_nps:
        parts.append((most.slope_nps / law.slope_nps, ""))
    elif law.stiffness_npm:
        parts.append((most.stiffness_npm / law.stiffness_npm, ""))
    part, why = min(parts)
    return f"{key} = {asked_n:g}, of which at most {part * asked_n:.3g}{why}" if part < 1.0 else ""
